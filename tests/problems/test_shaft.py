"""The shaft demo: torque, balances, and its parameters."""

import functools

import numpy as np
import pytest
from scenes import WORLD
from shaft import Parameters, run
from shaft_bodies import lame_pressure, slip_angle

KEYS = ("moment_error", "force_error", "work_error", "torque", "steps", "snes_iterations")


@functools.cache
def turn(**options):
    """Result and rows."""
    return run(Parameters(**options), WORLD)[:2]


@pytest.mark.parametrize("cell", ("quadrilateral", "triangle"))
@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
def test_friction(formulation, cell):
    """The torque is μ times normal forces times radius at every angle; reactions balance."""
    result, rows = turn(mu=0.2, steps=3, formulation=formulation, cell=cell)
    assert tuple(result) == KEYS and result["steps"] == 3
    assert result["moment_error"] < 1e-7 and result["force_error"] < 1e-9
    for row in rows[-4:]:
        assert np.isclose(row.torque, 0.2 * row.normal * row.radius, rtol=2e-3)
        assert np.isclose(row.torque, result["torque"], rtol=1e-4)
    assert max(row.iterations for row in rows[-3:]) < 25


@pytest.mark.long
def test_steps():
    """The torque does not depend on the number of steps.

    The error of the work falls with the square of the number.
    """
    few, many = (turn(mu=0.2, steps=steps)[0] for steps in (9, 18))
    assert np.isclose(few["torque"], many["torque"], rtol=1e-4)
    assert few["work_error"] < 6e-3 and 3.5 < few["work_error"] / many["work_error"] < 4.5


def test_direction():
    """With the opposite rotation the torque is the opposite."""
    torques = [turn(mu=0.2, steps=3, turn=turned)[0]["torque"] for turned in (90.0, -90.0)]
    assert torques[0] > 0 and np.isclose(*np.abs(torques), rtol=1e-4) and torques[1] < 0


def test_no_friction():
    """Without friction there is no torque, and the energy stays.

    Polygons rotate in each other as circles do.
    """
    result, rows = turn(steps=3)
    assert tuple(result) == KEYS and len(rows) == 4
    assert result["moment_error"] < 1e-7 and result["force_error"] < 1e-9
    assert abs(result["torque"]) < 1e-4 * rows[-1].normal
    assert result["work_error"] < 1e-3 and rows[-1].dissipated == 0
    assert np.isclose(rows[-1].elastic, rows[0].elastic, rtol=1e-4)


def test_one_large_step():
    """A quarter of a turn in one step gives the same torque."""
    result, rows = turn(mu=0.2, steps=1)
    assert np.isclose(result["torque"], turn(mu=0.2, steps=3)[0]["torque"], rtol=1e-4)
    assert rows[-1].iterations < 25


def test_closed_forms():
    """Pressure and stiffness are those of small strains, for small interference and finer cells."""
    p = Parameters(mu=0.2, steps=1, facets=96, interference=4e-3, turn=1.0)
    rows = run(p, WORLD)[1]
    pressure = rows[0].normal / (2 * np.pi * rows[0].radius)
    assert np.isclose(pressure, lame_pressure(p.interference), rtol=2e-3)
    stuck = rows[1].torque / np.radians(rows[1].angle)
    torque = 2 * np.pi * p.mu * lame_pressure(p.interference)
    assert np.isclose(stuck, torque / slip_angle(p.mu, p.interference), rtol=0.01)


def test_refused():
    with pytest.raises(ValueError, match="--turn: must be more than the 3"):
        Parameters(mu=0.2, turn=2.0)
    with pytest.raises(ValueError, match="--steps: must be at least one for each 90°"):
        Parameters(turn=-200.0, steps=2)
    with pytest.raises(ValueError, match="--mu"):
        Parameters(mu=-0.1)
