"""Two leaves that bend on each other, clamped at one end: contact moves along the shorter leaf."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic_form, plane

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

E, HEIGHT, LENGTH, FORCE = 1000.0, 0.1, 1.0, 1e-3


def leaf(cells, length, low, degree=2):
    """Mesh, space, displacement and clamp at the left end of a leaf."""
    msh = box(WORLD, (cells, 2), "quadrilateral", [0.0, low], [length, low + HEIGHT])
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    return msh, V, fem.Function(V), clamp(V, plane(msh, 0, 0.0))


def tip(cells, constraints):
    """Deflection of the longer leaf's loaded tip over that of beam theory; iterations."""
    long_, short = (
        leaf(cells, 3 * LENGTH, 0.0),
        leaf(round(2.3 * cells / 3), 2 * LENGTH, -HEIGHT),
    )
    F = []
    for msh, V, u, _ in (long_, short):
        F.append(elastic_form(u, ufl.TestFunction(V), E, 0.0))
    msh, V, u, _ = long_
    end = plane(msh, 0, 3 * LENGTH)
    ds = ufl.Measure("ds", msh, subdomain_data=mesh.meshtags(msh, 1, end, np.ones_like(end)))(1)
    load = fem.Constant(msh, (0.0, FORCE / HEIGHT))
    F[0] += ufl.inner(load, ufl.TestFunction(V)) * ds
    below = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], 0.0) & (x[0] <= 2.3 * LENGTH)
    )
    surfaces = qs.Surface(V, facets=below), qs.Surface(short[1], facets=plane(short[0], 1, 0.0))
    contact = qs.Contact(*surfaces, constraints=constraints)
    bcs = [[long_[3]], [short[3]]]
    problem = qs.ContactProblem(F, [long_[2], short[2]], [contact], bcs)
    problem.solve()
    lowered = float(WORLD.allreduce(-u.x.array.min()))
    inertia = HEIGHT**3 / 12
    beams = 118 / 24 * FORCE * LENGTH**3 / (E * inertia)
    return lowered / beams, problem.num_iterations


@pytest.mark.parametrize("cells", (20, pytest.param(80, marks=pytest.mark.long)))
def test_two_leaves(cells):
    """Leaves bend like beams that touch at the shorter leaf's tip.

    The number of iterations does not grow with the number of facets.
    """
    found, iterations = tip(cells, "points")
    assert found == pytest.approx(1.0, abs=0.02)
    assert iterations <= (12 if cells < 80 else 30)
