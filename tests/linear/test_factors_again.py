"""A solver with factors remains usable after errors in the middle of solves."""

import gc

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD

from qsdolfinx.base.passing import passing
from qsdolfinx.linear.factors_again import begin_afresh


class Failing:
    """Diagonal matrix whose products raise an error on request."""

    fails = False

    @passing()
    def mult(self, mat, x, y):
        if self.fails:
            raise RuntimeError("no product")
        y.array[:] = 2 * x.array_r

    def multTranspose(self, mat, x, y):
        self.mult(mat, x, y)


@pytest.mark.one_rank
def test_garbage_collection():
    """Garbage collection that starts with an exception does not see it within PETSc.

    The exception would be lost there.
    """
    threshold = gc.get_threshold()[0]
    context = Failing()
    context.fails = True
    shell = PETSc.Mat().createPython((3, 3), context, comm=PETSc.COMM_SELF)
    shell.setUp()
    for count in range(threshold - 100, threshold + 150):
        x, y = shell.createVecs()
        gc.collect(0)
        made = [[] for _ in range(count)]
        with pytest.raises(PETSc.Error):
            shell.mult(x, y)
        del made


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
        b, x = matrix.createVecs()  # the vectors of a failed solve stay locked
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
