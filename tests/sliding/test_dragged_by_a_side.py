"""A block that a load presses on a plane, dragged by a Dirichlet condition on its other side."""

import numpy as np
from scenes import WORLD, box, elastic_form, plane

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def test_limit_of_friction():
    """T = μ N after each step, though the way of the step strains the block by 1000 N at first."""
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
