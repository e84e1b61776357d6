"""The weighted gap of one pass: where the multiplier lives and what it acts on."""

from __future__ import annotations

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

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        points: Pairing points of the two.
        law: What the gap is used for.
        share: Part of the energy Σ S_k φ(ḡ_k) that this pass stands for.
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface,
        points: _cpp.PairingPoints,
        law: Law,
        share: float,
    ) -> None:
        self.slave = slave
        self.master = master
        self.points = points
        self.law = law
        self.operator = _cpp.GapOperator(
            slave._cpp_object, master._cpp_object, points, jump=law.jump
        )
        #: Slave node of each row, an index into the arrays of the slave surface.
        self.row_node: npt.NDArray[np.int64] = self.operator.row_node
        #: Area in the energy of each row, S_k times the share.
        self.weight: Array = share * slave.node_area[self.row_node]
        #: ḡ of the last evaluation, shape (rows, 1) or (rows, gdim); at first that of u = 0.
        self.values: Array = np.zeros((self.operator.num_rows, self.operator.width))
        if not law.jump:
            self.values[:, 0] = -self.operator.initial_gap

    def evaluate(self, u: Vecs) -> None:
        """Compute the weighted gaps for displacements u. Collective."""
        self.values = self.operator.apply(u[0].handle, u[1].handle)
        if not self.law.jump:
            self.values[:, 0] -= self.operator.initial_gap

    def add_forces(self, multiplier: Array, b: Vecs) -> None:
        """Add Gᵀ S λ to b, the derivative of the energy. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * multiplier)
        self.operator.add_transpose(force, b[0].handle, b[1].handle)

    def on_nodes(self, rows: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Spread values of the rows over all owned nodes of the slave surface."""
        out = np.full((len(self.slave.node_area), *rows.shape[1:]), missing, dtype=rows.dtype)
        out[self.row_node] = rows
        return out
