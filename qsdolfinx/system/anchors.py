"""Springs that anchor bodies which only contact holds to where they are, for a while."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.system.body import Body
from qsdolfinx.system.rigid_modes import RigidMotion
from qsdolfinx.system.tangent import Tangent

Array = npt.NDArray[np.float64]


class Anchors:
    """Adds k diag(K) (x − x₀) to the residual of free bodies, K being that of the bulk at first.

    Args:
        bodies: All bodies.
    """

    def __init__(self, bodies: typing.Sequence[Body]) -> None:
        self._bodies = bodies
        #: k; 0 for none.
        self.stiffness = 0.0
        self._from: list[Array] = []
        self._rows: list[npt.NDArray[np.int64]] = []
        self._forces: list[Array] = []

    @property
    def state(self) -> tuple[float, ...]:
        """What the tangent depends on."""
        return (self.stiffness,)

    def hold(self, rigid: RigidMotion, parts: typing.Sequence[Array], stiffness: float) -> None:
        """Anchor the bodies that conditions leave free.

        Args:
            rigid: Rigid motions of the bodies.
            parts: Owned unknowns of each body, where they are anchored.
            stiffness: k.
        """
        self.stiffness = stiffness
        self._from = [part.copy() for part in parts]
        self._rows, first = [], 0
        for i, body in enumerate(self._bodies):
            count = len(rigid.modes[i])
            free = np.abs(rigid.free_motions[first : first + count]).max(initial=0.0) > 1e-8
            rows = np.intersect1d(body.groups[0], body.free) if free else np.zeros(0, np.int64)
            self._rows.append(rows)
            first += count

    def release(self) -> None:
        """Take them away."""
        self.stiffness = 0.0

    def add_forces(self, residuals: typing.Sequence[Array], parts: typing.Sequence[Array]) -> None:
        """Add the springs' forces to residuals of the bodies' owned unknowns."""
        if self.stiffness == 0:
            return
        self._forces = []
        for i, body in enumerate(self._bodies):
            rows = self._rows[i]
            moved = parts[i][rows] - self._from[i][rows]
            self._forces.append(self.stiffness * body.diagonal[rows] * moved)
            residuals[i][rows] += self._forces[i]

    def add_to(self, tangent: Tangent) -> None:
        """Add the springs' stiffness to the tangent, until it is assembled again. Collective."""
        if self.stiffness == 0:
            return
        tangent.renew()
        for i, body in enumerate(self._bodies):
            if body.comm.allreduce(len(self._rows[i]), op=MPI.SUM):
                diagonal = tangent.diagonal(i)
                diagonal[self._rows[i]] += self.stiffness * body.diagonal[self._rows[i]]
                tangent.set_diagonal(i, diagonal)

    def share(self) -> float:
        """Norm of the springs' forces over that of contact's, at the last evaluation. Collective.

        Of the body where it is largest; infinite where contact bears nothing.
        """
        squares = np.zeros((2, len(self._bodies)))
        for i, body in enumerate(self._bodies):
            rows = self._rows[i]
            contact = body.force.array_r[rows]
            squares[:, i] = self._forces[i] @ self._forces[i], contact @ contact
        own, contact = np.sqrt(self._bodies[0].comm.allreduce(squares, op=MPI.SUM))
        shares = np.divide(own, contact, out=np.full(len(own), np.inf), where=contact > 0)
        return float(np.max(shares[own > 0], initial=0.0))
