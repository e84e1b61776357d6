"""Update multigrid for a changing tangent, and decide when its coarse spaces are stale."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.linear.multigrid import Aggregates, Multigrid
from qsdolfinx.linear.presets import FIRST, TIGHTEST
from qsdolfinx.system.body import Body
from qsdolfinx.system.sum import Sum

#: Iterations of a linear solve, over those of the first solve with the same spaces, above which the
#: spaces are made again. With 1 they would be made again each time, with much more never.
STALE = 1.5


class Hierarchy:
    """Multigrid for a tangent, and its first coarse spaces, which are kept for later tangents.

    The spaces are those of the bodies without contact. They are kept when the active set or the
    contact pairs change.

    Args:
        ksp: The linear solver; its rate of convergence shows whether the spaces still fit.
        bodies: The bodies. Spaces of linear bodies fit until the matrices change.
    """

    def __init__(self, ksp: PETSc.KSP, bodies: typing.Sequence[Body]) -> None:
        self._ksp, self._bodies = ksp, bodies
        self._multigrid: Multigrid | None = None
        self._spaces: dict[int, Aggregates] = {}
        self._states: list[int] = []
        self._first_pace: float | None = None
        #: Iterations per digit of the last solve, if by another solver; None if it was by this one.
        self.pace: float | None = None

    def forget(self) -> None:
        """Free multigrid, but not the spaces, before a new tangent. Collective."""
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
        """Update for a tangent that has changed. Collective.

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
        """Update the spaces of each body; old spaces are kept if only the matrix has changed.

        Args:
            prefix: Prefix of the options of the first coarsening.
            tangent: The tangent.
            modes: Rigid modes of each body.
            states: A number for each body that changes when the matrix of a linear body changes.
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
