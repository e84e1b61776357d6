"""Multigrid that follows the tangent: what is kept, and when its spaces are stale."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.linear.multigrid import Aggregates, Multigrid
from qsdolfinx.linear.presets import FIRST, TIGHTEST
from qsdolfinx.system.body import Body
from qsdolfinx.system.sum import Sum

#: Spaces are chosen anew when a linear solve takes this many times the iterations of their first.
STALE = 1.5


class Hierarchy:
    """Multigrid for a tangent, and its first coarse spaces, which outlive it.

    They are those of the bodies without contact: they stay while contact's active set changes, and
    when it pairs anew.

    Args:
        ksp: The linear solver, whose pace tells whether the spaces still fit.
        bodies: The spaces of linear ones fit until their matrices change.
    """

    def __init__(self, ksp: PETSc.KSP, bodies: typing.Sequence[Body]) -> None:
        self._ksp, self._bodies = ksp, bodies
        self._multigrid: Multigrid | None = None
        self._spaces: dict[int, Aggregates] = {}
        self._states: list[int] = []
        self._first_pace: float | None = None
        #: Iterations per digit of the last solve of another solver; None if it was this one's.
        self.pace: float | None = None

    def forget(self) -> None:
        """Free multigrid, but not the spaces: there is, or will be, a new tangent. Collective."""
        if self._multigrid is not None:
            self._multigrid.destroy()
        self._multigrid = None

    def destroy(self) -> None:
        """Free all. Collective."""
        self.forget()
        self._forget_spaces()

    def update(
        self,
        pc: PETSc.PC,
        tangent: Sum,
        modes: typing.Sequence[list[PETSc.Vec]],
    ) -> None:
        """Follow a tangent that has changed. Collective.

        Args:
            pc: PETSc's preconditioner, of type "mg".
            tangent: The tangent.
            modes: Rigid modes of each body.
        """
        if self._is_stale():
            self._forget_spaces()
            self.forget()
        states = [body.num_assemblies if body.linear else 0 for body in self._bodies]
        if states != self._states:
            self.forget()
        if self._multigrid is None:
            self._follow_bodies((pc.getOptionsPrefix() or "") + FIRST, tangent, modes, states)
            spaces = [self._spaces[i] for i in range(len(states))]
            self._multigrid = Multigrid(pc, tangent, spaces, modes)
        self._multigrid.update()

    def _follow_bodies(
        self,
        prefix: str,
        tangent: Sum,
        modes: typing.Sequence[list[PETSc.Vec]],
        states: list[int],
    ) -> None:
        """Spaces of each body, the old ones where its matrix is another of the same body.

        Args:
            prefix: Of the options of the first coarsening.
            tangent: The tangent.
            modes: Rigid modes of each body.
            states: A number for each body that changes when a linear one's matrix does.
        """
        for i, ((K, stays), state) in enumerate(zip(tangent.bodies, states, strict=True)):
            kept = self._spaces.get(i)
            if kept is not None and self._states[i] == state:
                kept.follow(K)
                continue
            if kept is not None:
                kept.destroy()
            self._spaces[i] = Aggregates(K, stays, modes[i], prefix)
        self._states = states

    def _is_stale(self) -> bool:
        """Whether the last solve was slower than the first one with these spaces."""
        linear = all(body.linear for body in self._bodies)
        if linear or self._multigrid is None:
            return False
        digits = -np.log10(max(self._ksp.getTolerances()[0], TIGHTEST))
        pace = self._ksp.getIterationNumber() / digits if self.pace is None else self.pace
        if pace == 0:
            return False
        if self._first_pace is None:
            self._first_pace = pace
        return bool(pace > STALE * self._first_pace)

    def _forget_spaces(self) -> None:
        for space in self._spaces.values():
            space.destroy()
        self._spaces, self._states, self._first_pace = {}, [], None
