"""Friction on surfaces that continue around corners: the other faces change nothing."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs


def dragged(sides, **options):
    """Return T and N of a block that is pressed on a wide plate and dragged along."""
    shapes = ([0.0, 0.0], [1.0, 0.5], (5, 3), 0.5), ([-1.0, -1.0], [2.0, 0.0], (14, 5), -1.0)
    us, forms, bcs, surfaces = [], [], [], []
    for i, (low, high, n, held) in enumerate(shapes):
        msh = box(WORLD, n, "quadrilateral", low, high, "scattered")
        V = vector_space(msh)
        us.append(fem.Function(V))
        forms.append(elastic(us[-1], E=1e3))
        value = fem.Constant(msh, (0.0, 0.0))
        bcs.append([fem.dirichletbc(value, clamp_dofs(V, held), V)])
        facets = [plane(msh, 1, 0.0)]
        if i == 0:
            top = value
            facets += [plane(msh, 0, x) for x in (0.0, 1.0) if sides]
        surfaces.append(qs.Surface(V, facets=np.unique(np.concatenate(facets))))
    contact = qs.Contact(*surfaces, quadrature="nodal", **options)
    problem = qs.ContactProblem(forms, us, [contact], bcs)

    def drive(t, dt):
        top.value[:] = np.interp(t, [1, 2], [0, 0.1]), np.interp(t, [0, 1], [0, -0.02])

    for _ in qs.TimeStepper(problem, 0.25, drive).run(2.0):
        pass
    return contact.force("slave")


def clamp_dofs(V, y):
    """Return the dofs of one side."""
    return fem.locate_dofs_topological(V, 1, plane(V.mesh, 1, y))


@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
def test_sides_do_not_tilt_pairs(formulation):
    """Sides do not change T/N: it was 0.232 with sides, from the mean normal at corners."""
    options = {"formulation": formulation, "friction": qs.Coulomb(0.2)}
    T, N = dragged(True, **options)
    assert abs(abs(T) / N - 0.2) < 0.003
    np.testing.assert_allclose([T, N], dragged(False, **options), rtol=0.01)


def test_bisectors_without_friction():
    T, N = dragged(True, normals="bisector")
    assert abs(T) < 1e-3 * N
