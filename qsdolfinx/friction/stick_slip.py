"""How Newton's method gets from stick to slip and back: the rows that need care."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.laws import Friction, Limited, Response

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Times that a row may open before it loses the friction that jumps when it opens.
MAX_OPENINGS = 3

#: Times that a row whose slip turns is made to stick, before it gets Kačanov's rigidity instead.
MAX_STICKS = 3

#: Most iterations of Kačanov's rigidity after one more turn. With more, some solves take too many.
MAX_WAIT = 4


class StickSlip:
    """Remedies for what full Newton steps do to friction, row by row.

    A slipping node has no stiffness along its slip, so that steps may throw it back and forth
    across the state in which it sticks. A node whose slip has turned is evaluated as if it had to
    stick, so that the next step says whether it can, or which way it slips (as in primal-dual
    active-set methods). After some turns, or under a line search, which must not see residuals of
    another law, it has the rigidity of Kačanov's iteration instead, |τ| over the slip that the
    trial stands for, |τ̂ + ε g|/ε, in all directions.

    A law whose limit does not vanish with the pressure lets τ jump to zero where a node opens. One
    Newton's method on all unknowns gives nodes that can then be neither open nor closed with all of
    τ a part of it, see ``fill``. Elsewhere they have none, once they have opened several times,
    until the solve ends or :meth:`give_back` is called.

    Args:
        friction: The law.
        rows: Number of rows.
        gdim: Components of τ.
    """

    def __init__(self, friction: Friction, rows: int, gdim: int) -> None:
        self._limited, self._jumps = isinstance(friction, Limited), friction.jumps
        self._shape = rows, gdim
        self.begin_solve()
        self.begin_iterations(False)
        self.end_iterations()

    def begin_solve(self) -> None:
        """Forget which rows have opened, and to which friction was given back."""
        self._given_back: Flags = np.zeros(self._shape[0], dtype=bool)
        self.begin_attempt()

    def begin_attempt(self) -> None:
        """Forget which rows have opened: with another line search they need not."""
        self._was_closed: Flags = np.zeros(self._shape[0], dtype=bool)
        self._openings: npt.NDArray[np.int64] = np.zeros(self._shape[0], dtype=np.int64)

    def begin_iterations(self, full_steps: bool, from_stick: bool = False) -> None:
        """Forget how slip has turned in earlier iterations.

        Args:
            full_steps: Whether rows may be made to stick.
            from_stick: Whether all rows that slip are made to, until this is called again.
        """
        self._may_stick = full_steps and self._limited
        self._all_stick = from_stick and self._limited
        self._last: Array = np.zeros(self._shape)
        self._turns: npt.NDArray[np.int64] = np.zeros(self._shape[0], dtype=np.int64)
        self._wait: npt.NDArray[np.int64] = np.zeros(self._shape[0], dtype=np.int64)
        self._turned: Flags = np.zeros(self._shape[0], dtype=bool)

    def end_iterations(self) -> None:
        """Make no row stick any more."""
        self._may_stick = self._all_stick = False

    @property
    def without_friction(self) -> Flags:
        """Rows that have lost their friction."""
        return np.asarray(self._openings >= (MAX_OPENINGS if self._jumps else np.inf))

    @property
    def careful(self) -> Flags:
        """Rows that have Kačanov's rigidity."""
        return np.asarray(self._wait > 0)

    def made_to_stick(self, response: Response) -> Flags:
        """Rows to evaluate again without a limit; to be called for each evaluation."""
        along = np.sum(response.traction * self._last, axis=1)
        self._turned = (along < 0) & response.slipping
        if self._all_stick:
            return response.slipping
        return self._turned & (self._turns < (MAX_STICKS if self._may_stick else 0))

    def note(self, response: Response, closed: Flags, stuck: Flags) -> None:
        """Take in the state for which there is going to be a tangent.

        Args:
            response: Of the last evaluation.
            closed: Rows in contact there.
            stuck: Rows that were made to stick there.
        """
        self._openings += self._was_closed & ~closed
        self._was_closed = closed
        self._turns += self._turned
        self._wait = np.maximum(self._wait - 1, 0)
        waiting = self._turned & ~stuck
        self._wait[waiting] = np.minimum(2 * self._turns[waiting], MAX_WAIT)
        self._last = np.where(stuck[:, None], 0.0, response.traction)

    def give_back(self, closed: Flags) -> bool:
        """Give friction back, once in a solve, to closed rows that have lost it.

        For the end of Newton's method: rows also open because it is far from the solution.

        Returns:
            Whether this rank has such rows.
        """
        rows = self.without_friction & closed & ~self._given_back
        self._openings[rows] = 0
        self._given_back |= rows
        return bool(rows.any())
