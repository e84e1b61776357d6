"""Slip of one pass: the tangential part of its weighted jump, and the friction that works on it."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.handles import handle_of
from qsdolfinx.friction.dissipation import Evaluated, slip_and_energy
from qsdolfinx.friction.filled import STEEP, bounded, limited
from qsdolfinx.friction.laws import Friction, Response, Rows
from qsdolfinx.friction.of_points import OfPoints, SavedNormals, SmoothRest, are_same
from qsdolfinx.gap.following import MOST_TURNED, Changes, Places, SlipAtPoints
from qsdolfinx.gap.frames import Frames, turned
from qsdolfinx.gap.rows import NodeRows, PointRows
from qsdolfinx.gap.weighted_gap import Vecs, WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
#: What rounding leaves of slips, over coordinates.
OF_RATES = 10 * np.finfo(np.float64).eps

#: Part of what is around a row that has slipped, from which on the row has.
MOST = 0.5

#: Way along surfaces, over its chord, from which on that may point backwards.
FARTHEST = 0.999 * MOST_TURNED / float(np.sin(MOST_TURNED))

#: Change in a step of the covered part of a node's area, over that part, up to which it is the
#: same: curved surfaces cover each other by a little more or less wherever they are.
SAME_COVER = 1e-2

#: Pressure at the start of a step, relative to that at its end, that is none but for rounding.
NO_PRESSURE = 1e-6


class Place(typing.NamedTuple):
    """Where the two sides of a pass are, for the nodes of both that conditions hold.

    Attributes:
        unknowns: Owned unknowns of the slave's and the master's body, zero of velocities, whose
            bodies start where they are; None of a rigid tool.
        tool: What its motion adds to the jump, or its position where gaps follow the bodies.
    """

    unknowns: tuple[Array | None, Array | None]
    tool: Array


class Held(typing.NamedTuple):
    """Components of τ̂ that are no unknowns, of owned nodes, (nodes, gdim).

    Attributes:
        components: Which.
        clamped: Those of them at nodes that are held as a whole.
    """

    components: npt.NDArray[np.bool_]
    clamped: npt.NDArray[np.bool_]


@dataclasses.dataclass
class SlipState:
    """What changes at the rows of a slip, while its pairing stays.

    Arrays are replaced, never written into: a shallow copy keeps the state.

    Attributes:
        jump: Weighted jump of the last evaluation, shape (rows, gdim).
        start: Where it was when the step began.
        starts_there: Whether that is not known yet: it is where the bodies are when the next solve
            begins, before conditions are in place.
        rest: With rows at points, what τ at the start of the step was beyond the multipliers of
            nodes (stress), (rows, gdim): 0 in the mean.
        reached: With rows at points and a penalty, τ of the nodes at the last solution, as
            ``augmented``, which it becomes at the step's end; None before the first.
        saved: Normals of the pairing that a checkpoint was written with; None otherwise.
        begun: Of gaps that follow the bodies, where everything was when the step began; None
            before that is known.
        of_points: With such rows, what they had then, see ``rest``; None before that is known.
        of_nodes: With such rows, which are others at each evaluation, functions of the nodes in the
            place of ``pressed`` and ``slipped``, (nodes, 2); None before there are any.
        closing: With such rows, functions of the nodes in the place of ``until_closed`` and
            ``share``, (nodes, gdim + 1): the answer may not jump where points go from facet to
            facet. None where all count the whole step.
        until_closed: What the jump changed from there until the row closed in this step; 0 for
            rows that were closed at its start, and as long as nobody knows. Same shape.
        share: Part of the step for which the row has been closed since, shape (rows,).
        carried: Jump that the next step starts from if this one ends at the last evaluation.
        shift: What a rigid tool's motion adds to the jump.
        augmented: τ̂, what the trial multiplier starts from; with rows at points for the sides of
            all owned nodes, (nodes, gdim · gdim), see ``PointRows``.
        pressed: Pressure λ at the start of the step, shape (rows,); where contact has paired since
            that of a function of nodes, which may be negative beside the edge.
        slipped: 1 of rows that slipped there, (rows,); or such a function.
        covered: Part of the area of each owned node that was covered there, (nodes,).
        moved: 1 of components in which conditions have moved an owned node against what is
            opposite to it in this step or before, while it was in contact, (nodes, gdim).
        at_start: Where the two sides were when the step began; None before the first.
        now: Where they are at the last evaluation, if conditions hold nodes of both.
        pressure: The same at the last evaluation.
        evaluated: The last evaluation; None before the first.
        closed: Rows in contact at the last evaluation.
        ended: Whether the step of the last evaluation has been ended.
        response: What the law answered at the last evaluation.
        on_edge: |τ| (stress) of rows that the last solve has found on the edge of contact or open,
            infinite of others, (rows,).
        solved: τ (stress) of the last solve, of laws that slip rates steer, (rows, gdim); None of
            others, and before.
        frames: Frames of the nodes in which τ̂ is known, of gaps that follow the bodies,
            (nodes, gdim, gdim); None before the first evaluation.
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
    saved: SavedNormals | None = None
    begun: Places | None = None
    of_points: OfPoints | None = None
    of_nodes: Array | None = None
    closing: Array | None = None

    @classmethod
    def at_rest(cls, rows: int, gdim: int, covered: Array, augmented: Array) -> SlipState:
        """Before the first evaluation.

        Args:
            rows: Their number.
            gdim: Of the bodies.
            covered: Part of the area of each owned node that is covered.
            augmented: τ̂ = 0.
        """
        zero, no = np.zeros((rows, gdim)), np.zeros(rows, dtype=bool)
        stiffness = np.zeros((rows, gdim, gdim))
        response = Response(zero, stiffness, zero, no, zero, np.zeros(rows))
        none, all_ = np.zeros(rows), np.ones(rows)
        starts = none, none, covered, np.zeros((len(covered), gdim))
        edge, until = np.full(rows, np.inf), zero
        start = zero, zero, zero, zero, augmented, until, all_
        return cls(*start, *starts, none, no, response, edge)


class Slip:
    """g_k = P_k (1/S_k) Σ_p w_p N_k(ξ_p) (Δu_s − Δu_m), P_k = 1 − n_k n_kᵀ, on the rows of a gap.

    Δu is the displacement since the step began; n_k is the mean of the normals of the row's pairing
    points. With rows at points it is g_p = P_p (Δu_s − Δu_m), and the law is asked there, with the
    pressure of the point.

    Args:
        gap: The weighted gap of the pass.
        friction: The law.
    """

    def __init__(self, gap: WeightedGap, friction: Friction) -> None:
        self.gap, self.friction = gap, friction
        self.operator = gap.jump_operator()
        gdim = gap.slave.gdim
        #: P_k, shape (rows, gdim, gdim).
        self.projector: Array
        self._held: npt.NDArray[np.bool_] | None = None
        self._normal: Array | None = None
        #: What tractions work on; the slip itself but for gaps that follow the bodies.
        self.works: _cpp.GapOperator = self.operator
        self._frames: Frames | None = None
        #: Frames of the nodes where the step began, of rows at points.
        self._began: tuple[Places, Array] | None = None
        #: What points have beyond nodes, as a function of the place, and what it was found for.
        self._smooth: tuple[OfPoints, SmoothRest] | None = None
        self.hold(None)
        #: Part of S_k that the row's pairing points stand for, shape (rows,).
        self.cover: Array = self._cover()
        #: Way along surfaces over the slip, (rows,).
        self.arc: Array = np.ones(len(self.cover))
        #: Whether conditions hold nodes of both sides, on any rank.
        self.may_be_held = False
        #: Components of τ̂ that conditions hold on both sides, and that they do not move against
        #: each other, of owned nodes; none if there are none anywhere.
        self.held: Held | None = None
        #: What changes while the pairing stays.
        num = self.operator.num_rows
        shape = (len(self.covered), gdim * gdim) if gap.rows.are_points else (num, gdim)
        self.state = SlipState.at_rest(num, gdim, self.covered, np.zeros(shape))
        #: Values of the law's parameters at the rows.
        self.parameters: dict[str, Array] = {}
        #: The same of nodes, or numbers, for rows that are others at each evaluation.
        self.of_nodes: dict[str, Array | float] = {}

    def known(self, elastic: float, reached: Array | None = None) -> Array:
        """τ that the trial starts from at the rows (stress), (rows, gdim). Collective.

        At points τ_h + r (τ̂_h − τ_h) + what they had beyond that when the step began, r being the
        part of a penalty's compliance, γ_t/ε_t.

        Args:
            elastic: r; 0 of an augmented Lagrangian.
            reached: τ_h at the points, (rows, gdim); by default that of the last solution.
        """
        if not isinstance(self.gap.rows, PointRows):
            return self.state.augmented
        return np.asarray(self.tangential(self._reached(elastic, reached)) + self.state.rest)

    def _reached(self, elastic: float, reached: Array | None) -> Array:
        """τ_h + r (τ̂_h − τ_h) at points, of which the tangential part counts. Collective."""
        state, rows = self.state, self.gap.rows
        assert isinstance(rows, PointRows)
        if reached is None:
            nodal = state.augmented if state.reached is None else state.reached
            reached = rows.vectors_from_sides(nodal)
        start = rows.vectors_from_sides(state.augmented) if elastic > 0 else 0.0
        return np.asarray((1 - elastic) * reached + elastic * start)

    def moving(self, elastic: float, reached: Array, penalty: float) -> Changes:
        """How slips change with what points move by on facets, and what τ_h leans by. Collective.

        Args:
            elastic: As for :meth:`known`.
            reached: Likewise.
            penalty: γ_t: the trial is τ_h + γ_t g.
        """
        if self.state.begun is None or self._normal is None:
            return Changes(self.operator)
        flat = self._reached(elastic, reached) / penalty + self._jump
        leaning = np.sum(self._normal * flat, axis=1)
        return self.gap.moving_slip(self.state.begun, leaning)

    @property
    def slave(self) -> Surface:
        """Surface that carries the multiplier."""
        return self.gap.slave

    @property
    def row_node(self) -> npt.NDArray[np.int64]:
        """Slave node of each row; not of points."""
        return self.gap.operator.row_node

    @property
    def weight(self) -> Array:
        """Area of each row in the virtual work."""
        return self.gap.weight

    @property
    def values(self) -> Array:
        """Slip g of the last evaluation (length), shape (rows, gdim)."""
        return self.tangential(self._jump)

    @property
    def _jump(self) -> Array:
        """What slip is the tangential part of."""
        return np.asarray(self.state.jump - self.state.start - self.state.until_closed)

    def hold(self, held: npt.NDArray[np.bool_] | None) -> None:
        """Leave out components that conditions hold along the surface, shape (rows, gdim).

        On a plane of symmetry what is beyond it slips the other way: the mean of the whole is zero.
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
        """See ``cover``; 1 of rows that nothing is opposite to."""
        cover = self.operator.slave_sum[:, 0]
        return np.where(cover > 0, cover, 1.0)

    @property
    def covered(self) -> Array:
        """Part of the area of each owned node that is opposite to something, (nodes,)."""
        rows = self.gap.rows
        if isinstance(rows, PointRows):
            covered = self.gap.share * rows.cover
        else:
            assert isinstance(rows, NodeRows)
            covered = rows.sums_on_nodes(self.weight * self.operator.slave_sum[:, 0])
        area = self.slave.node_area if self.gap.cut is None else self.gap.cut.node_area
        return np.asarray(covered / area)

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
        return self.operator.apply(handle_of(u[0]), handle_of(u[1]), self.gap.state.scale)

    def change(self, field: Affine) -> Array:
        """How the jump changes when a rigid tool is displaced by this field. Collective."""
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
            pressure: λ at the rows.
            closed: Rows in contact.
            penalty: ε in tangential direction, or at points γ_t.
            dt: Δt.
            slow: Slip rate (length per time) that is slow in the scene.
            in_displacement: Whether the slave's and the master's body have (total) displacements;
                what moves with velocities starts each step from where it is.
            gap: Weighted gap at the rows, length.
            compliance: Gap (length) that a pressure closes, over it.
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
        leaving = ~closed & self.has_slipped
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
        """Whether no row in contact, now or at the start, is covered more or less. Collective."""
        change = np.abs(self.state.covered - self.covered) > SAME_COVER * self.covered
        in_contact = self.state.closed | (self.state.pressed > 0)
        local = bool(np.any(change & self.gap.rows.on_nodes(in_contact, False).astype(bool)))
        return not self.slave.comm.allreduce(local, op=MPI.LOR)

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        self.operator.constrain(handle_of(slave), handle_of(master))

    def _place(self, u: Vecs, kept: tuple[bool, bool], tool: npt.ArrayLike) -> Place:
        """Copies of what says where the two sides are."""
        made = [
            None if vec is None else np.array(vec.array_r) if keeps else np.zeros(vec.local_size)
            for vec, keeps in zip(u, kept, strict=True)
        ]
        return Place((made[0], made[1]), np.array(tool, dtype=np.float64))

    def begin_with(self, u: Vecs, in_displacement: tuple[bool, bool], tool: Array) -> None:
        """Take where the two sides were when the step began, for nodes that conditions hold.

        Args:
            u: Unknowns then.
            in_displacement: As for :meth:`evaluate`.
            tool: What the motion of a rigid tool until then has added to the jump.
        """
        following = self.gap.following
        if following is not None:
            tool = np.zeros(0) if u[1] is not None else following.paired_at[1]
        self.state.at_start = self._place(u, in_displacement, tool)

    def _place_now(self, u: Vecs, in_displacement: tuple[bool, bool]) -> Place:
        """Where the two sides are with these unknowns."""
        tool = self.state.shift if in_displacement[0] else np.zeros_like(self.state.shift)
        base = self.gap.state.base
        if base is not None:
            tool = np.zeros(0) if u[1] is not None else base[1]
        return self._place(u, in_displacement, tool)

    def begin_at(self, u: Vecs, in_displacement: tuple[bool, bool]) -> None:
        """Let the step begin at these unknowns, unless its start is known. Collective."""
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

    # --- Gaps that follow the bodies

    def _follow(self) -> None:
        """Operator, normals, jump and τ̂ at the points of the last cut. Collective."""
        state, rows, gap = self.state, self.gap.rows, self.gap
        assert gap.cut is not None and isinstance(rows, PointRows)
        if state.begun is None:
            state.begun = gap.cut.places
        self.take_operator()
        found = gap.slip_at_points(state.begun)
        state.jump = found.slip
        self._turn_augmented()
        zero, none = np.zeros_like(state.jump), np.zeros(len(state.jump))
        state.start, state.shift, state.rest = zero, zero, 0.0
        if state.of_points is not None:
            state.rest = self.tangential(self._rest_at(found, state.of_points))
        state.on_edge = np.full_like(none, np.inf)
        state.pressed, state.slipped = none, none
        if state.of_nodes is not None:
            state.pressed, state.slipped = (rows.from_nodes(c) for c in state.of_nodes.T)
        state.until_closed, state.share = self._closing_of(found, rows)
        for name, values in self.of_nodes.items():
            if isinstance(values, float):
                self.parameters[name] = np.full_like(none, values)
            else:
                self.parameters[name] = rows.from_nodes(values)

    def _rest_at(self, found: SlipAtPoints, kept: OfPoints) -> Array:
        """ρ of the points, all that they had where none has moved. Collective."""
        turns, same = self._turns(), are_same(kept, found.facets, found.place)
        if self.slave.comm.allreduce(same, op=MPI.LAND):
            return np.asarray(np.einsum("pij,pj->pi", turns, kept.rest))
        if self._smooth is None or self._smooth[0] is not kept:
            self._smooth = kept, SmoothRest(kept)
        return self._smooth[1].at(found.facets, found.place, turns)

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
        """Take operator and normals of the gap's last evaluation. Collective."""
        if self.state.begun is None:  # before any step: those of the pairing
            self.operator = self.works = self.gap.jump_operator()
            self._normal, self._held = None, None
            self.arc = np.ones(self.operator.num_rows)
        else:
            found = self.gap.slip_at_points(self.state.begun)
            self.operator, self.works, self._normal = found.operator, found.works, found.normal
            self.arc = found.arc
        self.hold(self._held)
        self.cover = np.ones(len(self.arc))

    def _turn_augmented(self) -> None:
        """Let τ̂ turn with the slave. Collective."""
        state, gap = self.state, self.gap
        assert gap.cut is not None
        if self._frames is None:
            self._frames = Frames(self.slave)
        now = self._frames.at(gap.cut.places[0])
        if state.frames is not None:
            state.augmented = self._turned_with(state.augmented, state.frames, now)
            if state.reached is not None:
                state.reached = self._turned_with(state.reached, state.frames, now)
        state.frames = now

    def _turns(self) -> Array:
        """How the slave has turned at the points since the step began. Collective.

        Means of what its nodes have: as their multipliers, with what turns around normals.

        Returns:
            Shape (rows, gdim, gdim).
        """
        state, rows, gdim = self.state, self.gap.rows, self.slave.gdim
        assert self._frames is not None and state.begun is not None and state.frames is not None
        assert isinstance(rows, PointRows)
        if self._began is None or self._began[0] is not state.begun:
            self._began = state.begun, self._frames.at(state.begun[0])
        turns = np.einsum("nij,nkj->nik", state.frames, self._began[1])
        columns = [rows.from_nodes(c) for c in turns.reshape(len(turns), gdim * gdim).T]
        return np.stack(columns, axis=1).reshape(len(self.cover), gdim, gdim)

    def _turned_with(self, vectors: Array, before: Array, now: Array) -> Array:
        """Vectors, of the sides of a node behind each other, turned with frames."""
        gdim = self.slave.gdim
        parts = np.split(vectors, vectors.shape[1] // gdim, axis=1)
        return np.concatenate([turned(part, before, now) for part in parts], axis=1)

    @property
    def has_turned(self) -> bool:
        """Whether a point of this rank that slips has turned too far in the step for its chord.

        That is by 149° against what is opposite.
        """
        if self.state.ended or not self.gap.rows.are_points:
            return False
        return bool(np.any(self.slipping & (self.arc >= FARTHEST)))

    def _carried(self, u: Vecs, in_displacement: tuple[bool, bool]) -> Array:
        """Jump of the bodies that have total displacements. Collective."""
        s, m = (x * kept for x, kept in zip(self.gap.state.scale, in_displacement, strict=True))
        return np.asarray(self.operator.apply(handle_of(u[0]), handle_of(u[1]), (s, m)))

    # --- Rows that close within a step

    @property
    def has_slipped(self) -> npt.NDArray[np.bool_]:
        """Rows that slipped when the step began, or most of what is around them did."""
        return np.asarray(self.state.slipped >= MOST)

    @property
    def is_fresh(self) -> npt.NDArray[np.bool_]:
        """Rows that had no pressure when the step began."""
        return np.asarray(self.state.pressed <= NO_PRESSURE * self.state.pressure)

    def respond(self, rows: Rows, means: bool) -> Response:
        """What the law answers for the time in which rows are in contact.

        Args:
            rows: The rows.
            means: Whether multipliers are means over the step, as stresses of a velocity are: while
                in contact they are larger then.
        """
        if not means or np.all(rows.share == 1):
            return self.friction.respond(rows)
        share, of_vectors = rows.share, rows.share[:, None]
        response = self.friction.respond(
            rows._replace(
                traction=rows.traction / of_vectors,
                pressure=rows.pressure / share,
                penalty=rows.penalty / share,
            )
        )
        return response._replace(
            traction=response.traction * of_vectors,
            stiffness=response.stiffness * of_vectors[:, None],
            secant=response.secant * share,
        )

    def gap_at_start(self, gap: Array) -> Array:
        """ḡ (length) of the pass' rows at the start of the step, given that now. Collective."""
        if self.state.begun is not None:
            return self.gap.slip_at_points(self.state.begun).gap
        moved = np.sum(self.gap.operator.slave_sum * (self.state.jump - self.state.start), axis=1)
        return np.asarray(gap - moved / self.cover)

    def count_from(self, until_closed: Array, share: Array, closing: npt.NDArray[np.bool_]) -> None:
        """Let rows that close in this step count slip from when they close.

        Args:
            until_closed: What the jump changes until then, shape (rows, gdim); 0 of other rows.
            share: Part of the step that is left then, shape (rows,); 1 of other rows.
            closing: Rows that are closed at the end, (rows,).
        """
        self.state.until_closed, self.state.share = until_closed, share
        rows = self.gap.rows
        if self.gap.following is not None and isinstance(rows, PointRows):
            values = np.column_stack([until_closed, share])
            self.state.closing = rows.means_of_some(values, closing)

    def count_whole_step(self) -> None:
        """Count slip from the start of the step at all rows."""
        self.state.until_closed = np.zeros_like(self.state.start)
        self.state.share = np.ones_like(self.state.share)
        self.state.closing = None

    def rounding(self, response: Response) -> Array:
        """Stress that rounding makes of slips by a law that slip rates steer, (rows,).

        It may be much stiffer than penalties and bodies; 0 of other laws.
        """
        if not self.friction.needs_dt:
            return np.zeros_like(response.secant)
        size = float(np.abs(self.slave.mesh.geometry.x).max(initial=0.0))
        return np.asarray(OF_RATES * size * response.secant)

    def _as_solved(self, response: Response) -> Response:
        """With τ of the last solve, which balances, where the law's differs by rounding alone."""
        solved = self.state.solved
        if solved is None:
            return response
        error = np.linalg.norm(response.traction - solved, axis=1)
        near = error <= np.sqrt(2) * self.rounding(response)
        return response._replace(traction=np.where(near[:, None], solved, response.traction))

    def begin_solve(self) -> None:
        """Forget what the last solve has found of rows in this step."""
        self.state.solved = None
        self.state.on_edge = np.full_like(self.state.share, np.inf)
        self.count_whole_step()

    def with_bound(self, response: Response, rows: Rows) -> Response:
        """The answer at points of laws whose limit does not vanish with the pressure.

        At points |τ| is at most :data:`STEEP` times the pressure, so that it does not jump where
        one opens: any part of the limit is possible where the pressure is next to none.

        Args:
            response: What the law answers.
            rows: What it was told.
        """
        if not self.friction.jumps:
            return response
        bound = np.where(rows.unlimited, np.inf, STEEP * rows.pressure)
        return bounded(self.friction, response, bound, STEEP, rows.penalty)

    # --- τ̂ at all owned nodes, the same when contact pairs anew

    def augmented_on_nodes(self) -> Array:
        """τ̂ at all owned nodes, in corners and at points of their sides; 0 where there is none."""
        rows, augmented = self.gap.rows, self.state.augmented
        if isinstance(rows, NodeRows):
            return rows.on_sides(augmented)
        return augmented

    def set_augmented_on_nodes(self, values: Array) -> None:
        """Put back what :meth:`augmented_on_nodes` gave."""
        rows, values = self.gap.rows, np.array(values, dtype=np.float64)
        self.state.augmented = rows.from_sides(values) if isinstance(rows, NodeRows) else values

    def turn_augmented(self) -> None:
        """Bring τ̂ into the tangent planes, if it belongs to rows."""
        if not self.gap.rows.are_points:
            self.state.augmented = self.turned(self.state.augmented)

    def add_forces(self, b: Vecs) -> None:
        """Add Jᵀ S τ to b. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * self.state.response.traction)
        handles = handle_of(b[0]), handle_of(b[1])
        self.works.add_transpose(force, *handles)

    def add_stiffness(self, slope: Array, blocks: typing.Sequence[PETSc.Mat | None]) -> None:
        """Add Jᵀ S (D J + ∂τ/∂λ ∂λ/∂ḡ G) to the blocks (ss, sm, ms, mm), of linear gaps."""
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
        """S D, shape (rows, gdim, gdim), and S ∂τ/∂λ ∂λ/∂ḡ of the row of the pass, (rows, gdim).

        Args:
            slope: ∂λ/∂ḡ at the rows of the pass.
        """
        stiffness, coupling = self._slopes()
        return stiffness, (self.weight * slope)[:, None] * coupling

    def _slopes(self) -> tuple[Array, Array]:
        """S D and ∂τ/∂λ."""
        response = self.state.response
        stiffness = np.ascontiguousarray(self.weight[:, None, None] * response.stiffness)
        return stiffness, response.coupling

    def fastest(self) -> float:
        """Largest way of a closed row on this rank, length: at its rate, in a whole step."""
        size = np.linalg.norm(self.values, axis=1) / (self.cover * self.state.share)
        return float(np.max(size[self.state.closed], initial=0.0))

    def lost(self) -> tuple[Array, Array]:
        """Slip (length), and energy of each row, that friction took in this step.

        Shapes (rows, gdim) and (rows,). Collective.
        """
        state = self.state
        if state.evaluated is None:
            return np.zeros_like(state.start), np.zeros_like(state.pressed)
        with collective_errors(self.slave.comm):  # a law may be the user's
            slip, energy = slip_and_energy(self.friction, state.evaluated)
        return slip / self.cover[:, None], self.weight * energy

    def dissipation(self) -> Array:
        """Energy of each row that friction took in this step, shape (rows,). Collective."""
        return self.lost()[1]

    def dissipation_at_nodes(self) -> Array:
        """The same of all owned nodes; of points as their functions have them. Collective."""
        return self.gap.rows.sums_on_nodes(self.dissipation())

    @property
    def slipping(self) -> npt.NDArray[np.bool_]:
        """Rows in contact that slip."""
        return self.state.response.slipping

    def slipping_state(self) -> bytes:
        """Which rows of this rank slip."""
        return self.state.response.slipping.tobytes()

    def tangent_state(self) -> bytes:
        """What the tangent depends on."""
        return self.state.response.stiffness.tobytes() + self.state.response.coupling.tobytes()

    def end_step(self) -> None:
        """Let the next step begin where this one ended."""
        traction, rows = self.state.response.traction, self.gap.rows
        if isinstance(rows, PointRows):
            if self.state.reached is not None:
                self.state.augmented = self.state.reached
            of_nodes = self.tangential(rows.vectors_from_sides(self.state.augmented))
            self.state.rest = traction - of_nodes
            if self.gap.following is not None:
                assert self.state.begun is not None and self._normal is not None
                at = self.gap.slip_at_points(self.state.begun)
                kept = OfPoints(at.facets, at.place, self.state.rest, self._normal)
                self.state.of_points = kept
                flags = np.column_stack([self.state.pressure, self.state.response.slipping])
                self.state.of_nodes = rows.projected_means(flags.astype(np.float64))
        else:
            self.state.augmented = traction
        self.state.start = self.state.carried
        if self.gap.cut is not None:
            self.state.begun = self.gap.cut.places
        self.state.pressed = self.state.pressure
        self.state.covered = self.covered
        self.state.slipped = self.state.response.slipping.astype(np.float64)
        closed = self.gap.rows.on_nodes(self.state.closed, False).astype(bool)
        self.state.moved = np.where(closed[:, None], self.state.moved, 0.0)
        self.state.at_start = self.state.now
        self.count_whole_step()
        self.state.ended = True
