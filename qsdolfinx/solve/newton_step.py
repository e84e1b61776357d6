"""Newton step for bodies, multipliers and force-controlled tools by the problem's linear solver."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.saddle import SaddlePoint
from qsdolfinx.linear.saddle_factors import SaddleFactors
from qsdolfinx.solve.newton import Newton
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]

LATE = int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT)
LINEARLY = int(PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)


class NoConvergence(RuntimeError):
    """The iteration has not converged; the text describes its last state.

    Attributes:
        reason: PETSc's SNESConvergedReason, or a reason of the library.
        linear: PETSc's KSPConvergedReason, if a linear solve has failed; 0 otherwise.
    """

    def __init__(self, text: str, reason: int = LATE, linear: int = 0) -> None:
        super().__init__(text)
        self.reason, self.linear = reason, linear


class NewtonStep:
    """Solve with the inexact derivative of R, by factorisation or by a Krylov solver.

    If a Krylov solver fails, factorisation is used as a fallback, if the problem allows it.

    Args:
        equations: The equations.
        newton: Solver whose record and linear solver are used.
    """

    def __init__(self, equations: Equations, newton: Newton) -> None:
        self._equations, self._newton = equations, newton
        self._factors: SaddleFactors | None = None
        self._saddle: SaddlePoint | None = None
        self._guess: Array | None = None
        self._at: State | None = None
        self._shift = (0.0, 0.0)

    def set_up(self, at: State, shift: tuple[float, float]) -> None:
        """Form the derivative at the last evaluation. Collective.

        Args:
            at: The last evaluation.
            shift: As for ``Derivative.of``.
        """
        self._at, self._shift = at, shift
        if self._is_iterative:
            linear = self._newton.linear
            self._saddle = self._saddle or SaddlePoint(self._equations, linear)
            self._saddle.set_up(at, self._equations.derivative.springs(shift))
        else:
            self._form()

    @property
    def _is_iterative(self) -> bool:
        linear = self._newton.linear
        return not (linear.has_factors or linear.given_up.is_now)

    def _form(self) -> None:
        assert self._at is not None
        self._factors = self._factors or SaddleFactors(self._equations, self._newton.linear)
        self._factors.set_up(self._at, self._shift)

    def solve(self, rhs: Array, until: float, exact: bool = False) -> Array:
        """Change of z for a change of R (this rank's part of both). Collective.

        Args:
            rhs: The change of R.
            until: Norm of forces at which Newton's method ends.
            exact: Whether an iterative solver uses a small tolerance, whatever Newton's method
                needs.

        Raises:
            NoConvergence: If the matrix is singular, or an iterative solver fails for good.
        """
        record, out = self._newton.record, None
        if self._is_iterative:
            out = self._iterated(rhs, until, exact)
            if out is None:
                self._form()
        if out is None:
            assert self._factors is not None
            out = self._factors.solve(rhs)
            record.linear_iterations += 1
            if out is None:
                failed = int(PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED)
                raise NoConvergence(self._factors.reason, LINEARLY, failed)
        return out

    def _iterated(self, rhs: Array, until: float, exact: bool) -> Array | None:
        """Solve by a Krylov solver; None if a direct solver is used as a fallback. Collective."""
        newton = self._newton
        assert self._saddle is not None
        if self._saddle.is_singular:
            failed = int(PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED)
            raise NoConvergence("nothing resists the motion of a tool", LINEARLY, failed)
        out = self._saddle.solve(rhs, until, exact, self._guess)
        self._guess = out if exact else None  # for the motion of bodies without some constraints
        newton.record.linear_iterations += self._saddle.num_iterations
        if out is None:
            newton.record.restarts += 1
            if not newton.linear.give_up(self._saddle.reason):
                text = f"linear solver: {self._saddle.reason}"
                raise NoConvergence(text, LINEARLY, self._saddle.converged_reason)
        return out

    def multiply(self, x: Array, transposed: bool = False) -> Array:
        """Product of the derivative, or of its transpose, with this rank's part of x. Collective.

        The transpose is available with factorisation only.
        """
        if self._is_iterative:
            assert self._saddle is not None and not transposed
            return self._saddle.multiply(x)
        assert self._factors is not None
        return self._factors.multiply(x, transposed)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        if self._factors is not None:
            self._factors.destroy()
        if self._saddle is not None:
            self._saddle.free()
        self._factors = self._saddle = None
