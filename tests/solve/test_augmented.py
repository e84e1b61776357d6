"""Augmented Lagrangian: closed gaps at any penalty, multipliers that are kept."""

import numpy as np
import pytest
from scenes import CELLS, FORMULATIONS, WORLD, Pair, drag_top, largest, raises_everywhere

import qsdolfinx as qs

OPTIONS = {"enforcement": "augmented-lagrangian", "quadrature": "overlay"}
GIVEN = {"contact_options": OPTIONS}


def scene(cell="quadrilateral", penalty=30.0, law=None, **options):
    pair = Pair(cell, law=law, penalty=penalty, n=(5, 4), contact_options=OPTIONS | options)
    return pair, pair.problem()


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_default(formulation):
    """Wherever there is one; multipliers on both sides have none."""
    pair = Pair("triangle", formulation)
    assert pair.contact.quadrature == "overlay"
    both = formulation == "double-pass"
    assert pair.contact.enforcement == ("penalty" if both else "augmented-lagrangian")
    assert pair.contact.augmented != both
    if both:
        raises_everywhere(
            WORLD, ValueError, "cannot close", lambda: Pair("triangle", formulation, **GIVEN)
        )


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("solver", ("direct", "amg"))
def test_small_loads(law, solver):
    """Blocks that touch are as stiff under any load: gaps that stay become small as well."""
    loads, stiffness = np.array([-1e-2, -1e-5, -1e-8]), []
    for load in loads:
        pair = Pair("hexahedron", law=law(), n=(5, 4), penalty="auto", load=load)
        pair.problem(solver=solver).solve()
        stiffness.append(pair.contact.force("slave")[2] / load)
    rounding = 1e-14 / abs(loads)  # gaps of 1e-14 of the coordinates count as closed
    assert np.all(abs(np.array(stiffness) / stiffness[0] - 1) < 1e-6 + 3 * rounding)


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("cell", CELLS)
def test_gap_is_closed_at_any_penalty(cell, law):
    forces, gaps = [], []
    for penalty in (20.0, 200.0):
        pair, problem = scene(cell, penalty, law())
        problem.solve()
        forces.append(pair.contact.force("slave"))
        gap, active = pair.contact.weighted_gap(), pair.contact.active()
        gaps.append(largest(gap[active] if law is qs.Unilateral else gap))
        assert len(problem.violation_history) == problem.num_augmentations + 1
        assert problem.violation_history[-1] <= pair.contact.allowed_gap
    allowed = pair.contact.allowed_gap
    assert max(gaps) <= 3 * allowed
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("law", (qs.Unilateral, qs.Tied))
@pytest.mark.parametrize("n", ((2, 6), (5, 4)))
def test_any_penalty_will_do(n, law):
    """However soft: it is raised where many updates would be needed, and comes back by a reset."""
    given = {"wave": 0.03, "n": n}
    forces = []
    for penalty in (1e3, 10.0, 0.05):
        pair = Pair("hexahedron", law=law(), penalty=penalty, **given)
        drag_top(pair, 0.01)
        problem = pair.problem()
        problem.solve()
        assert problem.num_augmentations <= 60
        forces.append(pair.contact.force("slave"))
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(forces[2], forces[0], rtol=1e-4, atol=1e-7)
    assert pair.contact.penalty > 5 * penalty
    assert pair.contact.report().penalty_source == "given, raised to close gaps sooner"
    pair.contact.reset()
    assert pair.contact.penalty == penalty


def test_multipliers_are_kept():
    """For the next solve and when contact pairs anew, but not after a reset."""
    pair, problem = scene()
    counts = []
    for step in ("first", "again", "paired anew", "reset"):
        if step == "paired anew":
            pair.contact.update()
        if step == "reset":
            pair.contact.reset()
            for u in pair.u:
                u.x.array[:] = 0
        problem.solve()
        counts.append(problem.num_augmentations)
    assert counts[0] >= 1 and counts[1] == counts[2] == 0
    assert counts[3] == counts[0]


def test_failure_keeps_the_multipliers():
    pair, problem = scene()
    problem.solve()
    kept = pair.contact.multiplier()
    pair.bcs[1][0].g.value[1] = -0.3
    problem.snes.setTolerances(max_it=0)
    raises_everywhere(WORLD, qs.ConvergenceError, "did not converge", problem.solve)
    after = pair.contact.multiplier()
    np.testing.assert_allclose(after, kept, rtol=1e-6, atol=1e-9)


def test_a_gap_that_cannot_be_closed_is_told():
    """Below what rounding leaves of it."""
    _, problem = scene(gap_tolerance=1e-30)
    error = raises_everywhere(WORLD, qs.ConvergenceError, "GAP_NOT_CLOSED", problem.solve)
    assert error.reason_name == "GAP_NOT_CLOSED" and len(error.violation_history) > 100


@pytest.mark.parametrize("solver", ("direct", "amg"))
def test_loose_newton(solver):
    """What an update of the multipliers adds is solved for, be it below Newton's tolerance."""
    pair, _ = scene("hexahedron")
    problem = pair.problem(solver=solver, petsc_options={"snes_rtol": 1e-4})
    problem.solve()
    updates, gap = problem.num_augmentations, problem.violation_history[-1]
    assert gap <= pair.contact.allowed_gap
    assert updates < 15
