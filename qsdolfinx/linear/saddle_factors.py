"""Newton's step for bodies, multipliers and tools by a direct solver."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.factors_again import OF_A_LIBRARY
from qsdolfinx.linear.presets import EXTRA_MEMORY
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.system.equations import Equations, State

Array = npt.NDArray[np.float64]


class SaddleFactors:
    """Solves with the inexact derivative, formed as one AIJ matrix, by MUMPS or as options say.

    A second solve with the same factors takes back what makes the matrix regular.

    Args:
        equations: The equations.
        linear: The problem's linear solver, whose options are taken if it is a direct one.
    """

    def __init__(self, equations: Equations, linear: LinearSolver) -> None:
        self._equations, self._linear = equations, linear
        self._ksp = self._new_ksp()
        #: Why there was no solution.
        self.reason = ""

    def _new_ksp(self) -> PETSc.KSP:
        ksp: PETSc.KSP = PETSc.KSP().create(self._equations.system.comm)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        if self._linear.has_factors:
            ksp.setOptionsPrefix(self._linear.ksp.getOptionsPrefix())
            ksp.setFromOptions()
        self._is_new = True
        return ksp

    def set_up(self, at: State, shift: tuple[float, float]) -> None:
        """Form the matrix. Collective.

        Args:
            at: The evaluation, the last one.
            shift: As for ``Equations.tangent_of``.
        """
        matrix = self._equations.tangent_of(at, exact=False, shift=shift)
        self._ksp.setOperators(matrix)
        if self._is_new and self._is_mumps:
            self._ksp.getPC().setFactorSetUpSolverType()
            self._ksp.getPC().getFactorMatrix().setMumpsIcntl(14, EXTRA_MEMORY)
        self._is_new = False

    def solve(self, rhs: Array) -> Array | None:
        """Change of z for a change of R; None if the matrix is singular. Collective.

        Args:
            rhs: This rank's part of the change of R.
        """
        equations = self._equations
        matrix = self._ksp.getOperators()[0]
        x, b = matrix.createVecs()
        try:
            self._ksp.setUp()
            b.array[:] = rhs
            self._ksp.solve(b, x)
            out = np.array(x.array_r)
            b.array[:] = equations.softened * out
            self._ksp.solve(b, x)
            out += x.array_r
        except PETSc.Error as error:
            if error.ierr != OF_A_LIBRARY:
                raise
            out = np.full(equations.num_local, np.nan)
        x.destroy()
        b.destroy()
        fine = bool(np.isfinite(out).all())
        if equations.system.comm.allreduce(fine, op=MPI.LAND):
            return out
        self.reason = "singular"
        if self._is_mumps:
            info = self._ksp.getPC().getFactorMatrix().getMumpsInfog(1)
            self.reason = f"singular (MUMPS: INFOG(1) = {info})"
        self._ksp.destroy()  # an error leaves a preconditioner of no more use
        self._ksp = self._new_ksp()
        return None

    def multiply(self, x: Array, transposed: bool = False) -> Array:
        """Product of the matrix, or of its transpose, with this rank's part of x. Collective."""
        matrix = self._ksp.getOperators()[0]
        vec, out = matrix.createVecs()
        vec.array[:] = x
        (matrix.multTranspose if transposed else matrix.mult)(vec, out)
        found: Array = out.array_r.copy()
        vec.destroy()
        out.destroy()
        return found

    @property
    def _is_mumps(self) -> bool:
        return bool(self._ksp.getPC().getFactorSolverType() == PETSc.Mat.SolverType.MUMPS)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self._ksp.destroy()
