"""Block pressed on a plane by a load, dragged by a Dirichlet condition on its other side."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic_form, plane

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def test_limit_of_friction():
    """T = μ N after each step, although the motion first strains the block by 1000 N."""
    msh = box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    top = np.sort(plane(msh, 1, 1.0))
    ds = ufl.Measure("ds", msh, subdomain_data=mesh.meshtags(msh, 1, top, np.ones_like(top)))(1)
    F = elastic_form(u, v, 1e5, 0.0) + fem.Constant(msh, 100.0) * v[1] * ds
    moved = fem.Constant(msh, 0.0)
    bc = fem.dirichletbc(moved, fem.locate_dofs_topological(V.sub(0), 1, top), V.sub(0))
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    bottom = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(bottom, floor, friction=qs.Coulomb(0.2), sliding="finite")
    problem = qs.ContactProblem([F], [u], [contact], [[bc]])
    for drag in (0.0, 0.05, 0.15):
        moved.value = drag
        problem.solve()
    np.testing.assert_allclose(np.abs(contact.force("slave")), [20.0, 100.0], rtol=1e-4)


@pytest.mark.parametrize("sliding, update", (("finite", True), ("finite", False), ("small", True)))
def test_floor_that_is_moved_by_hand(sliding, update):
    """A floor that slides under a block has friction, with or without a contact update after it."""
    msh = box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    bc = clamp(V, plane(msh, 1, 1.0), [0.0, -0.01])
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    bottom = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(bottom, floor, friction=qs.Coulomb(0.2), sliding=sliding)
    problem = qs.ContactProblem([elastic_form(u, v, 1e3, 0.0)], [u], [contact], [[bc]])
    problem.solve()
    for _ in range(3):
        floor.advance()
        if update:
            contact.update()
        floor.displacement = [0.1, 0.0]
        problem.solve()
    np.testing.assert_allclose(contact.force("slave"), [2.0, 10.0], rtol=1e-6)
    assert np.isclose(contact.step_dissipation(), 2.0 * 0.1, rtol=1e-6)
