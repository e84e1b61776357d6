"""Gaps with updated geometry: computed again for each displaced position of the bodies."""

from __future__ import annotations

import dataclasses
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.laws import Law
from qsdolfinx.gap.no_value import NoGapError
from qsdolfinx.gap.own_rows import FacedVertices, OwnRows
from qsdolfinx.gap.vertex_normals import NormalsThere
from qsdolfinx.pairing.pair import LEAST_COVER
from qsdolfinx.surface.affine import trace_positions
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Positions of slave and master: of the nodes of the trace, (facets, nodes, 3), or the position of
#: a rigid tool, see ``RigidSurface.position``.
Places = tuple[Array, Array]
Vecs = tuple[PETSc.Vec, PETSc.Vec | None]

#: Largest rotation (radians): a larger one is not distinguished from a rotation in the opposite
#: direction. The same as in cpp/sliding/ray.cpp.
MOST_TURNED = 2.6


def follows(sliding: str, law: Law) -> bool:
    """Whether gaps have updated geometry: with finite sliding, but ties keep their pairs."""
    return sliding == "finite" and not law.jump


class Found(typing.NamedTuple):
    """Contact pairs for given positions of the surfaces.

    Attributes:
        cover: Σ_p w_p N_k of the smooth patches of the slave's owned nodes, (nodes, block).
        of_cutter: Further data of the cutter.
        num_missed: Segments on this rank with a ray that meets no point.
        normals: Normals of the curved surface that replaces facets opposite vertices; None if there
            is none.
        vertices: For points at vertices of a tool, which have multipliers of their own, these
            vertices; None for other points.
    """

    cover: Array
    of_cutter: typing.Any
    num_missed: int = 0
    normals: NormalsThere | None = None
    vertices: FacedVertices | None = None


class Alone(typing.NamedTuple):
    """Points without a partner, each with the multiplier of one smooth patch of a node.

    Attributes:
        unknown: Global unknowns of the slave that represent these patches of owned nodes; −1 for
            points with multipliers of their own.
        weight: Areas of the points.
        far: Open gap (length) of the points.
    """

    unknown: npt.NDArray[np.int64]
    weight: Array
    far: float


@dataclasses.dataclass
class SlipAtPoints:
    """Slip at the points of the last evaluation.

    Attributes:
        slip: Slip of the slave relative to the master, (rows, gdim).
        normal: Normals out of the slave, (rows, gdim).
        works: Operator of the displacements on which tractions do work.
        make_operator: Function that makes :attr:`operator`.
        facets: Keys of the pair of facets of each point, (rows, n).
        place: Positions on the slave's facets: shape functions of its vertices, (rows, vertices).
        arc: Arc length along the surfaces over the slip, which is the chord, (rows,).
        gap: Gap of the same material points at the start (length), positive in penetration,
            (rows,).
        turn: Rotations since the start of vectors that turn with the facets whose plane the slip is
            in, or with the tangent plane of a tool, (rows, gdim, gdim).
        of_cutter: Further data of the cutter.
    """

    slip: Array
    normal: Array
    works: _cpp.GapOperator
    make_operator: typing.Callable[[], _cpp.GapOperator]
    facets: npt.NDArray[np.int64]
    place: Array
    arc: Array
    gap: Array
    turn: Array
    of_cutter: typing.Any = None
    _marked: Vecs | None = None

    @functools.cached_property
    def operator(self) -> _cpp.GapOperator:
        """Derivative of the slip, a matrix for each node. Collective in its first use."""
        out = self.make_operator()
        if self._marked is not None:
            out.constrain(*map(handle_of, self._marked))
        return out

    def constrain(self, marked: Vecs) -> None:
        """Mark the unknowns with Dirichlet conditions by nonzero entries. Collective."""
        self._marked = marked
        self.works.constrain(*map(handle_of, marked))
        if "operator" in self.__dict__:
            self.operator.constrain(*map(handle_of, marked))


class Changes(typing.NamedTuple):
    """Derivative of gaps or slips at points that move on their facets, with changing heights.

    Attributes:
        operator: Derivative with respect to the nodes of the facets at the points.
        beside: Derivative with respect to other nodes, because normals at nodes turn with all
            facets there: 0 for the slave's body or 1 for the master's, and a matrix of the
            constraints and the unknowns of this body; None if there is none.
    """

    operator: _cpp.GapOperator
    beside: tuple[int, PETSc.Mat] | None = None


#: For each body, derivatives of Σ_p w_p r_p N_k of functions of the slave's nodes, since areas and
#: tangent planes change: unknowns of the slave that represent patches of nodes, unknowns of the
#: body (−1 at Dirichlet conditions), and values.
Mixed = list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]]


class Kept(typing.NamedTuple):
    """Part of the trials of tractions that is known at the start of a step, and turns from there.

    Attributes:
        before: This part at the start (stress), (rows, gdim).
        slopes: Its derivatives by the functions of the slave's vertices at the points, (rows,
            vertices, gdim), without the next one; None if it is constant.
        field: A function in this part, at the smooth patches of nodes, (nodes, block, gdim); None
            if there is none.
    """

    before: Array
    slopes: Array | None
    field: Array | None


class PointState(typing.NamedTuple):
    """State of constraints at points of segments, see ``PointState`` in cpp/tangent/point_forces.h.

    Components are the pressure, and with friction those of the traction.

    Attributes:
        factors: γ_c, a_c, and the factor of N_k in R_λ, each (components,).
        by_trial: Weighted derivative of stresses by trials, (rows, components, components).
        by_own: Weighted derivative of r by multipliers, (rows, components); empty without any.
        pressure: Pressures, held constant, (rows,).
        traction: Tractions, held constant, (rows, gdim); None without friction.
        rest: r in Σ_p w_p N_k r_p of R_λ and R_τ, (rows, components).
        turning: Vectors of which r are components, and which stay in the plane of the facet from
            which the rays start, (rows, gdim); None if there are none.
        leaning: l_p (length) in the derivative −l_p δn of slips, (rows,); None without.
        kept: Part of the trials of tractions that turns; None without.
        fields: λ and the components of τ at the smooth patches of nodes, (nodes, block); None for
            components without multipliers.
        slip: Slip at the points; None without friction.
        moves: Whether points move on their facets.
        gaps_move: Whether gaps and slips change with this motion.
        function_rows: Row of each function of the segments, then of points without a partner.
        functions: Factors of unknowns in the values of the functions, for each component.
    """

    factors: tuple[Array, Array, Array]
    by_trial: Array
    by_own: Array
    pressure: Array
    traction: Array | None
    rest: Array
    turning: Array | None
    leaning: Array | None
    kept: Kept | None
    fields: list[Array | None]
    slip: SlipAtPoints | None
    moves: bool
    gaps_move: bool
    function_rows: npt.NDArray[np.int64]
    functions: list[_cpp.CompressedRows]


class Destination(typing.NamedTuple):
    """Destination of derivatives of forces.

    Attributes:
        sums: Entries to be added to the matrix of all unknowns of the equations.
        numbers: Functions that map global unknowns of the slave's body, and of the master's unless
            it is a tool, to their numbers among all unknowns; −1 stays −1.
        scale: Displacement per unknown of both bodies.
        tool: Number of the displacement of a force-controlled tool; −1 without.
        way: Motion of the tool per displacement.
    """

    sums: _cpp.RowSums
    numbers: typing.Sequence[typing.Callable[[npt.NDArray[np.int64]], npt.NDArray[np.int64]]]
    scale: tuple[float, float]
    tool: int = -1
    way: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Cutter(typing.Protocol):
    """Interface for contact detection with updated geometry: finds contact pairs and their gaps.

    Attributes:
        are_own: Whether points are vertices of the slave, each with a multiplier of its own.
        has_segments: Whether it is an :class:`OfSegments`, or else an :class:`OfSamples`.
        kept_pairs: Pairs of facets that are kept between evaluations; None for other points than
            those of segments.
    """

    are_own: bool
    has_segments: bool

    @property
    def kept_pairs(self) -> _cpp.KeptPairs | None:
        """See above."""

    def node_area(self, places: Places) -> Array:
        """S_k of the slave at these positions. Collective."""

    def sides(self) -> Flags:
        """Smooth patches of owned nodes that may have multipliers, (nodes, block). Collective."""

    def choose(self, places: Places) -> Array | None:
        """Choose the vertices that get points, see ``GapState.vertices``. Collective."""

    def find(self, places: Places, vertices: Array | None) -> Found:
        """Find the contact pairs at these positions. Collective.

        Args:
            places: The positions. If they are the same object as in the last call, its result is
                used.
            vertices: See ``GapState``.
        """

    def operator_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Derivative of the gaps at these points; its rows are the points. Collective."""

    def jump_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Operator of x_slave − x_master for points fixed on their facets. Collective."""

    def slip_at_points(
        self, found: Found, places: Places, alone: Alone, start: Places
    ) -> SlipAtPoints:
        """Slip at these points relative to the positions at the start. Collective."""

    def points(self, found: Found) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps along the rays, positive if open."""

    def pairing_points(self, found: Found) -> _cpp.PairingPoints:
        """Contact quadrature points for other fields on the facets, without normals."""

    def facet_sizes(self, found: Found) -> Array:
        """Size (length) of the slave's facet at each of these points."""


class OfSegments(Cutter, typing.Protocol):
    """Points of segments of facets, which move on the facets with the segments."""

    def function_sides(self, found: Found) -> npt.NDArray[np.int64]:
        """Unknowns that represent the patches of the segments' functions, (segments · n,)."""

    def add_point_forces(
        self,
        found: Found,
        state: PointState,
        fields: list[PETSc.Vec | None],
        missing: list[PETSc.Vec],
        begun: list[PETSc.Vec],
        markers: Vecs,
        to: Destination,
    ) -> None:
        """Add the derivative of forces and of R_λ and R_τ at the points. Collective.

        Args:
            found: Contact pairs at these positions.
            state: State of the points.
            fields: ``state.fields`` as vectors of the slave's body.
            missing: ``state.rest`` of points without a partner, in the same way.
            begun: The same for the components of ``state.kept.field``; empty for None.
            markers: Vectors of both bodies, nonzero at unknowns with Dirichlet conditions.
            to: Destination of the derivatives.
        """


class OfSamples(Cutter, typing.Protocol):
    """Points that are fixed on the slave's facets."""

    def add_curvature_of_points(
        self,
        found: Found,
        pressure: Array,
        moves: bool,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """Add the derivative of Σ_p w_p p_p ∂g_p for fixed p_p. Collective.

        It contains the second derivative of the gaps and the motion of points on facets.

        Args:
            found: Contact pairs at these positions.
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            markers: Vectors of both bodies, nonzero at unknowns with Dirichlet conditions.
            to: Destination of the derivatives.
        """

    def mixed(
        self,
        found: Found,
        rest: Array,
        markers: Vecs,
        turning: tuple[Array, int] | None,
    ) -> Mixed | None:
        """Change of Σ_p w_p r_p N_k with the facets; None without any. Collective.

        Args:
            found: Contact pairs at these positions.
            rest: r_p, (rows,).
            turning: Vectors, (rows, gdim), that stay in the tangent plane, and the number of their
                component that is r_p; None if there are none.
            markers: As for :meth:`add_curvature_of_points`.
        """

    def moving_slip(
        self,
        found: Found,
        slip: SlipAtPoints,
        alone: Alone,
        leaning: Array,
        kept: Array,
        markers: Vecs,
    ) -> Changes:
        """Derivative of the slip, of −l_p δn, and of vectors that turn. Collective.

        It has a row for each component.

        Args:
            found: Contact pairs at these positions.
            slip: The slip at these positions.
            alone: Points without a partner.
            leaning: l_p (length), (rows,).
            kept: Vectors (length) at the start, which turn by ``slip.turn``, (rows, gdim).
            markers: As for :meth:`add_curvature_of_points`.
        """

    def add_slip_curvature_of_points(
        self,
        found: Found,
        traction: Array,
        moves: bool,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """Add the derivative of the forces of fixed tractions τ_p. Collective.

        Args:
            found: Contact pairs at these positions.
            traction: τ_p, (rows, gdim).
            moves: Whether points move on their facets.
            markers: As for :meth:`add_curvature_of_points`.
            to: Destination of the derivatives.
        """


@dataclasses.dataclass(frozen=True)
class Cut:
    """Result of one evaluation.

    Attributes:
        places: Positions of the facets.
        vertices: Vertices of the slave that have points, see ``GapState``.
        node_area: S_k of owned nodes at these positions.
        found: Contact pairs.
        operator: Derivative of the gaps; its ``initial_gap`` is −g.
        alone: Points without a partner; they are the last of the points.
        least_cover: See :attr:`Following.least_cover`.
        own: Multipliers of vertices of a tool; None for multipliers at nodes.
    """

    places: Places
    vertices: Array | None
    node_area: Array
    found: Found
    operator: _cpp.GapOperator
    alone: Alone
    least_cover: Array
    own: OwnRows | None = None

    @property
    def covered(self) -> Flags:
        """Owned nodes that are covered by the other surface at least in part."""
        return np.asarray(self.found.cover.sum(axis=1) > 0)


class Following:
    """Gaps at contact quadrature points as nonlinear functions of the unknowns (finite sliding).

    Forces are derivatives of the gaps for points that are fixed on the facets: each force pair
    conserves momentum and angular momentum. The weights of the points are areas of the facets in
    their present positions.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        radius: Search distance (length): contact pairs are not farther apart.
        cutter: Finds the contact pairs.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        radius: float,
        cutter: Cutter,
    ) -> None:
        self._slave, self._master, self._cutter = slave, master, cutter
        self.radius = radius
        self._values = [TraceValues(s) for s in (slave, *master.bodies)]
        #: Positions of the surfaces at contact detection.
        self.paired_at: Places
        self.pair()
        self._last: Cut | None = None
        self._jump: tuple[Cut, _cpp.GapOperator] | None = None
        self._slip: tuple[Cut, Places, SlipAtPoints] | None = None
        self._marked: Vecs | None = None
        #: See ``PointRows.least_cover``.
        self.least_cover: Array = LEAST_COVER * cutter.sides() * slave.node_area[:, None]
        #: Evaluation for which the sparsity pattern of the tangent blocks was made; None before.
        self._pattern_of: Cut | None = None

    @property
    def points_are_own(self) -> bool:
        """Whether points are vertices of the slave, each with a multiplier of its own."""
        return self._cutter.are_own

    @property
    def kept_pairs(self) -> _cpp.KeptPairs | None:
        """See :class:`Cutter`."""
        return self._cutter.kept_pairs

    def pair(self) -> Places:
        """Store the positions of the surfaces when they were last read, and return them."""
        bodies = [trace_positions(surface) for surface in (self._slave, *self._master.bodies)]
        here, there = bodies + [tool.position for tool in self._master.tools]
        self.paired_at = here.copy(), there.copy()
        return self.paired_at

    def joined(self, bodies: Places, tool: Places) -> Places:
        """Some positions of the bodies, with those of a rigid tool from other positions."""
        return bodies[0], (tool if is_rigid(self._master) else bodies)[1]

    def places(
        self,
        base: Places,
        u: tuple[PETSc.Vec | None, PETSc.Vec | None],
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> Places:
        """Positions for unknowns u: base positions plus scale times u. Collective."""
        out = list(base)
        for i, values in enumerate(self._values):
            vec = u[i]
            if vec is not None:
                out[i] = out[i] + scale[i] * values(vec)
        return out[0], out[1]

    def choose(self, places: Places) -> Array | None:
        """Choose the vertices that get points, see :class:`Cutter`. Collective.

        Args:
            places: Positions of the facets.
        """
        return self._cutter.choose(places)

    def cut(self, places: Places, vertices: Array | None) -> Cut:
        """Compute the gaps and their derivative with the facets at these positions. Collective.

        Args:
            places: The positions.
            vertices: See ``GapState``.

        Raises:
            NoGapError: If positions are not finite, or a ray from a curved facet does not meet the
                opposite facet.
        """
        last, comm = self._last, self._slave.comm
        there = last is not None and _equal(last.places, places)
        same = there and last is not None and last.vertices is vertices
        same = same and last is not None and last.least_cover is self.least_cover
        agreed = np.array([there, same], dtype=bool)
        comm.Allreduce(MPI.IN_PLACE, agreed, op=MPI.LAND)
        there, same = map(bool, agreed)
        if there:
            assert last is not None
            places = last.places  # the contact pairs are known
        if same:
            assert last is not None
            return last
        finite = all(np.isfinite(x).all() for x in places)
        if not comm.allreduce(finite, op=MPI.LAND):
            raise NoGapError("displacements of contact facets are not finite (NaN, infinity)")
        found = self._cutter.find(places, vertices)
        missed = comm.allreduce(found.num_missed, op=MPI.SUM)
        if missed:
            raise NoGapError(
                f"{missed} segments of curved contact facets have rays that meet no point of the "
                "opposite facet: the deformed facets are too curved for their size"
            )
        node_area = self._cutter.node_area(places)
        alone = self._alone(found, vertices)
        operator = self._cutter.operator_at_points(found, alone)
        self._constrain(operator)
        own = None
        if found.vertices is not None:
            own = OwnRows.of(found.vertices, np.asarray(operator.row_area))
        self._last = Cut(places, vertices, node_area, found, operator, alone, self.least_cover, own)
        return self._last

    def _alone(self, found: Found, vertices: Array | None) -> Alone:
        """Points that keep multipliers regular where hardly anything is covered. Collective.

        If less than a part of a node's area is covered, a point with an open gap has the rest of
        this part, so that the multiplier is 0 where nothing is opposite.
        """
        if found.vertices is not None:
            lost = found.vertices.lost
            return Alone(np.full(len(lost), -1), found.vertices.area[lost], self.radius)
        # Areas of the surface at the start: these parts change with the covered areas alone.
        slave, missing = self._slave, self.least_cover - found.cover
        some = missing > 0
        return Alone(slave.node_dofs[some].astype(np.int64), missing[some], self.radius)

    def slip_at_points(self, last: Cut, start: Places) -> SlipAtPoints:
        """Slip at the points of the last evaluation relative to these positions. Collective."""
        known = self._slip
        if known is None or known[0] is not last or known[1] is not start:
            found = self._cutter.slip_at_points(last.found, last.places, last.alone, start)
            if self._marked is not None:
                found.constrain(self._marked)
            self._slip = last, start, found
        assert self._slip is not None
        return self._slip[2]

    def moving_slip(self, last: Cut, slip: SlipAtPoints, leaning: Array, kept: Array) -> Changes:
        """Derivative of that slip with moving points, see :class:`Cutter`. Collective."""
        assert self._marked is not None
        out = self._samples.moving_slip(last.found, slip, last.alone, leaning, kept, self._marked)
        self._constrain(out.operator)
        return out

    def add_slip_curvature_of_points(
        self,
        last: Cut,
        traction: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add the derivative of the forces of fixed tractions τ_p. Collective.

        Args:
            last: The last evaluation.
            traction: τ_p, (rows, gdim).
            moves: Whether points move on their facets.
            to: Destination of the derivatives.
        """
        assert self._marked is not None
        self._samples.add_slip_curvature_of_points(last.found, traction, moves, self._marked, to)

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
            self._slip[2].constrain(self._marked)

    def _constrain(self, operator: _cpp.GapOperator) -> None:
        if self._marked is not None:
            operator.constrain(*map(handle_of, self._marked))

    # --- Relative displacements

    def jump_operator(self, last: Cut) -> _cpp.GapOperator:
        """Operator of x_slave − x_master at points fixed on their facets. Collective."""
        if self._jump is None or self._jump[0] is not last:
            out = self._cutter.jump_at_points(last.found, last.alone)
            self._constrain(out)
            self._jump = last, out
        return self._jump[1]

    @property
    def has_segments(self) -> bool:
        """Whether points are those of segments, with :meth:`add_point_forces`."""
        return self._cutter.has_segments

    @property
    def _segments(self) -> OfSegments:
        return typing.cast(OfSegments, self._cutter)

    @property
    def _samples(self) -> OfSamples:
        return typing.cast(OfSamples, self._cutter)

    def function_sides(self, last: Cut) -> npt.NDArray[np.int64]:
        """Unknowns that represent the patches of functions, see :class:`PointState`."""
        of_segments = self._segments.function_sides(last.found)
        return np.concatenate([of_segments, last.alone.unknown])

    def add_point_forces(self, last: Cut, state: PointState, to: Destination) -> None:
        """Add the derivative of forces and of R_λ and R_τ at the points. Collective."""
        assert self._marked is not None
        vecs = [None if field is None else self._vec_of_sides(field) for field in state.fields]
        known = None if state.kept is None else state.kept.field
        missing = self._missing(last, state.rest)
        begun = [] if known is None else [self._vec_of_sides(c) for c in np.moveaxis(known, 2, 0)]
        self._segments.add_point_forces(last.found, state, vecs, missing, begun, self._marked, to)
        for vec in (*vecs, *missing, *begun):
            if vec is not None:
                vec.destroy()

    def _missing(self, last: Cut, rest: Array) -> list[PETSc.Vec]:
        """R of points without a partner at the smooth patches of nodes. Collective.

        Args:
            last: The last evaluation.
            rest: r at all points, (rows, components).

        Returns:
            A vector for each component; none if no rank has such points.
        """
        unknown = last.alone.unknown
        any_here = len(unknown) > 0 and last.found.vertices is None
        if not self._slave.comm.allreduce(any_here, op=MPI.LOR):
            return []
        out = []
        for values in rest[len(rest) - len(unknown) :].T:
            vec = self._slave.create_vec()
            vec.array[unknown - vec.owner_range[0]] = values
            out.append(vec)
        return out

    def points(self, last: Cut) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps, positive if open."""
        return self._cutter.points(last.found)

    def pairing_points(self, last: Cut) -> _cpp.PairingPoints:
        """Contact quadrature points for other fields on the facets, without normals."""
        return self._cutter.pairing_points(last.found)

    def facet_sizes(self, last: Cut) -> Array:
        """Size (length) of the slave's facet at each of these points."""
        return self._cutter.facet_sizes(last.found)

    # --- Tangent

    def make_pattern(self, last: Cut) -> _cpp.GapOperator:
        """Return the derivative that sets the sparsity pattern of the tangent blocks."""
        self._pattern_of = last
        return last.operator

    def fits(self, last: Cut) -> bool:
        """Whether the sparsity pattern of the tangent blocks fits this evaluation."""
        return self._pattern_of is last

    def add_curvature_of_points(
        self,
        last: Cut,
        pressure: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add the derivative of Σ_p w_p p_p ∂g_p for fixed p_p. Collective.

        It contains the second derivative of the gaps and the motion of points on facets.

        Args:
            last: The last evaluation.
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            to: Destination of the derivatives.
        """
        assert self._marked is not None
        self._samples.add_curvature_of_points(last.found, pressure, moves, self._marked, to)

    def _vec_of_sides(self, field: Array) -> PETSc.Vec:
        """New vector of values of the smooth patches of owned nodes. Collective."""
        vec = self._slave.create_vec()
        vec.array[self._slave.node_dofs - vec.owner_range[0]] = field
        return vec

    def mixed(
        self, last: Cut, rest: Array, turning: tuple[Array, int] | None = None
    ) -> Mixed | None:
        """Change of Σ_p w_p r_p N_k with the facets, see :class:`Cutter`. Collective."""
        assert self._marked is not None
        return self._samples.mixed(last.found, rest, self._marked, turning)


def _equal(a: Places, b: Places) -> bool:
    return all(x is y or np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def sides_of(slave: Surface) -> Flags:
    """Smooth patches of owned nodes, (nodes, block). Collective."""
    surface, nv = slave.cpp_object, slave.num_facet_vertices
    sides = np.asarray(surface.vertex_side)[:, :nv, None].astype(np.int64)
    dofs = np.take_along_axis(np.asarray(surface.facet_dofs)[:, :nv], sides, axis=2).ravel()
    return np.asarray(sums_of_sides(slave, dofs, np.ones(len(dofs))) > 0)


def sums_of_sides(slave: Surface, dofs: npt.NDArray[np.int64], values: Array) -> Array:
    """Sums of values at the smooth patches of owned nodes, (nodes, block). Collective.

    Args:
        slave: The surface.
        dofs: Unknowns that represent the patches, of any rank, (n,).
        values: The values, (n,).
    """
    vec = slave.create_vec()
    vec.setValues(dofs.astype(PETSc.IntType), values, PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: Array = vec.array_r[slave.node_dofs - vec.owner_range[0]].copy()
    vec.destroy()
    return out
