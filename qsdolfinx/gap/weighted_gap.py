"""The weighted gap of one pass: where the multiplier lives and what it acts on."""

from __future__ import annotations

import dataclasses
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.laws import Law
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
#: Vectors of the slave's and of the master's body, None for a rigid tool.
Vecs = tuple[PETSc.Vec, PETSc.Vec | None]


def handle_of(thing: PETSc.Vec | PETSc.Mat | None) -> int:
    """Handle for the kernels, 0 where there is nothing."""
    return 0 if thing is None else int(thing.handle)


@dataclasses.dataclass
class GapState:
    """What changes at the rows of a weighted gap, while its pairing stays.

    Arrays are replaced, never written into: a shallow copy keeps the state.

    Attributes:
        values: ḡ of the last evaluation, shape (rows, 1) or (rows, gdim); at first that of u = 0.
        augmented: λ̂, of the same shape.
        offset: Gap of displacements on top of those of the unknowns, of the same shape.
        shift: What a rigid tool's motion adds to ḡ, of the same shape.
        allowance: Gap (length) at each row that counts as none: overclosure that is not resolved.
        scale: Displacement per unknown of the slave's and of the master's body.
    """

    values: Array
    augmented: Array
    offset: Array
    shift: Array
    allowance: Array
    scale: tuple[float, float] = (1.0, 1.0)


class WeightedGap:
    """ḡ_k = (1/S_k) Σ_p w_p N_k(ξ_p) [(u_s − u_m)·n_p − δ_p] on the slave nodes of this rank.

    A jump law weights the vector u_s − u_m instead. One row per slave node that a pairing point
    reaches.

    With an augmented Lagrangian, the law sees the gap ḡ + λ̂/ε, λ̂ being the multiplier so far: it
    then gives λ = [λ̂ + ε ḡ]₊ or λ̂ + ε ⟦u⟧. With λ̂ = 0 that is the penalty method. Nodes that are
    covered in part get a larger ε there, S_k / Σ w_p N_k times: otherwise they
    would need very many updates of λ̂.

    On the overlay the sum is divided by Σ_p w_p N_k(ξ_p), the part of S_k that is covered, so that
    the gap of a node at the rim is the mean gap of what it covers. At nodes it is divided by S_k,
    as in (12).

    A rigid master has no unknowns; its motion r, a field that is linear in x, shifts the gap by
    the slave's part of the operator, ḡ = G_s (u_s − r) − d.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        points: Pairing points of the two.
        law: What the gap is used for.
        share: Part of the energy Σ S_k φ(ḡ_k) that this pass stands for.
        by_cover: Whether gaps are divided by what is covered of S_k.
        augmented: Whether λ̂ is going to be updated.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        points: _cpp.PairingPoints,
        law: Law,
        share: float,
        by_cover: bool,
        augmented: bool,
    ) -> None:
        self.slave = slave
        self.master = master
        self.points = points
        self.law = law
        self.by_cover = by_cover
        self.operator = self._operator(law.jump)
        #: Slave node of each row, an index into the arrays of the slave surface.
        self.row_node: npt.NDArray[np.int64] = self.operator.row_node
        #: Area in the energy of each row: what its gap is divided by, times the share.
        self.weight: Array = share * self.operator.row_area
        cover = self.operator.row_area / slave.node_area[self.row_node]
        #: ε of each row in units of the contact's.
        self.relative_penalty: Array = 1 / cover if augmented else np.ones_like(cover)
        zero = np.zeros((self.operator.num_rows, self.operator.width))
        #: Components of λ̂ that conditions hold on both sides; None if there are none anywhere.
        self.extension: Extension | None = None
        #: What changes while the pairing stays.
        self.state = GapState(zero, zero, zero, zero, zero[:, 0])
        if not law.jump:
            self.state.values = -self.operator.initial_gap[:, None]

    def _operator(self, jump: bool) -> _cpp.GapOperator:
        surfaces = self.slave.cpp_object, self.master.cpp_object
        return _cpp.GapOperator(*surfaces, self.points, jump=jump, by_cover=self.by_cover)

    def jump_operator(self) -> _cpp.GapOperator:
        """The operator of the whole jump vector, at the same rows. Collective."""
        return self.operator if self.law.jump else self._operator(True)

    def change_of(self, u: Vecs) -> Array:
        """How ḡ changes when the unknowns change by u. Collective."""
        return self.operator.apply(handle_of(u[0]), handle_of(u[1]), self.state.scale)

    def evaluate(self, u: Vecs) -> None:
        """Compute the weighted gaps for unknowns u. Collective."""
        state = self.state
        state.values = self.change_of(u) + state.offset + state.shift
        if not self.law.jump:
            state.values -= (self.operator.initial_gap + state.allowance)[:, None]
        elif self.extension is not None:
            state.values = np.where(self.extension.held, 0.0, state.values)

    def allow(self, allowance: Array) -> None:
        """Set the gaps (length) of the rows that count as none."""
        self.state.values = self.state.values + (self.state.allowance - allowance)[:, None]
        self.state.allowance = allowance

    def change(self, field: Affine) -> Array:
        """How ḡ changes when a rigid tool is displaced by this field. Collective."""
        r = affine_vec(self.slave, field)
        out = -self.operator.apply(r.handle, 0)
        r.destroy()
        return out

    def multiplier(self, penalty: float) -> Array:
        """λ at the last evaluation, shape (rows, 1) or (rows, gdim)."""
        eps = penalty * self.relative_penalty
        return self.law.multiplier(self._shifted(eps), eps)

    def slope(self, penalty: float, touching: float) -> Array:
        """∂λ/∂ḡ at the last evaluation, shape (rows,)."""
        eps = penalty * self.relative_penalty
        return self.law.slope(self._shifted(eps), eps, touching)

    def energy(self, penalty: float) -> float:
        """This rank's part of the energy at the last evaluation."""
        eps = penalty * self.relative_penalty
        density = self.law.energy(self._shifted(eps), eps)
        return float(self.weight @ (density - np.sum(self.state.augmented**2, axis=1) / (2 * eps)))

    def image(self, penalty: float) -> Array:
        """λ at the last evaluation as the next λ̂. Collective."""
        multiplier = self.multiplier(penalty)
        if self.extension is None:
            return multiplier
        return self.extension.fill(multiplier, self.law.linear | (multiplier[:, 0] > 0))

    def violation(self, penalty: float) -> float:
        """Largest gap that λ̂ leaves on this rank: |λ − λ̂| / ε, which is |ḡ| where it is closed.

        Collective.
        """
        change = self.image(penalty) - self.state.augmented
        gaps = np.linalg.norm(change, axis=1) / (penalty * self.relative_penalty)
        return float(np.max(gaps, initial=0.0))

    def _shifted(self, eps: Array) -> Array:
        return self.state.values + self.state.augmented / eps[:, None]

    def add_forces(self, multiplier: Array, b: Vecs) -> None:
        """Add Gᵀ S λ to b, the derivative of the energy. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * multiplier)
        self.operator.add_transpose(force, handle_of(b[0]), handle_of(b[1]))

    def add_stiffness(
        self, slope: Array, blocks: typing.Sequence[PETSc.Mat | None], pattern: bool
    ) -> None:
        """Add Gᵀ S diag(slope) G to the blocks (ss, sm, ms, mm), or only fix their pattern."""
        handles = [handle_of(mat) for mat in blocks]
        stiffness = self.weight * slope
        if self.extension is not None and not pattern and self.law.jump:
            stiffness = np.ascontiguousarray(stiffness[:, None] * ~self.extension.held)
        _cpp.insert_contact(self.operator, stiffness, handles, self.state.scale, pattern)

    def on_nodes(self, rows: npt.NDArray[np.generic], missing: float) -> npt.NDArray[np.generic]:
        """Spread values of the rows over all owned nodes of the slave surface."""
        out = np.full((len(self.slave.node_area), *rows.shape[1:]), missing, dtype=rows.dtype)
        out[self.row_node] = rows
        return out
