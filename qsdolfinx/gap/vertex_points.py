"""Points of updated gaps at vertices on sharp edges, which protrude from their facets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.facet_cutter import Twins
from qsdolfinx.gap.following import Places
from qsdolfinx.gap.vertex_normals import NormalsThere, VertexNormals
from qsdolfinx.pairing.ahead import PRESSED_FLAT, UPRIGHT
from qsdolfinx.pairing.facets import (
    SharpNodes,
    gathered,
    normals_at_vertices,
    sharp_nodes,
    unit_normals,
)
from qsdolfinx.pairing.vertices import lead_away, nodes_of
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class Vertices:
    """Points at vertices of the slave on sharp edges, along the normals of the facets they face.

    Facets of a deformable master with sharp edges at all of their vertices belong to a coarse
    curved surface and get no such points: in its corners a vertex would alternate between facets,
    and the points of its own facets see as much there.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        radius: Search distance: points farther away are not paired.
        sharp: Sharp vertices of the slave and of the master, None for a rigid tool.
    """

    both, are_own, of_tool, raised, kept_pairs = False, True, None, 1, None

    def __init__(
        self,
        slave: Surface,
        master: AnySurface,
        radius: _cpp.SearchRadius,
        sharp: tuple[SharpNodes | None, SharpNodes | None],
    ) -> None:
        of_slave, of_master = sharp
        assert of_slave is not None
        self._slave, self._radius, self._sharp = slave, radius, of_slave.sharp
        self._master = master
        self._is_rigid, self._facets = is_rigid(master), master.as_facets(slave.axisymmetric)
        there = sharp_nodes(self._facets) if of_master is None else of_master.sharp
        self._sharp_there = there.astype(np.float64)
        self._normals = VertexNormals(self._facets, self._sharp_there > 0.5)
        x, _, nodes = slave.coordinates
        #: Signs that make normals computed from the facet vertices alone outward.
        self._signs: Array = np.sign(
            np.sum(unit_normals(x, nodes) * normals_at_vertices(slave), axis=2)
        )

    def sides(self) -> Flags:
        """See :class:`Finder`: one patch for each sharp vertex."""
        out = np.zeros((len(self._sharp), self._slave.block), dtype=bool)
        out[:, 0] = self._sharp
        return out

    def choose(self, surfaces: Twins, places: Places) -> Array | None:
        """See :class:`Finder`: vertices that protrude from their facets, see ``pair_vertices``."""
        surfaces[0].measure_nodes()
        points = _cpp.pair_vertices(*surfaces, self._sharp.astype(np.uint8), self._radius)
        some = self._are_before_smooth_facets(points)
        node, along = nodes_of(self._slave, points)[some], np.zeros((len(self._sharp), 3))
        along[node] = points.normal[some]
        x = places[0][:, : self._slave.num_facet_vertices]
        normals = self._signs[..., None] * unit_normals(
            x, places[0] if self._slave.degree > 1 else None
        )
        ahead = lead_away(self._slave, along, x, normals, PRESSED_FLAT)[node]
        out = np.zeros((len(self._sharp), self._slave.block))
        out[node, 0] = ahead * np.asarray(surfaces[0].node_area)[node]
        return out

    def _are_before_smooth_facets(self, points: _cpp.PairingPoints) -> Flags:
        """Points that face a facet with a vertex on no sharp edge, (points,). Collective."""
        if self._is_rigid:
            return np.ones(points.size, dtype=bool)
        dofs = points.master["dofs"][:, : self._facets.num_facet_vertices, 0]
        return np.asarray(np.any(gathered(self._facets, self._sharp_there, dofs) < 0.5, axis=1))

    def pieces(
        self, surfaces: Twins, places: Places, vertices: Array | None
    ) -> tuple[_cpp.Pieces, NormalsThere | None]:
        """See :class:`Finder`."""
        assert vertices is not None
        surfaces[0].measure_nodes()
        area = np.ascontiguousarray(vertices[:, 0])
        which = (area > 0).astype(np.uint8)
        out = _cpp.vertex_pieces(*surfaces, False, which, area, self._radius)
        normals = raise_facets(out, self._normals, self._master.facet_positions(places[1]))
        return out, None if self._is_rigid else normals  # a tool's normals do not change


class ToolVertices:
    """Points at vertices of a rigid tool on sharp edges, along the normals of the body's facets.

    Each vertex has a multiplier of its own, wherever it slides: with multipliers of the body's
    nodes, several would belong to one constraint. The nodes show means of these multipliers.

    Args:
        slave: The body's surface.
        tool: The rigid tool, made of facets.
        radius: Search distance: points farther away are not paired.
        sharp: Sharp vertices of the slave.
    """

    both, are_own, raised, kept_pairs = True, False, 0, None

    def __init__(
        self,
        slave: Surface,
        tool: AnySurface,
        radius: _cpp.SearchRadius,
        sharp: SharpNodes | None,
    ) -> None:
        assert sharp is not None
        self._slave, self._tool, self._radius = slave, tool, radius
        self._facets = tool.as_facets(slave.axisymmetric)
        self._sharp, self._sharp_there = sharp_nodes(self._facets), sharp.sharp
        self._normals = VertexNormals(slave, self._sharp_there)
        x = self._facets.coordinates[0]
        #: Signs that make normals computed from the tool's vertices alone outward.
        self._signs: Array = np.sign(
            np.sum(unit_normals(x) * normals_at_vertices(self._facets), axis=2)
        )
        #: Areas of the vertices: the mean area of a node of the body.
        self._area: Array = np.full(len(self._sharp), sharp.node_size)
        some = np.flatnonzero(self._sharp).astype(np.int64)
        #: See :class:`Finder`.
        self.of_tool: tuple[Indices, Array] = some, self._area[some]

    def sides(self) -> Flags:
        """See :class:`Finder`: one patch for each node."""
        out = np.zeros((len(self._sharp_there), self._slave.block), dtype=bool)
        out[:, 0] = True
        return out

    def choose(self, surfaces: Twins, places: Places) -> Array | None:
        """See :class:`Finder`: vertices that protrude from their facets, see ``pair_vertices``."""
        slave, tool = surfaces
        tool.measure_nodes()
        points = _cpp.pair_vertices(tool, slave, self._sharp.astype(np.uint8), self._radius)
        node, along = nodes_of(self._facets, points), np.zeros((len(self._sharp), 3))
        along[node] = points.normal
        x = self._tool.facet_positions(places[1])
        normals = self._signs[..., None] * unit_normals(x)
        out = np.zeros((len(self._sharp), 1))
        out[node, 0] = lead_away(self._facets, along, x, normals, UPRIGHT)[node] * self._area[node]
        return out

    def pieces(
        self, surfaces: Twins, places: Places, vertices: Array | None
    ) -> tuple[_cpp.Pieces, NormalsThere | None]:
        """See :class:`Finder`."""
        assert vertices is not None
        surfaces[1].measure_nodes()
        which = (vertices[:, 0] > 0).astype(np.uint8)
        out = _cpp.vertex_pieces(*surfaces, True, which, self._area, self._radius)
        return out, raise_facets(out, self._normals, places[0])


def raise_facets(pieces: _cpp.Pieces, normals: VertexNormals, x: Array) -> NormalsThere:
    """Let forces act along the normals of a surface without kinks between facets. Collective.

    A vertex that rests where facets meet would otherwise be pushed along the normal of one facet,
    then along that of the other.

    Args:
        pieces: The points.
        normals: Averaged vertex normals of the surface that vertices face.
        x: Positions of the nodes of its facets, (facets, nodes, 3).
    """
    there = normals.at(x)
    vec = there.vec()
    pieces.raise_facets(vec.handle)
    vec.destroy()
    return there
