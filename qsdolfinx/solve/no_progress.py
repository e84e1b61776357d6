"""Recognise that Newton's method makes no progress, and say why it has not converged."""

from __future__ import annotations

import hashlib
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.system.passes import State
from qsdolfinx.system.system import ContactSystem

#: Relative difference of merits, and of parts of steps, up to which iterates count as the same.
#: With less, cycles that converge are not seen; with more, slow convergence counts as a cycle.
SAME = 0.01


class _Iterate(typing.NamedTuple):
    """One iterate.

    Attributes:
        merit: Norm of all equations, as forces.
        step: Part of the Newton step that has led to it.
        sets: Hash of the active and stick sets on this rank.
        closed: Active constraints of each contact on this rank.
    """

    merit: float
    step: float
    sets: bytes
    closed: list[int]


class Progress:
    """Iterates of one run of Newton's method with a line search.

    The line search takes a full step if no part of the step decreases the merit. The run then
    leaves a local minimum of the merit. It makes no progress if iterates repeat: in two successive
    periods all active and stick sets, all parts of steps and all merits are the same. The next
    iterate is a function of the last one, up to settings that depend on the same norms. That the
    merit rises again and again is no sign: from a poor start it may do so before it converges.

    Args:
        system: The system.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        self._iterates: list[_Iterate] = []

    def add(self, at: State, merit: float, step: float, closed: list[int]) -> None:
        """Add an iterate.

        Args:
            at: The evaluation.
            merit: Its merit, the same on all ranks.
            step: Part of the Newton step that has led to it, the same on all ranks.
            closed: Active constraints of each contact on this rank.
        """
        flags = b"".join(e.closed.tobytes() + e.sticking.tobytes() for e in at.passes)
        sets = hashlib.blake2b(flags, digest_size=16).digest()
        self._iterates.append(_Iterate(merit, step, sets, closed))

    def fault(self) -> str | None:
        """Describe why there is no progress, None if there may be some. Collective."""
        period = self._period()
        if period is None:
            return None
        return f"active sets and residual repeat every {period} iterations{self._sets(period)}"

    def late(self) -> str:
        """Describe the last iterates of a run that has reached its last iteration. Collective."""
        last = self._iterates[-10:]
        first, now = last[0].merit, last[-1].merit
        text = f"in the last {len(last) - 1} iterations the residual of all equations went from "
        text += f"{first:.3g} to {now:.3g}"
        num_short = sum(each.step < 0.25 for each in last)
        if 2 * num_short > len(last):
            text += f", and {num_short} steps were cut to less than 0.25"
        return text + self._sets(len(last))

    def _period(self) -> int | None:
        """Period with which the last iterates repeat, of at least two; else None. Collective."""
        iterates = self._iterates
        norms = np.array([[each.merit, each.step] for each in iterates])
        for period in range(2, len(iterates) // 2 + 1):
            now, before = norms[-period:], norms[-2 * period : -period]
            if np.any(np.abs(now - before) > SAME * np.maximum(now, before)):
                continue
            sets = [each.sets for each in iterates[-2 * period :]]
            of_rank = sets[period:] == sets[:period], len(set(sets)) == 1
            both = np.array(of_rank, dtype=bool)
            self._system.comm.Allreduce(MPI.IN_PLACE, both, op=MPI.LAND)
            if both[0] and not both[1]:
                return period
        return None

    def _sets(self, count: int) -> str:
        """Contacts whose active sets change in the last iterates, as the end of a sentence."""
        contacts = self._system.contacts
        counts: npt.NDArray[np.int64] = np.array([each.closed for each in self._iterates[-count:]])
        counts = self._system.comm.allreduce(counts.astype(np.int64), op=MPI.SUM)
        if not counts.size:
            return ""
        low, high = counts.min(axis=0), counts.max(axis=0)
        texts = [
            f"{contact.called(i)} has between {low[i]} and {high[i]} active constraints"
            for i, contact in enumerate(contacts)
            if low[i] < high[i]
        ]
        return f"; {', '.join(texts)}" if texts else "; the number of active constraints stays"
