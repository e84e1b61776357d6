"""Products with a body's matrix in blocks, compared with PETSc's."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, vector_space

import ufl
from dolfinx import fem
from dolfinx.fem import petsc

from qsdolfinx import _cpp


def matrix_of(cell, kind="baij", moves=True):
    """Matrix of an elastic block, unsymmetric if it is carried along, and its form."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    u = fem.Function(vector_space(box(WORLD, [3] * dim, cell, [0] * dim, [1] * dim)))
    v, along = ufl.TestFunction(u.function_space), ufl.as_vector([1.0, 2.0, 3.0][:dim])
    F = elastic(u)
    if moves:
        F += ufl.inner(ufl.dot(ufl.grad(u), along), v) * ufl.dx
    form = fem.form(ufl.derivative(F, u))
    matrix = petsc.create_matrix(form, kind)
    petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    return matrix, form


@pytest.mark.parallel
@pytest.mark.parametrize("cell", CELLS)
def test_product(cell):
    """Products are those of PETSc, also after another assembly into the same matrix."""
    matrix, form = matrix_of(cell)
    product = _cpp.BlockProduct(matrix.handle)
    x, expected = matrix.createVecs()
    found = expected.duplicate()
    low, high = x.owner_range
    x.array[:] = np.random.default_rng(1).normal(size=x.size)[low:high]
    for factor in (1.0, 2.5):
        matrix.zeroEntries()
        petsc.assemble_matrix(matrix, form)
        matrix.assemble()
        matrix.scale(factor)
        matrix.mult(x, expected)
        found.set(np.nan)
        product.apply(x.handle, found.handle)
        found.axpy(-1.0, expected)
        assert found.norm() < 1e-14 * expected.norm()


@pytest.mark.parallel
@pytest.mark.parametrize("cell", CELLS)
def test_symmetric_product(cell):
    """Half of a symmetric matrix gives the products of the whole one."""
    whole, _form = matrix_of(cell, moves=False)  # PETSc needs the mesh's communicator
    half = whole.convert("sbaij", PETSc.Mat())
    product = _cpp.BlockProduct(half.handle)
    x, expected = whole.createVecs()
    found = expected.duplicate()
    low, high = x.owner_range
    x.array[:] = np.random.default_rng(1).normal(size=x.size)[low:high]
    whole.mult(x, expected)
    found.set(np.nan)
    product.apply(x.handle, found.handle)
    found.axpy(-1.0, expected)
    assert found.norm() < 1e-14 * expected.norm()


def test_other_matrices():
    """Rows without blocks, and blocks of other sizes, are left to PETSc."""
    assert _cpp.BlockProduct.is_for(matrix_of("triangle")[0].handle)
    assert not _cpp.BlockProduct.is_for(matrix_of("triangle", "aij")[0].handle)
    V = fem.functionspace(box(WORLD, [2, 2], "triangle", [0, 0], [1, 1]), ("Lagrange", 1))
    mass = fem.form(ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * ufl.dx)
    assert not _cpp.BlockProduct.is_for(petsc.create_matrix(mass, "baij").handle)
