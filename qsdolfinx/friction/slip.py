"""Slip of one pass: the tangential part of its weighted jump, and the friction that works on it."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.friction.laws import Friction, Response, Rows
from qsdolfinx.friction.stick_slip import StickSlip
from qsdolfinx.gap.weighted_gap import Vecs, WeightedGap, handle_of
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


class Slip:
    """g_k = P_k (1/S_k) Σ_p w_p N_k(ξ_p) (Δu_s − Δu_m), P_k = 1 − n_k n_kᵀ, on the rows of a gap.

    Δu is the displacement since the step began; n_k is the mean of the normals of the row's pairing
    points.

    Args:
        gap: The weighted gap of the pass.
        friction: The law.
        by_cover: As for the gap.
    """

    def __init__(self, gap: WeightedGap, friction: Friction, by_cover: bool) -> None:
        self.gap = gap
        self.friction = friction
        self.operator = _cpp.GapOperator(
            gap.slave._cpp_object,
            gap.master._cpp_object if isinstance(gap.master, Surface) else None,
            gap.points,
            jump=True,
            by_cover=by_cover,
        )
        normal = gap.operator.slave_sum
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
        gdim = gap.slave.gdim
        #: P_k, shape (rows, gdim, gdim).
        self.projector: Array = np.eye(gdim) - normal[:, :, None] * normal[:, None, :]
        #: Part of S_k that the row's pairing points stand for, shape (rows,).
        self.cover: Array = self.operator.slave_sum[:, 0]
        shape = (self.operator.num_rows, gdim)
        #: Weighted jump of the last evaluation and where it was when the step began.
        self.jump: Array = np.zeros(shape)
        self.start: Array = np.zeros(shape)
        #: Whether that place is not known yet: it is where the bodies are at the next evaluation.
        self.starts_there = False
        #: Jump that the next step starts from if this one ends at the last evaluation.
        self._carried: Array = np.zeros(shape)
        #: What a rigid tool's motion adds to the jump.
        self.shift: Array = np.zeros(shape)
        #: τ̂, what the trial multiplier starts from.
        self.augmented: Array = np.zeros(shape)
        #: Values of the law's parameters at the rows.
        self.parameters: dict[str, Array] = {}
        #: Rows in contact at the last evaluation.
        self.closed: npt.NDArray[np.bool_] = np.zeros(shape[0], dtype=bool)
        #: Whether the step of the last evaluation has been ended.
        self.ended = True
        #: How Newton's method fares.
        self.stick_slip = StickSlip(friction, *shape)
        self._stuck: npt.NDArray[np.bool_] = np.zeros(shape[0], dtype=bool)
        #: What the law answered at the last evaluation.
        self.response = Response(
            np.zeros(shape),
            np.zeros((*shape, gdim)),
            np.zeros(shape),
            np.zeros(shape[0], dtype=bool),
            np.zeros(shape),
            np.zeros(shape[0]),
        )

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.gap.slave

    @property
    def row_node(self) -> npt.NDArray[np.int64]:
        """Slave node of each row."""
        return self.gap.row_node

    @property
    def weight(self) -> Array:
        """Area of each row in the virtual work."""
        return self.gap.weight

    @property
    def values(self) -> Array:
        """Slip g of the last evaluation (length), shape (rows, gdim)."""
        return self.tangential(self.jump - self.start)

    def tangential(self, vectors: Array) -> Array:
        """Tangential parts of vectors at the rows."""
        return np.asarray(np.einsum("rij,rj->ri", self.projector, vectors))

    def turned(self, vectors: Array) -> Array:
        """Vectors at the rows brought into the tangent planes, their lengths kept."""
        flat = self.tangential(vectors)
        size = np.linalg.norm(flat, axis=1)
        grow = np.divide(np.linalg.norm(vectors, axis=1), size, where=size > 0, out=0 * size)
        return np.asarray(flat * grow[:, None])

    def jump_of(self, u: Vecs) -> Array:
        """Weighted jump for given displacements over the bodies' scales. Collective."""
        return self.operator.apply(handle_of(u[0]), handle_of(u[1]), self.gap.scale)

    def change(self, field: Affine) -> Array:
        """How the jump changes when a rigid tool is displaced by this field. Collective."""
        r = affine_vec(self.gap.slave, field)
        out = -self.operator.apply(r.handle, 0)
        r.destroy()
        return out

    def evaluate(
        self,
        u: Vecs,
        pressure: Array,
        closed: npt.NDArray[np.bool_],
        penalty: float,
        dt: float | None,
        facet_size: float,
        in_displacement: tuple[bool, bool],
    ) -> None:
        """Compute slip and response for unknowns u. Collective.

        Args:
            u: Unknowns of the bodies.
            pressure: λ at the rows.
            closed: Rows in contact.
            penalty: ε in tangential direction.
            dt: Δt.
            facet_size: Of the smallest facet.
            in_displacement: Whether the slave's and the master's body have (total) displacements;
                what moves with velocities starts each step from where it is.
        """
        self.jump = self.jump_of(u)
        self._carried = self.jump
        if not all(in_displacement):
            scales = [s * kept for s, kept in zip(self.gap.scale, in_displacement, strict=True)]
            handles = handle_of(u[0]), handle_of(u[1])
            self._carried = self.operator.apply(*handles, (scales[0], scales[1]))
        if self.starts_there:
            self.start, self.starts_there = self.start + self._carried, False
        self.jump = self.jump + self.shift
        if in_displacement[0]:
            self._carried = self._carried + self.shift
        self.closed, self.ended = closed, False
        rows = Rows(
            self.values,
            self.augmented,
            pressure,
            closed & ~self.stick_slip.without_friction,
            np.zeros_like(closed),
            penalty * self.gap.relative_penalty,
            self.projector,
            self.cover,
            dt,
            facet_size,
            self.parameters,
        )
        with collective_errors(self.slave.comm):  # a law may be the user's
            self.response = self.friction.respond(rows)
            self._stuck = self.stick_slip.made_to_stick(self.response)
            if self._stuck.any():
                self.response = self.friction.respond(rows._replace(unlimited=self._stuck))

    def note(self) -> None:
        """Say that there is going to be a tangent at the last evaluation."""
        self.stick_slip.note(self.response, self.closed, self._stuck)

    def unsettled(self) -> bool:
        """Whether rows were made to stick or are given friction back: to go on with the solve."""
        return bool(self._stuck.any()) | self.stick_slip.give_back(self.closed)

    def violation(self, penalty: float) -> float:
        """Largest |τ − τ̂| / ε (length) on this rank; 0 of a law without a limit to keep."""
        if self.friction.needs_dt:
            return 0.0
        change = np.linalg.norm(self.response.traction - self.augmented, axis=1)
        return float(np.max(change / (penalty * self.gap.relative_penalty), initial=0.0))

    def add_forces(self, b: Vecs) -> None:
        """Add Jᵀ S τ to b. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * self.response.traction)
        handles = handle_of(b[0]), handle_of(b[1])
        self.operator.add_transpose(force, *handles, self.gap.slave_only)

    def add_stiffness(self, slope: Array, blocks: typing.Sequence[PETSc.Mat | None]) -> None:
        """Add Jᵀ S (D J + ∂τ/∂λ ∂λ/∂ḡ G) to the blocks (ss, sm, ms, mm)."""
        careful = self.stick_slip.careful[:, None]
        secant = self.response.secant[:, None, None] * self.projector
        stiffness = np.where(careful[:, None], secant, self.response.stiffness)
        stiffness = self.weight[:, None, None] * stiffness
        coupling = np.where(careful, 0.0, self.response.coupling)
        coupling = (self.weight * slope)[:, None] * coupling
        _cpp.insert_friction(
            self.operator,
            self.gap.operator,
            np.ascontiguousarray(stiffness),
            np.ascontiguousarray(coupling),
            [handle_of(mat) for mat in blocks],
            self.gap.scale,
            self.gap.slave_only,
        )

    def dissipation(self) -> Array:
        """Energy of each row that friction took in this step, never negative, shape (rows,).

        Two-half-pass contact has a multiplier for each side's force on itself: each stands for half
        of the energy.
        """
        work = np.sum(self.response.traction * self.response.dissipative, axis=1)
        return np.asarray(self.weight * work * (0.5 if self.gap.slave_only else 1.0))

    @property
    def slipping(self) -> npt.NDArray[np.bool_]:
        """Rows in contact that slip, those included that have lost their friction."""
        return self.response.slipping | (self.closed & self.stick_slip.without_friction)

    def state(self) -> bytes:
        """Which rows of this rank slip."""
        return self.response.slipping.tobytes()

    def tangent_state(self) -> bytes:
        """What the tangent depends on."""
        law = self.response.stiffness.tobytes() + self.response.coupling.tobytes()
        return law + np.where(self.stick_slip.careful, self.response.secant, -1.0).tobytes()

    def end_step(self) -> None:
        """Let the next step begin where this one ended."""
        self.augmented = self.response.traction.copy()
        self.start = self._carried.copy()
        self.ended = True
