"""Segmentation of facets in their present positions, for gaps with updated geometry."""

from __future__ import annotations

import functools
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.following import (
    Alone,
    Destination,
    Found,
    Places,
    PointState,
    SlipAtPoints,
    Vecs,
    sides_of,
    sums_of_sides,
)
from qsdolfinx.gap.own_rows import FacedVertices
from qsdolfinx.gap.vertex_normals import NormalsThere, new_matrix
from qsdolfinx.pairing.pair import overlay_rules
from qsdolfinx.surface.affine import trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
#: Motion of both surfaces together, over the mean facet size, up to which pairs of facets are kept.
#: It bounds the part of evaluations with a search; with much more, each evaluation goes through
#: more pairs in vain.
SKIN = 1.0
#: Slave and master as separate objects of the extension, which can be moved alone.
Twins = tuple[_cpp.Surface, _cpp.Surface]


class Finder(typing.Protocol):
    """Interface for finding the contact quadrature points of facets that face each other.

    Attributes:
        both: Whether the facets of both surfaces are segmented.
        are_own: As in :class:`Cutter`.
        of_tool: Vertices of a tool that have multipliers of their own, among the owned ones, and
            their areas; None for other points.
        raised: Side over whose facets there may be a curved surface: 0 for the slave, 1 for the
            master.
        kept_pairs: Pairs of facets that are kept between evaluations; None for other points than
            those of segments.
    """

    both: bool
    are_own: bool
    raised: int

    @property
    def kept_pairs(self) -> _cpp.KeptPairs | None:
        """See above."""

    @property
    def of_tool(self) -> tuple[Indices, Array] | None:
        """See above."""

    def sides(self) -> Flags:
        """Smooth patches of owned nodes of the slave that may have multipliers. Collective."""

    def choose(self, surfaces: Twins, places: Places) -> Array | None:
        """``GapState.vertices`` for surfaces at these positions. Collective."""

    def pieces(
        self, surfaces: Twins, places: Places, vertices: Array | None
    ) -> tuple[_cpp.Pieces, NormalsThere | None]:
        """Find the points for surfaces at these positions. Collective.

        The second result is the normals of the curved surface over facets of a body along whose
        normals forces act; None for none.
        """


class Overlay:
    """Segmentation of all facets that face each other; arguments as in :class:`FacetCutter`."""

    are_own, of_tool, raised = False, None, 1

    def __init__(self, slave: Surface, both: bool, radius: _cpp.SearchRadius, degree: int) -> None:
        self._slave, self.both = slave, both
        #: See :class:`Finder`.
        self.kept_pairs = _cpp.KeptPairs(radius, SKIN)
        self._rules = overlay_rules(slave.gdim, degree)

    def sides(self) -> Flags:
        """See :class:`Finder`: all smooth patches."""
        return sides_of(self._slave)

    def choose(self, surfaces: Twins, places: Places) -> Array | None:
        """See :class:`Finder`."""
        return None

    def pieces(
        self, surfaces: Twins, places: Places, vertices: Array | None
    ) -> tuple[_cpp.Pieces, NormalsThere | None]:
        """See :class:`Finder`."""
        return _cpp.overlay_pieces(*surfaces, self.both, self.kept_pairs, *self._rules), None


class Known(typing.NamedTuple):
    """The segments of the last evaluation, and the positions and vertices they belong to."""

    places: Places
    vertices: Array | None
    pieces: _cpp.Pieces
    normals: NormalsThere | None


class FacetCutter:
    """Segmentation of the facets of two surfaces.

    Half of the integral is over each surface: facet y of one surface is intersected with facet z of
    the other, projected along the normal n of y. At a point of y with fixed reference coordinates ξ
    the gap is −t with x_z(ζ) = x_y(ξ) + t n. The multiplier is taken at the point on the slave, ξ
    or ζ.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface, or a tool made of facets.
        finder: Finds the points.
    """

    has_segments = True

    def __init__(self, slave: Surface, master: AnySurface, finder: Finder) -> None:
        self._surfaces = slave, master
        self._slave, self._master = slave.cpp_object, master.cpp_object
        self._finder = finder
        self.are_own = finder.are_own
        #: Whether the functions of multipliers do not change at the points.
        self._are_constant = finder.are_own or finder.of_tool is not None
        self._moving = slave.twin(), master.twin(slave.axisymmetric)
        self._moved_to: Places | None = None
        self._known: Known | None = None

    @property
    def kept_pairs(self) -> _cpp.KeptPairs | None:
        """See :class:`Cutter`."""
        return self._finder.kept_pairs

    def node_area(self, places: Places) -> Array:
        """See :class:`Cutter`."""
        self._put(places)
        self._moving[0].measure_nodes()
        return np.asarray(self._moving[0].node_area)

    def sides(self) -> Flags:
        """See :class:`Cutter`."""
        return self._finder.sides()

    def choose(self, places: Places) -> Array | None:
        """See :class:`Cutter`."""
        self._put(places)
        return self._finder.choose(self._moving, places)

    def find(self, places: Places, vertices: Array | None) -> Found:
        """See :class:`Cutter`."""
        known = self._pieces(places, vertices)
        pieces, slave = known.pieces, self._surfaces[0]
        cover = sums_of_sides(slave, np.asarray(pieces.side_dofs()), np.asarray(pieces.cover()))
        own, faced = self._finder.of_tool, None
        if own is not None:
            faced = FacedVertices(*own, np.asarray(pieces.vertex))
        return Found(cover, pieces, pieces.num_missed, known.normals, faced)

    def _pieces(self, places: Places, vertices: Array | None) -> Known:
        """Segments for :meth:`find`; for unchanged positions those of the last call. Collective."""
        known = self._known
        if known is not None and known.places is places and known.vertices is vertices:
            return known
        self._put(places)
        self._known = Known(places, vertices, *self._finder.pieces(self._moving, places, vertices))
        return self._known

    def operator_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """See :class:`Cutter`."""
        return _cpp.GapOperator(
            self._master,
            points_of=found.of_cutter,
            alone=alone.unknown,
            weight=alone.weight,
            far=alone.far,
        )

    def _add_turning(
        self,
        found: Found,
        stress: Array,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """Add the derivative of forces due to turning normals. Collective."""
        if found.normals is None:
            return
        side, comm = self._finder.raised, self._surfaces[0].comm
        vec = markers[side]
        assert vec is not None
        entries = found.of_cutter.forces_by_normals(stress, stress.ndim > 1)
        turn = _but_for_held(found.normals.turn(entries), None, vec)
        for i, rows in enumerate(markers):
            if rows is None:
                continue
            forces = new_matrix(rows.getSizes(), vec.getSizes(), entries[i], comm)
            product = _but_for_held(forces, rows, None).matMult(turn)
            starts, column, value = product.getValuesCSR()
            row = product.getOwnershipRange()[0] + np.repeat(
                np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts)
            )
            numbers = to.numbers[i](row), to.numbers[side](column.astype(np.int64))
            to.sums.add_entries(*numbers, to.scale[side] * value)
            for mat in (forces, product):
                mat.destroy()
        turn.destroy()

    def jump_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """See :class:`Cutter`."""
        return _cpp.GapOperator(
            self._master,
            jump_of=found.of_cutter,
            alone=alone.unknown,
            weight=alone.weight,
        )

    def function_sides(self, found: Found) -> Indices:
        """See :class:`Cutter`."""
        return np.asarray(found.of_cutter.side_dofs()).ravel()

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
        """See :class:`Cutter`."""
        rest, own, none = state.rest, found.vertices is not None, np.zeros(0)
        if self._are_constant:  # τ turns, with Σ_k N_k = 1
            missing = []  # areas of vertices do not change
            first = len(fields) if own else 1
            fields = [None] * first + fields[first:]
            rest = np.where(np.arange(rest.shape[1]) < first, 0.0, rest)
        traction, turning = (
            none if of is None else _in_space(of) for of in (state.traction, state.turning)
        )
        leaning = none if state.leaning is None else np.ascontiguousarray(state.leaning)
        kept, slopes = typing.cast(Array, none), typing.cast(Array, none)
        if state.kept is not None and state.slip is not None:
            kept = _in_space(np.einsum("pij,pj->pi", state.slip.turn, state.kept.before))
            if state.kept.slopes is not None and not own:
                slopes = _in_space(state.kept.slopes)
        _cpp.add_point_forces(
            to.sums,
            found.of_cutter,
            None if state.slip is None else state.slip.of_cutter,
            factors=state.factors,
            derivatives=[np.ascontiguousarray(of) for of in (state.by_trial, state.by_own)],
            values=[
                np.ascontiguousarray(state.pressure),
                traction,
                np.ascontiguousarray(rest),
                turning,
                leaning,
                kept,
                slopes,
            ],
            fields=[handle_of(vec) for vec in fields],
            missing=[handle_of(vec) for vec in missing],
            begun=[vec.handle for vec in begun],
            moves=state.moves,
            gaps_move=state.gaps_move,
            function_rows=state.function_rows,
            functions=state.functions,
            own=own,
            numbers=_numbers(found, markers, to),
            scale=to.scale,
            tool=to.tool,
            way=to.way,
        )
        if state.moves:
            self._add_turning(found, np.ascontiguousarray(state.pressure), markers, to)
            if state.traction is not None:
                self._add_turning(found, traction, markers, to)

    def slip_at_points(
        self, found: Found, places: Places, alone: Alone, start: Places
    ) -> SlipAtPoints:
        """See :class:`Cutter`."""
        pieces, gdim = found.of_cutter, found.of_cutter.gdim
        slave, master = self._surfaces
        bodies = slave, *master.bodies
        vecs = [trace_vec(s, x[..., :gdim]) for s, x in zip(bodies, start, strict=False)]
        of_tool = _back(places[1], start[1]) if is_rigid(master) else np.zeros(0)
        on_master = vecs[1].handle if len(vecs) > 1 else 0
        slips = _cpp.SlipOfPieces(pieces, vecs[0].handle, on_master, of_tool)

        def operator(works: bool) -> _cpp.GapOperator:
            weight = alone.weight
            return _cpp.GapOperator(
                self._master, points_of=pieces, slip=slips, works=works, weight=weight
            )

        for vec in vecs:
            vec.destroy()
        count = len(alone.weight)
        slip, normal = (
            np.concatenate([np.asarray(values)[:, :gdim], np.zeros((count, gdim))])
            for values in (slips.slip, slips.normal)
        )
        facets, place = (
            np.concatenate([values, np.full((count, values.shape[1]), -1, dtype=values.dtype)])
            for values in (np.asarray(pieces.facets()), np.asarray(pieces.functions()))
        )
        arc = np.concatenate([np.asarray(slips.arc), np.ones(count)])
        gap = np.concatenate([np.asarray(slips.gap), np.full(count, -alone.far)])
        turn = np.asarray(slips.turns(pieces))[:, :gdim, :gdim]
        turn = np.concatenate([turn, np.broadcast_to(np.eye(gdim), (count, gdim, gdim))])
        return SlipAtPoints(
            slip,
            normal,
            operator(True),
            functools.partial(operator, False),
            facets,
            place,
            arc,
            gap,
            turn,
            slips,
        )

    def points(self, found: Found) -> tuple[Array, Array]:
        """See :class:`Cutter`."""
        return np.asarray(found.of_cutter.x()), np.asarray(found.of_cutter.gaps())

    def pairing_points(self, found: Found) -> _cpp.PairingPoints:
        """See :class:`Cutter`."""
        return _cpp.points_of_pieces(self._slave, self._master, found.of_cutter)

    def facet_sizes(self, found: Found) -> Array:
        """See :class:`Cutter`."""
        return np.asarray(found.of_cutter.slave_sizes())

    def _put(self, places: Places) -> None:
        """Move the facets to these positions."""
        if self._moved_to is places:
            return
        for surface, moving, place in zip(self._surfaces, self._moving, places, strict=True):
            moving.follow(np.ascontiguousarray(surface.facet_positions(place)))
        self._moved_to = places


def _numbers(found: Found, markers: Vecs, to: Destination) -> list[Indices]:
    """Numbers of the segments' unknowns on both sides, see ``cpp/tangent/point_forces.h``.

    Collective.
    """
    pieces, none = found.of_cutter, np.zeros(0, dtype=np.int64)
    out: list[Indices] = [none, none]
    for i, (numbers, vec) in enumerate(zip(to.numbers, markers, strict=False)):
        assert vec is not None
        out[i] = numbers(np.asarray(_cpp.free_unknowns(pieces, i, vec.handle)))
    return out


def _but_for_held(mat: PETSc.Mat, rows: PETSc.Vec | None, columns: PETSc.Vec | None) -> PETSc.Mat:
    """Set the matrix to zero at Dirichlet conditions, see the markers of :class:`Cutter`."""
    free: list[PETSc.Vec | None] = []
    for marked in (rows, columns):
        vec = None if marked is None else marked.copy()
        if vec is not None:
            vec.array[:] = vec.array_r == 0
        free.append(vec)
    mat.diagonalScale(*free)
    for vec in free:
        if vec is not None:
            vec.destroy()
    return mat


def _in_space(vectors: Array) -> Array:
    """Vectors with a third component, in the last axis."""
    out = np.zeros((*vectors.shape[:-1], 3))
    out[..., : vectors.shape[-1]] = vectors
    return out


def _back(now: Array, before: Array) -> Array:
    """Map from present to earlier positions of a tool: the rows of a (3, 4) matrix, flattened.

    Args:
        now: Present position [R | t], (gdim, gdim + 1).
        before: Earlier position, (gdim, gdim + 1).
    """
    gdim, out = len(now), np.eye(3, 4)
    turn = before[:, :gdim] @ now[:, :gdim].T
    out[:gdim, :gdim], out[:gdim, 3] = turn, before[:, gdim] - turn @ now[:, gdim]
    return np.ascontiguousarray(out.ravel())
