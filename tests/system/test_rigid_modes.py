"""Rigid modes attached to the matrices for multigrid are motions without strain."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, mini_space, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.system.rigid_modes import RigidMotion


def quadratic_space(msh):
    """Make a space of P2 or Q2 displacements."""
    return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))


@pytest.mark.parametrize("kind", ("nest", "mpi"))
@pytest.mark.parametrize(
    "cell, space",
    [(cell, space) for cell in CELLS for space in (vector_space, quadratic_space)]
    + [("triangle", mini_space), ("tetrahedron", mini_space)],
)
def test_no_strain(cell, space, kind):
    """K times a mode is zero for an unsupported body, and the modes are orthonormal."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    msh = box(WORLD, [2, 3, 2][:gdim], cell, [0.3] * gdim, [1.0, 2.0, 1.5][:gdim], "scattered")
    u = fem.Function(space(msh))
    problem = qs.ContactProblem([elastic(u)], [u], [], kind=kind)
    problem.solve()
    matrix = problem.snes.getJacobian()[0]
    problem.snes.computeJacobian(problem.snes.getSolution(), matrix)
    K = problem.blocks.block(0, 0) if kind == "nest" else matrix
    modes = K.getNearNullSpace().getVecs()
    assert len(modes) == (3 if gdim == 2 else 6)
    image = K.createVecLeft()
    for i, mode in enumerate(modes):
        K.mult(mode, image)
        assert image.norm() < 1e-8 * K.norm()  # except for the tangent's regularisation
        products = [mode.dot(other) for other in modes]
        np.testing.assert_allclose(products, np.eye(len(modes))[i], atol=1e-12)


@pytest.mark.parametrize("n", (4, 40))
def test_two_close_nodes_hold_a_body(n):
    """No motion is free if nodes at a distance of 1e-5 sizes of the body are held.

    The number of unknowns has no effect, although modes of a finer mesh have smaller values.
    """
    msh = box(WORLD, (n, n), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    low = plane(msh, 1, 0.0)
    x = msh.geometry.x
    near = np.isclose(x[:, 0], 1 / n)
    x[near, 0] = 1e-5
    V = vector_space(msh)
    dofs = fem.locate_dofs_topological(V, 1, low)
    at = V.tabulate_dof_coordinates()[dofs]
    dofs = dofs[(at[:, 0] < 2e-5) & np.isclose(at[:, 1], 0.0)].astype(np.int32)
    bc = fem.dirichletbc(np.zeros(2), dofs, V)
    u = fem.Function(V)
    for bcs, free in (([[bc]], 0), ([[]], 3)):
        problem = qs.ContactProblem([elastic(u)], [u], [], bcs)
        motion = RigidMotion(problem.bodies)
        assert motion.free_motions.shape == (3, free)
        motion.destroy()
