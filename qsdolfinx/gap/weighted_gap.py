"""The weighted gap of one integration side, and its multipliers."""

from __future__ import annotations

import dataclasses
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.following import (
    Changes,
    Cut,
    Destination,
    Following,
    Mixed,
    Places,
    PointState,
    SlipAtPoints,
)
from qsdolfinx.gap.law_memory import LawMemory, committed, named_keys
from qsdolfinx.gap.laws import BUILT_IN, Law
from qsdolfinx.gap.no_value import check_finite
from qsdolfinx.gap.own_rows import OfVertices, OwnRows
from qsdolfinx.gap.rows import NodeRows, PointRows, Rows
from qsdolfinx.gap.tie import Places as TiePlaces
from qsdolfinx.gap.tie import Tie
from qsdolfinx.gap.turning import Turned, Turning
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Vectors of the slave's and of the master's body, None for a rigid tool.
Vecs = tuple[PETSc.Vec, PETSc.Vec | None]

#: Kinds of constraints, in the order of GapRows in cpp/gap/gap.h.
KINDS = ("area", "cover", "points")


@dataclasses.dataclass
class GapState:
    """Variable data of the constraints of a weighted gap, for fixed contact pairs.

    "Rows" in shapes is the number of constraints.

    Arrays are replaced, never written into: a shallow copy keeps the state.

    Attributes:
        values: ḡ of the last evaluation, shape (rows, 1) or (rows, gdim); at first that of u = 0.
        augmented: Lagrange multiplier λ̂, of the shape of ``values``; with constraints at points
            for the smooth patches of all owned nodes, shape (nodes, gdim), see ``PointRows``. With
            a penalty alone λ of the last solution, where the next solve begins.
        offset: Gap due to displacements added to those of the unknowns, of the shape of ``values``.
        shift: Contribution of the motion of a rigid tool to ḡ, of the shape of ``values``.
        allowance: Gap (length) of each constraint that counts as zero: overclosure that is not
            resolved. With updated geometry, at the patches of nodes, as ``augmented``.
        scale: Displacement per unknown of the slave's and of the master's body.
        carried: Relative displacement (length) due to meshes and a tool since the tie was made, of
            the shape of ``values``.
        places: Positions of tied surfaces after the motion of the meshes that ``carried`` includes;
            None for those at which they were tied.
        turned: Rotation of the gaps between tied surfaces at these positions, or at the last
            evaluation.
        base: Positions of facets with updated geometry for unknowns 0.
        vertices: For points at vertices, their areas at the patches of owned nodes that have a
            point, 0 at other patches, (nodes, block). They stay as they were when the vertices were
            chosen, because multipliers are per these areas. None for points on facets.
        of_vertices: Multipliers λ̂ of a tool's vertices, of which ``augmented`` has means at nodes;
            None if they are not known, or for other points.
        conductance: h of the constraints at the last evaluation, for a conductance law; None before
            it, and for other laws.
        closed: With constraints at points, the part in contact of the covered area of each patch of
            an owned node at the last solution, (nodes, gdim); None before any.
        memory: History variables of the law.
    """

    values: Array
    augmented: Array
    offset: Array
    shift: Array
    allowance: Array
    scale: tuple[float, float] = (1.0, 1.0)
    carried: Array | float = 0.0
    places: TiePlaces | None = None
    turned: Turned | None = None
    base: Places | None = None
    vertices: Array | None = None
    of_vertices: OfVertices | None = None
    conductance: Array | None = None
    closed: Array | None = None
    memory: LawMemory = dataclasses.field(default_factory=LawMemory)


class WeightedGap:
    """ḡ_k = (1/S_k) Σ_p w_p N_k(ξ_p) [(u_s − u_m)·n_p − δ_p] on the slave nodes of this rank.

    A law with ``jump`` uses the vector u_s − u_m instead. There is one constraint for each slave
    node with a contact quadrature point in its support. In the corner of several walls there is one
    for each smooth patch of the node, with the area of the patch instead of S_k. With constraints
    at points there is one for each contact quadrature point, g_p = (u_s − u_m)·n_p − δ_p, with the
    weight w_p instead of S_k.

    With an augmented Lagrangian, the law is evaluated at the gap ḡ + λ̂/ε, where λ̂ is the present
    multiplier: it then gives λ = [λ̂ + ε ḡ]₊ or λ̂ + ε ⟦u⟧. With λ̂ = 0 this is the penalty method.
    For nodes that are covered in part, ε is multiplied by S_k / Σ w_p N_k: otherwise they would
    need very many multiplier updates.

    With constraints at points, λ̂ still belongs to the nodes; at sharp edges there is one λ̂ for
    each smooth patch of the surface. The multiplier at a point is λ̂_h = Σ_k λ̂_k N_k(ξ_p). It is
    updated to the function that is closest to [λ̂_h + ε g_p]₊. λ̂ may become negative at a node
    beside the edge of contact, where λ̂_h approximates a pressure that ends within a facet.

    On the overlay the sum is divided by Σ_p w_p N_k(ξ_p), the covered part of S_k, so that the gap
    of a node at the boundary of the master is the mean over its covered support. At nodes it is
    divided by S_k, as in (12).

    A rigid master has no unknowns; its motion r, a field that is linear in x, shifts the gap by
    the slave's part of the operator, ḡ = G_s (u_s − r) − d.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        points: Contact quadrature points between the two surfaces.
        law: Contact law.
        share: Part of the energy Σ S_k φ(ḡ_k) that this integration side contributes.
        rows: Kind of constraints: ``"area"``, at nodes, with the gap divided by S_k; ``"cover"``,
            at nodes, with the gap divided by the covered part of S_k; or ``"points"``.
        augmented: Whether λ̂ is updated.
        following: Updates the geometry at each evaluation, with constraints at points; the operator
            is then the derivative at the last evaluation. None for gaps that are linear in u.
        turns: Whether gaps between tied surfaces are co-rotated with the master: ``"finite"``, with
            each evaluation, or ``"small"``, by small rotations since meshes moved; None for not.
        of: Name of the contact in errors of its law; None for none.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        points: _cpp.PairingPoints,
        law: Law,
        share: float,
        rows: str,
        augmented: bool,
        following: Following | None = None,
        turns: str | None = None,
        of: str | None = None,
    ) -> None:
        self.slave = slave
        self.master = master
        self.points = points
        self.law = law
        #: Name of the contact in errors; None for none.
        self.of = of
        self._kind, self._share, self._is_augmented = KINDS.index(rows), share, augmented
        self.following = following
        #: The last evaluation of gaps with updated geometry.
        self.cut: Cut | None = None
        base = vertices = None
        if following is not None:
            base = following.paired_at
            vertices = following.choose(base)
            self.cut = following.cut(base, vertices)
        #: Operator without co-rotated gaps.
        self._own = self._operator(law.jump) if self.cut is None else self.cut.operator
        self._marked: Vecs | None = None
        #: Co-rotated gaps between tied surfaces; None if there are none.
        self.turning: Turning | None = None
        self._turns_anew = turns == "finite"
        self._offset: tuple[Array, Array | None] | None = None
        zero = np.zeros((self._own.num_rows, self._own.width))
        multipliers: Array = zero
        #: Transfer of values between the constraints and the slave's nodes.
        self.rows: Rows
        if rows == "points":
            are_own = following is not None and following.points_are_own
            self.rows = point_rows = PointRows(self._own, slave, are_own)
            multipliers = np.zeros_like(point_rows.cover_of_sides)
        else:
            self.rows = NodeRows(self._own, slave, points.by_sides)
        #: Redundant components of λ̂, with Dirichlet conditions on both sides; None if there are
        #: none on any rank.
        self.extension: Extension | None = None
        #: Variable data, for fixed contact pairs.
        allowance = zero[:, 0] if following is None else np.zeros_like(multipliers)
        values = zero - self._own.initial_gap[:, None]
        self.state = GapState(values, multipliers, zero, zero, allowance)
        self.state.base, self.state.vertices = base, vertices
        self.state.memory = LawMemory.of(law, self.rows)
        #: Motion of tied surfaces since the tie was made; None for other laws.
        self.tie = Tie(slave, master) if law.jump and not slave.is_scalar else None
        if turns and self.tie is not None:
            self._begin_to_turn()
        self._at_rows: tuple[Array, Array] = multipliers, zero

    @property
    def operator(self) -> _cpp.GapOperator:
        """Derivative of the gaps, where they are linear or at the last evaluation."""
        turned = self.state.turned
        return self._own if turned is None else turned.operator

    @property
    def own(self) -> OwnRows | None:
        """Multipliers of a tool's vertices at the last evaluation; None for those at nodes."""
        return None if self.cut is None else self.cut.own

    @property
    def is_linear(self) -> bool:
        """Whether gaps are linear functions of the unknowns."""
        return self.following is None and not (self.turning and self._turns_anew)

    @property
    def _area(self) -> Array:
        """Area by which the gap of each constraint is divided."""
        return self.operator.row_area

    @property
    def share(self) -> float:
        """Part of the energy that this integration side contributes."""
        return self._share

    @property
    def weight(self) -> Array:
        """Area of each constraint in the energy: the area of its mean gap, times the share."""
        return np.asarray(self._share * self._area)

    @property
    def multiplier_weight(self) -> Array:
        """Area of each multiplier, of the shape of λ̂."""
        if isinstance(self.rows, PointRows):
            return np.asarray(self._share * self.rows.cover_of_sides)
        return self.weight[:, None] * np.ones(self.operator.width)

    @property
    def relative_penalty(self) -> Array:
        """ε of each constraint in units of the contact's ε; for a conductance law h, with ε = 1."""
        if self.state.conductance is not None:
            return self.state.conductance
        if not (self._is_augmented and KINDS[self._kind] == "cover"):
            return np.ones(self.num_rows)
        return np.asarray(self.rows.node_area[self.operator.row_node] / self._area)

    def by_node(self) -> WeightedGap:
        """The gap with constraints at nodes: itself unless they are at points. Collective."""
        if not self.rows.are_points:
            return self
        surfaces = self.slave, self.master
        return WeightedGap(
            *surfaces, self.points, self.law, self._share, "cover", self._is_augmented, of=self.of
        )

    @property
    def present_points(self) -> _cpp.PairingPoints:
        """Contact quadrature points; with updated geometry those of the last evaluation."""
        if self.following is None or self.cut is None:
            return self.points
        return self.following.pairing_points(self.cut)

    def _operator(self, jump: bool, kind: int | None = None) -> _cpp.GapOperator:
        surfaces = self.slave.cpp_object, self.master.cpp_object
        rows = self._kind if kind is None else kind
        return _cpp.GapOperator(*surfaces, self.points, jump=jump, rows=rows)

    @property
    def num_rows(self) -> int:
        """Number of constraints on this rank."""
        return self._own.num_rows

    @property
    def num_alone(self) -> int:
        """Number of points with nothing opposite on this rank; they come last."""
        return 0 if self.cut is None else len(self.cut.alone.weight)

    @functools.cached_property
    def cover_share(self) -> Array:
        """ḡ of a gap that is 1 everywhere, shape (rows,). Collective at the first call.

        This is Σ_p w_p N_k over the area by which the gap of a constraint is divided: 1, unless
        that area is S_k of a node.
        """
        if KINDS[self._kind] != "area":
            return np.ones(self.num_rows)
        cover = self._operator(False, KINDS.index("cover")).row_area
        return np.asarray(cover / self.operator.row_area)

    def jump_operator(self) -> _cpp.GapOperator:
        """The operator of the relative displacement vector, at the same constraints. Collective."""
        if self.following is not None and self.cut is not None:
            return self.following.jump_operator(self.cut)
        return self.operator if self.law.jump else self._operator(True)

    @property
    def condensed(self) -> Flags | None:
        """Redundant components of a tie, whose jump counts as zero, (rows, gdim); None for none.

        Redundant multipliers of normal gaps belong to gaps like all others.
        """
        return self.extension.held if self.extension is not None and self.law.jump else None

    @property
    def violation(self) -> Array:
        """Penetration (length), or absolute components of relative displacements, (rows, width)."""
        return np.abs(self.state.values) if self.law.jump else self.state.values

    @property
    def sizes(self) -> Array:
        """Gap of each constraint, or the size of its relative displacement (length), (rows,)."""
        values = self.state.values
        return np.linalg.norm(values, axis=1) if self.law.jump else values[:, 0]

    def change_of(self, u: Vecs) -> Array:
        """Change of ḡ when the unknowns change by u. Collective."""
        return self.operator.apply(handle_of(u[0]), handle_of(u[1]), self.state.scale)

    def evaluate(self, u: Vecs) -> None:
        """Compute the weighted gaps for unknowns u. Collective."""
        state = self.state
        if self.following is not None:
            self._cut_at(u)
            self._augmented_at_rows()
            return
        if self.turning is not None and self._turns_anew:
            self._turn_with(u)
        else:
            state.values = self.change_of(u) + state.offset
        state.values = state.values + state.shift + state.carried
        if state.turned is not None:
            state.values += state.turned.moved
        state.values -= (self.operator.initial_gap + state.allowance)[:, None]
        if self.condensed is not None:
            state.values = np.where(self.condensed, 0.0, state.values)
        self._augmented_at_rows()
        state.memory = state.memory.at(self.rows)

    # --- Co-rotated gaps

    def turning_error(self, places: TiePlaces) -> Array:
        """Error (length) of co-rotated gaps due to the assumption of small rotations, (rows,).

        Collective.

        Args:
            places: Positions of the surfaces at the last evaluation.
        """
        if self.turning is None or self.tie is None or self._turns_anew:
            return np.zeros(self.num_rows)
        slave, master = self.tie.motion(places)
        jump = self._own.apply(slave.handle, handle_of(master))
        for vec in (slave, master):
            if vec is not None:
                vec.destroy()
        error = self.state.values - jump - self.turning.moved(places, self._own)
        if self.condensed is not None:
            error = np.where(self.condensed, 0.0, error)
        return np.asarray(np.linalg.norm(error, axis=1))

    def _begin_to_turn(self) -> None:
        """Start to co-rotate the gaps between tied surfaces, if there are any. Collective."""
        assert self.tie is not None
        for master in self.master.bodies:  # a rigid tool moves with the surface tied to it
            turning = Turning(self.slave, master, self.points, self.tie.places())
            if turning.any:
                self.turning = turning
                self._turn_to(self.tie.places())

    def _turn_to(self, places: TiePlaces) -> None:
        """Co-rotate gaps with the surfaces at these positions. Collective."""
        assert self.turning is not None
        turned = self.turning.at(places, self._own, self._kind)
        if self._marked is not None:
            turned.operator.constrain(*map(handle_of, self._marked))
        self.state.turned = turned

    def _turn_with(self, u: Vecs) -> None:
        """Co-rotate gaps for these unknowns, and compute the displacement jumps. Collective."""
        state = self.state
        self._turn_to(self._places_with(u))
        handles = handle_of(u[0]), handle_of(u[1])
        state.values = self._own.apply(*handles, state.scale) + state.offset

    def add_turning(self, multiplier: Array, to: Destination) -> None:
        """Add the derivative of forces of constant λ due to co-rotated gaps. Collective.

        Args:
            multiplier: λ, (rows, gdim).
            to: Destination of the derivatives.
        """
        turned = self.state.turned
        assert self.turning is not None and turned is not None and self._marked is not None
        forces = self.weight[:, None] * multiplier
        self.turning.add_curvature(turned, forces, self._own, self._marked, to)

    def _places_with(self, u: Vecs) -> TiePlaces:
        """Positions of tied surfaces for these unknowns. Collective."""
        assert self.tie is not None
        return self.tie.moved(self.state.places, u, self.state.scale, self._offset)

    def _cut_at(self, u: Vecs) -> None:
        """Repeat the segmentation of the facets, displaced by these unknowns. Collective."""
        state = self.state
        assert self.following is not None and state.base is not None
        places = self.following.places(state.base, u, state.scale)
        self.show(self.following.cut(places, state.vertices))
        state.values = -(self._own.initial_gap + self.allowance)[:, None]
        state.memory = state.memory.at(self.rows)

    @property
    def allowance(self) -> Array:
        """Gap (length) of the constraints that counts as zero, (rows,). Collective."""
        if self.following is not None and isinstance(self.rows, PointRows):
            return self.rows.from_sides(self.state.allowance)
        return self.state.allowance

    def show(self, cut: Cut) -> None:
        """Use this evaluation as the last one, without changing the state. Collective."""
        is_same = self._own is cut.operator
        self.cut, self._own = cut, cut.operator
        if not is_same:
            are_own = self.following is not None and self.following.points_are_own
            self.rows = PointRows(cut.operator, self.slave, are_own, len(cut.alone.weight))
            self._at_rows = np.zeros(0), np.zeros(0)

    def rebase(self) -> None:
        """Let displacements count from the surfaces as they were last read. Collective."""
        assert self.following is not None
        self.state.base = self.following.pair()

    def choose_anew(self, u: Vecs, kept: tuple[bool, bool]) -> None:
        """Choose vertices with facets displaced by those unknowns alone that are kept. Collective.

        Vertices that carry a force keep their points and areas: otherwise the step would not begin
        in equilibrium.

        Args:
            u: The unknowns.
            kept: Whether the unknowns of each side are kept from step to step.
        """
        state, before = self.state, self.state.vertices
        assert self.following is not None and state.base is not None
        scale = state.scale[0] * kept[0], state.scale[1] * kept[1]
        state.vertices = self.following.choose(self.following.places(state.base, u, scale))
        if before is not None and state.vertices is not None:
            bears = self._bear() & (before > 0)
            state.vertices = np.where(bears, before, state.vertices)

    def _bear(self) -> Flags:
        """Vertices with a multiplier that carry a force, in the shape of ``GapState.vertices``."""
        state, known = self.state, self.state.of_vertices
        if self.own is None or state.vertices is None:
            return np.asarray(state.augmented > 0)
        out = np.zeros(state.vertices.shape, dtype=bool)
        if known is not None and known.on_nodes is state.augmented:
            out[known.vertex] = known.values > 0
        return out

    def choose_vertices(self) -> bool:
        """Give points to vertices that need them at the last evaluation. Collective.

        No vertex loses its point: with the point, faces may be inclined by just so much less that
        the vertex would not need it, and without the point by more.

        Returns:
            Whether vertices have got a point.
        """
        before = self.state.vertices
        if self.following is None or self.cut is None or before is None:
            return False
        chosen = self.following.choose(self.cut.places)
        assert chosen is not None
        vertices = np.where(before > 0, before, chosen)
        same = np.array_equal(vertices, before)
        if self.slave.comm.allreduce(same, op=MPI.LAND):
            return False
        self.state.vertices = vertices
        return True

    def evaluate_kept(self, u: Vecs, kept: tuple[bool, bool]) -> None:
        """Evaluate with those unknowns alone that are kept from step to step. Collective.

        A rigid tool is at its position at contact detection: its later motion belongs to the next
        step.
        """
        assert self.following is not None and self.state.base is not None
        state, base, scale = self.state, self.state.base, self.state.scale
        state.base = self.following.joined(base, self.following.paired_at)
        state.scale = state.scale[0] * kept[0], state.scale[1] * kept[1]
        self._cut_at(u)
        state.scale, state.base = scale, base

    def move_tool(self, position: Array) -> None:
        """Set the position of a rigid tool for updated gaps, see ``RigidSurface.position``."""
        assert self.following is not None and self.state.base is not None
        self.state.base = self.state.base[0], position

    def slip_at_points(self, start: Places) -> SlipAtPoints:
        """Slip at the points of the last evaluation relative to these positions. Collective."""
        assert self.following is not None and self.cut is not None
        return self.following.slip_at_points(self.cut, start)

    def add_slip_curvature(
        self,
        traction: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add the derivative of the friction forces of fixed τ, (rows, gdim). Collective.

        Args:
            traction: τ.
            moves: Whether points move on their facets.
            to: Destination of the derivatives.
        """
        if self.following is None or self.cut is None:
            return
        self.following.add_slip_curvature_of_points(self.cut, self._share * traction, moves, to)

    def set_offset(self, u: Vecs) -> None:
        """Set displacements that are added to those of the unknowns. Collective."""
        if self.following is not None:
            at = self.following.paired_at
            base = self.following.joined(at, self.state.base or at)
            self.state.base = self.following.places(base, u)
            return
        operator = self._own if self._turns_anew else self.operator
        self.state.offset = operator.apply(handle_of(u[0]), handle_of(u[1]))
        if self.turning is not None:
            assert self.tie is not None
            self._offset = self.tie.values(u)

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        self.operator.constrain(handle_of(slave), handle_of(master))
        if self.turning is not None:
            for vec in self._marked or ():
                if vec is not None:
                    vec.destroy()
            self._marked = slave.copy(), None if master is None else master.copy()
        if self.following is not None:
            self.following.constrain(slave, master)

    def add_curvature_of_points(self, pressure: Array, moves: bool, to: Destination) -> None:
        """Add the derivative of Σ_p w_p p_p ∂g_p for fixed p_p, for updated gaps. Collective.

        Args:
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            to: Destination of the derivatives.
        """
        assert self.following is not None and self.cut is not None
        self.following.add_curvature_of_points(self.cut, self._share * pressure, moves, to)

    @property
    def has_segments(self) -> bool:
        """Whether the constraints are at points of segments, see ``Following``."""
        return self.following is not None and self.following.has_segments

    def add_point_forces(self, state: PointState, to: Destination) -> None:
        """Add the derivative of forces, R_λ and R_τ at points of segments. Collective.

        Args:
            state: State of the points, for stress without the share of this integration side.
            to: Destination of the derivatives.
        """
        assert self.following is not None and self.cut is not None
        share, traction, turning = self._share, state.traction, state.turning
        state = state._replace(
            pressure=share * state.pressure,
            traction=None if traction is None else share * traction,
            rest=share * state.rest,
            turning=None if turning is None else share * turning,
        )
        self.following.add_point_forces(self.cut, state, to)

    def mixed(self, rest: Array, turning: tuple[Array, int] | None = None) -> Mixed | None:
        """Change of Σ_p w_p r_p N_k with the facets; None without any. Collective.

        Args:
            rest: r_p, (rows,).
            turning: Vectors that turn with the facets, (rows, gdim), and the number of their
                component of which r_p is a part, up to terms that do not turn; None if there are
                none.
        """
        if self.following is None or self.cut is None:
            return None
        if turning is not None:
            turning = self._share * turning[0], turning[1]
        return self.following.mixed(self.cut, self._share * rest, turning)

    def moving_slip(self, start: Places, leaning: Array, kept: Array) -> Changes:
        """Derivative of the slip since then, with moving points and planes. Collective.

        Args:
            start: Positions at the start.
            leaning: l_p (length) of the term −l_p δn, (rows,).
            kept: Vectors (length) at the start that turn since then, (rows, gdim).
        """
        assert self.following is not None and self.cut is not None
        slip = self.following.slip_at_points(self.cut, start)
        return self.following.moving_slip(self.cut, slip, leaning, kept)

    def fits_pattern(self) -> bool:
        """Whether the sparsity pattern of the tangent blocks fits the last evaluation."""
        return self.following is None or self.cut is None or self.following.fits(self.cut)

    def allow(self, allowance: Array) -> None:
        """Set the gaps (length) of constraints that count as zero; see ``GapState``. Collective."""
        before = self.allowance
        self.state.allowance = allowance
        self.state.values = self.state.values + (before - self.allowance)[:, None]

    def change(self, field: Affine) -> Array:
        """Change of ḡ when a rigid tool is displaced by this field. Collective."""
        r = affine_vec(self.slave, field) if self.tie is None else self.tie.of_tool(field)
        out = -self.operator.apply(r.handle, 0)
        r.destroy()
        return out

    def multiplier(self, penalty: float) -> Array:
        """λ at the last evaluation, shape (rows, 1) or (rows, gdim). Collective."""
        eps = penalty * self.relative_penalty
        return self.multiplier_of(self._shifted(eps), eps)

    def slope(self, penalty: float, touching: float) -> Array:
        """∂λ/∂ḡ at the last evaluation, shape (rows,). Collective."""
        eps = penalty * self.relative_penalty
        return self.slope_of(self._shifted(eps), eps, touching)

    def energy(self, penalty: float, part: float = 1.0) -> float:
        """This rank's part of the energy at the last evaluation. Collective.

        Args:
            penalty: ε, stress per length.
            part: a, the factor of the multipliers at the constraints, see ``PointConstraints``.
        """
        eps = penalty * self.relative_penalty
        density = self._of_law("energy", (self.num_rows,), self._shifted(eps), eps)
        if self.state.conductance is not None:
            return float(self.weight @ density)
        known = np.sum(self._augmented_at_rows() ** 2, axis=1)
        return float(self.weight @ (density - known / (2 * part * eps)))

    def _shifted(self, eps: Array) -> Array:
        if self.state.conductance is not None:  # h may be 0, and there is no multiplier
            return self.state.values
        return self.state.values + self._augmented_at_rows() / eps[:, None]

    def _augmented_at_rows(self) -> Array:
        """λ̂ at the constraints, updated when it changes; 0 with a penalty alone. Collective."""
        if not self._is_augmented:
            return np.zeros_like(self.state.values)
        augmented = self.state.augmented
        if not isinstance(self.rows, PointRows):
            return augmented
        if self._at_rows[0] is not augmented:
            own, known = self.own, self.state.of_vertices
            if own is not None and known is not None and known.on_nodes is augmented:
                self._at_rows = augmented, own.at_rows(known.at(own))
            else:
                self._at_rows = augmented, self.rows.from_sides(augmented)[:, None]
        return self._at_rows[1]

    @property
    def augmented_at_rows(self) -> Array:
        """λ̂ at the constraints, (rows, width). Collective."""
        return self._augmented_at_rows()

    # --- The law, with its history variables

    def multiplier_of(self, gap: Array, eps: Array) -> Array:
        """λ of the law for these gaps (stress), of the shape of the gaps. Collective.

        Raises:
            ValueError: If a user's law returns an array of another shape.
            NoMultiplierError: If it returns a number that is not finite.
        """
        return self._of_law("multiplier", gap.shape, gap, eps)

    def slope_of(self, gap: Array, eps: Array, touching: float) -> Array:
        """∂λ/∂ḡ of the law for these gaps (stress per length), (rows,). Collective.

        Raises:
            ValueError: If a user's law returns an array of another shape.
            NoMultiplierError: If it returns a number that is not finite.
        """
        return self._of_law("slope", (self.num_rows,), gap, eps, touching)

    def _of_law(
        self, function: str, shape: tuple[int, ...], gap: Array, eps: Array, *others: float
    ) -> Array:
        """Result of a function of the law; errors are raised on all ranks. Collective.

        Args:
            function: Name of the function.
            shape: Shape of its result.
            gap: Gaps, the first argument.
            eps: ε, the second argument.
            others: Further arguments.
        """
        known, call = self.state.memory.known, getattr(self.law, function)
        if type(self.law) in BUILT_IN:
            return np.asarray(call(gap, eps, *others))
        with collective_errors(self.slave.comm), named_keys(self.law, "law"):
            found = np.asarray(call(gap, eps, *others, **known))
            whole = "the gap's shape" if function == "multiplier" else "shape"
            text = f"law: {function} must return an array of {whole} {shape}, not {found.shape}"
            require(found.shape == shape, text)
            named = f"law: {type(self.law).__name__}.{function}"
            check_finite(named, found, [("gap", gap), *known.items()], self.of)
        return found

    def commit(self, penalty: float) -> None:
        """Compute the history variables of the law at the end of a step. Collective.

        Args:
            penalty: ε, stress per length.

        Raises:
            ValueError: If a user's law returns anything else.
        """
        memory = self.state.memory
        if not memory.first:
            return
        eps = penalty * self.relative_penalty
        gap = self._shifted(eps)
        with collective_errors(self.slave.comm), named_keys(self.law, "law"):
            found = self.law.commit(gap, eps, **memory.known)
            found = committed(self.law, "law", found, self.num_rows)
        self.state.memory = memory.after(self.rows, found)

    # --- λ̂ at all owned nodes, unchanged by an update of the contact pairs

    def augmented_on_nodes(self) -> Array:
        """λ̂ at all owned nodes, 0 where there is none.

        In corners and with constraints at points it is given per smooth patch; with constraints at
        points the parts of the patches in contact follow.
        """
        augmented = self.state.augmented
        if isinstance(self.rows, NodeRows):
            return self.rows.on_sides(augmented)
        closed = self.state.closed
        closed = np.asarray(augmented > 0, dtype=np.float64) if closed is None else closed
        return np.concatenate([augmented, closed], axis=1)

    def set_augmented_on_nodes(self, values: Array) -> None:
        """Restore values of :meth:`augmented_on_nodes`."""
        values, rows = np.asarray(values, dtype=np.float64), self.rows
        if isinstance(rows, NodeRows):
            self.state.augmented = rows.from_sides(values)
            return
        block = self.slave.block
        augmented, known = np.ascontiguousarray(values[:, :block]), self.state.of_vertices
        if known is not None:
            augmented = known.recognised(augmented, self.slave.comm)
        self.state.augmented = augmented
        self.state.closed = np.ascontiguousarray(values[:, block:])

    def carry(self, meshes: bool) -> None:
        """Add the motion of a tool, and perhaps of meshes, since the tie was made. Collective."""
        assert self.tie is not None
        if meshes:
            self.state.places = self.tie.places()
            if self.turning is not None:
                self._turn_to(self.state.places)
        slave, master = self.tie.motion(self.state.places)
        self.state.carried = self._own.apply(slave.handle, handle_of(master))
        for vec in (slave, master):
            if vec is not None:
                vec.destroy()

    # --- Forces

    def add_forces(self, multiplier: Array, b: Vecs) -> None:
        """Add Gᵀ S λ to b, the derivative of the energy. Collective."""
        force = np.ascontiguousarray(self.weight[:, None] * multiplier)
        self.operator.add_transpose(force, handle_of(b[0]), handle_of(b[1]))

    def add_stiffness(
        self, slope: Array, blocks: typing.Sequence[PETSc.Mat | None], pattern: bool
    ) -> None:
        """Add Gᵀ S diag(slope) G to the blocks (ss, sm, ms, mm), or only set their pattern."""
        handles = [handle_of(mat) for mat in blocks]
        operator = self.operator
        if pattern and self.following is not None and self.cut is not None:
            operator = self.following.make_pattern(self.cut)
        stiffness = np.zeros(operator.num_rows) if pattern else self.stiffness(slope)
        _cpp.insert_contact(operator, stiffness, handles, self.state.scale, pattern)

    def stiffness(self, slope: Array) -> Array:
        """S diag(slope), force per length of ḡ, shape (rows,), or of components (rows, width)."""
        stiffness = self.weight * slope
        if self.condensed is None:
            return stiffness
        return np.ascontiguousarray(stiffness[:, None] * ~self.condensed)
