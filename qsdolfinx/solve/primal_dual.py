"""Primal-dual active sets: unknowns and multipliers from one linear system for each active set."""

from __future__ import annotations

import hashlib
import typing

import numpy as np

from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.solve.newton import Newton

#: Solves after which Uzawa's method goes on.
MAX_SOLVES = 12

#: Residual, relative to the one before, with which the next active set is looked for.
LOOSE = 0.1

#: The same that a solve has to reach which takes too many iterations, to go on in another.
SLOW = 0.01


class PrimalDual:
    """Solves for unknowns and multipliers until the active set stays.

    Rows whose multipliers would pull open for the next solve, those whose gaps are negative close
    (Hintermüller, Ito and Kunisch, 2002). At nodes without pressure the sets may take turns: that
    is noticed, and left to Uzawa's method.

    Args:
        newton: With a linear solver that has :meth:`LinearSolver.solve_saddle_point`.
        contacts: Contacts with an augmented Lagrangian.
    """

    def __init__(self, newton: Newton, contacts: typing.Sequence[ContactModel]) -> None:
        self._newton, self._system = newton, newton.system
        self._contacts = contacts
        #: Whether the last solve was given up since a direct solver would have been faster.
        self.crawls = False

    def close(self, stays: bool) -> bool:
        """Close the gaps, from the last evaluation on. Collective.

        Args:
            stays: Whether the active set is expected to stay, so that one exact solve does.

        Returns:
            Whether they were closed, and forces balanced. Otherwise unknowns and multipliers are
            those of the last system that could be solved.
        """
        self.crawls = False
        now, seen, exact = self.digest(), set(), stays
        for _ in range(MAX_SOLVES):
            seen.add(now)
            left = self._solve(exact)
            if left > LOOSE:
                break
            before, now = now, self.digest()
            if now == before and left == 0:
                self._admit()
                return True
            if now != before and now in seen:
                if exact:
                    break
                seen, exact = set(), True  # it may be for what inexact solves leave
            else:
                exact = exact or now == before
        self._admit()
        return False

    def _solve(self, exact: bool) -> float:
        """Solve as if the active set stayed, and evaluate; the part of the residual that is left.

        Zero if that is all that is asked for, infinite if there is no system.
        """
        system, newton = self._system, self._newton
        residual = system.residual(system.x.array_r)
        newton.assemble()
        measures, limits = newton.measure()
        rounding = float(np.linalg.norm(measures.settled))
        until, part = float(limits.min()), 0.0 if exact else LOOSE
        saddle = newton.linear.solve_saddle_point(residual, until, rounding, part)
        if saddle is None:
            return np.inf
        self.crawls = saddle.crawls
        newton.record.iterations += 1
        newton.record.linear_iterations += saddle.num_iterations
        if not (saddle.converged or saddle.left <= SLOW):
            return np.inf
        system.x.array[:] += saddle.change
        for contact, multiplier in zip(self._contacts, saddle.multipliers, strict=True):
            contact.gaps[0].state.augmented = multiplier
        norm = system.norm(system.residual(system.x.array_r))
        newton.record.add(norm, system.num_active_local())
        if saddle.converged:
            return 0.0 if exact else LOOSE
        return saddle.left

    def _admit(self) -> None:
        """Leave no multiplier that pulls. Collective."""
        for contact in self._contacts:
            p = contact.gaps[0]
            p.state.augmented = p.law.admissible(p.state.augmented)
        self._system.residual(self._system.x.array_r)

    def digest(self) -> bytes:
        """Of the active sets of all ranks. Collective."""
        local = b"".join(active_set.active_state(contact) for contact in self._contacts)
        parts = self._system.comm.allgather(hashlib.blake2b(local, digest_size=16).digest())
        return hashlib.blake2b(b"".join(parts)).digest()
