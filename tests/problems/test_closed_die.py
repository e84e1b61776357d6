"""The closed-die demo, coarse and for a part of its stroke: balances, depths, keys, ranks."""

import functools

from mpi4py import MPI

import numpy as np
import pytest
from closed_die import Parameters, run
from closed_die_output import compared, read_curve, write_curve
from closed_die_tools import DIES, FLASH, LAND, billet_size, cavity, height, profile
from scenes import WORLD

pytest.importorskip("gmsh")

KEYS = [
    "steps",
    "remeshings",
    "volume_change",
    "max_penetration",
    "facet_size",
    "filled",
    "force_max",
    "energy_error",
    "die_traction_peak",
    "total_seconds",
]


#: A coarse mesh of some hundred cells, remeshed at each step.
COARSE = Parameters(size=4.5, tool_size=3.0, advance=1.5, every=1, thinning=0.05, stroke=5.0)


@functools.cache
def forged():
    return run(COARSE, WORLD)


@pytest.mark.long
def test_what_it_reports():
    result, scene, die, _ = forged()
    assert list(result) == KEYS
    assert result["steps"] == 4 and result["remeshings"] == 3
    assert abs(result["volume_change"]) < 5e-3
    assert result["max_penetration"] < 0.1 * result["facet_size"]
    assert 0.34 < result["filled"] < 0.5
    assert abs(result["energy_error"]) < 0.05
    # The billet has cooled at the contact, and is nowhere hotter than plastic work makes it.
    low, high = (
        WORLD.allreduce(f(scene.temperature.x.array), op=op)
        for f, op in ((np.min, MPI.MIN), (np.max, MPI.MAX))
    )
    assert 200.0 < low < 1090.0 and 1100.0 < high < 1250.0
    assert np.allclose(die.sent, die.arrived, rtol=1e-9)
    assert die.arrived[2] == pytest.approx(-result["force_max"] / 4, rel=0.1)


@pytest.mark.long
def test_curves(tmp_path):
    """A curve read again is the same; one that is 3 % higher is 3 % apart.

    A file without a curve is refused.
    """
    curve = forged()[-1]
    if WORLD.rank == 0:
        write_curve(tmp_path / "curve.csv", curve)
        again = read_curve(tmp_path / "curve.csv")
        np.testing.assert_allclose(again, curve, rtol=1e-8)
        (line,) = compared(np.array(curve) * [1.0, 1.03], again[:-1])
        assert f"to {curve[-2][0]:.1f} mm: 3.00% apart in the mean, work +3.00%" in line
        with pytest.raises(ValueError, match="no curve"):
            read_curve(__file__)


def test_cavity():
    """The volume of the cavity is that of Pappus' rings of the profile; dies do not touch."""
    total = 0.0
    for die in DIES:
        r, z = profile(die, 400).T
        inside = r <= LAND
        r, depth = r[inside], np.abs(z[inside] - height(die, 0.0))
        total += 2 * np.pi * np.trapezoid(r * depth, r)
    assert cavity() == pytest.approx(total + np.pi * LAND**2 * FLASH, rel=1e-3)
    assert billet_size(10.0, 0.0) * np.pi * 100.0 == pytest.approx(cavity())


@pytest.mark.long
@pytest.mark.several_ranks
def test_ranks():
    """With remeshing, results are the same on one rank."""
    alone = run(COARSE, WORLD.Split(WORLD.rank))[0]
    together = forged()[0]
    for key in KEYS[:-1]:
        assert together[key] == pytest.approx(alone[key], rel=1e-6), key
