"""Compute rigid motions of loaded bodies and tools on an elastic foundation."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.equations import UNBALANCED

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Springs:
    """Springs of a foundation at the constraints of one integration side of a contact.

    Attributes:
        gap: The integration side, evaluated at the start of the motions.
        change: Change of its gaps with the motions, shape (values of the gaps, motions).
        modulus: E of the contact, stress.
        contact: Number of the contact: its constraints share a patch.
    """

    gap: WeightedGap
    change: Array
    modulus: float
    contact: int


class Foundation:
    """Rigid bodies under load that are pressed together through springs (Winkler foundation).

    Minimises Π(q) = ½ Σ ε_c S_k [ḡ_k + (G q)_k]₊² + r·q over motions q of bodies or tools. The
    stiffness ε_c = E/ℓ of the springs of a contact is that of a half-space under a patch of size ℓ,
    the size of the active part. For a cylinder on a half-space the width of the contact is then
    nearly right.

    No matrix is factorised, and Newton's method for the bodies starts from an active set near the
    solution. From a single point or the whole surface it would take one step per facet.

    Args:
        springs: Springs of all integration sides.
        loads: r, work of the loads against each motion, the same on all ranks, shape (motions,).
    """

    def __init__(self, springs: typing.Sequence[Springs], loads: Array) -> None:
        slave = springs[0].gap.slave
        self._comm: MPI.Intracomm = slave.comm
        self._area_dim = slave.area_dim
        self._moduli = np.zeros(1 + max(s.contact for s in springs))
        for s in springs:
            self._moduli[s.contact] = s.modulus
        self._gap = np.concatenate([s.gap.state.values.ravel() for s in springs])
        self._weight = np.concatenate(
            [np.repeat(s.gap.weight, s.gap.state.values.shape[1]) for s in springs]
        )
        counts = [s.gap.state.values.size for s in springs]
        self._tied = np.repeat([s.gap.law.linear for s in springs], counts)
        self._contact = np.repeat([s.contact for s in springs], counts)
        self._G = np.concatenate([s.change for s in springs])
        self._r = loads
        self._eps = self._springs(np.ones(len(self._gap), dtype=bool))
        pressure = np.where(self._closed(np.zeros(len(self._r))), self._gap, 0.0)
        forces = np.abs(self._G).T @ np.abs(pressure * self._eps * self._weight)
        forces = self._comm.allreduce(forces, op=MPI.SUM)
        #: Size of the loads and of the spring forces at the start. Where springs act against each
        #: other, as between two dies, their difference may consist of rounding errors only.
        self._size = float(np.linalg.norm(self._r) + np.linalg.norm(forces))

    def _springs(self, closed: npt.NDArray[np.bool_]) -> Array:
        """Stiffness at each constraint, for patches of these active constraints."""
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
        """Newton direction; steepest descent if no spring resists the gradient."""
        values, vectors = np.linalg.eigh(self._hessian(q))
        stiff = values > 1e-10 * max(values.max(), 1e-300)
        along = vectors.T @ gradient
        if np.linalg.norm(along[~stiff]) > UNBALANCED * self._size:
            return np.asarray(-vectors[:, ~stiff] @ along[~stiff])
        return np.asarray(-vectors[:, stiff] @ (along[stiff] / values[stiff]))

    def _step(self, q: Array, direction: Array) -> float | None:
        """Step length that minimises Π along a direction; None if Π is unbounded."""
        change = self._G @ direction
        scale = self._comm.allreduce(np.max(np.abs(change), initial=0), op=MPI.MAX)
        reach = self._comm.allreduce(np.max(np.abs(self._gap), initial=0), op=MPI.MAX)
        largest = self._comm.allreduce(np.max(np.abs(self._G), initial=0), op=MPI.MAX)
        if scale <= 1e-12 * largest * np.linalg.norm(direction):
            return None  # sliding: gaps change by rounding errors only
        # Bracket: the width of the gaps, or the deflection if the springs at all constraints act.
        stiffness = self._comm.allreduce(self._eps * self._weight @ change**2, op=MPI.SUM)
        low, high = 0.0, max(reach / scale, abs(direction @ self._gradient(q)) / stiffness)
        for _ in range(60):  # until the force changes its sign: 2^60 is beyond any scene
            if direction @ self._gradient(q + high * direction) > 0:
                break
            low, high = high, 2 * high
        else:
            return None
        for _ in range(30):  # 2^-30 of the step is below the tolerance
            middle = 0.5 * (low + high)
            if direction @ self._gradient(q + middle * direction) > 0:
                high = middle
            else:
                low = middle
        return high

    def settle(self) -> Array | None:
        """Compute the motions q; None if nothing stops them. Collective."""
        q: Array = np.zeros(len(self._r))
        for _ in range(3):
            for _ in range(30):  # there are six unknowns a body
                gradient = self._gradient(q)
                if np.linalg.norm(gradient) <= UNBALANCED * self._size:
                    break
                direction = self._direction(q, gradient)
                step = self._step(q, direction)
                if step is None:
                    return None
                q = q + step * direction
            self._eps = self._springs(self._closed(q))
        return q
