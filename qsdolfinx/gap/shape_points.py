"""Updated gaps at quadrature points of a slave that faces a tool of analytic shape."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.following import (
    MOST_TURNED,
    Alone,
    Changes,
    Destination,
    Found,
    Mixed,
    Places,
    SlipAtPoints,
    Vecs,
    sides_of,
    sums_of_sides,
)
from qsdolfinx.gap.vertex_normals import new_matrix
from qsdolfinx.pairing.ahead import PRESSED_FLAT
from qsdolfinx.pairing.facets import (
    at_vertices,
    first_corners,
    normals_at_vertices,
    sharp_nodes,
    sums,
    unit_normals,
)
from qsdolfinx.pairing.pair import facet_rule
from qsdolfinx.pairing.vertices import lead_away
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.surface.unknowns import CORNERS
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def corner_rule(slave: Surface) -> tuple[Array, Array]:
    """The vertices of the reference facet, with equal weights."""
    x = CORNERS[slave.num_facet_vertices]
    return x, np.full(len(x), 1 / len(x))


def arc_of_turn(first: Array, last: Array) -> Array:
    """θ/sin θ: arc length over its projection on the tangent at one end; θ is the angle of turn.

    Args:
        first: Unit normals at one end, (points, gdim).
        last: Unit normals at the other end.
    """
    theta = np.arccos(np.clip(np.sum(first * last, axis=1), -1.0, 1.0))
    theta = np.clip(theta, 1e-4, MOST_TURNED)
    return np.asarray(theta / np.sin(theta))


class Points(typing.NamedTuple):
    """Quadrature points of the slave, with their distances from the tool.

    Attributes:
        x: Positions of all points, shape (facets, points, 3).
        normal: Outward normals of the tool at the points, shape (facets, points, 3).
        distance: Distances from the tool, (facets, points).
        weight: Areas; 0 for points that do not face the tool, (facets, points).
        position: Position of the tool.
        places: Positions of the slave's facets.
    """

    x: Array
    normal: Array
    distance: Array
    weight: Array
    position: Array
    places: Array


class Turn(typing.NamedTuple):
    """Motion of the tool's tangent planes at points since the start of a step.

    Vectors turn with the tool, and then by the smallest angle into the present plane.

    Attributes:
        along: Component along the normal (length) of the vector at the start from a point to the
            material point of the tool that it faces now, (points,).
        before: Normals of the tool at the start, turned with the tool, (points, gdim).
        now: Present normals, (points, gdim).
        tool: Rotation of the tool, (gdim, gdim).
    """

    along: Array
    before: Array
    now: Array
    tool: Array

    @property
    def _sum(self) -> tuple[Array, Array]:
        """A + b and 1 + a·b of both normals a and b; at least 1e-9, for a half turn."""
        both = 1 + np.sum(self.before * self.now, axis=1)
        return self.before + self.now, np.maximum(both, 1e-9)

    @property
    def matrices(self) -> Array:
        """Rotations R of vectors, R a = b, (points, gdim, gdim)."""
        total, both = self._sum
        turn = 2 * self.now[:, :, None] * self.before[:, None, :]
        turn -= total[:, :, None] * total[:, None, :] / both[:, None, None]
        turn += np.eye(self.now.shape[1])
        return np.asarray(turn @ self.tool)

    def by_normal(self, vectors: Array) -> Array:
        """Derivative by b of rotated vectors, up to parts along b, (points, gdim, gdim).

        Args:
            vectors: Vectors at the start, of which parts along normals are left out, (points,
                gdim).
        """
        total, both = self._sum
        w = vectors @ self.tool.T
        w = w - np.sum(self.before * w, axis=1, keepdims=True) * self.before
        part = np.sum(self.now * w, axis=1) / both  # R w = w − part (a + b)
        change = (w - part[:, None] * self.before) / both[:, None]
        out = -total[:, :, None] * change[:, None, :]
        return np.asarray(out - part[:, None, None] * np.eye(w.shape[1]))


class ShapePoints:
    """Quadrature points fixed on the slave's facets, with exact distances from a tool.

    G_k = −Σ_p w_p N_k(ξ_p) d(x_p), with the distance d along the tool's normals, ∂d = n, and ∂²d
    the curvature of the shape.

    Args:
        slave: Surface that carries the multiplier.
        tool: The tool.
        radius: Search distance (length): points farther away are not paired.
        degree: Degree of the rule on the facets; None for one point at each vertex on a sharp edge.
    """

    def __init__(
        self, slave: Surface, tool: RigidSurface, radius: float, degree: int | None
    ) -> None:
        self._slave, self._tool, self._radius = slave, tool, radius
        self.has_segments = False
        self.kept_pairs = None
        self.are_own = degree is None
        #: One facet vertex for each sharp node, (facets, vertices); None for points on facets.
        self._corners: Flags | None = None
        if degree is None:
            sharp = at_vertices(slave, sharp_nodes(slave).astype(np.float64)) > 0.5
            self._corners = first_corners(slave) & sharp
        x, w = corner_rule(slave) if degree is None else facet_rule(slave, degree)
        self._rule, self._w = (x, w), w
        kind = slave.num_facet_vertices
        #: Shape functions of the vertices and of the trace at the points, (points, functions).
        self._N = np.asarray(_cpp.trace_values(kind, 1, x))
        self._T = np.asarray(_cpp.trace_values(kind, slave.degree, x))
        #: Derivatives of the shape functions of the vertices, (points, functions, 2).
        self._dN = np.asarray(_cpp.trace_gradients(kind, 1, x))
        self._measured = slave.twin()
        self._sign = self._orientation()
        side = np.asarray(slave.cpp_object.vertex_side, dtype=np.int64)
        of_facets = np.asarray(slave.cpp_object.facet_dofs)[:, : side.shape[1]]
        #: Unknowns that represent the smooth patches of facet vertices, (facets, vertices).
        self._dofs = np.take_along_axis(of_facets, side[..., None], axis=2)[..., 0]
        self._values = TraceValues(slave)
        x0, _, nodes = slave.coordinates
        #: Signs that make normals computed from the facet vertices alone outward.
        self._signs = np.sign(np.sum(unit_normals(x0, nodes) * normals_at_vertices(slave), axis=2))

    def _orientation(self) -> Array:
        """Signs, 1 or −1, that make the area vectors of the facets outward."""
        x, inside, _ = self._slave.coordinates
        out = x.mean(axis=1) - inside
        area = self._area_vectors(x).sum(axis=1)
        return np.asarray(np.where(np.sum(area * out, axis=1) > 0, 1.0, -1.0))

    def _area_vectors(self, x: Array) -> Array:
        """∂x/∂ξ × ∂x/∂η of the straight facets through the vertices, (facets, points, 3)."""
        nv = self._slave.num_facet_vertices
        tangents = np.einsum("pvi,fvd->fpid", self._dN, x[:, :nv])
        a = tangents[:, :, 0]
        if self._slave.gdim == 2:
            return np.stack([a[..., 1], -a[..., 0], 0 * a[..., 0]], axis=-1)
        return np.cross(a, tangents[:, :, 1])

    def _area_growth(self, x: Array) -> Array:
        """Derivative of the logarithm of :meth:`_areas` with respect to the vertex positions.

        Shape (facets, points, vertices, gdim).
        """
        nv, gdim = self._slave.num_facet_vertices, self._slave.gdim
        tangents = np.einsum("pvi,fvd->fpid", self._dN, x[:, :nv])
        if gdim == 2:
            tangents[:, :, 1] = 0.0, 0.0, 1.0
        a, b = tangents[:, :, 0], tangents[:, :, 1]
        s = np.cross(a, b)
        s /= np.sum(s * s, axis=2, keepdims=True)
        out = np.einsum("pv,fpd->fpvd", self._dN[:, :nv, 0], np.cross(b, s))
        if gdim == 3:
            out += np.einsum("pv,fpd->fpvd", self._dN[:, :nv, 1], np.cross(s, a))
        if self._slave.axisymmetric:
            r = np.einsum("pv,fv->fp", self._N, x[:, :nv, 0])
            out[..., 0] += self._N / r[:, :, None]
        return np.asarray(out[..., :gdim])

    def _areas(self, x: Array) -> Array:
        """Areas of the points, (facets, points)."""
        out = self._w * np.linalg.norm(self._area_vectors(x), axis=2)
        if self._slave.axisymmetric:
            nv = self._slave.num_facet_vertices
            out = out * 2 * np.pi * np.einsum("pv,fv->fp", self._N, x[:, :nv, 0])
        return np.asarray(out)

    def node_area(self, places: Places) -> Array:
        """See :class:`Cutter`."""
        self._measured.follow(np.ascontiguousarray(places[0]))
        self._measured.measure_nodes()
        return np.asarray(self._measured.node_area)

    def choose(self, places: Places) -> Array | None:
        """See :class:`Cutter`: vertices that protrude from their facets, see ``pair_vertices``."""
        if self._corners is None:
            return None
        slave, corners = self._slave, self._corners
        x = places[0][:, : slave.num_facet_vertices]
        normals = self._signs[..., None] * unit_normals(x, places[0] if slave.degree > 1 else None)
        distance, of_tool = self._tool.distance(x.reshape(-1, 3), places[1])
        of_tool = of_tool.reshape(x.shape)
        near = np.abs(distance.reshape(corners.shape)) <= self._radius
        near &= np.sum(self._mean(normals) * of_tool, axis=2) < 0
        at = np.where((corners & near)[..., None], -of_tool, 0.0)
        along = np.stack([sums(slave, at[..., i].ravel()) for i in range(3)], axis=1)
        ahead = lead_away(slave, along, x, normals, PRESSED_FLAT) & np.any(along, axis=1)
        sides = self._sides_of(corners & (at_vertices(slave, ahead.astype(np.float64)) > 0.5))
        return np.where(sides, self.node_area(places)[:, None], 0.0)

    def sides(self) -> Flags:
        """See :class:`Cutter`."""
        return sides_of(self._slave) if self._corners is None else self._sides_of(self._corners)

    def _sides_of(self, chosen: Flags) -> Flags:
        """Smooth patches of owned nodes at the chosen vertices of facets. Collective."""
        sums = sums_of_sides(self._slave, self._dofs.ravel(), chosen.astype(np.float64).ravel())
        return np.asarray(sums > 0.5)

    def _mean(self, normals: Array) -> Array:
        """Sums of normals of the facets at each vertex, (facets, vertices, 3). Collective."""
        of_nodes = [sums(self._slave, values.ravel()) for values in np.moveaxis(normals, 2, 0)]
        return np.stack([at_vertices(self._slave, values) for values in of_nodes], axis=2)

    def _weights(self, x: Array, vertices: Array | None) -> Array:
        """Areas of the points; for points at vertices those of ``vertices``. Collective."""
        if self._corners is None or vertices is None:
            return self._areas(x)
        area = at_vertices(self._slave, vertices.sum(axis=1))
        return np.where(self._corners, area, 0.0)

    def find(self, places: Places, vertices: Array | None) -> Found:
        """See :class:`Cutter`."""
        x = np.einsum("pj,fjd->fpd", self._T, places[0])
        distance, normal = (
            values.reshape(*x.shape[:2], *values.shape[1:])
            for values in self._tool.distance(x.reshape(-1, 3), places[1])
        )
        outward = self._sign[:, None, None] * self._area_vectors(places[0])
        opposite = np.abs(distance) <= self._radius
        if self._corners is None:
            opposite &= np.sum(outward * normal, axis=2) < 0
        weight = np.where(opposite, self._weights(places[0], vertices), 0.0)
        cover = sums_of_sides(self._slave, self._dofs.ravel(), (weight @ self._N).ravel())
        return Found(cover, Points(x, normal, distance, weight, *places[::-1]))

    def operator_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """See :class:`Cutter`."""
        points = self._paired(found, alone)
        return _cpp.GapOperator(self._slave.cpp_object, None, points, jump=False, rows=2)

    def jump_at_points(self, found: Found, alone: Alone) -> _cpp.GapOperator:
        """See :class:`Cutter`."""
        points = self._paired(found, alone)
        return _cpp.GapOperator(self._slave.cpp_object, None, points, jump=True, rows=2)

    def _paired(self, found: Found, alone: Alone, factor: float = 1.0) -> _cpp.PairingPoints:
        """The points that face the tool, and the points without a partner.

        Args:
            found: Points that face the tool.
            alone: Points without a partner.
            factor: Factor of the normals.
        """
        return self._pairing_points(found, factor).with_alone(*alone)

    def pairing_points(self, found: Found) -> _cpp.PairingPoints:
        """See :class:`Cutter`."""
        return self._pairing_points(found, 1.0)

    def _pairing_points(self, found: Found, factor: float) -> _cpp.PairingPoints:
        at = found.of_cutter
        points = _cpp.sample_facets(self._slave.cpp_object, *self._rule)
        kept = at.weight.ravel() > 0
        normal, gap = -factor * at.normal.reshape(-1, 3), at.distance.ravel()
        weight = at.weight.ravel() / np.asarray(points.weight)
        _cpp.face_tool(points, kept.astype(np.uint8), normal, gap, len(self._w))
        return points.scaled(weight[kept])

    def mixed(
        self,
        found: Found,
        rest: Array,
        markers: Vecs,
        turning: tuple[Array, int] | None,
    ) -> Mixed | None:
        """See :class:`Cutter`; points are fixed, but their areas change with the facets."""
        at = found.of_cutter
        if self._corners is not None and turning is None:
            return None
        forces = at.weight * self._at_points(at, rest)
        some = np.flatnonzero(np.any(at.weight > 0, axis=1))
        value = np.einsum("fp,pk,fpjc->fkjc", forces[some], self._N, self._growth(at, some))
        if turning is not None:  # τ stays in the tangent plane of the tool: n·δτ = −τ·δn
            vectors, component = turning
            n, bent = at.normal[some][..., component], self._bent(at, some)
            turned = np.einsum("fpa,fpac->fpc", self._at_points(at, vectors)[some], bent)
            factor = at.weight[some] * n
            value -= np.einsum("fp,pk,pj,fpc->fkjc", factor, self._N, self._T, turned)
        row = np.broadcast_to(self._dofs[some][:, :, None, None], value.shape)
        columns = np.broadcast_to(self._free(markers, some)[:, None], value.shape)
        row, columns, value = (np.ascontiguousarray(v).ravel() for v in (row, columns, value))
        return [(row, columns.astype(np.int64), value)]

    def slip_at_points(
        self, found: Found, places: Places, alone: Alone, start: Places
    ) -> SlipAtPoints:
        """See :class:`Cutter`: slip of the points relative to the tool.

        It is the tangential part of the vector at the start from a point to the material point of
        the tool that it faces now. This vector turns with the tool.
        """
        at, gdim = found.of_cutter, self._slave.gdim
        kept = at.weight > 0
        x, n = at.x[kept][:, :gdim], at.normal[kept][:, :gdim]
        on_tool = x - at.distance[kept][:, None] * n
        before = np.einsum("pj,fjd->fpd", self._T, start[0])[kept][:, :gdim]
        now, then = places[1], start[1]
        turn = now[:, :gdim] @ then[:, :gdim].T
        was_there = (on_tool - now[:, gdim]) @ turn + then[:, gdim]
        way = (was_there - before) @ turn.T
        along = np.sum(way * n, axis=1)
        slip = way - along[:, None] * n
        points, operator = self._paired(found, alone), self.jump_at_points(found, alone)
        none = np.zeros((len(alone.weight), gdim))
        in_space = np.zeros((len(before), 3))
        in_space[:, :gdim] = before
        distance, n_before = self._tool.distance(in_space, then)
        arc = np.concatenate([arc_of_turn(n_before[:, :gdim], n @ turn), np.ones(len(none))])
        gap = np.concatenate([-distance, np.full(len(none), -alone.far)])
        tool = Turn(along, n_before[:, :gdim] @ turn.T, n, turn)
        turns = np.concatenate([tool.matrices, np.tile(np.eye(gdim), (len(none), 1, 1))])
        slip, normal = (np.concatenate([values, none]) for values in (slip, -n))
        facets = np.asarray(points.slave["dofs"])[:, : self._N.shape[1], 0]
        place = np.asarray(points.multiplier_values)
        return SlipAtPoints(
            slip, normal, operator, lambda: operator, facets, place, arc, gap, turns, tool
        )

    def moving_slip(
        self,
        found: Found,
        slip: SlipAtPoints,
        alone: Alone,
        leaning: Array,
        kept: Array,
        markers: Vecs,
    ) -> Changes:
        """See :class:`Cutter`; the tool's closest points and planes move with the points."""
        return Changes(slip.operator, self._by_nodes(found, slip, leaning, kept, markers))

    def add_slip_curvature_of_points(
        self,
        found: Found,
        traction: Array,
        moves: bool,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """See :class:`Cutter`; points are fixed, and tractions stay tangential to the tool."""
        at = found.of_cutter
        tau = self._at_points(at, traction)
        some = np.flatnonzero(np.any(tau != 0, axis=(1, 2)))
        w, tau, n = at.weight[some], tau[some], at.normal[some][..., : self._slave.gdim]
        turned = np.einsum("fpa,fpac->fpc", tau, self._bent(at, some))
        H = -np.einsum("fp,pi,fpa,pj,fpc->fiajc", w, self._T, n, self._T, turned)
        H += np.einsum("fp,pi,fpa,fpjc->fiajc", w, self._T, tau, self._growth(at, some))
        self._insert(to, self._free(markers, some), H)

    def _at_points(self, points: Points, values: Array) -> Array:
        """Values of constraints at all points, 0 at points without one, (facets, points, …)."""
        kept = points.weight > 0
        out = np.zeros(kept.shape + values.shape[1:])
        out[kept] = values[: np.count_nonzero(kept)]
        return out

    def _bent(self, points: Points, some: npt.NDArray[np.int64]) -> Array:
        """∂n/∂x of the tool at the points of selected facets, (facets, points, gdim, gdim)."""
        gdim = self._slave.gdim
        bent = self._tool.curvature(points.x[some].reshape(-1, 3), points.position)
        return np.asarray(bent.reshape(len(some), len(self._w), 3, 3)[..., :gdim, :gdim])

    def _growth(self, points: Points, some: npt.NDArray[np.int64]) -> Array:
        """See :meth:`_area_growth`, for all nodes of selected facets; 0 for points at vertices."""
        out = np.zeros((len(some), len(self._w), self._T.shape[1], self._slave.gdim))
        if self._corners is None:
            out[:, :, : self._slave.num_facet_vertices] = self._area_growth(points.places[some])
        return out

    def _free(self, markers: Vecs, some: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
        """Unknowns of nodes of selected facets, −1 if constrained, (facets, nodes, gdim)."""
        held = self._values(markers[0])[some, :, : self._slave.gdim] != 0
        return np.where(held, -1, self._slave.trace_dofs[0][some]).astype(PETSc.IntType)

    @staticmethod
    def _insert(to: Destination, dofs: npt.NDArray[np.int32], H: Array) -> None:
        """Add the facet matrices H, (facets, nodes, gdim, nodes, gdim)."""
        width = int(np.prod(dofs.shape[1:]))
        numbers = to.numbers[0](dofs.reshape(-1, width).astype(np.int64))
        to.sums.add_squares(numbers, to.scale[0] * H)

    def _by_nodes(
        self,
        found: Found,
        slip: SlipAtPoints,
        leaning: Array,
        kept: Array,
        markers: Vecs,
    ) -> tuple[int, PETSc.Mat]:
        """Derivative of slips due to turning tangent planes of the tool, a row per component."""
        at, gdim, comm = found.of_cutter, self._slave.gdim, self._slave.comm
        num_rows = slip.works.num_rows * gdim
        rows = PETSc.Vec().createMPI((num_rows, PETSc.DETERMINE), comm=comm)
        faces, some = at.weight > 0, np.arange(len(at.weight))
        tool: Turn = slip.of_cutter
        count = len(tool.along)
        factor = leaning[:count] - tool.along - at.distance[faces]
        by_normal = factor[:, None, None] * np.eye(gdim) + tool.by_normal(kept[:count])
        bent = np.einsum("fprs,fpsc->fprc", self._at_points(at, by_normal), self._bent(at, some))
        value = np.einsum("pj,fprc->fprjc", self._T, bent)[faces]
        number = rows.owner_range[0] + np.arange(np.count_nonzero(faces) * gdim)
        row = np.broadcast_to(number.reshape(-1, gdim)[..., None, None], value.shape)
        dofs = self._free(markers, some)
        columns = np.broadcast_to(dofs[:, None, None], (*faces.shape, 1, *dofs.shape[1:]))[faces]
        columns = np.broadcast_to(columns, value.shape)
        free = columns >= 0
        assert markers[0] is not None
        sizes = rows.getSizes(), markers[0].getSizes()
        out = new_matrix(*sizes, (row[free], columns[free], value[free]), comm)
        rows.destroy()
        return 0, out

    def add_curvature_of_points(
        self,
        found: Found,
        pressure: Array,
        moves: bool,
        markers: Vecs,
        to: Destination,
    ) -> None:
        """See :class:`Cutter`; points are fixed."""
        at = found.of_cutter
        force = at.weight * self._at_points(at, pressure)
        some = np.flatnonzero(np.any(force != 0, axis=1))
        force, n = -force[some], at.normal[some][..., : self._slave.gdim]
        H = np.einsum("fp,pi,pj,fpab->fiajb", force, self._T, self._T, self._bent(at, some))
        H += np.einsum("fp,pi,fpa,fpjb->fiajb", force, self._T, n, self._growth(at, some))
        self._insert(to, self._free(markers, some), H)

    def points(self, found: Found) -> tuple[Array, Array]:
        """See :class:`Cutter`."""
        kept = found.of_cutter.weight > 0
        return found.of_cutter.x[kept], found.of_cutter.distance[kept]

    def facet_sizes(self, found: Found) -> Array:
        """See :class:`Cutter`; sizes are those of the mesh when it was last read."""
        kept, x = found.of_cutter.weight > 0, self._slave.coordinates[0]
        size = np.linalg.norm(x[:, :, None] - x[:, None], axis=-1).max(axis=(1, 2), initial=0.0)
        return np.asarray(np.broadcast_to(size[:, None], kept.shape)[kept])
