"""Full steps where the line search makes hardly any progress."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Part of a Newton step below which it counts as short. With 0.02, parts of a 32nd do not count,
#: which are most of those in ``tests/solve/test_watchdog.py``.
SHORT = 0.1
#: Number of successive short steps before a full step is tried. With 10, as many iterations more
#: are needed where a full step helps; with 1, a single short step is enough, which may be the last.
PATIENCE = 2
#: Number of iterations after a full step within which the merit must fall below the one before
#: it. With 1, runs return that would converge in the next iteration; with many, full steps that do
#: not help take as many iterations.
TRIAL = 8
#: Merit over that at the start of the solve below which iterates are close to a solution. With 1,
#: full steps are also taken near limit points, where the derivative is almost singular, and lead
#: anywhere.
CLOSE = 0.01


class Watchdog:
    """Chooses full steps, and returns from them if they do not help (the watchdog technique).

    Where a constraint becomes active or inactive, the merit has a kink. On both sides of it Newton
    steps may lead across the kink, and the line search then takes small parts of them, one after
    the other. A full step increases the merit, but leads away from the kink, and Newton's method
    often converges from there. So after some short steps a full step is taken. If the merit does
    not fall below the one before it within some iterations, the run returns to the iterate before
    it, and takes twice as many short steps before the next full one (Chamberlain, Powell,
    Lemarechal, Pedersen, Math. Program. Study 16, 1982, 1).

    This is done close to a solution only. Far from one, steps are also short where the derivative
    is almost singular, as at a limit point, and full steps lead anywhere.

    Args:
        begun: Merit at the start of the solve.
    """

    def __init__(self, begun: float) -> None:
        self._begun = begun
        self._short, self._patience, self._left = 0, PATIENCE, 0
        self._held: tuple[Array, float] | None = None

    def back(self, merit: float) -> Array | None:
        """Unknowns to which the run returns after a full step without success, or None.

        Args:
            merit: Merit of the present iterate.
        """
        if self._held is None:
            return None
        z, before = self._held
        if merit < before:
            self._held = None
        elif self._left == 0:
            self._held, self._patience = None, 2 * self._patience
            return z
        self._left -= 1
        return None

    def wants_full_step(self, merit: float) -> bool:
        """Whether the next step is to be a full one.

        Args:
            merit: Merit of the present iterate.
        """
        is_close = merit < CLOSE * self._begun
        return is_close and self._held is None and self._short >= self._patience

    def hold(self, z: Array, merit: float) -> None:
        """Store the iterate before a full step.

        Args:
            z: Its unknowns on this rank.
            merit: Its merit.
        """
        self._held, self._left = (z, merit), TRIAL

    def note(self, step: float) -> None:
        """Note the part of a Newton step that the line search has taken."""
        self._short = self._short + 1 if step < SHORT else 0
