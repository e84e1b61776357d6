"""Rigid modes attached to the matrices for multigrid are motions without strain."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, mini_space, vector_space

from dolfinx import fem

import qsdolfinx as qs


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
