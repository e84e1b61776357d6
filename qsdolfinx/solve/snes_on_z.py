"""PETSc's SNES, as the user's options have it, on bodies, multipliers and driven tools."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.base.reasons import reason_name
from qsdolfinx.gap.following import NoGapError
from qsdolfinx.solve.balance import Balance
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.newton_step import NewtonStep, NoConvergence
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]

REASONS = PETSc.SNES.ConvergedReason

#: What ends with these reasons is looked at: a short step alone is no success, and some types of
#: SNES end with the number of their iterations.
JUDGED = {
    REASONS.CONVERGED_SNORM_RELATIVE: REASONS.DIVERGED_LINE_SEARCH,
    REASONS.CONVERGED_ITS: REASONS.DIVERGED_MAX_IT,
}


class _Steps:
    """Context of the KSP: Newton's step for a right-hand side, with the last derivative."""

    def __init__(
        self, equations: Equations, newton: Newton, step: NewtonStep, balance: Balance
    ) -> None:
        self._equations, self._newton = equations, newton
        self._step, self._balance = step, balance

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve; a step that is not found is a divergence, not an error."""
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
    """Lets the problem's SNES find c R(z) = 0, with all its options, monitors and tolerances.

    c makes forces of all rows, continuous where sets change: |c R| is what line searches see. Its
    linear solves are Newton's steps of the problem's own linear solver, a KSP of type ``python``;
    the derivative is a shell matrix that multiplies. The convergence test is the library's own,
    unless the user has set one, or named one by ``snes_convergence_test``. Areas of gaps that
    follow are held meanwhile.

    Args:
        equations: The equations.
        newton: Whose SNES it is.
        step: Solves linear systems.
        balance: The library's convergence test.
    """

    def __init__(
        self, equations: Equations, newton: Newton, step: NewtonStep, balance: Balance
    ) -> None:
        self._equations, self._newton = equations, newton
        self._step, self._balance = step, balance
        self._comm = equations.system.comm
        #: The evaluation that was measured last, and whether it solves the equations.
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
        """Solution, from z on. Collective.

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
            text = f"SNES: {reason_name(REASONS, reason)}"
            raise NoConvergence(f"{text}: {history[-1]}" if history else text, reason)
        return found

    def _judged(self, reason: int, z: Array) -> int:
        """SNES' reason, or another where it ends for one that says nothing of R. Collective."""
        if reason not in JUDGED or self._newton.has_users_test:
            return reason
        try:
            at = self._equations.evaluate(z)
        except NoGapError:
            return int(JUDGED[reason])
        self._measure(at)
        return int(REASONS.CONVERGED_FNORM_RELATIVE if self._is_found else JUDGED[reason])

    # --- What SNES calls

    def residual(self, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """Evaluate c R; not finite where a gap cannot be evaluated."""
        equations = self._equations
        try:
            at = equations.evaluate(x.array_r.copy())
        except NoGapError:  # on all ranks
            f.array[:] = np.nan
            return
        f.array[:] = equations.in_forces(equations.residual_of(at))

    def tangent(self, x: PETSc.Vec) -> None:
        """Take the derivative at x."""
        at = self._equations.evaluate(x.array_r.copy())
        self._measure(at)
        self._equations.set_proximal(self._balance.proximal)
        self._step.set_up(at, self._balance.shift)

    def converged(self, snes: PETSc.SNES) -> int:
        """Whether SNES' solution is one."""
        self._measure(self._equations.evaluate(snes.getSolution().array_r.copy()))
        return int(REASONS.CONVERGED_FNORM_RELATIVE) if self._is_found else 0

    def shown(self, snes: PETSc.SNES) -> tuple[float, list[int]]:
        """|R_u|, and closed rows of each contact on this rank."""
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
        """The product of its transpose; of factors alone."""
        with self._newton.kept():
            y.array[:] = self._step.multiply(self._equations.in_forces(x.array_r), True)
