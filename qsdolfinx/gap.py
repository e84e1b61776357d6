"""The weighted gap of one pass: where the multiplier lives and what it acts on."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx import _cpp
from qsdolfinx.laws import Law
from qsdolfinx.surface import Surface

Array = npt.NDArray[np.float64]
#: Vectors of the slave's and of the master's body.
Vecs = tuple[PETSc.Vec, PETSc.Vec]


class WeightedGap:
    """ḡ_k = (1/S_k) Σ_p w_p N_k(ξ_p) [(u_s − u_m)·n_p − δ_p] on the slave nodes of this rank.

    A jump law weights the vector u_s − u_m instead. One row per slave node that a pairing point
    reaches.

    With an augmented Lagrangian, the law sees the gap ḡ + λ̂/ε, λ̂ being the multiplier so far: it
    then gives λ = [λ̂ + ε ḡ]₊ or λ̂ + ε ⟦u⟧. With λ̂ = 0 that is the penalty method.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        points: Pairing points of the two.
        law: What the gap is used for.
        share: Part of the energy Σ S_k φ(ḡ_k) that this pass stands for.
        slave_only: Whether its forces act on the slave alone.
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface,
        points: _cpp.PairingPoints,
        law: Law,
        share: float,
        slave_only: bool,
    ) -> None:
        self.slave = slave
        self.master = master
        self.points = points
        self.law = law
        self.slave_only = slave_only
        self.operator = _cpp.GapOperator(
            slave._cpp_object, master._cpp_object, points, jump=law.jump
        )
        #: Slave node of each row, an index into the arrays of the slave surface.
        self.row_node: npt.NDArray[np.int64] = self.operator.row_node
        #: Area in the energy of each row, S_k times the share.
        self.weight: Array = share * slave.node_area[self.row_node]
        shape = (self.operator.num_rows, self.operator.width)
        #: ḡ of the last evaluation, shape (rows, 1) or (rows, gdim); at first that of u = 0.
        self.values: Array = np.zeros(shape)
        if not law.jump:
            self.values[:, 0] = -self.operator.initial_gap
        #: λ̂, of the same shape.
        self.augmented: Array = np.zeros(shape)

    def evaluate(self, u: Vecs) -> None:
        """Compute the weighted gaps for displacements u. Collective."""
        self.values = self.operator.apply(u[0].handle, u[1].handle)
        if not self.law.jump:
            self.values[:, 0] -= self.operator.initial_gap

    def multiplier(self, penalty: float) -> Array:
        """λ at the last evaluation, shape (rows, 1) or (rows, gdim)."""
        return self.law.multiplier(self._shifted(penalty), penalty)

    def slope(self, penalty: float, touching: float) -> Array:
        """∂λ/∂ḡ at the last evaluation, shape (rows,)."""
        return self.law.slope(self._shifted(penalty), penalty, touching)

    def energy(self, penalty: float) -> float:
        """This rank's part of the energy at the last evaluation."""
        density = self.law.energy(self._shifted(penalty), penalty)
        return float(self.weight @ (density - np.sum(self.augmented**2, axis=1) / (2 * penalty)))

    def violation(self, penalty: float) -> float:
        """Largest gap that λ̂ leaves on this rank: |λ − λ̂| / ε, which is |ḡ| where it is closed."""
        change = self.multiplier(penalty) - self.augmented
        return float(np.max(np.linalg.norm(change, axis=1), initial=0.0)) / penalty

    def _shifted(self, penalty: float) -> Array:
        return self.values + self.augmented / penalty

    def add_forces(self, multiplier: Array, b: Vecs) -> None:
        """Add Gᵀ S λ to b, the derivative of the energy. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * multiplier)
        self.operator.add_transpose(force, b[0].handle, b[1].handle, self.slave_only)

    def add_stiffness(
        self, slope: Array, blocks: typing.Sequence[PETSc.Mat], pattern: bool
    ) -> None:
        """Add Gᵀ S diag(slope) G to the blocks (ss, sm, ms, mm), or only fix their pattern."""
        handles = [mat.handle for mat in blocks]
        _cpp.insert_contact(self.operator, self.weight * slope, handles, self.slave_only, pattern)

    def on_nodes(self, rows: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Spread values of the rows over all owned nodes of the slave surface."""
        out = np.full((len(self.slave.node_area), *rows.shape[1:]), missing, dtype=rows.dtype)
        out[self.row_node] = rows
        return out
