"""Which contacts follow their bodies without being told."""

import numpy as np
import pytest
from following import Boxes
from scenes import WORLD, Pair, box, elastic, largest, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs


def boxes(n=((4, 2), (3, 2)), cell="quadrilateral", **options):
    """A neo-Hookean block on another one, whose upper end goes down and along by a facet."""
    case = Boxes(cell, n, ((1.2, 0.5), (1.0, 0.5)), start=0.1)
    case.lower.clamp(plane(case.lower.mesh, 1, -0.5))
    case.upper.clamp(plane(case.upper.mesh, 1, 0.5), [0.3, -0.02])
    contact = qs.Contact(case.above, case.below, **options)
    return case, contact, case.problem(contact)


def test_nonlinear_bodies():
    """As with what is asked for by name; what is asked for stays."""
    found = {}
    for sliding in (None, "finite", "small"):
        case, contact, problem = boxes(sliding=sliding)
        assert contact.sliding == (sliding or "finite")
        problem.solve()
        found[sliding] = case.upper.u.x.array.copy()
    assert largest(found[None] - found["finite"]) < 1e-12
    assert largest(found[None] - found["small"]) > 1e-4


def test_linear_bodies():
    """Small in a solve, finite in time steps; what is asked for, or has been solved, stays."""
    pair = Pair("triangle")
    problem = pair.problem()
    assert pair.contact.sliding == "small"
    qs.TimeStepper(problem, 1.0)
    assert pair.contact.sliding == "finite"
    for asked, solved in (("small", False), (None, True)):
        pair = Pair("triangle", contact_options={"sliding": asked})
        problem = pair.problem()
        if solved:
            problem.solve()
        qs.TimeStepper(problem, 1.0)
        assert pair.contact.sliding == "small"


def test_one_of_many():
    """Contacts are finite between the bodies that are nonlinear, or a tool and one of these."""
    V, u, F, contacts, bcs = [], [], [], [], []
    for i in range(2):
        msh = box(WORLD, (3, 3), "triangle", [2.0 * i, 0.0], [2.0 * i + 1, 1.0])
        V.append(vector_space(msh))
        u.append(fem.Function(V[-1]))
        tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        contacts.append(qs.Contact(qs.Surface(V[-1], facets=plane(msh, 1, 1.0)), tool))
        bcs.append([])
    stress = qs.materials.neo_hookean(u[1], 1.0, 1.0)
    F = [elastic(u[0]), ufl.inner(stress, ufl.grad(ufl.TestFunction(V[1]))) * ufl.dx]
    assert [contact.sliding for contact in contacts] == ["small", "small"]
    qs.ContactProblem(F, u, contacts, bcs)
    assert [contact.sliding for contact in contacts] == ["small", "finite"]


def test_refused_problems_change_nothing():
    """What is wrong with a solver's options leaves the contact as it was made."""
    case, contact, _ = boxes(sliding="small")
    contact = qs.Contact(case.above, case.below)
    with pytest.raises(ValueError, match="snes_type"):
        case.problem(contact, petsc_options={"snes_type": "ngmres"})
    assert contact.sliding == "small"


STAY = {
    "nodal": {"quadrature": "nodal"},
    "nodes": {"constraints": "nodes"},
    "bisector": {"normals": "bisector"},
    "smoothing": {"smoothing": "shared-curvature"},
    "double-pass": {"formulation": "double-pass"},
    "velocity": {"unknown": "velocity", "dt": 1.0},
}


@pytest.mark.parametrize("options", STAY.values(), ids=STAY)
def test_small_where_it_cannot_follow(options):
    assert boxes(**options)[1].sliding == "small"


@pytest.mark.parametrize("walls", (False, True))
def test_creases_in_3d(walls):
    """Edges are in contact with small sliding alone."""
    msh = box(WORLD, (3, 3, 3), "hexahedron", [0.0] * 3, [1.0] * 3)
    V = vector_space(msh)
    u = fem.Function(V)
    stress = qs.materials.neo_hookean(u, 1.0, 1.0)
    sides = [plane(msh, 0, 1.0)] if walls else []
    surface = qs.Surface(V, facets=np.concatenate([plane(msh, 2, 0.0), *sides]))
    x = np.array([[-1.0, -1.0, 0.0], [2.0, -1.0, 0.0], [2.0, 2.0, 0.0], [-1.0, 2.0, 0.0]])
    tool = qs.RigidSurface.triangulated(WORLD, x, np.array([[0, 1, 2], [0, 2, 3]]))
    contact = qs.Contact(surface, tool)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
    qs.ContactProblem([F], [u], [contact], [[]])
    assert contact.sliding == ("small" if walls else "finite")


def test_what_has_been_solved_for():
    """Goes on as it was, in a problem with other forms."""
    pair = Pair("triangle")
    pair.problem().solve()
    stress = qs.materials.neo_hookean(pair.u[0], 1.0, 1.0)
    form = ufl.inner(stress, ufl.grad(ufl.TestFunction(pair.V[0]))) * ufl.dx
    problem = qs.ContactProblem([form, pair.F[1]], pair.u, [pair.contact], pair.bcs)
    assert pair.contact.sliding == "small"
    problem.solve()
