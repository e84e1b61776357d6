"""Newton step for bodies, multipliers and tools by a direct solver."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.factors_again import OF_A_LIBRARY
from qsdolfinx.linear.presets import EXTRA_MEMORY
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]


#: Values of MUMPS' INFOG(1) for too little working space.
SHORT_OF_MEMORY = (-8, -9)


class SaddleFactors:
    """Solve with the inexact derivative as one AIJ matrix, by MUMPS or by the solver of options.

    A second solve with the same factors corrects for the regularisation of the matrix.

    Args:
        equations: The equations.
        linear: The problem's linear solver; its options are used if it is a direct solver.
    """

    def __init__(self, equations: Equations, linear: LinearSolver) -> None:
        self._equations, self._linear = equations, linear
        self._memory = EXTRA_MEMORY
        self._ksp = self._new_ksp()
        #: Reason why there was no solution.
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
            shift: As for ``Derivative.of``.
        """
        self._take(self._equations.tangent_of(at, exact=False, shift=shift))

    def _take(self, matrix: PETSc.Mat) -> None:
        self._ksp.setOperators(matrix)
        if self._is_new and self._is_mumps:
            self._ksp.getPC().setFactorSetUpSolverType()
            self._ksp.getPC().getFactorMatrix().setMumpsIcntl(14, self._memory)
        self._is_new = False

    def solve(self, rhs: Array) -> Array | None:
        """Change of z for a change of R; None if the matrix is singular. Collective.

        Delayed pivots may need many times the memory that MUMPS estimates.

        Args:
            rhs: This rank's part of the change of R.
        """
        while True:
            out = self._solved(rhs)
            fine = bool(np.isfinite(out).all())
            if self._equations.system.comm.allreduce(fine, op=MPI.LAND):
                return out
            matrix, info = self._ksp.getOperators()[0], 0
            if self._is_mumps:
                info = self._ksp.getPC().getFactorMatrix().getMumpsInfog(1)
            self._ksp.destroy()  # the preconditioner is unusable after an error
            self._ksp = self._new_ksp()
            if info not in SHORT_OF_MEMORY or self._memory >= 100 * EXTRA_MEMORY:
                self.reason = f"singular (MUMPS: INFOG(1) = {info})" if info else "singular"
                return None
            self._memory *= 10
            if self._linear.has_factors:  # options are read again with each new factorisation
                name = f"{self._linear.ksp.getOptionsPrefix()}mat_mumps_icntl_14"
                self._memory = max(self._memory, 10 * PETSc.Options().getInt(name, 0))
                PETSc.Options().setValue(name, self._memory)
            self._take(matrix)

    def _solved(self, rhs: Array) -> Array:
        """The change; NaN where there are no factors. Collective."""
        matrix = self._ksp.getOperators()[0]
        x, b = matrix.createVecs()
        try:
            self._ksp.setUp()
            b.array[:] = rhs
            self._ksp.solve(b, x)
            out = np.array(x.array_r)
            if np.isfinite(out).all():
                b.array[:] = self._equations.derivative.softened * out
            self._ksp.solve(b, x)
            out += x.array_r
        except PETSc.Error as error:
            if error.ierr != OF_A_LIBRARY:
                raise
            out = np.full(self._equations.num_local, np.nan)
        x.destroy()
        b.destroy()
        return out

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
