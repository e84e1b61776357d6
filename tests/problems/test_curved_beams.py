"""The demo of curved beams: symmetries, meshes, energy, friction, and its parameters."""

import dataclasses
import functools

import numpy as np
import pytest
from curved_beams import Parameters, push
from curved_beams_output import (
    energy_error,
    force_change,
    forces,
    kink,
    largest_force,
    summary,
    symmetry_error,
)
from scenes import WORLD

KEYS = (
    "force_x_max",
    "force_y_max",
    "force_change",
    "kink",
    "symmetry_error",
    "energy_error",
    "max_penetration",
    "facet_size",
    "snes_iterations",
)
SMALL = Parameters(cells=3, steps=48)


def pushed(friction=0.0, **options):
    """Call :func:`run`."""
    return run(friction=friction, **options)


@functools.cache
def run(**options):
    """Rows of one mesh, and the elastic energies of both beams."""
    energies = []
    rows = push(
        dataclasses.replace(SMALL, **options),
        WORLD,
        lambda row, scene: energies.append([beam.energy() for beam in scene[:2]]),
    )
    return rows, np.array(energies)


def test_past_each_other():
    """The beams touch within the stroke only, balance, and return all the work."""
    rows, _ = pushed()
    touching = np.array([row.touching for row in rows]) > 0
    assert not touching[[0, 1, -2, -1]].any() and touching[4:-4].all()
    force = largest_force(rows)
    assert np.abs(forces(rows)[:, ~touching]).max() < 1e-9 * force
    assert max(row.net_force for row in rows) < 1e-9 * force
    assert max(row.penetration for row in rows) < 0.1 * rows[0].facet_size
    assert energy_error(rows) < 5e-3
    assert sum(row.cutbacks for row in rows) == 0


def test_mirror_image():
    """Results before the middle are the mirror image of the results after it."""
    rows, energies = pushed()
    assert symmetry_error(rows) < 1e-6
    np.testing.assert_allclose(energies, energies[::-1], atol=1e-6 * energies.max())
    middle = rows[len(rows) // 2]
    assert middle.shift == 0 and abs(middle.fx) < 1e-6 * abs(middle.fy)


@pytest.mark.parametrize("friction", (0.0, pytest.param(0.3, marks=pytest.mark.long)))
def test_point_reflection(friction):
    """Each beam is the point reflection of the other, also with friction."""
    _, energies = pushed(friction=friction)
    np.testing.assert_allclose(*energies.T, atol=5e-3 * energies.max())


@pytest.mark.long
def test_meshes():
    """A finer mesh has nearly the same curves, and smaller kinks."""
    (rows, _), (finer, _) = pushed(), pushed(cells=6)
    assert force_change(rows, finer) < 0.04
    assert kink(finer) < kink(rows) < 2e-3


@pytest.mark.long
def test_friction():
    """Friction dissipates energy at any time, and all the work at the end."""
    (rows, _), (smooth, _) = pushed(friction=0.3), pushed()
    taken = np.array([row.dissipated for row in rows])
    assert np.all(np.diff(taken) > -1e-9 * taken[-1]) and taken[-1] > smooth[len(rows) // 2].elastic
    assert energy_error(rows) < 1e-2
    assert rows[-1].elastic < 1e-9 * taken[-1]
    assert forces(rows)[0].max() > 1.5 * forces(smooth)[0].max()


def test_results():
    rows, _ = pushed()
    result = summary(rows, rows)
    assert tuple(result) == KEYS and result["force_change"] == 0
    assert result["force_y_max"] == largest_force(rows) > result["force_x_max"]
    assert result["snes_iterations"] == 2 * sum(row.iterations for row in rows)


def test_refused():
    with pytest.raises(ValueError, match="--friction"):
        Parameters(friction=-0.1)
    for steps in (6, 11):
        with pytest.raises(ValueError, match="--steps: must be even, and at least 8"):
            Parameters(steps=steps)
    with pytest.raises(ValueError, match="--overlap"):
        Parameters(overlap=4.0)
    with pytest.raises(ValueError, match="--penalty"):
        Parameters(penalty=0.0)
