"""Slip of one integration side: tangential relative displacement, and its friction forces."""

from __future__ import annotations

import dataclasses
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.friction.dissipation import Evaluated, slip_and_energy
from qsdolfinx.friction.filled import STEEP, bounded, limited
from qsdolfinx.friction.laws import Friction, Response, Rows, Slid
from qsdolfinx.friction.of_points import OfPoints, SmoothRest, are_same
from qsdolfinx.gap.following import MOST_TURNED, Changes, Kept, Places, SlipAtPoints
from qsdolfinx.gap.frames import Frames, turned
from qsdolfinx.gap.law_memory import LawMemory, committed, named_keys
from qsdolfinx.gap.no_value import check_finite
from qsdolfinx.gap.own_rows import OfVertices
from qsdolfinx.gap.rows import NodeRows, PointRows
from qsdolfinx.gap.weighted_gap import Vecs, WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
#: Vectors at points, (rows, gdim), and a function that returns their derivatives by the functions
#: of the slave's vertices there, (rows, vertices, gdim); None if they are constant.
Rest = tuple[Array, typing.Callable[[], Array] | None]

#: Least arc length along surfaces over its chord for which the chord may point backwards: larger
#: rotations are not distinguished.
FARTHEST = (1 - SOLVED) * MOST_TURNED / float(np.sin(MOST_TURNED))

#: Largest relative change in a step of the covered part of a node's area that counts as no change:
#: the covered area of curved surfaces depends a little on their position.
SAME_COVER = 1e-2


class Place(typing.NamedTuple):
    """Positions of slave and master, for nodes with Dirichlet conditions on both sides.

    Attributes:
        unknowns: Owned unknowns of the slave's and the master's body. They are zero for
            velocity-based bodies, whose steps start at their present positions, and None for a
            rigid tool.
        tool: Contribution of the motion of a rigid tool to the relative displacement; with updated
            geometry the position of the tool.
    """

    unknowns: tuple[Array | None, Array | None]
    tool: Array


class Held(typing.NamedTuple):
    """Redundant components of τ̂, which are no unknowns, at owned nodes, (nodes, gdim).

    Attributes:
        components: Flags of the redundant components.
        clamped: Flags of the redundant components at nodes that are clamped in all directions.
    """

    components: npt.NDArray[np.bool_]
    clamped: npt.NDArray[np.bool_]


@dataclasses.dataclass
class SlipState:
    """Variable data of the constraints of a slip, for fixed contact pairs.

    "Rows" in shapes is the number of constraints.

    Arrays are replaced, never written into: a shallow copy keeps the state.

    Attributes:
        jump: Weighted relative displacement of the last evaluation, shape (rows, gdim).
        start: Relative displacement at the start of the step, shape (rows, gdim).
        starts_there: Whether ``start`` is not known yet: it is then the relative displacement at
            the start of the next solve, before Dirichlet conditions are applied.
        rest: With constraints at points, the part of τ at the start of the step that the
            multipliers of nodes do not contain (stress), (rows, gdim); its mean is 0.
        reached: With constraints at points and a penalty, τ of the nodes at the last solution, of
            the shape of ``augmented``, which it becomes at the end of the step; None before the
            first solution.
        saved: After a checkpoint has been read, transfers its data to a slip of new contact pairs:
            to transfer them first to the present pairs would change them. None otherwise.
        begun: With updated geometry, the positions at the start of the step; None before these are
            known.
        of_points: With updated geometry, data of the points at the start of the step, see ``rest``;
            None before these are known.
        of_nodes: ``pressed``, ``slipped`` and ``used`` of all owned nodes, from which those of new
            contact pairs, or of points that change at each evaluation, are computed, (nodes, 3);
            with constraints at points for the smooth patches of nodes, (nodes, block * 3). None
            before there are any.
        closing: With updated geometry, functions of the nodes instead of ``until_closed`` and
            ``share``, (nodes, gdim + 1), so that the response does not jump when points move to
            another facet. None if the whole step counts for all constraints.
        until_closed: Change of the relative displacement from ``start`` until the constraint became
            active in this step, shape (rows, gdim); 0 for constraints that were active at the
            start, and until it is known.
        share: Part of the step in which the constraint has been active since then, shape (rows,).
        carried: Relative displacement from which the next step starts if this step ends at the last
            evaluation.
        shift: Contribution of the motion of a rigid tool to the relative displacement.
        augmented: Multiplier τ̂, from which the trial starts; with constraints at points for the
            smooth patches of all owned nodes, (nodes, gdim · gdim), see ``PointRows``.
        pressed: Pressure λ at the start of the step, shape (rows,). If the contact pairs have been
            updated since, it is that of a function of nodes, which may be negative beside the edge
            of contact.
        slipped: 1 for constraints that slipped at the start of the step, (rows,); or values of such
            a function.
        used: Part of its friction limit that each constraint reached at the start of the step,
            (rows,); or values of such a function.
        covered: Covered part of the area of each owned node at the start of the step, (nodes,).
        moved: 1 for components in which Dirichlet conditions have moved an owned node relative to
            the opposite surface, in this step or before, while it was in contact, (nodes, gdim).
        at_start: Positions of the two sides at the start of the step; None before the first.
        now: Positions of the two sides at the last evaluation, if there are Dirichlet conditions on
            both.
        pressure: Pressure λ at the last evaluation, shape (rows,).
        evaluated: The last evaluation; None before the first.
        closed: Active constraints at the last evaluation.
        ended: Whether the step of the last evaluation has ended.
        response: Response of the law at the last evaluation.
        of_vertices: Multipliers τ̂ of a tool's vertices, of which ``augmented`` or ``reached`` has
            means at nodes; None if they are not known, or for other points.
        on_edge: |τ| (stress) of constraints that the last solve has found on the edge of contact or
            inactive, infinite for others, (rows,).
        solved: τ (stress) of the last solve, for laws that depend on slip rates, (rows, gdim); None
            for others, and before.
        frames: With updated geometry, the frames of the nodes that belong to τ̂, (nodes, gdim,
            gdim); None before the first evaluation.
        memory: History variables of the law.
    """

    jump: Array
    start: Array
    carried: Array
    shift: Array
    augmented: Array
    until_closed: Array
    share: Array
    pressed: Array
    slipped: Array
    used: Array
    covered: Array
    moved: Array
    pressure: Array
    closed: npt.NDArray[np.bool_]
    response: Response
    on_edge: Array
    starts_there: bool = False
    ended: bool = True
    evaluated: Evaluated | None = None
    solved: Array | None = None
    frames: Array | None = None
    at_start: Place | None = None
    now: Place | None = None
    rest: Array | float = 0.0
    reached: Array | None = None
    of_vertices: OfVertices | None = None
    saved: typing.Callable[[Slip], None] | None = None
    begun: Places | None = None
    of_points: OfPoints | None = None
    of_nodes: Array | None = None
    closing: Array | None = None
    memory: LawMemory = dataclasses.field(default_factory=LawMemory)

    @classmethod
    def at_rest(cls, rows: int, gdim: int, covered: Array, augmented: Array) -> SlipState:
        """Return the state before the first evaluation.

        Args:
            rows: Number of constraints.
            gdim: Geometric dimension.
            covered: Covered part of the area of each owned node.
            augmented: τ̂ = 0.
        """
        zero, no = np.zeros((rows, gdim)), np.zeros(rows, dtype=bool)
        stiffness = np.zeros((rows, gdim, gdim))
        response = Response(zero, stiffness, zero, no, zero, np.zeros(rows))
        none, all_ = np.zeros(rows), np.ones(rows)
        starts = none, none, none, covered, np.zeros((len(covered), gdim))
        edge, until = np.full(rows, np.inf), zero
        start = zero, zero, zero, zero, augmented, until, all_
        return cls(*start, *starts, none, no, response, edge)


class Slip:
    """Slip g_k = P_k (1/S_k) Σ_p w_p N_k(ξ_p) (Δu_s − Δu_m), P_k = 1 − n_k n_kᵀ, at constraints.

    Δu is the displacement since the step began, and n_k is the mean of the normals of the contact
    quadrature points of the constraint. With constraints at points it is g_p = P_p (Δu_s − Δu_m),
    and the law is evaluated there with the pressure of the point.

    Args:
        gap: The weighted gap of the integration side.
        friction: The law.
    """

    def __init__(self, gap: WeightedGap, friction: Friction) -> None:
        self.gap, self.friction = gap, friction
        self._own = gap.jump_operator()
        #: With updated geometry, the slip at the points of the last evaluation.
        self._found: SlipAtPoints | None = None
        #: P_k, shape (rows, gdim, gdim).
        self.projector: Array
        self._held: npt.NDArray[np.bool_] | None = None
        self._normal: Array | None = None
        #: Operator of the displacements on which tractions do work: the slip, except with updated
        #: geometry.
        self.works: _cpp.GapOperator = self._own
        self._frames: Frames | None = None
        #: With constraints at points, frames of the nodes at the start of the step.
        self._began: tuple[Places, Array] | None = None
        #: With updated geometry, rotations of vectors at the points since the start of the step,
        #: (rows, gdim, gdim), and ``SlipState.rest`` before it turns; None before the first step.
        self._turn: Array | None = None
        self._rest: Rest | None = None
        #: The part of τ beyond the nodes' multipliers as a function of position, and the data from
        #: which it was computed.
        self._smooth: tuple[OfPoints, SmoothRest] | None = None
        self.hold(None)
        #: Mortar weight of the covered support over S_k, shape (rows,).
        self.cover: Array = self._cover()
        #: Arc length along the surfaces over the slip, (rows,).
        self.arc: Array = np.ones(len(self.cover))
        #: Whether Dirichlet conditions act on nodes of both sides, on any rank.
        self.may_be_held = False
        #: Redundant components of τ̂ at owned nodes: Dirichlet conditions act on both sides,
        #: without relative motion; None if there are none on any rank.
        self.held: Held | None = None
        #: Variable data, for fixed contact pairs.
        self.state: SlipState = self._at_rest()
        #: Values of the law's parameters at the constraints.
        self.parameters: dict[str, Array] = {}
        #: Values at the nodes, or numbers, for points that change at each evaluation.
        self.of_nodes: dict[str, Array | float] = {}

    def _at_rest(self) -> SlipState:
        """The state without any history."""
        num, gdim, nodes = self.works.num_rows, self.slave.gdim, len(self.slave.node_area)
        shape = (nodes, gdim * gdim) if self.gap.rows.are_points else (num, gdim)
        state = SlipState.at_rest(num, gdim, self.covered, np.zeros(shape))
        state.memory = LawMemory.of(self.friction, self.gap.rows)
        return state

    def reset(self) -> None:
        """Delete the history: the state is that of a new slip of the same pairs. Collective."""
        shift, self.state = self.state.shift, self._at_rest()
        if self.gap.following is not None:
            self.take_operator()
            self._rest = self._smooth = None
        else:
            self.state.shift = shift

    def known(self, elastic: float, reached: Array | None = None) -> Array:
        """Multiplier from which the trial starts at the constraints (stress), (rows, gdim).

        At points it is τ_h + r (τ̂_h − τ_h) plus the part of τ beyond the nodes' multipliers at the
        start of the step, where r = γ_t/ε_t is the part of a penalty's compliance. Collective.

        Args:
            elastic: r; 0 for an augmented Lagrangian.
            reached: τ_h at the points, (rows, gdim); by default that of the last solution.
        """
        if not isinstance(self.gap.rows, PointRows):
            return self.state.augmented
        flat, start = self._reached(elastic, reached), self._start(elastic)
        if start is not None:
            flat = flat + self._since_start(self.at_rows(start))
        return np.asarray(self.tangential(flat) + self.state.rest)

    def _reached(self, elastic: float, reached: Array | None) -> Array:
        """τ_h + r (τ̂_h − τ_h) at points, without :meth:`_start`; its tangential part is used.

        Collective.
        """
        state, rows = self.state, self.gap.rows
        assert isinstance(rows, PointRows)
        if reached is None:
            nodal = state.augmented if state.reached is None else state.reached
            reached = self.at_rows(nodal)
        turns = self._start(elastic) is not None
        start = self.at_rows(state.augmented) if elastic > 0 and not turns else 0.0
        return np.asarray((1 - elastic) * reached + elastic * start)

    def _start(self, elastic: float) -> Array | None:
        """R τ̂ of nodes at the start of the step, which turns with the points. Collective.

        It is in the shape of ``augmented``, and None where it does not turn: without updated
        geometry, for multipliers of vertices, and for r = 0.
        """
        state = self.state
        if elastic == 0 or self._turn is None or self.gap.own is not None or state.frames is None:
            return None
        return elastic * self._turned_with(state.augmented, state.frames, self._frames_then())

    def kept(self, elastic: float) -> Kept | None:
        """Part of the trials at points that turns with the facets. Collective.

        None if there is none.

        Args:
            elastic: As for :meth:`known`.
        """
        field, rest = self._start(elastic), self._rest
        if self._turn is None or (field is None and rest is None):
            return None
        before, slopes = np.zeros_like(self.state.jump), None
        if rest is not None:
            before = before + rest[0]
            slopes = None if rest[1] is None else rest[1]()
        if field is not None:
            before = before + self.at_rows(field)
            field = field.reshape(len(field), self.slave.block, self.slave.gdim)
        flat = self.tangential(self._since_start(before))  # the part that counts
        return Kept(np.einsum("pji,pj->pi", self._turn, flat), slopes, field)

    def _since_start(self, vectors: Array) -> Array:
        """Vectors at points, turned since the start of the step, (rows, gdim)."""
        assert self._turn is not None
        return np.asarray(np.einsum("pij,pj->pi", self._turn, vectors))

    def at_rows(self, on_nodes: Array) -> Array:
        """τ̂ at points, from that at nodes or at vertices of a tool, (rows, gdim). Collective.

        Args:
            on_nodes: τ̂ of the smooth patches of owned nodes, (nodes, gdim · gdim).
        """
        own, known, rows = self.gap.own, self.state.of_vertices, self.gap.rows
        if own is not None and known is not None and known.on_nodes is on_nodes:
            return own.at_rows(known.at(own))
        assert isinstance(rows, PointRows)
        return rows.vectors_from_sides(on_nodes)

    def moving(self, elastic: float, reached: Array, penalty: float) -> Changes:
        """Derivative of slips with moving points on facets, and with the tilt of τ_h. Collective.

        Args:
            elastic: As for :meth:`known`.
            reached: As for :meth:`known`.
            penalty: γ_t: the trial is τ_h + γ_t g.
        """
        leaning = self.leaning(elastic, reached, penalty)
        if leaning is None or self.state.begun is None:
            return Changes(self.operator)
        kept = self.kept(elastic)
        before = np.zeros_like(self._jump) if kept is None else kept.before
        return self.gap.moving_slip(self.state.begun, leaning, np.asarray(before / penalty))

    @property
    def operator(self) -> _cpp.GapOperator:
        """Operator of the relative displacement, or derivative of the slip. Collective."""
        return self._own if self._found is None else self._found.operator

    @property
    def at_points(self) -> SlipAtPoints | None:
        """Slip at points at the last evaluation, with updated geometry; None before a step."""
        begun = self.state.begun
        return None if begun is None else self.gap.slip_at_points(begun)

    def leaning(self, elastic: float, reached: Array, penalty: float) -> Array | None:
        """Components of τ_h/γ_t and of the relative displacement along normals, (rows,).

        None if slips do not turn. Arguments as for :meth:`moving`. Collective.
        """
        if self.state.begun is None or self._normal is None:
            return None
        flat = self._reached(elastic, reached) / penalty + self._jump
        return np.asarray(np.sum(self._normal * flat, axis=1))

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.gap.slave

    @property
    def row_node(self) -> npt.NDArray[np.int64]:
        """Slave node of each constraint; not for constraints at points."""
        return self.gap.operator.row_node

    @property
    def weight(self) -> Array:
        """Area of each constraint in the virtual work."""
        return self.gap.weight

    @property
    def values(self) -> Array:
        """Slip g of the last evaluation (length), shape (rows, gdim)."""
        return self.tangential(self._jump)

    @property
    def _jump(self) -> Array:
        """Relative displacement whose tangential part is the slip."""
        return np.asarray(self.state.jump - self.state.start - self.state.until_closed)

    def hold(self, held: npt.NDArray[np.bool_] | None) -> None:
        """Exclude components with Dirichlet conditions along the surface, shape (rows, gdim).

        On a plane of symmetry, the mirrored body slips in the opposite direction: the mean of both
        is zero.
        """
        self._held = held
        normal = self.gap.operator.slave_sum if self._normal is None else self._normal
        free = np.ones_like(normal) if held is None else np.where(held, 0.0, 1.0)
        normal = free * normal
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
        within = free[:, :, None] * np.eye(normal.shape[1])
        self.projector = within - normal[:, :, None] * normal[:, None, :]

    def _cover(self) -> Array:
        """See ``cover``; 1 for constraints that are not covered."""
        cover = self.operator.slave_sum[:, 0]
        return np.where(cover > 0, cover, 1.0)

    @property
    def covered(self) -> Array:
        """Covered part of the area of each owned node, (nodes,)."""
        rows = self.gap.rows
        if isinstance(rows, PointRows):
            covered = self.gap.share * rows.cover
        else:
            assert isinstance(rows, NodeRows)
            covered = rows.sums_on_nodes(self.weight * self.operator.slave_sum[:, 0])
        area = self.slave.node_area if self.gap.cut is None else self.gap.cut.node_area
        return np.asarray(covered / area)

    def tangential(self, vectors: Array) -> Array:
        """Tangential parts of vectors at the constraints."""
        return np.asarray(np.einsum("rij,rj->ri", self.projector, vectors))

    def turned(self, vectors: Array) -> Array:
        """Rotate vectors at the constraints into the tangent planes, without a change of length."""
        flat = self.tangential(vectors)
        size = np.linalg.norm(flat, axis=1)
        grow = np.divide(np.linalg.norm(vectors, axis=1), size, where=size > 0, out=0 * size)
        return np.asarray(flat * grow[:, None])

    def jump_of(self, u: Vecs) -> Array:
        """Weighted relative displacement for given unknowns of the bodies. Collective."""
        return self.operator.apply(handle_of(u[0]), handle_of(u[1]), self.gap.state.scale)

    def change(self, field: Affine) -> Array:
        """Change of the relative displacement if a rigid tool moves by this field. Collective."""
        r = affine_vec(self.gap.slave, field)
        out = -self.works.apply(r.handle, 0)
        r.destroy()
        return out

    def evaluate(
        self,
        u: Vecs,
        pressure: Array,
        closed: npt.NDArray[np.bool_],
        penalty: float,
        dt: float | None,
        slow: float | None,
        in_displacement: tuple[bool, bool],
        gap: Array,
        compliance: float,
        elastic: float,
    ) -> None:
        """Compute slip and response for unknowns u. Collective.

        Args:
            u: Unknowns of the bodies.
            pressure: λ at the constraints.
            closed: Active constraints.
            penalty: ε in tangential direction, or at points γ_t.
            dt: Δt.
            slow: Slip rate (length per time) that counts as slow in this problem.
            in_displacement: Whether the bodies of slave and master are displacement-based, with
                total displacements; velocity-based bodies start each step from their present
                positions.
            gap: Weighted gap at the constraints, length.
            compliance: Gap (length) that a pressure closes, over this pressure.
            elastic: As for :meth:`known`.
        """
        state = self.state
        state.now = self._place_now(u, in_displacement) if self.may_be_held else None
        if self.gap.following is not None:
            self._follow()
        else:
            state.jump = self.jump_of(u)
        state.carried = state.jump if all(in_displacement) else self._carried(u, in_displacement)
        if self.gap.following is not None:
            state.starts_there, state.carried = False, np.zeros_like(state.jump)
        if state.starts_there:
            state.start, state.starts_there = state.start + state.carried, False
        if self.gap.following is None:
            state.jump = state.jump + state.shift
        if in_displacement[0] and self.gap.following is None:
            state.carried = state.carried + state.shift
        closed = closed | ((state.on_edge > 0) & np.isfinite(state.on_edge))
        state.closed, state.pressure, state.ended = closed, pressure, False
        state.memory = state.memory.at(self.gap.rows)
        augmented = self.known(elastic)
        rows = Rows(
            self.values,
            augmented,
            pressure,
            closed,
            np.zeros_like(closed),
            penalty * self.gap.relative_penalty,
            self.projector,
            self.cover,
            dt,
            slow,
            self.parameters,
            state.share,
            np.where(self.is_fresh, 0.0, state.pressed),
            memory=state.memory.known,
        )
        with collective_errors(self.slave.comm):  # a law may be the user's
            means = not all(in_displacement)
            state.response = self.respond(rows, means)
            if self.gap.rows.are_points:
                state.response = self.with_bound(state.response, rows)
            else:
                edge = state.on_edge
                state.response = limited(self.friction, state.response, edge, rows.penalty)
            state.response = self._as_solved(state.response)
        leaving = np.where(closed, 0.0, np.clip(state.used, 0.0, 1.0))
        state.evaluated = Evaluated(
            rows,
            state.response,
            leaving,
            gap / self.cover,
            compliance,
            means,
            self.tangential(state.until_closed),
            self._covers_the_same(),
            self.arc,
        )

    def _covers_the_same(self) -> bool:
        """Whether the covered area is unchanged for constraints active now or at the start.

        Collective.
        """
        change = np.abs(self.state.covered - self.covered) > SAME_COVER * self.covered
        in_contact = self.state.closed | (self.state.pressed > 0)
        local = bool(np.any(change & self.gap.rows.on_nodes(in_contact, False).astype(bool)))
        return not self.slave.comm.allreduce(local, op=MPI.LOR)

    def _begun_force(self) -> float:
        """Normal force at the start of the step over that now, from nodal pressures. Collective.

        It is 1 for constraints at nodes.
        """
        rows, known = self.gap.rows, self.state.of_nodes
        if not isinstance(rows, PointRows):
            return 1.0
        now = rows.projected(self.state.pressure[:, None])
        before = np.zeros((len(now), 1)) if known is None else known[:, ::3]  # of each patch
        forces = [
            float(covered @ (self.slave.node_area * np.maximum(pressure, 0.0).max(axis=1)))
            for covered, pressure in ((self.state.covered, before), (self.covered, now))
        ]
        start, end = self.slave.comm.allreduce(np.array(forces), op=MPI.SUM)
        return float(start / end) if end > 0 else 1.0

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        self.works.constrain(handle_of(slave), handle_of(master))

    def _place(self, u: Vecs, kept: tuple[bool, bool], tool: npt.ArrayLike) -> Place:
        """Copies of the data for the positions of the two sides."""
        made = [
            None if vec is None else np.array(vec.array_r) if keeps else np.zeros(vec.local_size)
            for vec, keeps in zip(u, kept, strict=True)
        ]
        return Place((made[0], made[1]), np.array(tool, dtype=np.float64))

    def begin_with(self, u: Vecs, in_displacement: tuple[bool, bool], tool: Array) -> None:
        """Store the positions at the start of the step, for nodes with Dirichlet conditions.

        Args:
            u: Unknowns at the start of the step.
            in_displacement: As for :meth:`evaluate`.
            tool: Contribution of the earlier motion of a rigid tool to the relative displacement.
        """
        following = self.gap.following
        if following is not None:
            tool = np.zeros(0) if u[1] is not None else following.paired_at[1]
        self.state.at_start = self._place(u, in_displacement, tool)

    def _place_now(self, u: Vecs, in_displacement: tuple[bool, bool]) -> Place:
        """Positions of the two sides for these unknowns."""
        tool = self.state.shift if in_displacement[0] else np.zeros_like(self.state.shift)
        base = self.gap.state.base
        if base is not None:
            tool = np.zeros(0) if u[1] is not None else base[1]
        return self._place(u, in_displacement, tool)

    def begin_at(self, u: Vecs, in_displacement: tuple[bool, bool]) -> None:
        """Start the step at these unknowns, unless its start is known. Collective."""
        state = self.state
        if not state.starts_there:
            return
        self.begin_with(u, in_displacement, state.start)
        if self.gap.following is not None:
            self.gap.evaluate_kept(u, in_displacement)
            assert self.gap.cut is not None
            state.begun = self.gap.cut.places
        else:
            state.start = state.start + self._carried(u, in_displacement)
        state.starts_there = False

    # --- Updated geometry

    def _follow(self) -> None:
        """Update operator, normals, slip and τ̂ at the points of this evaluation. Collective."""
        state, rows, gap = self.state, self.gap.rows, self.gap
        assert gap.cut is not None and isinstance(rows, PointRows)
        if state.begun is None:
            state.begun = gap.cut.places
        self.take_operator()
        found = gap.slip_at_points(state.begun)
        state.jump, self._rest = found.slip, None
        self._turn_augmented()
        zero, none = np.zeros_like(state.jump), np.zeros(len(state.jump))
        state.start, state.shift, state.rest = zero, zero, 0.0
        if state.of_points is not None:
            self._rest = self._rest_at(found, state.of_points)
            state.rest = self.tangential(self._since_start(self._rest[0]))
        state.on_edge = np.full_like(none, np.inf)
        state.pressed, state.slipped, state.used = none, none, none
        if state.of_nodes is not None:
            state.pressed, state.slipped, state.used = rows.vectors_from_sides(state.of_nodes).T
        state.until_closed, state.share = self._closing_of(found, rows)
        for name, values in self.of_nodes.items():
            if isinstance(values, float):
                self.parameters[name] = np.full_like(none, values)
            else:
                self.parameters[name] = rows.from_nodes(values)

    def _rest_at(self, found: SlipAtPoints, kept: OfPoints) -> Rest:
        """``rest`` at the points before it turns; the stored values if no point has moved.

        Collective.
        """
        if self.slave.comm.allreduce(are_same(kept, found.facets, found.place), op=MPI.LAND):
            return kept.rest, None
        if self._smooth is None or self._smooth[0] is not kept:
            self._smooth = kept, SmoothRest(kept)
        smooth, at = self._smooth[1], (found.facets, found.place)
        return smooth.at(*at), functools.partial(smooth.slopes, *at)

    def _closing_of(self, found: SlipAtPoints, rows: PointRows) -> tuple[Array, Array]:
        """``until_closed`` and ``share`` of the points of the last evaluation. Collective."""
        state, known = self.state, self.state.closing
        if known is None:
            return np.zeros_like(found.slip), np.ones(len(found.slip))
        closing = np.column_stack([rows.from_nodes(c) for c in known.T])
        fresh = state.pressed <= 0
        until = np.where(fresh[:, None], closing[:, :-1], 0.0)
        return until, np.where(fresh, closing[:, -1], 1.0)

    def take_operator(self) -> None:
        """Use operator and normals of the gap's last evaluation. Collective."""
        if self.state.begun is None:  # before any step: those of contact detection
            self._own = self.works = self.gap.jump_operator()
            self._found, self._normal, self._held = None, None, None
            self.arc, self._turn = np.ones(self.works.num_rows), None
        else:
            self._found = found = self.gap.slip_at_points(self.state.begun)
            self.works, self._normal = found.works, found.normal
            self.arc, self._turn = found.arc, found.turn
        self.hold(self._held)
        self.cover = np.ones(len(self.arc))

    def _turn_augmented(self) -> None:
        """Rotate τ̂ with the slave. Collective."""
        state, gap = self.state, self.gap
        assert gap.cut is not None
        if self._frames is None:
            self._frames = Frames(self.slave)
        now = self._frames.at(gap.cut.places[0])
        if state.frames is not None:
            before, known = state.frames, state.of_vertices
            for name in ("augmented", "reached"):
                vectors = getattr(state, name)
                if vectors is None:
                    continue
                found = self._turned_with(vectors, before, now)
                if known is not None and known.on_nodes is vectors:
                    state.of_vertices = self._turned_at_vertices(known, before, now, found)
                setattr(state, name, found)
        state.frames = now

    def _turned_at_vertices(
        self, known: OfVertices, before: Array, now: Array, on_nodes: Array
    ) -> OfVertices | None:
        """Rotate τ̂ of a tool's vertices with the slave there. Collective.

        Args:
            known: τ̂ of the vertices.
            before: Earlier frames of the nodes, (nodes, gdim, gdim).
            now: Present frames.
            on_nodes: The rotated τ̂ of the nodes.
        """
        own = self.gap.own
        if own is None:
            return None
        turns = self._at_points(np.einsum("nij,nkj->nik", now, before))
        values = np.einsum("pij,pj->pi", turns, own.at_rows(known.at(own)))
        return OfVertices(on_nodes, own.vertex, own.from_rows(values))

    def _frames_then(self) -> Array:
        """Frames of the nodes at the start of the step, (nodes, gdim, gdim). Collective."""
        begun = self.state.begun
        assert self._frames is not None and begun is not None
        if self._began is None or self._began[0] is not begun:
            self._began = begun, self._frames.at(begun[0])
        return self._began[1]

    def _at_points(self, turns: Array) -> Array:
        """Matrices of nodes interpolated to the points, (rows, gdim, gdim). Collective."""
        rows, gdim = self.gap.rows, self.slave.gdim
        assert isinstance(rows, PointRows)
        columns = [rows.from_nodes(c) for c in turns.reshape(len(turns), gdim * gdim).T]
        return np.stack(columns, axis=1).reshape(self.gap.num_rows, gdim, gdim)

    def _turned_with(self, vectors: Array, before: Array, now: Array) -> Array:
        """Rotate vectors with the frames of their nodes; a row has those of all patches."""
        gdim = self.slave.gdim
        parts = np.split(vectors, vectors.shape[1] // gdim, axis=1)
        return np.concatenate([turned(part, before, now) for part in parts], axis=1)

    @property
    def has_turned(self) -> bool:
        """Whether a slipping point of this rank has turned too far in the step to use the chord.

        The limit is a relative rotation of 149° between the two sides.
        """
        if self.state.ended or not self.gap.rows.are_points:
            return False
        return bool(np.any(self.slipping & (self.arc >= FARTHEST)))

    def _carried(self, u: Vecs, in_displacement: tuple[bool, bool]) -> Array:
        """Relative displacement due to displacement-based bodies only. Collective."""
        s, m = (x * kept for x, kept in zip(self.gap.state.scale, in_displacement, strict=True))
        return np.asarray(self.operator.apply(handle_of(u[0]), handle_of(u[1]), (s, m)))

    # --- Constraints that become active within a step

    @property
    def has_slipped(self) -> npt.NDArray[np.bool_]:
        """Constraints that slipped at the start of the step, or most of their surroundings did."""
        return np.asarray(self.state.slipped >= 0.5)

    @property
    def is_fresh(self) -> npt.NDArray[np.bool_]:
        """Constraints without pressure at the start of the step."""
        return np.asarray(self.state.pressed <= SOLVED * self.state.pressure)

    def respond(self, rows: Rows, means: bool) -> Response:
        """Response of the law for the time in which constraints are active.

        Args:
            rows: Input of the law.
            means: Whether multipliers are means over the step, as the stresses due to a velocity:
                during the time in contact they are larger than the means.

        Raises:
            NoMultiplierError: If τ is not finite, on this rank alone.
        """
        share, of_vectors = rows.share, rows.share[:, None]
        in_whole_step = not means or bool(np.all(share == 1))
        if not in_whole_step:
            rows = rows._replace(
                traction=rows.traction / of_vectors,
                pressure=rows.pressure / share,
                penalty=rows.penalty / share,
            )
        with named_keys(self.friction, "friction"):
            response = self.friction.respond(rows)
        given = [("slip", rows.slip), ("pressure", rows.pressure), *rows.memory.items()]
        named = f"friction: {type(self.friction).__name__}.respond"
        check_finite(named, response.traction, given, self.gap.of)
        check_finite(f"{named} (∂τ/∂λ)", response.coupling, given, self.gap.of)
        if in_whole_step:
            return response
        return response._replace(
            traction=response.traction * of_vectors,
            stiffness=response.stiffness * of_vectors[:, None],
            secant=response.secant * share,
        )

    def gap_at_start(self, gap: Array) -> Array:
        """ḡ (length) at the start of the step, from the present ḡ. Collective."""
        if self.state.begun is not None:
            return self.gap.slip_at_points(self.state.begun).gap
        moved = np.sum(self.gap.operator.slave_sum * (self.state.jump - self.state.start), axis=1)
        return np.asarray(gap - moved / self.cover)

    def count_from(self, until_closed: Array, share: Array, closing: npt.NDArray[np.bool_]) -> None:
        """Count slip from the onset of contact, for constraints that become active in this step.

        Args:
            until_closed: Change of the relative displacement until contact onset, shape (rows,
                gdim); 0 for other constraints.
            share: Part of the step after contact onset, shape (rows,); 1 for other constraints.
            closing: Constraints that are active at the end, (rows,).
        """
        self.state.until_closed, self.state.share = until_closed, share
        rows = self.gap.rows
        if self.gap.following is not None and isinstance(rows, PointRows):
            values = np.column_stack([until_closed, share])
            self.state.closing = rows.means_of_some(values, closing)

    def count_whole_step(self) -> None:
        """Count slip from the start of the step for all constraints."""
        self.state.until_closed = np.zeros_like(self.state.start)
        self.state.share = np.ones_like(self.state.share)
        self.state.closing = None

    def rounding(self, response: Response) -> Array:
        """Stress error due to rounding of slips, for laws that depend on slip rates, (rows,).

        Such a law may be much stiffer than penalties and bodies. The error is 0 for other laws.
        """
        if not self.friction.needs_dt:
            return np.zeros_like(response.secant)
        # A slip is the difference of sums of some coordinates.
        size = float(np.abs(self.slave.mesh.geometry.x).max(initial=0.0))
        eps = float(np.finfo(np.float64).eps)
        return np.asarray(10 * eps * size * response.secant)

    def _as_solved(self, response: Response) -> Response:
        """Replace τ by the balanced τ of the last solve where they differ only by rounding."""
        solved = self.state.solved
        if solved is None:
            return response
        error = np.linalg.norm(response.traction - solved, axis=1)
        near = error <= np.sqrt(2) * self.rounding(response)
        return response._replace(traction=np.where(near[:, None], solved, response.traction))

    def begin_solve(self) -> None:
        """Delete the results of the last solve for constraints in this step."""
        self.state.solved = None
        self.state.on_edge = np.full_like(self.state.share, np.inf)
        self.count_whole_step()

    def with_bound(self, response: Response, rows: Rows) -> Response:
        """Response at points for laws whose limit does not vanish with the pressure.

        At points |τ| is at most :data:`STEEP` times the pressure, so that it does not jump when a
        point opens: with hardly any pressure, any part of the limit is possible.

        Args:
            response: Response of the law.
            rows: Input of the law.
        """
        if not self.friction.jumps:
            return response
        bound = np.where(rows.unlimited, np.inf, STEEP * rows.pressure)
        return bounded(self.friction, response, bound, STEEP, rows.penalty)

    # --- τ̂ at all owned nodes, unchanged by an update of the contact pairs

    def augmented_on_nodes(self) -> Array:
        """τ̂ at all owned nodes, 0 where there is none.

        In corners and with constraints at points it is given per smooth patch.
        """
        rows, augmented = self.gap.rows, self.state.augmented
        if isinstance(rows, NodeRows):
            return rows.on_sides(augmented)
        return augmented

    def set_augmented_on_nodes(self, values: Array) -> None:
        """Restore values of :meth:`augmented_on_nodes`."""
        rows, values = self.gap.rows, np.array(values, dtype=np.float64)
        known = self.state.of_vertices
        if isinstance(rows, NodeRows):
            values = rows.from_sides(values)
        elif known is not None:
            values = known.recognised(values, self.slave.comm)
        self.state.augmented = values

    def turn_augmented(self) -> None:
        """Rotate τ̂ into the tangent planes, unless constraints are at points."""
        if not self.gap.rows.are_points:
            self.state.augmented = self.turned(self.state.augmented)

    def add_forces(self, b: Vecs) -> None:
        """Add Jᵀ S τ to b. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * self.state.response.traction)
        handles = handle_of(b[0]), handle_of(b[1])
        self.works.add_transpose(force, *handles)

    def add_stiffness(self, slope: Array, blocks: typing.Sequence[PETSc.Mat | None]) -> None:
        """Add Jᵀ S (D J + ∂τ/∂λ ∂λ/∂ḡ G) to the blocks (ss, sm, ms, mm), for linear gaps."""
        stiffness, coupling = self.stiffness(slope)
        _cpp.insert_friction(
            self.operator,
            self.gap.operator,
            stiffness,
            np.ascontiguousarray(coupling),
            [handle_of(mat) for mat in blocks],
            self.gap.state.scale,
        )

    def stiffness(self, slope: Array) -> tuple[Array, Array]:
        """S D, shape (rows, gdim, gdim), and S ∂τ/∂λ ∂λ/∂ḡ, (rows, gdim).

        Args:
            slope: ∂λ/∂ḡ at the constraints.
        """
        stiffness, coupling = self._slopes()
        return stiffness, (self.weight * slope)[:, None] * coupling

    def _slopes(self) -> tuple[Array, Array]:
        """S D and ∂τ/∂λ."""
        response = self.state.response
        stiffness = np.ascontiguousarray(self.weight[:, None, None] * response.stiffness)
        return stiffness, response.coupling

    def fastest(self) -> float:
        """Largest slip (length) of active constraints here, at its rate over a full step."""
        size = np.linalg.norm(self.values, axis=1) / (self.cover * self.state.share)
        return float(np.max(size[self.state.closed], initial=0.0))

    def lost(self) -> tuple[Array, Array]:
        """Dissipative slip (length) and dissipated energy of each constraint in this step.

        Shapes (rows, gdim) and (rows,). Collective.
        """
        state = self.state
        if state.evaluated is None:
            return np.zeros_like(state.start), np.zeros_like(state.pressed)
        slid = self._slid(state.evaluated)
        return slid.slip, self.weight * slid.energy

    def _slid(self, evaluated: Evaluated) -> Slid:
        """Slip, traction and dissipated energy per area in this step. Collective."""
        begun = 1.0 if evaluated.same else self._begun_force()
        with collective_errors(self.slave.comm):  # a law may be the user's
            slip, energy = slip_and_energy(self.friction, evaluated, begun)
        return Slid(slip / self.cover[:, None], evaluated.response.traction, energy)

    def commit(self) -> None:
        """Compute the history variables of the law at the end of a step. Collective.

        Raises:
            ValueError: If a user's law returns anything else.
        """
        memory, evaluated = self.state.memory, self.state.evaluated
        if not memory.first or evaluated is None:
            return
        law, slid = self.friction, self._slid(evaluated)
        with collective_errors(self.slave.comm), named_keys(law, "friction"):
            found = law.commit(evaluated.rows, slid)
            found = committed(law, "friction", found, self.works.num_rows)
        self.state.memory = memory.after(self.gap.rows, found)

    def dissipation(self) -> Array:
        """Dissipated energy of each constraint in this step, shape (rows,). Collective."""
        return self.lost()[1]

    def dissipation_at_nodes(self) -> Array:
        """Dissipated energy at all owned nodes in this step. Collective.

        Energies of points are distributed with the functions of the nodes.
        """
        return self.gap.rows.sums_on_nodes(self.dissipation())

    @property
    def slipping(self) -> npt.NDArray[np.bool_]:
        """Active constraints that slip."""
        return self.state.response.slipping

    def slipping_state(self) -> bytes:
        """Slip state of the constraints of this rank, as bytes."""
        return self.state.response.slipping.tobytes()

    def tangent_state(self) -> bytes:
        """Data on which the tangent depends, as bytes."""
        return self.state.response.stiffness.tobytes() + self.state.response.coupling.tobytes()

    def _used(self) -> Array:
        """Part of its friction limit that each constraint has reached. Collective."""
        evaluated = self.state.evaluated
        if evaluated is None:
            return np.zeros_like(self.state.pressed)
        with collective_errors(self.slave.comm):  # a law may be the user's
            return self.friction.used(evaluated.rows, self.state.response)

    def end_step(self) -> None:
        """Start the next step from the end of this one."""
        traction, rows = self.state.response.traction, self.gap.rows
        self.state.used, self.state.saved = self._used(), None
        if isinstance(rows, PointRows):
            if self.state.reached is not None:
                self.state.augmented = self.state.reached
            of_nodes = self.tangential(self.at_rows(self.state.augmented))
            # Multipliers of vertices contain all of τ.
            self.state.rest = traction - of_nodes if self.gap.own is None else 0.0 * traction
            if self.gap.following is not None:
                assert self.state.begun is not None and self._normal is not None
                at = self.gap.slip_at_points(self.state.begun)
                kept = OfPoints(at.facets, at.place, self.state.rest, self._normal)
                self.state.of_points = kept
        else:
            self.state.augmented = traction
        self.state.start = self.state.carried
        if self.gap.cut is not None:
            self.state.begun = self.gap.cut.places
        self.state.pressed = self.state.pressure
        self.state.covered = self.covered
        self.state.slipped = self.state.response.slipping.astype(np.float64)
        columns = np.column_stack([self.state.pressed, self.state.slipped, self.state.used])
        if isinstance(rows, PointRows):
            of_nodes = rows.projected(columns)
        else:
            of_nodes = rows.on_nodes(columns, 0.0).astype(np.float64)
        closed = rows.on_nodes(self.state.closed, False).astype(bool)[:, None]
        if self.gap.following is None:
            # Projections are small, but not 0, far from all active constraints. With updated
            # geometry they stay: points move by facets in a step, and without them the energy of
            # friction is 4 % too small (tests/sliding/test_points.py, test_energy_of_friction).
            of_nodes = np.where(closed, of_nodes, 0.0)
        self.state.of_nodes = of_nodes
        self.state.moved = np.where(closed, self.state.moved, 0.0)
        self.state.at_start = self.state.now
        self.count_whole_step()
        self.state.ended = True
