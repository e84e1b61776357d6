"""Update multigrid for a changing tangent, with the first coarse spaces of the bodies."""

from __future__ import annotations

import typing

from petsc4py import PETSc

from qsdolfinx.linear.multigrid import Aggregates, Multigrid
from qsdolfinx.linear.presets import FIRST
from qsdolfinx.system.body import Body
from qsdolfinx.system.sum import Sum


class Hierarchy:
    """Multigrid for a tangent, and its first coarse spaces, which are kept for later tangents.

    The spaces are those of the bodies without contact. They are kept when the active set or the
    contact pairs change, and as nonlinear bodies deform: new ones would need as many iterations.

    Args:
        bodies: The bodies. Spaces of linear bodies fit until the matrices change.
    """

    def __init__(self, bodies: typing.Sequence[Body]) -> None:
        self._bodies = bodies
        self._multigrid: Multigrid | None = None
        self._spaces: dict[int, Aggregates] = {}
        self._states: list[int] = []

    def forget(self) -> None:
        """Free multigrid, but not the spaces, before a new tangent. Collective."""
        if self._multigrid is not None:
            self._multigrid.destroy()
        self._multigrid = None

    def destroy(self) -> None:
        """Free all. Collective."""
        self.forget()
        for space in self._spaces.values():
            space.destroy()
        self._spaces, self._states = {}, []

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
