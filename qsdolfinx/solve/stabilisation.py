"""Stabilisation that vanishes, for nonlinear bodies which only contact holds."""

from __future__ import annotations

import dataclasses

import numpy as np

from qsdolfinx.base.checks import COUNT, FRACTION, POSITIVE, check, either, number
from qsdolfinx.base.messages import say
from qsdolfinx.solve.equilibrium import Equilibrium
from qsdolfinx.solve.snes import ConvergenceError

DECREASE = number("a number from 0 to 1, without 1", lambda x: 0 <= x < 1)

#: Stiffness of springs that vanish with the residual (rings between plates take fewest iterations
#: with it, an O-ring as many as without), and of the first ones that are in the residual.
VANISHING, FIRST = 1e-3, 1e-2

#: How often springs are made stiffer where a solve fails, and by what.
MAX_STIFFER, STIFFER = 3, 10.0


@dataclasses.dataclass(frozen=True)
class Stabilisation:
    """Springs that hold free bodies during a solve, and have no part in its result.

    Conditions leave a free body some rigid motion, such as an O-ring between moving tools: nothing
    but closed contacts holds it there. Newton's method may lose it: a step opens all contacts, and
    what is left is in equilibrium anywhere. So springs hold each unknown of such a body where it
    is, in proportion to the diagonal of the body's own stiffness.

    With constraints at nodes they are in Newton's matrix alone, and as much weaker as the residual
    has fallen (a proximal point method). With constraints at points, and by the paper's penalty
    with the nodal rule, the problem is solved with springs in the residual, too; then again from
    there, with weaker springs to the new place; and at last without any.

    Args:
        stiffness: Of the first springs, in units of the diagonal of the body's stiffness. By
            default 1e-3, at most that of the softest body; and 1e-2 with springs in the residual,
            where ten times as stiff ones are tried if a solve fails, three times at most.
        decrease: Of springs in the residual: factor of the stiffness from one solve to the next.
        tolerance: Of these: share of the springs in the forces, of those of contact, from which on
            the solve without springs follows. If that fails, the result with this share is what is
            returned.
        max_solves: Most solves with springs in the residual.

    Raises:
        ValueError: If a number is out of range.
    """

    stiffness: float | None = None
    decrease: float = 0.3
    tolerance: float = 1e-6
    max_solves: int = 15

    def __post_init__(self) -> None:
        check(either(POSITIVE, None), stiffness=self.stiffness)
        check(DECREASE, decrease=self.decrease)
        check(FRACTION, tolerance=self.tolerance)
        check(COUNT, max_solves=self.max_solves)


def vanishing(settings: Stabilisation | None) -> float | None:
    """Stiffness of springs in Newton's matrix; None without."""
    return None if settings is None else settings.stiffness or VANISHING


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
        system, settings, stiffness = (
            self._system,
            self._settings,
            self._settings.stiffness or FIRST,
        )
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
