"""The weighted gap of one pass: where the multiplier lives and what it acts on."""

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
from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.following import (
    Changes,
    Cut,
    Destination,
    Following,
    MovingFunctions,
    Places,
    SlipAtPoints,
)
from qsdolfinx.gap.laws import Law
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

#: What rows are, in the order of GapRows in cpp/gap/gap.h.
KINDS = ("area", "cover", "points")


@dataclasses.dataclass
class GapState:
    """What changes at the rows of a weighted gap, while its pairing stays.

    Arrays are replaced, never written into: a shallow copy keeps the state.

    Attributes:
        values: ḡ of the last evaluation, shape (rows, 1) or (rows, gdim); at first that of u = 0.
        augmented: λ̂, of the same shape; with rows at points for the sides of all owned nodes,
            shape (nodes, gdim), see ``PointRows``. With a penalty alone λ of the last solution,
            where the next solve begins.
        offset: Gap of displacements on top of those of the unknowns, of the same shape.
        shift: What a rigid tool's motion adds to ḡ, of the same shape.
        allowance: Gap (length) at each row that counts as none: overclosure that is not resolved.
            Of gaps that follow, of the sides of nodes, as ``augmented``.
        scale: Displacement per unknown of the slave's and of the master's body.
        carried: Jump (length) that meshes and a tool have made since they were tied, likewise.
        places: Where meshes had moved tied surfaces by then; None where they were tied.
        turned: How gaps between tied surfaces have turned by then, or by the last evaluation.
        base: Where facets that follow their bodies are with unknowns 0.
        vertices: Where points are vertices, the areas that they stand for at the sides of owned
            nodes that have one, 0 at others, (nodes, block): they stay as they were when they were
            chosen, since multipliers are over them. None where points are on facets.
        conductance: h of the rows, of contact that conducts; None of other laws.
        closed: With rows at points, the closed part of what each side of an owned node covers at
            the last solution, (nodes, gdim); None before any.
        memory: What the law remembered of the owned nodes when the step began, by name, (nodes,).
        committed: The same from the end of the last step on, as long as no other has begun.
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
    conductance: Array | None = None
    closed: Array | None = None
    memory: dict[str, Array] = dataclasses.field(default_factory=dict)
    committed: dict[str, Array] | None = None


class WeightedGap:
    """ḡ_k = (1/S_k) Σ_p w_p N_k(ξ_p) [(u_s − u_m)·n_p − δ_p] on the slave nodes of this rank.

    A jump law weights the vector u_s − u_m instead. One row per slave node that a pairing point
    reaches, and in the corner of several walls one per side of the node, whose area takes the place
    of S_k; or, with rows at points, one per pairing point, g_p = (u_s − u_m)·n_p − δ_p with the
    weight w_p in place of S_k.

    With an augmented Lagrangian, the law sees the gap ḡ + λ̂/ε, λ̂ being the multiplier so far: it
    then gives λ = [λ̂ + ε ḡ]₊ or λ̂ + ε ⟦u⟧. With λ̂ = 0 that is the penalty method. Nodes that are
    covered in part get a larger ε there, S_k / Σ w_p N_k times: otherwise they
    would need very many updates of λ̂.

    With rows at points λ̂ still belongs to the nodes, at creases one to each smooth side of the
    surface, and points see λ̂_h = Σ_k λ̂_k N_k(ξ_p). It is
    updated to the function that is closest to [λ̂_h + ε g_p]₊. λ̂ may become negative at a node
    beside the edge of contact, where λ̂_h is to follow a pressure that ends within a facet.

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
        rows: What rows are: ``"area"``, nodes, whose gap is divided by S_k; ``"cover"``, by what is
            covered of it; or ``"points"``.
        augmented: Whether λ̂ is going to be updated.
        following: Cuts the facets anew at each evaluation, with rows at points; None for gaps that
            are linear in u. The operator is then the derivative at the last evaluation.
        turns: Whether what is between tied surfaces turns with the master: ``"finite"``, with each
            evaluation, or ``"small"``, by small rotations since meshes moved; None for not.
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
    ) -> None:
        self.slave = slave
        self.master = master
        self.points = points
        self.law = law
        self._kind, self._share, self._is_augmented = KINDS.index(rows), share, augmented
        self.following = following
        #: The last evaluation of gaps that follow the bodies.
        self.cut: Cut | None = None
        base = vertices = None
        if following is not None:
            base = following.paired_at
            vertices = following.choose(base)
            self.cut = following.cut(base, vertices)
        #: Without what turns.
        self._own = self._operator(law.jump) if self.cut is None else self.cut.operator
        self._marked: Vecs | None = None
        #: What turns between tied surfaces; None for nothing.
        self.turning: Turning | None = None
        self._turns_anew = turns == "finite"
        self._offset: tuple[Array, Array | None] | None = None
        zero = np.zeros((self._own.num_rows, self._own.width))
        multipliers: Array = zero
        #: How values go between the rows and the slave's nodes.
        self.rows: Rows
        if rows == "points":
            are_own = following is not None and following.points_are_own
            self.rows = point_rows = PointRows(self._own, slave, are_own)
            multipliers = np.zeros_like(point_rows.cover_of_sides)
        else:
            self.rows = NodeRows(self._own, slave, points.by_sides)
        #: Components of λ̂ that conditions hold on both sides; None if there are none anywhere.
        self.extension: Extension | None = None
        #: What changes while the pairing stays.
        allowance = zero[:, 0] if following is None else np.zeros_like(multipliers)
        self.state = GapState(zero, multipliers, zero, zero, allowance)
        self.state.base, self.state.vertices = base, vertices
        self.forget()
        #: How ties count what has moved since they were made; None of other laws.
        self.tie = Tie(slave, master) if law.jump and not slave.is_scalar else None
        if turns and self.tie is not None:
            self._begin_to_turn()
        self._at_rows: tuple[Array, Array] = multipliers, zero
        if not law.jump:
            self.state.values = -self._own.initial_gap[:, None]

    @property
    def operator(self) -> _cpp.GapOperator:
        """Derivative of the gaps, where they are linear or at the last evaluation."""
        turned = self.state.turned
        return self._own if turned is None else turned.operator

    @property
    def is_linear(self) -> bool:
        """Whether gaps are linear functions of the unknowns."""
        return self.following is None and not (self.turning and self._turns_anew)

    @property
    def _area(self) -> Array:
        """What each row's gap is divided by."""
        return self.operator.row_area

    @property
    def share(self) -> float:
        """Part of the energy that the pass stands for."""
        return self._share

    @property
    def weight(self) -> Array:
        """Area in the energy of each row: what its gap is divided by, times the share."""
        return np.asarray(self._share * self._area)

    @property
    def multiplier_weight(self) -> Array:
        """Area of each multiplier, of the shape of λ̂."""
        if isinstance(self.rows, PointRows):
            return np.asarray(self._share * self.rows.cover_of_sides)
        return self.weight[:, None] * np.ones(self.operator.width)

    @property
    def relative_penalty(self) -> Array:
        """ε of each row in units of the contact's; h where that is 1."""
        if self.state.conductance is not None:
            return self.state.conductance
        if not (self._is_augmented and KINDS[self._kind] == "cover"):
            return np.ones(self.num_rows)
        return np.asarray(self.rows.node_area[self.operator.row_node] / self._area)

    def by_node(self) -> WeightedGap:
        """The same with a row for each node: itself, unless rows are points. Collective."""
        if not self.rows.are_points:
            return self
        surfaces = self.slave, self.master
        return WeightedGap(
            *surfaces, self.points, self.law, self._share, "cover", self._is_augmented
        )

    @property
    def present_points(self) -> _cpp.PairingPoints:
        """Pairing points, of gaps that follow the bodies those of the last evaluation."""
        if self.following is None or self.cut is None:
            return self.points
        return self.following.pairing_points(self.cut)

    def _operator(self, jump: bool, kind: int | None = None) -> _cpp.GapOperator:
        surfaces = self.slave.cpp_object, self.master.cpp_object
        rows = self._kind if kind is None else kind
        return _cpp.GapOperator(*surfaces, self.points, jump=jump, rows=rows)

    @property
    def num_rows(self) -> int:
        """Rows on this rank."""
        return self._own.num_rows

    @functools.cached_property
    def cover_share(self) -> Array:
        """ḡ of a gap that is 1 everywhere, shape (rows,). Collective at first.

        Σ_p w_p N_k over what a row's gap is divided by: 1, unless that is the area of a node.
        """
        if KINDS[self._kind] != "area":
            return np.ones(self.num_rows)
        cover = self._operator(False, KINDS.index("cover")).row_area
        return np.asarray(cover / self.operator.row_area)

    def jump_operator(self) -> _cpp.GapOperator:
        """The operator of the whole jump vector, at the same rows. Collective."""
        if self.following is not None and self.cut is not None:
            return self.following.jump_operator(self.cut)
        return self.operator if self.law.jump else self._operator(True)

    def change_of(self, u: Vecs) -> Array:
        """How ḡ changes when the unknowns change by u. Collective."""
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
        if not self.law.jump:
            state.values -= (self.operator.initial_gap + state.allowance)[:, None]
        elif self.extension is not None:
            state.values = np.where(self.extension.held, 0.0, state.values)
        self._augmented_at_rows()

    # --- Gaps that turn

    def turning_error(self, places: TiePlaces) -> Array:
        """By how much rotations are too large for gaps that turn by small ones, (rows,).

        Length; collective.

        Args:
            places: Where the surfaces are at the last evaluation.
        """
        if self.turning is None or self.tie is None or self._turns_anew:
            return np.zeros(self.num_rows)
        slave, master = self.tie.motion(places)
        jump = self._own.apply(slave.handle, handle_of(master))
        for vec in (slave, master):
            if vec is not None:
                vec.destroy()
        error = self.state.values - jump - self.turning.moved(places, self._own)
        if self.extension is not None:
            error = np.where(self.extension.held, 0.0, error)
        return np.asarray(np.linalg.norm(error, axis=1))

    def _begin_to_turn(self) -> None:
        """Let what is between tied surfaces turn, if there is anything. Collective."""
        assert self.tie is not None
        if not isinstance(self.master, Surface):
            return  # which takes along what is tied to it
        turning = Turning(self.slave, self.master, self.points, self.tie.places())
        if not turning.any:
            return
        self.turning = turning
        self._turn_to(self.tie.places())

    def _turn_to(self, places: TiePlaces) -> None:
        """Let gaps turn as surfaces at these places tell. Collective."""
        assert self.turning is not None
        turned = self.turning.at(places, self._own, self._kind)
        if self._marked is not None:
            turned.operator.constrain(*map(handle_of, self._marked))
        self.state.turned = turned

    def _turn_with(self, u: Vecs) -> None:
        """Let gaps turn as the unknowns tell, and find the jumps without them. Collective."""
        state = self.state
        self._turn_to(self._places_with(u))
        handles = handle_of(u[0]), handle_of(u[1])
        state.values = self._own.apply(*handles, state.scale) + state.offset

    def _places_with(self, u: Vecs) -> TiePlaces:
        """Where unknowns put tied surfaces. Collective."""
        assert self.tie is not None
        return self.tie.moved(self.state.places, u, self.state.scale, self._offset)

    def _cut_at(self, u: Vecs) -> None:
        """Cut the facets anew where the unknowns put them. Collective."""
        state = self.state
        assert self.following is not None and state.base is not None
        places = self.following.places(state.base, u, state.scale)
        self.show(self.following.cut(places, state.vertices))
        state.values = -(self._own.initial_gap + self.allowance)[:, None]

    @property
    def allowance(self) -> Array:
        """Gap (length) at the rows that counts as none, (rows,). Collective."""
        if self.following is not None and isinstance(self.rows, PointRows):
            return self.rows.from_sides(self.state.allowance)
        return self.state.allowance

    def show(self, cut: Cut) -> None:
        """Take what an evaluation has found for the last one, but for the state. Collective."""
        is_same = self._own is cut.operator
        self.cut, self._own = cut, cut.operator
        if not is_same:
            are_own = self.following is not None and self.following.points_are_own
            self.rows = PointRows(cut.operator, self.slave, are_own)
            self._at_rows = np.zeros(0), np.zeros(0)

    def rebase(self) -> None:
        """Let displacements count from where the surfaces were read last. Collective."""
        assert self.following is not None
        self.state.base = self.following.pair()

    def choose_anew(self, u: Vecs, kept: tuple[bool, bool]) -> None:
        """Choose vertices where those unknowns alone put the facets that are kept. Collective.

        Those that bear keep their points and areas: else the step would not begin in equilibrium.

        Args:
            u: The unknowns.
            kept: Which of the two sides are.
        """
        state, before = self.state, self.state.vertices
        assert self.following is not None and state.base is not None
        scale = state.scale[0] * kept[0], state.scale[1] * kept[1]
        state.vertices = self.following.choose(self.following.places(state.base, u, scale))
        if before is not None and state.vertices is not None and self.following.points_are_own:
            bears = (state.augmented > 0) & (before > 0)
            state.vertices = np.where(bears, before, state.vertices)

    def choose_vertices(self) -> bool:
        """Give points to vertices that need them at the last evaluation; whether others do.

        None loses its point: with it faces may lean by just so much less that it would not need it,
        and without it by more. Collective.
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
        """Evaluate for those unknowns alone that are kept from step to step. Collective.

        A rigid tool is where contact was paired: what it has moved since is of the step to come.
        """
        assert self.following is not None and self.state.base is not None
        state, base, scale = self.state, self.state.base, self.state.scale
        if self.following.tool is not None:
            state.base = base[0], self.following.paired_at[1]
        state.scale = state.scale[0] * kept[0], state.scale[1] * kept[1]
        self._cut_at(u)
        state.scale, state.base = scale, base

    def move_tool(self, position: Array) -> None:
        """Put a rigid tool that gaps follow there, see ``RigidSurface.position``."""
        assert self.following is not None and self.state.base is not None
        self.state.base = self.state.base[0], position

    def slip_at_points(self, start: Places) -> SlipAtPoints:
        """Slip at the points of the last evaluation since everything was there. Collective."""
        assert self.following is not None and self.cut is not None
        return self.following.slip_at_points(self.cut, start)

    def add_slip_curvature(
        self,
        traction: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add how forces of friction τ, (rows, gdim), change with τ held. Collective.

        Args:
            traction: τ.
            moves: Whether points move on their facets.
            to: Where to.
        """
        if self.following is None or self.cut is None:
            return
        self.following.add_slip_curvature_of_points(self.cut, self._share * traction, moves, to)

    def set_offset(self, u: Vecs) -> None:
        """Set displacements on top of those of the unknowns. Collective."""
        if self.following is not None:
            at, there = self.following.paired_at, self.state.base
            base = at if self.following.tool is None or there is None else (at[0], there[1])
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
        """Add how Σ_p w_p p_p ∂g_p changes with p_p held, of gaps that follow. Collective.

        Args:
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            to: Where to.
        """
        assert self.following is not None and self.cut is not None
        self.following.add_curvature_of_points(self.cut, self._share * pressure, moves, to)

    def moving_functions(
        self,
        of_sides: Array,
        rest: Array,
        moves: bool,
        turning: tuple[Array, int] | None = None,
    ) -> MovingFunctions | None:
        """How λ_h moves at the last evaluation; None if it does not. Collective.

        Args:
            of_sides: λ of the sides of owned nodes, (nodes, block).
            rest: r_p, see :class:`MovingFunctions`, (rows,).
            moves: Whether points move on their facets.
            turning: Vectors that r_p is this component of, less what stays, and that turn with the
                facets, (rows, gdim); None if there are none.
        """
        if self.following is None or self.cut is None:
            return None
        if turning is not None:
            turning = self._share * turning[0], turning[1]
        return self.following.moving_functions(
            self.cut, of_sides, self._share * rest, moves, turning
        )

    def moving_slip(self, start: Places, leaning: Array) -> Changes:
        """Derivative of the slip since then with what points move by, and −l_p δn. Collective."""
        assert self.following is not None and self.cut is not None
        slip = self.following.slip_at_points(self.cut, start)
        return self.following.moving_slip(self.cut, slip, leaning)

    def fits_pattern(self) -> bool:
        """Whether the blocks of the tangent have room for the last evaluation."""
        return self.following is None or self.cut is None or self.following.fits(self.cut)

    def allow(self, allowance: Array) -> None:
        """Set the gaps (length) of the rows that count as none; see ``GapState``. Collective."""
        before = self.allowance
        self.state.allowance = allowance
        self.state.values = self.state.values + (before - self.allowance)[:, None]

    def moving_gaps(self) -> Changes:
        """How gaps change, those that follow with what points move by on facets. Collective."""
        if self.following is None or self.cut is None:
            return Changes(self.operator)
        return self.following.moving_gaps(self.cut)

    def change(self, field: Affine, operator: _cpp.GapOperator | None = None) -> Array:
        """How ḡ changes when a rigid tool is displaced by this field. Collective.

        Args:
            field: The field.
            operator: What to take in place of :attr:`operator`.
        """
        r = affine_vec(self.slave, field) if self.tie is None else self.tie.of_tool(field)
        out = -(operator or self.operator).apply(r.handle, 0)
        r.destroy()
        return out

    def multiplier(self, penalty: float) -> Array:
        """λ at the last evaluation, shape (rows, 1) or (rows, gdim). Collective."""
        eps = penalty * self.relative_penalty
        return self.law.multiplier(self._shifted(eps), eps, **self._memory_at_rows())

    def slope(self, penalty: float, touching: float) -> Array:
        """∂λ/∂ḡ at the last evaluation, shape (rows,). Collective."""
        eps = penalty * self.relative_penalty
        return self.law.slope(self._shifted(eps), eps, touching, **self._memory_at_rows())

    def energy(self, penalty: float, part: float = 1.0) -> float:
        """This rank's part of the energy at the last evaluation. Collective.

        Args:
            penalty: ε, stress per length.
            part: a, what rows see of multipliers, see ``PointConstraints``.
        """
        eps = penalty * self.relative_penalty
        density = self.law.energy(self._shifted(eps), eps, **self._memory_at_rows())
        if self.state.conductance is not None:
            return float(self.weight @ density)
        known = np.sum(self._augmented_at_rows() ** 2, axis=1)
        return float(self.weight @ (density - known / (2 * part * eps)))

    def _shifted(self, eps: Array) -> Array:
        if self.state.conductance is not None:  # which may be 0, and has nothing to augment
            return self.state.values
        return self.state.values + self._augmented_at_rows() / eps[:, None]

    def _augmented_at_rows(self) -> Array:
        """λ̂ at the rows, found anew when it is replaced; 0 with a penalty alone. Collective."""
        if not self._is_augmented:
            return np.zeros_like(self.state.values)
        augmented = self.state.augmented
        if not isinstance(self.rows, PointRows):
            return augmented
        if self._at_rows[0] is not augmented:
            self._at_rows = augmented, self.rows.from_sides(augmented)[:, None]
        return self._at_rows[1]

    # --- What the law remembers

    @property
    def memory(self) -> dict[str, Array]:
        """What the law remembers of the owned nodes since the last step, by name, (nodes,)."""
        committed = self.state.committed
        return self.state.memory if committed is None else committed

    def set_memory(self, memory: dict[str, Array]) -> None:
        """Put back what :attr:`memory` gave."""
        self.state.memory, self.state.committed = memory, None

    def forget(self) -> None:
        """Let the law remember what it does at first."""
        count, first = len(self.slave.node_area), self.law.memory
        self.set_memory({name: np.full(count, float(first[name])) for name in first})

    def _memory_at_rows(self) -> dict[str, Array]:
        out = {name: self.rows.from_nodes(values) for name, values in self.state.memory.items()}
        for values in out.values():
            values.flags.writeable = False  # the law, the user's, is to return others
        return out

    def begin_step(self) -> None:
        """Let the law remember what it has at the end of the last step."""
        self.set_memory(self.memory)

    def commit(self, penalty: float) -> None:
        """Ask the law what it remembers from the last evaluation on.

        Args:
            penalty: ε, stress per length.

        Raises:
            ValueError: If the law, the user's, gives something else.
        """
        if not self.law.memory:
            return
        eps, before = penalty * self.relative_penalty, self._memory_at_rows()
        found = self.law.commit(self._shifted(eps), eps, **before)
        names = sorted(found)
        fits = names == sorted(self.law.memory)
        require(fits, f"law: commit must return {sorted(self.law.memory)}, not {names}")
        committed = {}
        for name, values in found.items():
            values = np.asarray(values, dtype=np.float64)
            fits = values.shape == (self.num_rows,) and bool(np.isfinite(values).all())
            require(fits, f"law: commit must return finite {name!r} for each constraint")
            kept = self.state.memory[name]
            change = self.rows.on_nodes(values - before[name], 0.0).astype(np.float64)
            committed[name] = kept + change
        self.state.committed = committed

    # --- λ̂ at all owned nodes, the same when contact pairs anew

    def augmented_on_nodes(self) -> Array:
        """λ̂ at all owned nodes, in corners and at points of their sides; 0 where there is none.

        At points with the closed parts of the sides.
        """
        augmented = self.state.augmented
        if isinstance(self.rows, NodeRows):
            return self.rows.on_sides(augmented)
        closed = self.state.closed
        closed = np.asarray(augmented > 0, dtype=np.float64) if closed is None else closed
        return np.concatenate([augmented, closed], axis=1)

    def set_augmented_on_nodes(self, values: Array) -> None:
        """Put back what :meth:`augmented_on_nodes` gave."""
        values, rows = np.asarray(values, dtype=np.float64), self.rows
        if isinstance(rows, NodeRows):
            self.state.augmented = rows.from_sides(values)
            return
        block = self.slave.block
        self.state.augmented = np.ascontiguousarray(values[:, :block])
        self.state.closed = np.ascontiguousarray(values[:, block:])

    def carry(self, meshes: bool) -> None:
        """Let a tie count how a tool, and perhaps meshes, have moved since then. Collective."""
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
        """Add Gᵀ S diag(slope) G to the blocks (ss, sm, ms, mm), or only fix their pattern."""
        handles = [handle_of(mat) for mat in blocks]
        operator = self.operator
        if pattern and self.following is not None and self.cut is not None:
            operator = self.following.make_pattern(self.cut)
        stiffness = np.zeros(operator.num_rows) if pattern else self.stiffness(slope)
        _cpp.insert_contact(operator, stiffness, handles, self.state.scale, pattern)

    def stiffness(self, slope: Array) -> Array:
        """S diag(slope), force per length of ḡ, shape (rows,), or of components (rows, width)."""
        stiffness = self.weight * slope
        if self.extension is None or not self.law.jump:
            return stiffness
        return np.ascontiguousarray(stiffness[:, None] * ~self.extension.held)
