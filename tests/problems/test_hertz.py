"""Hertz contact against the closed form, and the demo's own results."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
from common.command import FORMULATIONS
from hertz import Parameters, run
from scenes import WORLD

SIDES = ("slave", "master")


def hertz(comm=WORLD, **parameters):
    return run(dataclasses.replace(Parameters(), **parameters), comm)[0]


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("ratio", (3.0, 1.0, 1 / 3, 0.7))
def test_cylinder_on_block(ratio, enforcement):
    result = hertz(h=0.05, ratio=ratio, enforcement=enforcement)
    for side in SIDES:
        assert abs(result[f"peak_error_{side}"]) <= 0.03
        assert result[f"l2_error_{side}"] <= 0.06
    assert abs(result["radius_error"]) < 0.05 * max(1, ratio)
    assert result["force_error"] < 1e-10
    assert result["snes_iterations"] <= 10


def test_cylinders_at_nodes():
    """The default constraints at nodes are accurate, in a few iterations."""
    result = hertz(case="cylinders", h=0.025)
    for side in SIDES:
        assert result[f"l2_error_{side}"] <= 0.01
        assert abs(result[f"peak_error_{side}"]) <= 0.005
    assert result["snes_iterations"] <= 10


def test_cylinders():
    """Constraints at points are as good as the best mortar codes on these meshes.

    A few iterations are enough.
    """
    errors = []
    for h in (0.0225, 0.025, 0.0275):
        result = hertz(case="cylinders", h=h, penalty=5 * 200.0 / h, constraints="points")
        errors.append([result[f"l2_error_{side}"] for side in SIDES])
        assert max(abs(result[f"peak_error_{side}"]) for side in SIDES) <= 0.005
        assert result["snes_iterations"] <= 10
    assert np.max(errors) <= 0.008 and np.max(np.mean(errors, axis=0)) <= 0.006


def test_swap_of_cylinders():
    """Constraints at points give the same results with slave and master swapped."""
    one, other = (
        hertz(case="cylinders", h=0.05, swap=swap, constraints="points") for swap in (False, True)
    )
    for a, b in (SIDES, SIDES[::-1]):
        assert np.isclose(one[f"l2_error_{a}"], other[f"l2_error_{b}"], rtol=1e-9)


def test_convergence():
    h = (0.2, 0.1, 0.05, 0.025)
    results = [hertz(h=size) for size in h]
    for side in SIDES:
        error = [result[f"l2_error_{side}"] for result in results]
        assert np.polyfit(np.log(h), np.log(error), 1)[0] >= 0.8
        assert error[-1] < 0.02


def test_swap():
    """Results do not depend on which body is the slave."""
    one, other = (hertz(h=0.05, ratio=1.5, swap=swap) for swap in (None, True))
    for a, b in (SIDES, SIDES[::-1]):
        assert abs(one[f"peak_error_{a}"] - other[f"peak_error_{b}"]) < 0.01


def test_sphere():
    """On one coarse mesh in 3D the peak is right to 4 %, the radius to one facet."""
    result = hertz(dim=3, h=0.15)
    for side in SIDES:
        assert abs(result[f"peak_error_{side}"]) <= 0.04
    assert abs(result["radius_error"]) * 0.8173 < 0.15


def test_ranks_do_not_matter():
    """Results on gmsh meshes do not depend on the partition."""
    result, expected = hertz(h=0.1, ratio=2.0), hertz(MPI.COMM_SELF, h=0.1, ratio=2.0)
    for side in SIDES:
        for name in ("peak", "l2"):
            key = f"{name}_error_{side}"
            assert np.isclose(result[key], expected[key], rtol=1e-7, atol=1e-10)
    assert result["dofs"] == expected["dofs"]


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_formulations(formulation):
    """With a moderate penalty all formulations give Hertz's pressure on both sides."""
    result = hertz(h=0.05, formulation=formulation, penalty=3 * 200.0 / 0.05)
    for side in SIDES:
        assert abs(result[f"peak_error_{side}"]) <= 0.03
        assert result[f"l2_error_{side}"] <= 0.05
