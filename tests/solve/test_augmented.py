"""Augmented Lagrangian: gaps are closed at any penalty, and multipliers are kept between solves."""

import numpy as np
import pytest
from scenes import (
    CELLS,
    FORMULATIONS,
    WORLD,
    Pair,
    box,
    clamp,
    drag_top,
    elastic,
    largest,
    plane,
    raises_everywhere,
    slide,
    vector_space,
)

from dolfinx import fem

import qsdolfinx as qs

OPTIONS = {"enforcement": "augmented-lagrangian", "quadrature": "overlay"}
GIVEN = {"contact_options": OPTIONS}


def scene(cell="quadrilateral", penalty=30.0, law=None, solver="direct", **options):
    pair = Pair(cell, law=law, penalty=penalty, n=(5, 4), contact_options=OPTIONS | options)
    return pair, pair.problem(solver=solver)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_default(formulation):
    """Augmented Lagrangian is the default, except for multipliers on both sides (double-pass)."""
    pair = Pair("triangle", formulation)
    assert pair.contact.settings.quadrature == "overlay"
    both = formulation == "double-pass"
    assert pair.contact.settings.enforcement == ("penalty" if both else "augmented-lagrangian")
    assert pair.contact.model.augmented != both
    if both:
        raises_everywhere(
            WORLD, ValueError, "cannot close", lambda: Pair("triangle", formulation, **GIVEN)
        )


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("solver", ("direct", "amg"))
def test_small_loads(law, solver):
    """Touching blocks are equally stiff under any load: the remaining gaps become small as well."""
    loads, stiffness = np.array([-1e-2, -1e-5, -1e-8]), []
    for load in loads:
        pair = Pair("hexahedron", law=law(), n=(5, 4), penalty="auto", load=load)
        pair.problem(solver=solver).solve()
        stiffness.append(pair.contact.force("slave")[2] / load)
    rounding = 1e-14 / abs(loads)  # gaps of 1e-14 of the coordinates count as closed
    assert np.all(abs(np.array(stiffness) / stiffness[0] - 1) < 1e-6 + 3 * rounding)


def quarter_on_plate(ratio, swap=False, solver="direct", **options):
    """A tied quarter of a block with symmetry conditions, pressed on a stiffer plate.

    Returns:
        The contact and the solved problem.
    """
    F, u, bcs, surfaces = [], [], [], []
    boxes = ((6, [0.0] * 3, [1.0] * 3, 1.0, ratio), (4, [0.1, 0.1, 1.0], [0.87, 0.87, 2.0], 2.0, 1))
    for n, low, high, end, E in boxes:
        V = vector_space(box(WORLD, (n, n, n), "tetrahedron", low, high, "scattered"))
        u.append(fem.Function(V))
        F.append(elastic(u[-1], E=E))
        bottom, top = clamp(V, plane(V.mesh, 2, 0.0)), slide(V, 2, plane(V.mesh, 2, 2.0), -0.04)
        bcs.append([bottom if end == 1 else top])
        if end == 2:
            bcs[-1] += [slide(V, axis, plane(V.mesh, axis, 0.1)) for axis in (0, 1)]
        surfaces.append(qs.Surface(V, facets=plane(V.mesh, 2, 1.0)))
    master, slave = surfaces[::-1] if swap else surfaces
    contact = qs.Contact(slave, master, law=qs.Tied(), **options)
    problem = qs.ContactProblem(F, u, [contact], bcs, linear_solver=solver)
    problem.solve()
    return contact, problem


@pytest.mark.parametrize("solver", ("direct", "amg"))
@pytest.mark.parametrize("swap", (False, True))
@pytest.mark.parametrize("ratio", (1e3, 1e6))
def test_ties_of_held_nodes_to_a_stiff_body(ratio, swap, solver):
    """Forces are correct where conditions hold tied nodes.

    Only the stiff body deforms there, under large forces.
    """
    exact = quarter_on_plate(1e3, swap, gap_tolerance=1e-12)[0].force("slave")
    contact, _ = quarter_on_plate(ratio, swap, solver=solver)
    assert abs(exact[0]) > 0.01 * abs(exact[2])
    np.testing.assert_allclose(contact.force("slave"), exact, rtol=5e-3)  # stiffness ratios alone
    exact = quarter_on_plate(ratio, swap, gap_tolerance=1e-13)[0].force("slave")
    np.testing.assert_allclose(contact.force("slave"), exact, rtol=1e-4)


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
@pytest.mark.parametrize("cell", CELLS)
def test_gap_is_closed_at_any_penalty(cell, law):
    """Neither gaps nor the force depend on the penalty, even if it is soft."""
    forces, gaps = [], []
    for penalty in (200.0, 0.05):
        pair, problem = scene(cell, penalty, law())
        drag_top(pair, 0.01)
        problem = pair.problem()
        problem.solve()
        forces.append(pair.contact.force("slave"))
        gap, active = pair.contact.weighted_gap(), pair.contact.active()
        gaps.append(largest(gap[active] if law is qs.Unilateral else gap))
        (gap,) = problem.violation_history
        assert gap <= pair.contact.settings.allowed_gap
    allowed = pair.contact.settings.allowed_gap
    assert max(gaps) <= 3 * allowed
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-6, atol=1e-9)


def test_multipliers_are_kept():
    """Multipliers are kept for the next solve and by an update of the pairs, not after a reset."""
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
        counts.append(problem.num_iterations)
    assert counts[0] >= 1 and counts[1] == counts[2] == 0
    assert counts[3] == counts[0]


def test_a_gap_that_cannot_be_closed_is_told():
    """A gap tolerance below the rounding of the gaps raises an error with GAP_NOT_CLOSED."""
    _, problem = scene(gap_tolerance=1e-30, solver="amg")
    error = raises_everywhere(WORLD, qs.ConvergenceError, "GAP_NOT_CLOSED", problem.solve)
    assert error.reason_name == "GAP_NOT_CLOSED"


@pytest.mark.parametrize("solver", ("direct", "amg"))
def test_loose_newton(solver):
    """Gaps are closed at any tolerance of Newton's method."""
    pair, _ = scene("hexahedron")
    problem = pair.problem(solver=solver, petsc_options={"snes_rtol": 1e-4})
    problem.solve()
    assert problem.violation_history[-1] <= pair.contact.settings.allowed_gap
