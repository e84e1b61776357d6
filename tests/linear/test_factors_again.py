"""A solver with factors goes on after errors in the middle of solves."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD

from qsdolfinx.linear.factors_again import begin_afresh


class Failing:
    """A diagonal matrix whose products raise as long as they are to."""

    fails = False

    def mult(self, mat, x, y):
        if self.fails:
            raise RuntimeError("no product")
        y.array[:] = 2 * x.array_r

    def multTranspose(self, mat, x, y):
        self.mult(mat, x, y)


def test_errors_in_solves():
    sizes = ((3, PETSc.DECIDE), (3, PETSc.DECIDE))
    context = Failing()
    shell = PETSc.Mat().createPython(sizes, context, comm=WORLD)
    shell.setUp()
    matrix = PETSc.Mat().createAIJ(sizes, nnz=1, comm=WORLD)
    low, high = matrix.getOwnershipRange()
    for i in range(low, high):
        matrix.setValue(i, i, 2.0)
    matrix.assemble()
    ksp = PETSc.KSP().create(WORLD)
    ksp.setOperators(shell, matrix)
    ksp.setType("gmres")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    for _ in range(4):
        b, x = matrix.createVecs()  # those of a solve that failed stay locked
        b.set(1.0)
        context.fails = True
        with pytest.raises(PETSc.Error):
            ksp.solve(b, x)
        context.fails = False
        begin_afresh(ksp)
        b, x = matrix.createVecs()
        b.set(1.0)
        ksp.solve(b, x)
        np.testing.assert_allclose(x.array_r, 0.5)
    assert ksp.getPC().getFactorSolverType() == "mumps"
