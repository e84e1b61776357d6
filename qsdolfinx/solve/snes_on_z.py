"""Solve for bodies, multipliers and force-controlled tools by PETSc's SNES with user options."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.base.reasons import reason_name
from qsdolfinx.gap.no_value import NoValueError
from qsdolfinx.solve.balance import Balance
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.newton_step import NewtonStep, NoConvergence
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]

REASONS = PETSc.SNES.ConvergedReason

#: Ends with these reasons are checked: a short step alone is not convergence, and some types of
#: SNES end when they reach their number of iterations.
JUDGED = {
    REASONS.CONVERGED_SNORM_RELATIVE: REASONS.DIVERGED_LINE_SEARCH,
    REASONS.CONVERGED_ITS: REASONS.DIVERGED_MAX_IT,
}


class _Steps:
    """Context of the KSP: Newton step for a right-hand side, with the last derivative."""

    def __init__(
        self, equations: Equations, newton: Newton, step: NewtonStep, balance: Balance
    ) -> None:
        self._equations, self._newton = equations, newton
        self._step, self._balance = step, balance

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve; if no step is found, this is reported as divergence, not as an error."""
        reasons = PETSc.KSP.ConvergedReason
        rhs = self._equations.in_forces(b.array_r, back=True)
        with self._newton.kept():
            try:
                x.array[:] = self._step.solve(rhs, self._balance.until)
            except NoConvergence:
                ksp.setConvergedReason(reasons.DIVERGED_BREAKDOWN)
                return
        ksp.setConvergedReason(reasons.CONVERGED_ITS)


class SnesOnZ:
    """Solve c R(z) = 0 by the problem's SNES, with all its options, monitors and tolerances.

    The factor c scales all rows to forces that are continuous where sets change; line searches use
    |c R|. Linear solves are Newton steps by the problem's own linear solver, a KSP of type
    ``python``. The derivative is a shell matrix that can only be multiplied. The convergence test
    is the library's own, unless the user has set another test, or named one by
    ``snes_convergence_test``. With updated geometry, the areas of gaps are kept constant while SNES
    runs.

    Args:
        equations: The equations.
        newton: Solver whose SNES is used.
        step: Solver of the linear systems.
        balance: The library's convergence test.
    """

    def __init__(
        self, equations: Equations, newton: Newton, step: NewtonStep, balance: Balance
    ) -> None:
        self._equations, self._newton = equations, newton
        self._step, self._balance = step, balance
        self._comm = equations.system.comm
        #: The last evaluation that was tested, and whether it solves the equations.
        self._measured: State | None = None
        self._is_found = False
        size = (equations.num_local, equations.size)
        self.matrix: PETSc.Mat = PETSc.Mat().createPython((size, size), self, self._comm)
        self.matrix.setUp()
        self.ksp: PETSc.KSP = PETSc.KSP().create(self._comm)
        self.ksp.setType(PETSc.KSP.Type.PYTHON)
        self.ksp.setPythonContext(_Steps(equations, newton, step, balance))
        self.ksp.getPC().setType(PETSc.PC.Type.NONE)
        self.ksp.setOperators(self.matrix)

    def solve(self, z: Array) -> Array:
        """Compute the solution, starting from z. Collective.

        Args:
            z: Unknowns of this rank.

        Raises:
            NoConvergence: If none is found.
            KeyboardInterrupt: After Ctrl-C.
        """
        x = PETSc.Vec().createWithArray(z.copy(), comm=self._comm)
        f = x.duplicate()
        self._measured = None
        try:
            reason = self._newton.solve_other(self, x, f)
            interrupt.look(self._comm)
            found: Array = x.array_r.copy()
            reason = self._judged(reason, found)
        finally:
            for thing in (self.ksp, self.matrix, f, x):
                thing.destroy()
        if reason < 0:
            history = self._balance.history
            text = f"PETSc's SNES has ended with {reason_name(REASONS, reason)}"
            if history:
                now = history[-1]
                text += f" where {now.forces:.3g} of the contact forces are not balanced"
                text += f", with {now.active} active constraints"
            raise NoConvergence(text, reason)
        return found

    def _judged(self, reason: int, z: Array) -> int:
        """Reason of SNES, or another reason if SNES' reason does not depend on R. Collective."""
        if reason not in JUDGED or self._newton.has_users_test:
            return reason
        try:
            at = self._equations.evaluate(z)
        except NoValueError:
            return int(JUDGED[reason])
        self._measure(at)
        return int(REASONS.CONVERGED_FNORM_RELATIVE if self._is_found else JUDGED[reason])

    # --- Callbacks of SNES

    def residual(self, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """Evaluate c R; not finite where a gap cannot be evaluated."""
        equations = self._equations
        try:
            at = equations.evaluate(x.array_r.copy())
        except NoValueError:  # on all ranks
            f.array[:] = np.nan
            return
        f.array[:] = equations.in_forces(equations.residual_of(at))

    def tangent(self, x: PETSc.Vec) -> None:
        """Form the derivative at x."""
        at = self._equations.evaluate(x.array_r.copy())
        self._measure(at)
        self._equations.set_proximal(self._balance.proximal)
        self._step.set_up(at, self._balance.shift)

    def converged(self, snes: PETSc.SNES) -> int:
        """Converged reason if the present iterate of SNES is a solution."""
        self._measure(self._equations.evaluate(snes.getSolution().array_r.copy()))
        return int(REASONS.CONVERGED_FNORM_RELATIVE) if self._is_found else 0

    def shown(self, snes: PETSc.SNES) -> tuple[float, list[int]]:
        """|R_u|, and active constraints of each contact on this rank."""
        at = self._equations.evaluate(snes.getSolution().array_r.copy())
        self._measure(at)
        return self._balance.history[-1].residual, self._balance.num_closed(at)

    def _measure(self, at: State) -> None:
        if at is not self._measured:
            self._is_found = self._balance.is_found(at, np.nan)
            self._measured = at

    # --- The derivative as a matrix

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The product of the derivative of c R."""
        with self._newton.kept():
            y.array[:] = self._equations.in_forces(self._step.multiply(x.array_r))

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The product of its transpose; available with factors only."""
        with self._newton.kept():
            y.array[:] = self._step.multiply(self._equations.in_forces(x.array_r), True)
