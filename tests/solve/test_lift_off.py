"""Loss of contact: solves end when the residual is at rounding level."""

import numpy as np
import pytest
from scenes import WORLD, clamp, elastic_form, plane, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

HEIGHTS = (-0.02, -0.05, -0.01, 0.01, -0.03, 0.02)


def stack(seed):
    """Three stacked blocks under a plane; moduli, heights, cells and quadrature are random."""
    rng = np.random.default_rng(seed)
    F, u, bcs, bottoms, tops, z = [], [], [], [], [], 0.0
    for k in range(3):
        height, n = rng.uniform(0.5, 1.5), [int(i) for i in rng.integers(3, 8, 2)]
        cell = mesh.CellType.quadrilateral if rng.random() < 0.5 else mesh.CellType.triangle
        msh = mesh.create_rectangle(WORLD, [[0, z], [1, z + height]], n, cell)
        V = vector_space(msh)
        E = fem.Constant(msh, 10.0 ** rng.uniform(-2, 2))
        u.append(fem.Function(V))
        F.append(elastic_form(u[-1], ufl.TestFunction(V), E, 0.3))
        faces = [plane(msh, 1, y) for y in (z, z + height)]
        bottoms.append(qs.Surface(V, facets=faces[0]))
        tops.append(qs.Surface(V, facets=faces[1]))
        held = clamp(V, faces[0]) if k == 0 else slide(V, 0, plane(msh, 0, 0.0))
        bcs.append([held])
        z += height
    options = {
        "enforcement": "augmented-lagrangian",
        "quadrature": "overlay" if rng.random() < 0.5 else "nodal",
    }
    tool = qs.RigidSurface.plane(WORLD, [0.0, z], [0.0, -1.0])
    pairs = (bottoms[1], tops[0]), (bottoms[2], tops[1]), (tops[2], tool)
    contacts = [qs.Contact(*pair, **options) for pair in pairs]
    return tool, contacts, qs.ContactProblem(F, u, contacts, bcs)


@pytest.mark.parametrize("seed", range(3))
def test_stack_under_a_plane_that_is_lifted(seed):
    """Unloaded blocks, which stay where rounding leaves them, are not a failure."""
    tool, contacts, problem = stack(seed)
    forces = []
    for height in HEIGHTS:
        tool.displacement = [0.0, height]
        problem.solve()
        forces.append([contact.force("slave")[1] for contact in contacts])
    forces = np.abs(forces)
    pressed = np.array(HEIGHTS) < 0
    largest = forces.max()
    np.testing.assert_allclose(forces[pressed, 0], forces[pressed, 2], rtol=1e-6)
    np.testing.assert_allclose(forces[pressed, 1], forces[pressed, 2], rtol=1e-6)
    assert np.all(forces[~pressed] < 1e-9 * largest)
    assert np.all(forces[pressed, 2] > 0.1 * largest)
