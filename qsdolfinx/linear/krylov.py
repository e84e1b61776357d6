"""Type and tolerance of the Krylov solvers for large problems."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.linear.presets import EXACT, GMRES_RESTART, TIGHTEST

#: Relative tolerances of a linear solve after which active sets may still change: in general, for
#: linear bodies, and with velocity–pressure bodies, whose viscosities make Newton's method diverge
#: with a tolerance of 1e-4. Tighter ones cost iterations, looser ones more Newton steps.
LOOSE, LOOSE_OF_LINEAR, LOOSE_OF_FLOW = 1e-3, 3e-2, 1e-6

#: Residual norm of a linear solve, relative to the norm at which Newton's method ends, for the
#: solve that may be the last one. With 1, rounding could keep Newton's method from ending; with
#: less, each last solve would take longer.
SAFETY = 0.3

#: The same ratio if the nonlinear residual is linear, and so decreases as that of the linear
#: solver. Above 1, Newton's method would not end.
SAFETY_LINEAR = 0.9

#: Relative tolerance of a linear solve that may be the last one: a few more iterations cost less
#: than another tangent. With much less, one solve would take as long as two.
NEAR = 1e-5

#: Relative tolerance of the first linear solve if constraints do not change, but move with the
#: bodies, such as ties in finite sliding. A Newton step leaves about that much; with a tighter one,
#: this solve takes more iterations, with a looser one there are more Newton steps.
UNCHANGED = 1e-4

#: Smallest limit of the number of iterations of any solve. With fewer, solves of two digits would
#: count as failed.
LEAST = 30

#: Factor of the tolerance for each iteration after the first one without a decrease of the
#: residual. With 1, errors of linear solves could change the active set for ever.
TIGHTER = 0.1

#: Upper bound of the relative tolerance of a linear solve. With 1 a solve would do nothing.
_LOOSEST = 0.1


class Krylov:
    """Prepare each linear solve of Newton's method with an iterative preset.

    Args:
        ksp: The linear solver.
        given: Names of the options that the user has given, without the prefix.
        linear: Whether all bodies are linear.
        slips: Whether there is friction.
        is_flow: Whether there are bodies in velocity and pressure.
        patience: Iterations to EXACT after which a solve counts as failed; None to use the options.
    """

    def __init__(
        self,
        ksp: PETSc.KSP,
        given: typing.Collection[str],
        linear: bool,
        slips: bool,
        is_flow: bool = False,
        patience: int | None = None,
    ) -> None:
        self._ksp = ksp
        self._linear = linear
        self._loose = LOOSE
        if is_flow and not linear:
            self._loose = LOOSE_OF_FLOW
        elif linear:
            self._loose = LOOSE_OF_LINEAR
        self._slips = slips
        self._patience = patience
        self._chooses_type = "ksp_type" not in given
        #: Whether this class chooses the tolerance of linear solves, not the user's options.
        self.chooses_tolerance = not {"ksp_rtol", "ksp_atol", "snes_ksp_ew"} & set(given)

    def choose_type(self, symmetric: bool) -> None:
        """Choose conjugate gradients, or GMRES for a tangent that is not symmetric."""
        kind = PETSc.KSP.Type.CG if symmetric else PETSc.KSP.Type.GMRES
        if not self._chooses_type:
            return
        is_flexible = self._ksp.getType() == PETSc.KSP.Type.FGMRES
        if not is_flexible and self._ksp.getType() != kind:
            self._ksp.setType(kind)
            if not symmetric:
                self._ksp.setGMRESRestart(GMRES_RESTART)
        is_left = symmetric and not is_flexible
        side = PETSc.PC.Side.LEFT if is_left else PETSc.PC.Side.RIGHT
        self._ksp.setPCSide(side)
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)  # the norm of Newton's test

    def set_tolerance(
        self, norms: typing.Sequence[float], until: float, changed: bool, moves: bool = False
    ) -> None:
        """Set the tolerance needed to end Newton's method, or to find the active set.

        While the tangent changes, a few digits are enough (inexact Newton methods: Eisenstat and
        Walker, 1996). For linear bodies the residual is linear while the active set is unchanged:
        one solve then ends Newton's method. If the residual no longer decreases, errors of the
        linear solves may change the active set back and forth; the tolerance is then reduced.

        Args:
            norms: Norm of the residual at each iteration so far.
            until: Norm of the residual at which Newton's method ends.
            changed: Whether the tangent has changed since the last linear solve.
            moves: Whether constraints move with the bodies (finite sliding): residuals of linear
                bodies are not linear then.
        """
        if not self.chooses_tolerance or not norms or norms[-1] == 0:
            return
        last = SAFETY * until / norms[-1]
        if self._linear and not changed and not moves:
            tolerance = SAFETY_LINEAR * until / norms[-1]
        elif last >= NEAR:
            tolerance = last
        elif self._linear and not changed:
            fallen = (norms[-1] / norms[-2]) ** 2 if len(norms) > 1 else UNCHANGED
            tolerance = max(last, min(UNCHANGED, fallen))
        elif len(norms) < 2 or (self._linear and not self._slips):
            tolerance = max(last, self._loose * TIGHTER ** max(_stalls(norms) - 1, 0))
        else:
            tolerance = max(last, min(self._loose, (norms[-1] / norms[-2]) ** 2))
        self._set(min(max(tolerance, TIGHTEST), _LOOSEST))

    def set(self, tolerance: float) -> None:
        """Set the relative tolerance of a linear solve outside Newton's method."""
        if self.chooses_tolerance:
            self._set(min(max(tolerance, TIGHTEST), _LOOSEST))

    def longest(self, tolerance: float, least: int | None = None) -> int | None:
        """Largest number of iterations to this relative tolerance; None to use the options."""
        if self._patience is None:
            return None
        least = LEAST if least is None else least
        return max(least, round(np.log(tolerance) / np.log(EXACT) * self._patience))

    def _set(self, tolerance: float) -> None:
        longest = self.longest(tolerance)
        self._ksp.setTolerances(rtol=tolerance, **({} if longest is None else {"max_it": longest}))


def _stalls(norms: typing.Sequence[float]) -> int:
    """Number of iterations since a norm was at most half of the smallest one before."""
    least, stalls = np.inf, 0
    for norm in norms:
        stalls = 0 if norm <= least / 2 else stalls + 1
        least = min(least, norm)
    return stalls
