"""First guess for bodies that only contact holds: rigid motion onto an elastic foundation."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.contact import Contact
from qsdolfinx.system.blocks import Sides
from qsdolfinx.system.rigid_modes import RigidMotion

Array = npt.NDArray[np.float64]

#: No guess is made if contact at the start leaves less than this part of the loads unbalanced.
BALANCED = 0.5

_TOLERANCE = 1e-3
_MAX_STEPS = 30
_MAX_BISECTIONS = 30
_MAX_DOUBLINGS = 60


class Foundation:
    """Rigid bodies under load that press on each other through springs (Winkler's foundation).

    Minimises Π(q) = ½ Σ ε_c S_k [ḡ_k + (G q)_k]₊² + r·q over the rigid motions q that Dirichlet
    conditions leave free; r is the residual of the loads. The stiffness ε_c = E/ℓ of the springs of
    a contact is that of a half-space under a patch of the size ℓ that is found closed. For a
    cylinder on a half-space the width of the contact is then nearly right.

    There is no matrix to factorise, and Newton's method starts from an active set near the right
    one, not from a single point or the whole surface, from where it would take a step per facet.

    Args:
        rigid: Rigid motions of the bodies.
        contacts: Contacts, evaluated at the start.
        sides: Bodies of each contact.
        moduli: E of each contact, stress.
        residual: Residual of the bulk forms at the start, owned unknowns of each body.
    """

    def __init__(
        self,
        rigid: RigidMotion,
        contacts: typing.Sequence[Contact],
        sides: Sides,
        moduli: typing.Sequence[float],
        residual: typing.Sequence[Array],
    ) -> None:
        self._comm: MPI.Intracomm = contacts[0].comm
        self._area_dim = contacts[0].slave.area_dim
        self._moduli = np.asarray(moduli)
        self._motions = rigid.free_motions
        gap, weight, tied, number, change = [], [], [], [], []
        for i, (contact, side) in enumerate(zip(contacts, sides, strict=True)):
            for p in contact.passes:
                width = p.values.shape[1]
                gap.append(p.values.ravel())
                weight.append(np.repeat(p.weight, width))
                tied.append(np.full(p.values.size, p.law.linear))
                number.append(np.full(p.values.size, i))
                slave, master = contact.ordered(p, side)
                change.append(rigid.gap_changes(p, (slave, master)) @ self._motions)
        self._gap, self._weight = np.concatenate(gap), np.concatenate(weight)
        self._tied, self._contact = np.concatenate(tied), np.concatenate(number)
        self._G = np.concatenate(change)
        self._r = self._motions.T @ rigid.work(residual)
        self._eps = self._springs(np.ones(len(self._gap), dtype=bool))
        pressure = np.where(self._closed(np.zeros(len(self._r))), self._gap, 0.0)
        forces = np.abs(self._G).T @ np.abs(pressure * self._eps * self._weight)
        forces = self._comm.allreduce(forces, op=MPI.SUM)
        #: Size of the loads and of the springs' forces at the start. Where springs press against
        #: each other, as between two dies, their difference may be nothing but rounding errors.
        self._size = float(np.linalg.norm(self._r) + np.linalg.norm(forces))

    def _springs(self, closed: npt.NDArray[np.bool_]) -> Array:
        """Stiffness at each row, for patches of these closed rows."""
        area = np.bincount(self._contact[closed], self._weight[closed], minlength=len(self._moduli))
        size = self._comm.allreduce(area, op=MPI.SUM) ** (1 / self._area_dim)
        eps = np.divide(self._moduli, size, out=self._moduli.copy(), where=size > 0)
        return np.asarray(eps[self._contact])

    def _closed(self, q: Array) -> npt.NDArray[np.bool_]:
        return self._tied | (self._gap + self._G @ q > 0)

    def _gradient(self, q: Array) -> Array:
        gap = self._gap + self._G @ q
        pressure = np.where(self._tied | (gap > 0), gap, 0) * self._eps * self._weight
        return np.asarray(self._comm.allreduce(self._G.T @ pressure, op=MPI.SUM) + self._r)

    def _hessian(self, q: Array) -> Array:
        stiffness = np.where(self._closed(q), self._eps * self._weight, 0)
        return np.asarray(self._comm.allreduce((self._G.T * stiffness) @ self._G, op=MPI.SUM))

    def _direction(self, q: Array, gradient: Array) -> Array:
        """Newton's; down the gradient where that is in motions that no spring resists."""
        values, vectors = np.linalg.eigh(self._hessian(q))
        stiff = values > 1e-10 * max(values.max(), 1e-300)
        along = vectors.T @ gradient
        if np.linalg.norm(along[~stiff]) > _TOLERANCE * self._size:
            return np.asarray(-vectors[:, ~stiff] @ along[~stiff])
        return np.asarray(-vectors[:, stiff] @ (along[stiff] / values[stiff]))

    def _step(self, q: Array, direction: Array) -> float | None:
        """Where Π is least along a direction; None if it falls for ever."""
        scale = self._comm.allreduce(np.max(np.abs(self._G @ direction), initial=0), op=MPI.MAX)
        reach = self._comm.allreduce(np.max(np.abs(self._gap), initial=0), op=MPI.MAX)
        largest = self._comm.allreduce(np.max(np.abs(self._G), initial=0), op=MPI.MAX)
        if scale <= 1e-12 * largest * np.linalg.norm(direction):
            return None  # sliding: gaps do not change but for rounding errors
        low, high = 0.0, max(reach, 1e-300) / scale
        for _ in range(_MAX_DOUBLINGS):
            if direction @ self._gradient(q + high * direction) > 0:
                break
            low, high = high, 2 * high
        else:
            return None
        for _ in range(_MAX_BISECTIONS):
            middle = 0.5 * (low + high)
            if direction @ self._gradient(q + middle * direction) > 0:
                high = middle
            else:
                low = middle
        return high

    def settle(self) -> Array | None:
        """Coefficients of the rigid modes of all bodies; None if nothing stops the bodies."""
        q: Array = np.zeros(len(self._r))
        for _ in range(3):
            for _ in range(_MAX_STEPS):
                gradient = self._gradient(q)
                if np.linalg.norm(gradient) <= _TOLERANCE * self._size:
                    break
                direction = self._direction(q, gradient)
                step = self._step(q, direction)
                if step is None:
                    return None
                q = q + step * direction
            self._eps = self._springs(self._closed(q))
        return np.asarray(self._motions @ q)
