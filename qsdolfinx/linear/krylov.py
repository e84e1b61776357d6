"""The Krylov solvers of large problems: type and tolerance."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.linear.presets import EXACT, GMRES_RESTART, TIGHTEST

#: Relative tolerance of a linear solve after which sets may still change; of bodies that are
#: linear; and with bodies in velocity and pressure, whose viscosities let Newton's method diverge
#: from what 1e-4 leaves.
LOOSE, LOOSE_OF_LINEAR, LOOSE_OF_FLOW = 1e-3, 3e-2, 1e-6

#: Norm that a linear solve leaves, relative to what Newton's method may end with.
SAFETY = 0.3

#: The same where the residual is linear, so that it falls as the linear solver's does.
SAFETY_LINEAR = 0.9

#: Relative tolerance of a linear solve that is worth a try if it may be the last one: a few
#: iterations more cost less than another tangent.
NEAR = 1e-5

#: Iterations that any solve is given.
LEAST = 30

#: Factor of the tolerance for each iteration after the first one in which the residual is no less.
TIGHTER = 0.1

#: Upper bound of the relative tolerance of a linear solve.
_LOOSEST = 0.1


class Krylov:
    """Prepares each linear solve of Newton's method, where the preset is an iterative one.

    Args:
        ksp: The linear solver.
        given: Names of the options that the user has given, without the prefix.
        linear: Whether all bodies are linear.
        slips: Whether there is friction.
        is_flow: Whether there are bodies in velocity and pressure.
        patience: Iterations to EXACT after which a solve has failed; None for what options say.
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
        #: Whether the user leaves the tolerance of linear solves to this class.
        self.chooses_tolerance = not {"ksp_rtol", "ksp_atol", "snes_ksp_ew"} & set(given)

    def choose_type(self, symmetric: bool) -> None:
        """Conjugate gradients, or GMRES for a tangent that is not symmetric."""
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
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)  # Newton's method ends by it

    def set_tolerance(self, norms: typing.Sequence[float], until: float, changed: bool) -> None:
        """Solve as exactly as it takes to end, or to find out which contacts close.

        While the tangent changes a few digits do (inexact Newton methods: Eisenstat and Walker,
        1996). For linear bodies the residual is linear while the active set stays: one solve then
        ends Newton's method. Where the residual does not fall any more, what linear solves leave
        may be what opens and closes contacts in turns: they get more exact then.

        Args:
            norms: Norm of the residual at each iteration so far.
            until: Norm of the residual at which Newton's method ends.
            changed: Whether the tangent has changed since the last linear solve.
        """
        if not self.chooses_tolerance or not norms or norms[-1] == 0:
            return
        last = SAFETY * until / norms[-1]
        if self._linear and not changed:
            tolerance = SAFETY_LINEAR * until / norms[-1]
        elif last >= NEAR:
            tolerance = last
        elif len(norms) < 2 or (self._linear and not self._slips):
            tolerance = max(last, self._loose * TIGHTER ** max(_stalls(norms) - 1, 0))
        else:
            tolerance = max(last, min(self._loose, (norms[-1] / norms[-2]) ** 2))
        self._set(min(max(tolerance, TIGHTEST), _LOOSEST))

    def set(self, tolerance: float) -> None:
        """The relative tolerance of a linear solve outside of Newton's method."""
        if self.chooses_tolerance:
            self._set(min(max(tolerance, TIGHTEST), _LOOSEST))

    def longest(self, tolerance: float, least: int = LEAST) -> int | None:
        """Iterations to this relative tolerance at most; None for what options say."""
        if self._patience is None:
            return None
        return max(least, round(np.log(tolerance) / np.log(EXACT) * self._patience))

    def _set(self, tolerance: float) -> None:
        longest = self.longest(tolerance)
        self._ksp.setTolerances(rtol=tolerance, **({} if longest is None else {"max_it": longest}))


def _stalls(norms: typing.Sequence[float]) -> int:
    """Iterations since a norm was half of the least one before."""
    least, stalls = np.inf, 0
    for norm in norms:
        stalls = 0 if norm <= least / 2 else stalls + 1
        least = min(least, norm)
    return stalls
