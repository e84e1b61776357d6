"""Stabilisation that vanishes, for nonlinear bodies which only contact holds."""

from __future__ import annotations

import dataclasses

import numpy as np

from qsdolfinx.base.checks import COUNT, FRACTION, POSITIVE, check, number
from qsdolfinx.base.messages import say
from qsdolfinx.solve.equilibrium import Equilibrium
from qsdolfinx.solve.snes import ConvergenceError

DECREASE = number("a number from 0 to 1, without 1", lambda x: 0 <= x < 1)

#: How often springs are made stiffer where a solve fails, and by what.
MAX_STIFFER, STIFFER = 3, 10.0


@dataclasses.dataclass(frozen=True)
class Stabilisation:
    """Springs that hold free bodies during a solve, and are gone at its end.

    Nothing but closed contacts holds a free body, such as an O-ring between moving tools. Newton's
    method may lose it: a step opens all contacts, and what is left is in equilibrium anywhere. So
    the problem is solved with springs between each unknown of such a body and where it is, in
    proportion to the diagonal of the body's own stiffness; then again from there, with weaker
    springs to the new place (the proximal point method, or so many steps of a viscous body); and
    at last without any.

    Args:
        stiffness: Of the first springs, in units of the diagonal of the body's stiffness. Where a
            solve fails, ten times as stiff ones are tried, three times at most.
        decrease: Factor of the stiffness from one solve to the next.
        tolerance: Share of the springs in the forces, of those of contact, from which on the solve
            without springs follows. If that fails, the result with this share is what is returned.
        max_solves: Most solves with springs.

    Raises:
        ValueError: If a number is out of range.
    """

    stiffness: float = 1e-2
    decrease: float = 0.3
    tolerance: float = 1e-6
    max_solves: int = 15

    def __post_init__(self) -> None:
        check(POSITIVE, stiffness=self.stiffness)
        check(DECREASE, decrease=self.decrease)
        check(FRACTION, tolerance=self.tolerance)
        check(COUNT, max_solves=self.max_solves)


class Stabilised:
    """Equilibrium that is found with the help of springs.

    Args:
        equilibrium: Finds it without.
        settings: What to do.
        verbose: Whether to log the springs' shares.
    """

    def __init__(self, equilibrium: Equilibrium, settings: Stabilisation, verbose: bool) -> None:
        self._equilibrium, self._settings, self._verbose = equilibrium, settings, verbose
        self._system = equilibrium.newton.system
        #: Share of the springs in the forces, after each solve with them; the last of the result.
        self.shares: list[float] = []

    def find(self) -> None:
        """Solve for the multipliers as they are. Collective.

        Raises:
            ConvergenceError: If a solve fails, or with all springs that are allowed their share
                stays above the tolerance and the solve without fails.
        """
        system, anchors = self._system, self._system.anchors
        if system.made.rigid.free_motions.shape[1] == 0:
            self._equilibrium.find()
            return
        try:
            self._weaken()
        finally:
            anchors.release()
        self._let_go()

    def _weaken(self) -> None:
        """Solve with weaker and weaker springs, with stiffer ones again where that fails."""
        system, settings, stiffness = self._system, self._settings, self._settings.stiffness
        failures = 0
        for _ in range(settings.max_solves):
            reached = system.x.array.copy()
            try:
                self._solve(stiffness)
            except ConvergenceError:
                failures += 1
                if failures > MAX_STIFFER:
                    raise
                system.x.array[:] = reached
                stiffness *= STIFFER
                continue
            stiffness *= settings.decrease
            if stiffness == 0 or self.shares[-1] <= settings.tolerance:
                break

    def _solve(self, stiffness: float) -> None:
        system = self._system
        system.anchors.hold(system.made.rigid, system.parts(system.x.array.copy()), stiffness)
        system.residual(system.x.array_r)
        self._equilibrium.find()
        self.shares.append(system.anchors.share())
        if self._verbose:
            text = f"stabilisation: springs of {stiffness:.3g}, {self.shares[-1]:.3g} of the forces"
            say(system.comm, text)

    def _let_go(self) -> None:
        """The solve without springs."""
        system = self._system
        share = self.shares[-1] if self.shares else np.inf
        held = system.x.array.copy()
        try:
            system.residual(system.x.array_r)
            self._equilibrium.find()
            self.shares.append(0.0)
        except ConvergenceError:
            if share > self._settings.tolerance:
                raise
            system.x.array[:] = held
            system.residual(system.x.array_r)
