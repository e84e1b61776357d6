"""The rubber demo: balance, rolling, and parameters."""

import functools

import numpy as np
import pytest
from rubber import Parameters, run
from rubber_scenes import DEPTH, DRAG, ROLLER
from scenes import WORLD

KEYS = ("force", "u_x", "max_penetration", "facet_size", "snes_iterations")


@functools.cache
def rolled(**options):
    """Results and rows of one scene."""
    return run(Parameters(**options), WORLD)


def squeezed(comm=WORLD):
    """Run the scene with a coarse ring that is squeezed only."""
    return run(Parameters(facet=0.4, steps=6, distance=0.0), comm)


def test_squeezed_ring():
    """The forces of lid and groove balance, and have no sideways part."""
    result, rows = squeezed()
    assert tuple(result) == KEYS
    force = [row.force for row in rows]
    assert np.all(np.diff(force) > 0)
    assert max(row.net_force for row in rows) < 1e-6 * result["force"]
    assert abs(result["u_x"]) < 1e-2
    assert result["max_penetration"] < 0.1 * result["facet_size"]


@pytest.mark.long
def test_ring_rolls_half_as_far_as_the_lid():
    result, rows = rolled(facet=0.3, steps=24, distance=0.3)
    assert result["u_x"] == pytest.approx(0.15, rel=0.02)
    assert abs(rows[-1].drag) < 0.05 * result["force"]


def test_roller():
    """In a part of a turn the roller travels a little less than on its circumference.

    Forces balance.
    """
    result, rows = rolled(scene="roller", facet=4.0, steps=3, distance=3 / 90)
    way = 2 * np.pi * ROLLER * 3 / 90
    assert -way < result["u_x"] < -0.85 * way
    rolling = [row for row in rows if row.t > 5]
    assert all(row.drag == pytest.approx(DRAG, rel=1e-6) for row in rolling)
    assert result["max_penetration"] < 0.1 * DEPTH


@pytest.mark.parametrize("options, message", [
    ({"facet": 0.0}, "--facet: must be positive and at most 0.5"),
    ({"friction": 0.0}, "--friction: must be positive"),
    ({"distance": -0.1}, "--distance: must be from 0 to 0.63"),
    ({"distance": 1.2, "scene": "roller"}, "--distance: must be from 0 to 1"),
])  # fmt: skip
def test_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Parameters(**options)
