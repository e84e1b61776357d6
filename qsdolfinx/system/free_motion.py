"""Regularise the tangent of unsupported rigid bodies, so that it can be factorised."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.surface.unknowns import owned_vertices
from qsdolfinx.system.blocks import Sides
from qsdolfinx.system.body import Body
from qsdolfinx.system.rigid_modes import RigidMotion, displacement_space
from qsdolfinx.system.tangent import Tangent

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Value added to the diagonal of the tangent, relative to its mean. Results do not depend on it;
#: with less than 1e-14, the matrix would stay singular: ``tests/system/test_hold.py``.
SHIFT = 1e-9


class Hold:
    """Add a small value to the diagonal of bodies with a free rigid motion, only in the tangent.

    A workpiece between frictionless dies can slide: neither Dirichlet conditions nor active
    contacts resist. For such a motion, Newton's method becomes the proximal point method. The
    residual is not changed, so that the solution does not depend on the added value. Where
    equilibrium does not determine the motion, the method finds the solution next to the first
    guess. In a single AIJ matrix of linear bodies, the values accumulate over the iterations, away
    from contact: the longer Newton's method takes to bring a body to equilibrium, the better
    conditioned is the matrix.

    Args:
        rigid: Rigid motions of the bodies.
        bodies: The bodies.
        contacts: The contacts, after contact detection.
        sides: Bodies of each contact.
    """

    def __init__(
        self,
        rigid: RigidMotion,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
    ) -> None:
        self._bodies, self._contacts, self._rigid = bodies, contacts, rigid
        self._sides = sides
        self._motions = rigid.free_motions
        #: Motions for which a value was added last, (modes of all bodies, motions).
        self.held: Array = self._motions[:, :0]
        #: Changes of the gaps of each integration side by the motions.
        self._changes: list[list[Array]] = []
        if self._motions.shape[1] == 0:
            return
        self._changes = self._found()

    def _found(self) -> list[list[Array]]:
        """Compute ``_changes``."""
        found = []
        for contact, side in zip(self._contacts, self._sides, strict=True):
            changes = []
            for p in contact.gaps:
                change = self._rigid.gap_changes(p, contact.ordered(p, side))
                changes.append(change @ self._motions)
            found.append(changes)
        return found

    def free_motions(self, closed: typing.Sequence[Flags] | None = None) -> Array:
        """Motions that active contacts do not resist either, (modes of all bodies, motions).

        Collective.

        Args:
            closed: Active constraints of each integration side; by default those of the last
                evaluation.
        """
        count = self._motions.shape[1]
        stiffness, whole = np.zeros((count, count)), np.zeros((count, count))
        if count == 0:
            return self._motions
        passes = [(c, p) for c in self._contacts for p in c.gaps]
        if any(p.following is not None for _, p in passes):
            self._changes = self._found()  # points change at each evaluation
        if closed is None:
            closed = [active_set.closed(contact, p) for contact, p in passes]
        changes = [change for of_contact in self._changes for change in of_contact]
        for (contact, p), change, rows in zip(passes, changes, closed, strict=True):
            weight = np.repeat(p.weight * contact.eps, p.operator.width)
            resisting = weight * np.repeat(rows, p.operator.width)
            whole += (change.T * weight) @ change
            stiffness += (change.T * resisting) @ change
        comm: MPI.Intracomm = self._bodies[0].comm
        stiffness, whole = comm.allreduce(np.array([stiffness, whole]), op=MPI.SUM)
        values, vectors = np.linalg.eigh(stiffness)
        return np.asarray(self._motions @ vectors[:, values <= ROUNDING * np.trace(whole)])

    def add_to(self, tangent: Tangent) -> None:
        """Add the value to the diagonal blocks of bodies in such motions. Collective.

        Args:
            tangent: The assembled tangent.
        """
        free = self.held = self.free_motions()
        first = 0
        for i, body in enumerate(self._bodies):
            count = len(self._rigid.modes[i])
            if free.shape[1] and np.abs(free[first : first + count]).max(initial=0.0) > 1e-8:
                tangent.renew()
                _shift(body, tangent, i)
            first += count


def _shift(body: Body, tangent: Tangent, i: int) -> None:
    """Add a part of the mean diagonal at free displacements of vertices. Collective."""
    V = displacement_space(body.V)
    assert V is not None
    dofs = np.setdiff1d(owned_vertices(V)[0].ravel(), body.owned_constrained)
    diagonal = tangent.diagonal(i)
    values = diagonal[dofs]
    total = body.comm.allreduce(np.array([np.abs(values).sum(), len(values)]), op=MPI.SUM)
    diagonal[dofs] = values + SHIFT * total[0] / total[1]
    tangent.set_diagonal(i, diagonal)
