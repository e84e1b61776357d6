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
from qsdolfinx.gap.vertex_normals import NormalsThere
from qsdolfinx.surface.affine import trace_positions
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Of the slave and of the master: where the nodes of the trace are, (facets, nodes, 3); of a rigid
#: tool its position, see ``RigidSurface.position``.
Places = tuple[Array, Array]
Vecs = tuple[PETSc.Vec, PETSc.Vec | None]

#: Part of a node's area that its multiplier stands for at least, beside what is covered of it: it
#: is 0 where nothing is opposite. And the same where neighbours carry it, whom it would draw down:
#: ``tests/sliding/test_small_limit.py``, "swapped" (1.5 % of displacements with the former). Not of
#: vertices, of which single ones slide from neighbour to neighbour: ``test_tip_that_slides``.
LEAST_COVER, LEAST_CARRIED = 0.01, 1e-8

#: Turns by more (radians) are not told from those the other way round; as in cpp/sliding/ray.cpp.
MOST_TURNED = 2.6


class NoGapError(ValueError):
    """Facets are where gaps cannot be measured: an iterate of Newton's method has gone too far."""


class Found(typing.NamedTuple):
    """What is opposite to each other somewhere.

    Attributes:
        cover: Σ_p w_p N_k of the sides of the slave's owned nodes, (nodes, block).
        of_cutter: What else the cutter wants to know of it.
        num_missed: Pieces on this rank with a ray that meets no point.
        normals: Of the curved surface that facets before vertices stand for; None if there is none.
    """

    cover: Array
    of_cutter: typing.Any
    num_missed: int = 0
    normals: NormalsThere | None = None


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
        of_cutter: What else the cutter wants to know of it.
    """

    slip: Array
    normal: Array
    operator: _cpp.GapOperator
    works: _cpp.GapOperator
    facets: npt.NDArray[np.int64]
    place: Array
    arc: Array
    gap: Array
    of_cutter: typing.Any = None


class Changes(typing.NamedTuple):
    """Derivative of gaps or slips at points that move on their facets, with heights that change.

    Attributes:
        operator: By the nodes of the facets there.
        beside: By other nodes, as normals at nodes turn with all facets there: 0 for the slave's
            body or 1 for the master's, and rows by its unknowns; None if there is nothing.
    """

    operator: _cpp.GapOperator
    beside: tuple[int, PETSc.Mat] | None = None


class MovingFunctions(typing.NamedTuple):
    """How functions of the slave's nodes move along its facets at the last evaluation.

    Attributes:
        operator: Derivative of Σ_k λ_k N_k at the points, which are its rows.
        mixed: Of each body the derivative of Σ_p w_p r_p N_k by the motion of functions and points:
            unknowns of the slave that stand for sides of nodes, unknowns of the body, −1 where
            conditions hold, and values.
    """

    operator: _cpp.GapOperator
    mixed: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]]


class Destination(typing.NamedTuple):
    """Where derivatives of forces go.

    Attributes:
        sums: What is added to the matrix by all unknowns of the equations.
        numbers: Functions of global unknowns of the slave's body, and of the master's unless that
            is a tool, that give their numbers among all; −1 stays.
        scale: Displacement per unknown of both bodies.
    """

    sums: _cpp.RowSums
    numbers: typing.Sequence[typing.Callable[[npt.NDArray[np.int64]], npt.NDArray[np.int64]]]
    scale: tuple[float, float]


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

    def choose(self, places: Places) -> Array | None:
        """Vertices that are to have points, see ``GapState.vertices``. Collective."""

    def find(self, places: Places, vertices: Array | None) -> Found:
        """What is opposite to what at these places. Collective.

        Args:
            places: The places; those of the last call are known if they are the same object.
            vertices: See ``GapState``.
        """

    def operator_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Derivative of the gaps of these points, which are its rows. Collective."""

    def moving_gaps(self, found: Found, alone: Alone, markers: Vecs) -> Changes | None:
        """The same with what points and heights move by; None if they do not. Collective.

        Args:
            found: What has been found there.
            alone: Points that see one side of a node each.
            markers: As for :meth:`add_curvature_of_points`.
        """

    def jump_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """Jump x_slave − x_master at these points, places on the facets staying. Collective."""

    def add_curvature_of_points(
        self,
        found: Found,
        pressure: Array,
        moves: bool,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """Add how Σ_p w_p p_p ∂g_p changes with p_p held: gaps bend, and points move on facets.

        Collective.

        Args:
            found: What has been found there.
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            markers: Vectors of both bodies, nonzero at unknowns with Dirichlet conditions.
            to: Where to.
        """

    def moving_functions(
        self,
        found: Found,
        alone: Alone,
        field: PETSc.Vec,
        rest: Array,
        moves: bool,
        markers: Vecs,
        turning: tuple[Array, int] | None,
    ) -> MovingFunctions | None:
        """How a field of the sides of the slave's nodes moves; None if it does not. Collective.

        Args:
            found: What has been found there.
            alone: Points that see one side of a node each.
            field: The field.
            rest: r_p, (rows,).
            moves: Whether points move on their facets.
            turning: Vectors that r_p is this component of, and that stay in the plane of the facet
                that rays leave, (rows, gdim); None if there are none.
            markers: As for :meth:`add_curvature_of_points`.
        """

    def slip_at_points(
        self, found: Found, places: Places, alone: Alone, start: Places
    ) -> SlipAtPoints:
        """Slip at these points since everything was at the start. Collective."""

    def moving_slip(
        self, found: Found, slip: SlipAtPoints, alone: Alone, leaning: Array, markers: Vecs
    ) -> Changes:
        """Derivative of the slip, rows for each component, and −l_p δn. Collective.

        Args:
            found: What has been found there.
            slip: The slip there.
            alone: Points that see one side of a node each.
            leaning: l_p (length), (rows,).
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
        """Add how the forces of tractions τ_p change with these held. Collective.

        Args:
            found: What has been found there.
            traction: τ_p, (rows, gdim).
            moves: Whether points move on their facets.
            markers: As for :meth:`add_curvature_of_points`.
            to: Where to.
        """

    def points(self, found: Found) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps along the rays, positive when open."""

    def pairing_points(self, found: Found) -> _cpp.PairingPoints:
        """The same with what sees them, for other fields on the facets; normals are not known."""

    def facet_sizes(self, found: Found) -> Array:
        """Size (length) of the slave's facet at each of these points."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """What one evaluation has found.

    Attributes:
        places: Where the facets are.
        vertices: Which of the slave have points, see ``GapState``.
        node_area: S_k of owned nodes there.
        found: What is opposite to what.
        operator: Derivative of the gaps; its ``initial_gap`` is −g.
        alone: The last of the points.
        carried: See :attr:`Following.carried`.
    """

    places: Places
    vertices: Array | None
    node_area: Array
    found: Found
    operator: _cpp.GapOperator
    alone: Alone
    carried: Flags | None

    @property
    def covered(self) -> Flags:
        """Owned nodes that anything is opposite to."""
        return np.asarray(self.found.cover.sum(axis=1) > 0)


class Following:
    """Gaps of one pass at its contact quadrature points as nonlinear functions of the unknowns.

    Forces are derivatives of gaps with points that keep their places on the facets: each of them
    conserves momentum and moment. Weights of the points are areas of the facets where these are.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a rigid tool.
        radius: Distance (length) beyond which nothing is opposite.
        cutter: Finds what is opposite to what.
    """

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        radius: float,
        cutter: Cutter,
    ) -> None:
        #: Sides of owned nodes that have multipliers, (nodes, block).
        self._sides_of_nodes = cutter.sides()
        self._slave, self._master, self._cutter = slave, master, cutter
        self._tool = as_tool(master)
        self.radius = radius
        self._values = [TraceValues(s) for s in (slave, master) if isinstance(s, Surface)]
        #: Where the surfaces were when they were paired.
        self.paired_at: Places
        self.pair()
        self._last: Cut | None = None
        self._jump: tuple[Cut, _cpp.GapOperator] | None = None
        self._slip: tuple[Cut, Places, SlipAtPoints] | None = None
        self._marked: Vecs | None = None
        #: Sides of owned nodes whose multipliers neighbours carry, (nodes, block); None for none.
        self.carried: Flags | None = None
        #: What the blocks of the tangent have room for; None before there are any.
        self._pattern_of: Cut | None = None

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

    def choose(self, places: Places) -> Array | None:
        """Vertices that are to have points with the facets there, see :class:`Cutter`. Collective.

        Args:
            places: Where facets are.
        """
        return self._cutter.choose(places)

    def cut(self, places: Places, vertices: Array | None) -> Cut:
        """Gaps and their derivative with the facets at these places. Collective.

        Args:
            places: The places.
            vertices: See ``GapState``.

        Raises:
            NoGapError: If places are not finite, or a ray of a curved facet meets no other.
        """
        last, comm = self._last, self._slave.comm
        there = last is not None and _equal(last.places, places)
        same = there and last is not None and last.vertices is vertices
        same = same and last is not None and last.carried is self.carried
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
        found = self._cutter.find(places, vertices)
        missed = comm.allreduce(found.num_missed, op=MPI.SUM)
        if missed:
            raise NoGapError(
                f"{missed} segments of curved contact facets have rays that meet no point of the "
                "opposite facet: the facets are too curved for their size"
            )
        node_area = self._cutter.node_area(places)
        alone = self._alone(found, vertices, node_area)
        operator = self._cutter.operator_at_points(found, alone)
        self._constrain(operator)
        self._last = Cut(places, vertices, node_area, found, operator, alone, self.carried)
        return self._last

    def _alone(self, found: Found, vertices: Array | None, node_area: Array) -> Alone:
        """What keeps multipliers regular where next to nothing is opposite. Collective."""
        slave, sides = self._slave, self._sides_of_nodes
        least: Array | float = LEAST_COVER
        if self.carried is not None and vertices is None:
            least = np.where(self.carried, LEAST_CARRIED, LEAST_COVER)
        missing = least * sides * node_area[:, None] - found.cover
        some = missing > 0
        return Alone(slave.node_dofs[some].astype(np.int64), missing[some], self.radius)

    def slip_at_points(self, last: Cut, start: Places) -> SlipAtPoints:
        """Slip at the points of the last evaluation since everything was there. Collective."""
        known = self._slip
        if known is None or known[0] is not last or known[1] is not start:
            found = self._cutter.slip_at_points(last.found, last.places, last.alone, start)
            for operator in (found.operator, found.works):
                self._constrain(operator)
            self._slip = last, start, found
        assert self._slip is not None
        return self._slip[2]

    def moving_slip(self, last: Cut, slip: SlipAtPoints, leaning: Array) -> Changes:
        """Derivative of that slip with what points move by, see :class:`Cutter`. Collective."""
        assert self._marked is not None
        out = self._cutter.moving_slip(last.found, slip, last.alone, leaning, self._marked)
        self._constrain(out.operator)
        return out

    def add_slip_curvature_of_points(
        self,
        last: Cut,
        traction: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add how the forces of tractions τ_p change with these held. Collective.

        Args:
            last: The last evaluation.
            traction: τ_p, (rows, gdim).
            moves: Whether points move on their facets.
            to: Where to.
        """
        assert self._marked is not None
        self._cutter.add_slip_curvature_of_points(last.found, traction, moves, self._marked, to)

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
            for operator in (self._slip[2].operator, self._slip[2].works):
                self._constrain(operator)

    def _constrain(self, operator: _cpp.GapOperator) -> None:
        if self._marked is not None:
            operator.constrain(*map(handle_of, self._marked))

    # --- Jumps

    def jump_operator(self, last: Cut) -> _cpp.GapOperator:
        """The jump x_slave − x_master at the rows, places on the facets staying. Collective."""
        if self._jump is None or self._jump[0] is not last:
            out = self._cutter.jump_at_points(last.found, last.alone)
            self._constrain(out)
            self._jump = last, out
        return self._jump[1]

    def moving_gaps(self, last: Cut) -> Changes:
        """Derivative of the gaps with what points move by on their facets. Collective."""
        assert self._marked is not None
        out = self._cutter.moving_gaps(last.found, last.alone, self._marked)
        if out is None:
            return Changes(last.operator)
        self._constrain(out.operator)
        return out

    def points(self, last: Cut) -> tuple[Array, Array]:
        """Points on this rank, (points, 3), and their gaps, positive when open."""
        return self._cutter.points(last.found)

    def pairing_points(self, last: Cut) -> _cpp.PairingPoints:
        """The same with what sees them, for other fields on the facets; normals are not known."""
        return self._cutter.pairing_points(last.found)

    def facet_sizes(self, last: Cut) -> Array:
        """Size (length) of the slave's facet at each of these points."""
        return self._cutter.facet_sizes(last.found)

    # --- Tangent

    def make_pattern(self, last: Cut) -> _cpp.GapOperator:
        """Derivative that the blocks of the tangent are to have room for."""
        self._pattern_of = last
        return last.operator

    def fits(self, last: Cut) -> bool:
        """Whether they have room for what was found."""
        return self._pattern_of is last

    def add_curvature_of_points(
        self,
        last: Cut,
        pressure: Array,
        moves: bool,
        to: Destination,
    ) -> None:
        """Add how Σ_p w_p p_p ∂g_p changes with p_p held: gaps bend, and points move on facets.

        Collective.

        Args:
            last: The last evaluation.
            pressure: p_p, (rows,).
            moves: Whether points move on their facets.
            to: Where to.
        """
        assert self._marked is not None
        self._cutter.add_curvature_of_points(last.found, pressure, moves, self._marked, to)

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
        moves: bool,
        turning: tuple[Array, int] | None = None,
    ) -> MovingFunctions | None:
        """How λ_h moves at the last evaluation; None if it does not. Collective.

        Args:
            last: That evaluation.
            field: λ of the sides of nodes, (nodes, block).
            rest: r_p, (rows,).
            moves: Whether points move on their facets.
            turning: As of :class:`Cutter`.
        """
        assert self._marked is not None
        vec = self._vec_of_sides(field)
        found = self._cutter.moving_functions(
            last.found, last.alone, vec, rest, moves, self._marked, turning
        )
        vec.destroy()
        if found is not None:
            self._constrain(found.operator)
        return found


def _equal(a: Places, b: Places) -> bool:
    return all(x is y or np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def sides_of(slave: Surface) -> Flags:
    """Smooth sides that owned nodes have, (nodes, block). Collective."""
    surface, nv = slave.cpp_object, slave.num_facet_vertices
    sides = np.asarray(surface.vertex_side)[:, :nv, None].astype(np.int64)
    dofs = np.take_along_axis(np.asarray(surface.facet_dofs)[:, :nv], sides, axis=2).ravel()
    return np.asarray(sums_of_sides(slave, dofs, np.ones(len(dofs))) > 0)


def sums_of_sides(slave: Surface, dofs: npt.NDArray[np.int64], values: Array) -> Array:
    """Sums of values at the sides of owned nodes, (nodes, block). Collective.

    Args:
        slave: The surface.
        dofs: Unknowns that stand for the sides, of any rank, (n,).
        values: The values, (n,).
    """
    vec = slave.create_vec()
    vec.setValues(dofs.astype(PETSc.IntType), values, PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: Array = vec.array_r[slave.node_dofs - vec.owner_range[0]].copy()
    vec.destroy()
    return out
