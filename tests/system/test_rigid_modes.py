"""Rigid modes that the matrices carry for multigrid are motions without any strain."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, vector_space

from dolfinx import fem

import qsdolfinx as qs


@pytest.mark.parametrize("kind", ("nest", "mpi"))
@pytest.mark.parametrize("cell", CELLS)
def test_no_strain(cell, kind):
    """K times a mode is nothing, for a body that nothing holds, and they are orthonormal."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    msh = box(WORLD, [2, 3, 2][:gdim], cell, [0.3] * gdim, [1.0, 2.0, 1.5][:gdim], "scattered")
    u = fem.Function(vector_space(msh))
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
        assert image.norm() < 1e-8 * K.norm()  # less what keeps the tangent regular
        products = [mode.dot(other) for other in modes]
        np.testing.assert_allclose(products, np.eye(len(modes))[i], atol=1e-12)
