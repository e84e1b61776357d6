"""Gaps that follow the bodies: they are found anew wherever the unknowns put these."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.surface.affine import trace_positions, trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Of the slave and of the master: where the nodes of the trace are, (facets, nodes, 3); of a rigid
#: tool its position, see ``RigidSurface.position``.
Places = tuple[Array, Array]
Vecs = tuple[PETSc.Vec, PETSc.Vec | None]

#: Part of a node's area below which what its points cover does not count: D_k is at least that.
LEAST_COVER = 0.01

#: Measures and allowances that are kept, of which vectors are.
MAX_KEPT = 16

#: Part below which neighbours carry its multiplier; as in cpp/gap/piece_forces.cpp.
HARDLY_COVERED = 0.1

#: Turns by more (radians) are not told from those the other way round; as in cpp/sliding/ray.cpp.
MOST_TURNED = 2.6


@dataclasses.dataclass(frozen=True)
class Measure:
    """Where areas were measured last: they are constants until they are again.

    Attributes:
        places: Where the facets were.
        area: D_k, what points cover of each owned node's area, and LEAST_COVER of it at least; S_k
            of nodes that nothing is opposite to, which may come into contact.
        node_area: S_k.
        cover: Part of S_k that is covered, at the smooth side of the node that keeps its
            multiplier, the closest one; 0 at the others; shape (nodes, gdim). There, and where
            hardly anything is covered, its neighbours on the facet carry it. None if all keep
            theirs on all ranks.
        vertices: Where points are vertices, the sides of owned nodes that have one, (nodes, block);
            None where they are on facets.
    """

    places: Places
    area: Array
    node_area: Array
    cover: Array | None
    vertices: Flags | None = None

    @property
    def hardly_covered(self) -> npt.NDArray[np.bool_]:
        """Sides of nodes where neighbours carry their multipliers, (nodes, gdim) or (1, 1)."""
        if self.cover is None:
            return np.zeros((1, 1), dtype=bool)
        return np.asarray(self.cover < HARDLY_COVERED)


#: Numbers at points of rims, for their gaps and what gives values of fields of nodes there.
AtRim = typing.Callable[[Array, typing.Callable[[PETSc.Vec], Array]], Array]


class NoGapError(ValueError):
    """Facets are where gaps cannot be measured: an iterate of Newton's method has gone too far."""


class Found(typing.NamedTuple):
    """What is opposite to each other somewhere.

    Attributes:
        cover: As given.
        allowance: As given.
        rows: What it gives to the nodes of the slave.
        of_cutter: What else the cutter wants to know of it.
        num_missed: Pieces on this rank with a ray that meets no point.
    """

    cover: PETSc.Vec | None
    allowance: PETSc.Vec | None
    rows: _cpp.PieceRows
    of_cutter: typing.Any
    num_missed: int = 0


class Alone(typing.NamedTuple):
    """Points that see the multiplier of one side of a node each, where nothing is opposite.

    Attributes:
        unknown: Global unknowns of the slave that stand for these sides of owned nodes.
        weight: Areas.
        far: Their gaps (length), open.
    """

    unknown: npt.NDArray[np.int64]
    weight: Array
    far: float


class SlipAtPoints(typing.NamedTuple):
    """Slip at the points of the last evaluation.

    Attributes:
        slip: Of the slave against the other side, (rows, gdim).
        normal: Outward of the slave, likewise.
        operator: Its derivative, a matrix for each node.
        works: What tractions work on.
        facets: What tells apart between which facets points are, (rows, n).
        place: Where on the slave's: functions of its vertices, (rows, vertices).
        arc: Way along the surfaces over the slip, which is its chord, (rows,).
        gap: Gap of the same places at the start (length), positive in penetration, (rows,).
    """

    slip: Array
    normal: Array
    operator: _cpp.GapOperator
    works: _cpp.GapOperator
    facets: npt.NDArray[np.int64]
    place: Array
    arc: Array
    gap: Array


class MovingFunctions(typing.NamedTuple):
    """How functions of the slave's nodes move along its facets at the last evaluation.

    Attributes:
        operator: Derivative of Σ_k λ_k N_k at the points, which are its rows.
        mixed: Of each body Σ_p w_p r_p ∂N_k for some numbers r_p: unknowns of the slave that stand
            for sides of nodes, unknowns of the body, −1 where conditions hold, and values.
    """

    operator: _cpp.GapOperator
    mixed: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]]


class Cutter(typing.Protocol):
    """Finds what is opposite to what, and gaps.

    Attributes:
        are_own: Whether points are vertices of the slave, each with a multiplier of its own.
    """

    are_own: bool

    def node_area(self, places: Places) -> Array:
        """S_k of the slave there. Collective."""

    def sides(self) -> Flags:
        """Sides of owned nodes that may have multipliers, (nodes, block). Collective."""

    def choose(self, places: Places) -> Flags | None:
        """``Measure.vertices`` there. Collective."""

    def find(
        self,
        places: Places,
        measured: Places,
        cover: PETSc.Vec | None,
        allowance: PETSc.Vec | None = None,
        vertices: Flags | None = None,
        at_points: bool = False,
    ) -> Found:
        """What is opposite to what at these places, with the areas of others. Collective.

        Args:
            places: The places; those of the last call are known if they are the same object.
            measured: Those where areas are measured.
            cover: ``Measure.cover`` at the unknowns of each node.
            allowance: a_k, likewise; None for none.
            vertices: ``Measure.vertices``.
            at_points: Whether rows of nodes are asked for what is covered alone.
        """

    def operator_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Derivative of the gaps of these points, which are its rows. Collective."""

    def jump_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Jump x_slave − x_master at these points, places on the facets staying. Collective."""

    def add_curvature_of_points(
        self,
        found: Found,
        pressure: Array,
        at_rim: typing.Callable[[Array, typing.Callable[[PETSc.Vec], Array]], Array],
        markers: Vecs,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> bool:
        """Add Σ_p w_p p_p ∂²g_p to the blocks; whether it is symmetric. Collective.

        Args:
            found: What has been found there.
            pressure: p_p.
            at_rim: p at other points, for their gaps and what gives values of fields of the sides
                of nodes there.
            markers: As for :meth:`add_curvature`.
            blocks: Likewise.
            scale: Likewise.
        """

    def moving_functions(
        self,
        found: Found,
        alone: Alone,
        field: PETSc.Vec,
        rest: Array,
        at_rim: AtRim | None,
        markers: Vecs,
    ) -> MovingFunctions | None:
        """How a field of the sides of the slave's nodes moves; None if it does not. Collective.

        Args:
            found: What has been found there.
            alone: Points that see one side of a node each.
            field: The field.
            rest: r_p, (rows,).
            at_rim: r at other points, as for :meth:`add_curvature_of_points`; None for 0.
            markers: As for :meth:`add_curvature`.
        """

    def slip_at_points(
        self, found: Found, places: Places, alone: Alone, start: Places
    ) -> SlipAtPoints:
        """Slip at these points since everything was at the start. Collective."""

    def add_slip_curvature_of_points(
        self,
        found: Found,
        traction: Array,
        of_sides: typing.Sequence[PETSc.Vec],
        markers: Vecs,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> None:
        """Add how the forces of tractions τ_p change with these held. Collective.

        Args:
            found: What has been found there.
            traction: τ_p, (rows, gdim).
            of_sides: Components of τ of the sides of nodes, for the rims; none for no tractions.
            markers: As for :meth:`add_curvature`.
            blocks: Likewise.
            scale: Likewise.
        """

    def points(self, found: Found) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps along the rays, positive when open."""

    def pairing_points(self, found: Found) -> _cpp.PairingPoints:
        """The same with what sees them, for other fields on the facets; normals are not known."""

    def facet_sizes(self, found: Found) -> Array:
        """Size (length) of the slave's facet at each of these points."""

    def find_nearby(self, places: Places) -> _cpp.PieceRows:
        """Columns of all rows that there may be, before anything moves by a margin. Collective."""

    def add_curvature(
        self,
        found: Found,
        multiplier: PETSc.Vec,
        markers: Vecs,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> bool:
        """Add Σ_k λ_k ∂²G_k to the blocks (ss, sm, ms, mm); whether it is symmetric. Collective."""

    def add_slip_forces(self, found: Found, traction: PETSc.Vec, b: Vecs) -> bool:
        """Add forces of friction on objective slip; False if a jump's will do. Collective."""

    def slip_rows(self, found: Found) -> list[_cpp.PieceRows]:
        """Variations of objective slip along each axis; none if a jump's will do. Collective."""

    def add_slip_curvature(
        self,
        found: Found,
        traction: PETSc.Vec,
        markers: Vecs,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> None:
        """Add how forces on objective slip change with tractions held. Collective."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """What one evaluation has found.

    Attributes:
        places: Where the facets are.
        measure: With which areas.
        found: What is opposite to what.
        operator: Derivative of the gaps (G_k − a_k C_k)/D_k; its ``initial_gap`` is −G_k/D_k.
        share: C_k/D_k of each owned node, C_k what is covered of it there.
        allowance: a_k, penetration (length) of each owned node that counts as none.
        alone: With rows at points, the last of them.
    """

    places: Places
    measure: Measure
    found: Found
    operator: _cpp.GapOperator
    share: Array
    allowance: Array
    alone: Alone | None = None

    @property
    def covered(self) -> npt.NDArray[np.bool_]:
        """Owned nodes that anything is opposite to."""
        return self.share > 0

    @property
    def jump(self) -> Array:
        """Mean of x_slave − x_master at each owned node, shape (nodes, 3)."""
        area = self.measure.area
        return np.asarray(self.found.rows.jump(len(area)) / area[:, None])


class Following:
    """Gaps of one pass as nonlinear functions of the unknowns: ḡ_k = G_k / D_k.

    Areas in G_k and D_k are those of the last measure. Forces are derivatives of G_k with points
    that keep their places on the facets: each of them conserves momentum and moment. Of penetration
    a_k that counts as none nothing is left in either: with C_k = Σ w N_k they are those of
    G_k − a_k C_k.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        radius: Distance (length) beyond which nothing is opposite.
        cutter: Finds what is opposite to what.
        at_points: Whether rows are the points themselves, with the multipliers of all sides of
            nodes.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        radius: float,
        cutter: Cutter,
        at_points: bool = False,
    ) -> None:
        self.at_points = at_points
        #: Sides of owned nodes that have multipliers, (nodes, block).
        self._sides_of_nodes = cutter.sides()
        self._slave, self._master, self._cutter = slave, master, cutter
        self._tool = as_tool(master)
        self._creases = bool(np.any(slave.cpp_object.vertex_side > 0))
        self._objects = slave.cpp_object, master.cpp_object
        self.radius = radius
        self._values = [TraceValues(s) for s in (slave, master) if isinstance(s, Surface)]
        #: Where the surfaces were when they were paired.
        self.paired_at: Places
        self.pair()
        self._last: Cut | None = None
        self._jump: tuple[Cut, _cpp.GapOperator] | None = None
        self._slip: tuple[Cut, Places, SlipAtPoints] | None = None
        self._of_base: tuple[_cpp.GapOperator, Array, Array | None, Array] | None = None
        self._kept: list[tuple[Array, PETSc.Vec]] = []
        self._marked: Vecs | None = None
        #: Columns of each row that the tangent has room for; None before there is one.
        self.pattern: _cpp.GapOperator | None = None

    @property
    def points_are_own(self) -> bool:
        """Whether points are vertices of the slave, each with a multiplier of its own."""
        return self._cutter.are_own

    @property
    def tool(self) -> RigidSurface | None:
        """The master if it is a rigid tool."""
        return self._tool

    def pair(self) -> Places:
        """Take the places where the surfaces were read last."""
        master = self._master
        there = trace_positions(master).copy() if isinstance(master, Surface) else master.position
        self.paired_at = trace_positions(self._slave).copy(), np.array(there)
        return self.paired_at

    def places(
        self,
        base: Places,
        u: tuple[PETSc.Vec | None, PETSc.Vec | None],
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> Places:
        """Where displacements over the scales put what is at the base with none. Collective."""
        out = list(base)
        for i, values in enumerate(self._values):
            vec = u[i]
            if vec is not None:
                out[i] = out[i] + scale[i] * values(vec)
        return out[0], out[1]

    def measure(
        self, places: Places, kept: Measure | None = None, vertices: Flags | None = None
    ) -> Measure:
        """Measure areas where the facets are. Collective.

        Args:
            places: Where they are.
            kept: With which nodes neighbours go on to carry multipliers; None to choose them anew.
            vertices: Those that are to be kept; None to choose them anew.
        """
        node_area = self._cutter.node_area(places)
        cover = None
        if kept is None and not self.at_points:
            cover = self._hardly_covered(places, node_area)
        if kept is not None:
            cover = kept.cover
            vertices = kept.vertices
        if vertices is None:
            vertices = self._cutter.choose(places)
        found = self._cutter.find(
            places, places, self._kept_vec(cover), vertices=vertices, at_points=self.at_points
        )
        covered = found.rows.cover(len(node_area))
        area = np.where(covered > 0, np.maximum(covered, LEAST_COVER * node_area), node_area)
        return Measure(places, area, node_area, cover, vertices)

    def _hardly_covered(self, places: Places, node_area: Array) -> Array | None:
        """``Measure.cover``. Collective."""
        rows = self._cutter.find(places, places, None).rows
        covered = np.asarray(rows.cover_of_sides(len(node_area)))
        share = covered.sum(axis=1) / node_area
        some = bool(np.any(share < HARDLY_COVERED) or self._creases)
        if not self._slave.comm.allreduce(some, op=MPI.LOR):
            return None
        depth = np.full_like(covered, -np.inf)
        seen = covered > LEAST_COVER * node_area[:, None]
        np.divide(rows.gap_of_sides(len(node_area)), covered, out=depth, where=seen)
        closest = np.arange(covered.shape[1]) == depth.argmax(axis=1)[:, None]
        return np.where(closest, share[:, None], 0.0)

    def _kept_vec(self, values: Array | None) -> PETSc.Vec | None:
        """Values of owned nodes as a vector of the slave's body. Collective.

        Args:
            values: ``Measure.cover`` or allowances, (nodes, gdim) or (nodes,); None for none. The
                same vector for the same array.
        """
        if values is None:
            return None
        for i, (known, vec) in enumerate(self._kept):
            if known is values:
                self._kept.append(self._kept.pop(i))
                return vec
        vec = self._slave.create_vec()
        vec.array[self._slave.node_dofs - vec.owner_range[0]] = (
            values[:, None] if values.ndim == 1 else values
        )
        self._kept.append((values, vec))
        if len(self._kept) > MAX_KEPT:  # the last cut and the areas before may need theirs
            self._kept.pop(0)[1].destroy()
        return vec

    def cut(self, places: Places, measure: Measure, allowance: Array | None = None) -> Cut:
        """Gaps and their derivative with the facets at these places. Collective.

        Args:
            places: The places.
            measure: Areas.
            allowance: a_k, penetration (length) of each owned node that counts as none; None for 0.

        Raises:
            NoGapError: If places are not finite, or a ray of a curved facet meets no other.
        """
        last, comm = self._last, self._slave.comm
        none = allowance is None or self.at_points  # points take it from their gaps
        allowed = np.zeros(len(measure.area)) if none or allowance is None else allowance
        there = last is not None and _equal(last.places, places)
        same = there and last is not None and last.measure is measure
        same = same and last is not None and np.array_equal(last.allowance, allowed)
        agreed = np.array([there, same], dtype=bool)
        comm.Allreduce(MPI.IN_PLACE, agreed, op=MPI.LAND)
        there, same = map(bool, agreed)
        if there:
            assert last is not None
            places = last.places  # what is between is known
        if same:
            assert last is not None
            return last
        finite = all(np.isfinite(x).all() for x in places)
        if not comm.allreduce(finite, op=MPI.LAND):
            raise NoGapError("displacements of contact facets are not finite (NaN, infinity)")
        some = comm.allreduce(bool(np.any(allowed != 0)), op=MPI.LOR)
        found = self._cutter.find(
            places,
            measure.places,
            self._kept_vec(measure.cover),
            self._kept_vec(allowed if some else None),
            measure.vertices,
            self.at_points,
        )
        missed = comm.allreduce(found.num_missed, op=MPI.SUM)
        if missed:
            raise NoGapError(
                f"{missed} pieces of curved contact facets have rays that meet no point of the "
                "facet opposite: the facets are too curved for their size"
            )
        alone = self._alone(found, measure) if self.at_points else None
        if alone is None:
            operator = _cpp.GapOperator(*self._objects, found.rows, measure.area, jump=False)
        else:
            operator = self._cutter.operator_at_points(found, alone)
        self._constrain(operator)
        share = np.asarray(found.rows.cover(len(measure.area))) / measure.area
        self._last = Cut(places, measure, found, operator, share, allowed, alone)
        return self._last

    def _alone(self, found: Found, measure: Measure) -> Alone:
        """What keeps multipliers regular where next to nothing is opposite. Collective."""
        slave, sides = self._slave, self._sides_of_nodes
        covered = np.asarray(found.rows.cover_of_sides(len(measure.node_area)))
        missing = LEAST_COVER * sides * measure.node_area[:, None] - covered
        some = missing > 0
        return Alone(slave.node_dofs[some].astype(np.int64), missing[some], self.radius)

    def slip_at_points(self, last: Cut, start: Places) -> SlipAtPoints:
        """Slip at the points of the last evaluation since everything was there. Collective."""
        known = self._slip
        if known is None or known[0] is not last or known[1] is not start:
            assert last.alone is not None
            found = self._cutter.slip_at_points(last.found, last.places, last.alone, start)
            for operator in (found.operator, found.works):
                self._constrain(operator)
            self._slip = last, start, found
        assert self._slip is not None
        return self._slip[2]

    def add_slip_curvature_of_points(
        self,
        last: Cut,
        traction: Array,
        of_sides: Array | None,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> None:
        """Add how the forces of tractions τ_p change with these held. Collective.

        Args:
            last: The last evaluation.
            traction: τ_p, (rows, gdim).
            of_sides: τ of the sides of owned nodes, (nodes, block, gdim), for the rims.
            blocks: The matrices (ss, sm, ms, mm).
            scale: Displacement per unknown of both bodies.
        """
        assert self._marked is not None
        fields = (
            [] if of_sides is None else [self._vec_of_sides(v) for v in np.moveaxis(of_sides, 2, 0)]
        )
        self._cutter.add_slip_curvature_of_points(
            last.found, traction, fields, self._marked, blocks, scale
        )
        for vec in fields:
            vec.destroy()

    def constrain(self, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        for vec in self._marked or ():
            if vec is not None:
                vec.destroy()
        self._marked = slave.copy(), None if master is None else master.copy()
        if self._last is not None:
            self._constrain(self._last.operator)
        if self._jump is not None:
            self._constrain(self._jump[1])
        if self._slip is not None:
            self._constrain(self._slip[2].operator)
            self._constrain(self._slip[2].works)

    def _constrain(self, operator: _cpp.GapOperator) -> None:
        if self._marked is not None:
            operator.constrain(*map(handle_of, self._marked))

    # --- Jumps

    def jump_operator(self, last: Cut) -> _cpp.GapOperator:
        """The jump x_slave − x_master at the rows, places on the facets staying. Collective."""
        if self._jump is None or self._jump[0] is not last:
            if last.alone is not None:
                out = self._cutter.jump_at_points(last.found, last.alone)
            else:
                objects, rows = self._objects, last.found.rows
                out = _cpp.GapOperator(*objects, rows, last.measure.area, jump=True)
            self._constrain(out)
            self._jump = last, out
        return self._jump[1]

    def jump_of_places(self, operator: _cpp.GapOperator, places: Places) -> Array:
        """What an operator of jumps gives for places of nodes, without a tool. Collective."""
        there = None if self._tool is not None else places[1]
        known = self._of_base
        if known is None or not (
            known[0] is operator and known[1] is places[0] and known[2] is there
        ):
            gdim = self._slave.gdim
            vecs = [trace_vec(self._slave, places[0][..., :gdim])]
            if there is not None and isinstance(self._master, Surface):
                vecs.append(trace_vec(self._master, there[..., :gdim]))
            handles = [vec.handle for vec in vecs] + [0] * (2 - len(vecs))
            known = operator, places[0], there, operator.apply(*handles)
            self._of_base = known
            for vec in vecs:
                vec.destroy()
        return known[3]

    def points(self, last: Cut) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps, positive when open."""
        return self._cutter.points(last.found)

    def pairing_points(self, last: Cut) -> _cpp.PairingPoints:
        """The same with what sees them, for other fields on the facets; normals are not known."""
        return self._cutter.pairing_points(last.found)

    def facet_sizes(self, last: Cut) -> Array:
        """Size (length) of the slave's facet at each of these points."""
        return self._cutter.facet_sizes(last.found)

    def add_slip_forces(self, last: Cut, traction: Array, b: Vecs) -> None:
        """Add the forces of friction τ_k of the owned nodes, (nodes, gdim). Collective."""
        vec = self._vec_of(traction)
        if not self._cutter.add_slip_forces(last.found, vec, b):
            force = np.ascontiguousarray(last.measure.area[:, None] * traction)
            self.jump_operator(last).add_transpose(force, *map(handle_of, b))
        vec.destroy()

    def _vec_of(self, traction: Array) -> PETSc.Vec:
        """Vectors of the owned nodes as one of the slave's body."""
        vec = self._slave.create_vec()
        vec.array[self._slave.node_dofs - vec.owner_range[0]] = traction
        return vec

    def slip_operators(self, last: Cut) -> list[_cpp.GapOperator]:
        """Variations of objective slip along each axis, a jump's if there are none. Collective."""
        rows = self._cutter.slip_rows(last.found)
        area = last.measure.area
        return [_cpp.GapOperator(*self._objects, each, area, jump=False) for each in rows]

    def add_slip_curvature(
        self,
        last: Cut,
        traction: Array,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> None:
        """Add how the forces of friction τ_k, (nodes, gdim), change with τ_k held. Collective."""
        assert self._marked is not None
        vec = self._vec_of(traction)
        self._cutter.add_slip_curvature(last.found, vec, self._marked, blocks, scale)
        vec.destroy()

    # --- Tangent

    def make_pattern(self, last: Cut) -> _cpp.GapOperator:
        """Rows with room for all that may be opposite nearby. Collective."""
        rows = self._cutter.find_nearby(last.places)
        self.pattern = _cpp.GapOperator(*self._objects, rows, last.measure.area, jump=False)
        return self.pattern

    def fits(self, last: Cut) -> bool:
        """Whether the pattern has room for what was found, on this rank."""
        return self.pattern is None or bool(self.pattern.covers(last.operator))

    def add_curvature_of_points(
        self,
        last: Cut,
        pressure: Array,
        law: typing.Callable[[Array, typing.Callable[[Array], Array]], Array],
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> bool:
        """Add Σ_p w_p p_p ∂²g_p to the blocks (ss, sm, ms, mm). Collective.

        Args:
            last: The last evaluation.
            pressure: p_p.
            law: p at other points, for their gaps and what gives values there of fields of the
                sides of nodes, (nodes, block).
            blocks: The matrices.
            scale: Displacement per unknown of both bodies.

        Returns:
            Whether it is symmetric but for the scale.
        """
        assert self._marked is not None
        return self._cutter.add_curvature_of_points(
            last.found, pressure, self._at_rim(law), self._marked, blocks, scale
        )

    def _at_rim(
        self, law: typing.Callable[[Array, typing.Callable[[Array], Array]], Array]
    ) -> AtRim:
        """A function of gaps and fields of the sides of nodes, as cutters ask for it."""

        def at_rim(gap: Array, values: typing.Callable[[PETSc.Vec], Array]) -> Array:
            def of_sides(field: Array) -> Array:
                vec = self._vec_of_sides(field)
                out = values(vec)
                vec.destroy()
                return out

            return law(gap, of_sides)

        return at_rim

    def _vec_of_sides(self, field: Array) -> PETSc.Vec:
        """New vector of values of the sides of owned nodes. Collective."""
        vec = self._slave.create_vec()
        vec.array[self._slave.node_dofs - vec.owner_range[0]] = field
        return vec

    def moving_functions(
        self,
        last: Cut,
        field: Array,
        rest: Array,
        law: typing.Callable[[Array, typing.Callable[[Array], Array]], Array] | None = None,
    ) -> MovingFunctions | None:
        """How λ_h moves at the last evaluation; None if it does not. Collective.

        Args:
            last: That evaluation.
            field: λ of the sides of nodes, (nodes, block).
            rest: r_p, (rows,).
            law: r at rims, as for :meth:`add_curvature_of_points`; None for 0.
        """
        assert last.alone is not None
        assert self._marked is not None
        vec = self._vec_of_sides(field)
        at_rim = None if law is None else self._at_rim(law)
        found = self._cutter.moving_functions(
            last.found, last.alone, vec, rest, at_rim, self._marked
        )
        vec.destroy()
        if found is not None:
            self._constrain(found.operator)
        return found

    def add_curvature(
        self,
        last: Cut,
        multiplier: Array,
        blocks: typing.Sequence[PETSc.Mat | None],
        scale: tuple[float, float],
    ) -> bool:
        """Add Σ_k λ_k ∂²G_k to the blocks (ss, sm, ms, mm). Collective.

        Args:
            last: The last evaluation.
            multiplier: λ_k of the owned nodes, force over area.
            blocks: The matrices.
            scale: Displacement per unknown of both bodies.

        Returns:
            Whether it is symmetric but for the scale.
        """
        assert self._marked is not None
        vec = self._slave.create_vec()
        vec.array[self._slave.node_dofs[:, 0] - vec.owner_range[0]] = multiplier
        symmetric = self._cutter.add_curvature(last.found, vec, self._marked, blocks, scale)
        vec.destroy()
        return symmetric


def _equal(a: Places, b: Places) -> bool:
    return all(x is y or np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def sides_of(slave: Surface) -> npt.NDArray[np.bool_]:
    """Smooth sides that owned nodes have, (nodes, block). Collective."""
    vec, surface = slave.create_vec(), slave.cpp_object
    nv = slave.num_facet_vertices
    sides = np.asarray(surface.vertex_side)[:, :nv, None].astype(np.int64)
    dofs = np.take_along_axis(np.asarray(surface.facet_dofs)[:, :nv], sides, axis=2).ravel()
    vec.setValues(dofs.astype(PETSc.IntType), np.ones(len(dofs)), PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: npt.NDArray[np.bool_] = vec.array_r[slave.node_dofs - vec.owner_range[0]] > 0
    vec.destroy()
    return out
