"""Contact points at vertices on sharp edges, which protrude from their facets."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.ahead import FLAT, TOWARDS, deepest, linear, with_own_multipliers
from qsdolfinx.pairing.facets import (
    Faceted,
    at_vertices,
    gathered,
    normals_at_vertices,
    sharp_nodes,
    sums,
)
from qsdolfinx.pairing.points import PairingSide, with_unknowns_alone
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_shape

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


class VerticesRole(typing.NamedTuple):
    """The two surfaces, and the one whose vertices are used.

    Attributes:
        slave: Surface that carries the multipliers.
        master: The other surface, or a rigid tool.
        of_tool: Whether the vertices are those of the tool; otherwise those of the slave.
    """

    slave: Surface
    master: AnySurface
    of_tool: bool


def pair_vertices(role: VerticesRole, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Find points at sharp vertices that protrude from their facets. Collective.

    A vertex is paired with the closest point of the other surface, along the normal there. It is
    used if no adjacent facet is inclined towards the other surface by more than 20°, and none is
    parallel to it up to 0.5°: the points of such facets are as close as the vertex, and its
    constraint would be redundant.

    A tool has no multipliers: points at its vertices use multipliers of the slave.

    Args:
        role: The two surfaces.
        radius: Search distance: points farther away are not paired.
    """
    if role.of_tool:
        return _of_tool(role.slave, role.master, radius)
    return _of_slave(role.slave, role.master, radius)


def _of_slave(slave: Surface, master: AnySurface, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Points at vertices of the slave; see :func:`pair_vertices`."""
    which = sharp_nodes(slave).astype(np.uint8)
    if is_shape(master):
        points = _cpp.sample_vertices(slave.cpp_object, which)
        gap, normal = master.distance(points.slave["x"])
        near = (np.abs(gap) <= radius.largest) & (np.sum(normal * points.normal, axis=1) < 0)
        _cpp.face_tool(points, near.astype(np.uint8), -normal, gap, 1)
    else:
        other = master.search_object(slave)
        points = _cpp.pair_vertices(slave.cpp_object, other, which, radius)
        with_unknowns_alone(points, master)
    keep = _lead_away(slave, points, points.normal) & (-points.gap <= deepest(slave))
    _cpp.keep_points(points, keep.astype(np.uint8))
    return points


def _of_tool(slave: Surface, tool: AnySurface, radius: _cpp.SearchRadius) -> _cpp.PairingPoints:
    """Points on the slave's facets opposite vertices of a tool; see :func:`pair_vertices`."""
    facets = tool.as_facets(slave.axisymmetric)
    which = sharp_nodes(facets).astype(np.uint8)
    found = _cpp.pair_vertices(facets.cpp_object, slave.cpp_object, which, radius)
    normal = _smoothed(slave, PairingSide(**found.master), -found.normal)
    ahead = _lead_away(facets, found, -normal) & (-found.gap <= deepest(slave))
    _cpp.keep_points(found, ahead.astype(np.uint8))
    on_slave, on_tool = PairingSide(**found.master), PairingSide(**found.slave)
    return with_own_multipliers((slave, tool), on_slave, on_tool, normal[ahead])


def _smoothed(surface: Surface, at: PairingSide, normal: Array) -> Array:
    """Averaged normals, which are continuous where points move to the next facet. Collective.

    They are interpolated linearly from the averaged normals of the facet's vertices. At vertices on
    sharp edges the normal of the facet is used.

    Args:
        surface: The surface.
        at: Points on the surface.
        normal: Outward unit normals of the facets of these points, (points, 3).
    """
    functions = linear(surface, at.shape_values)
    nodes = at.dofs[:, : surface.num_facet_vertices, 0]
    nodes = np.where(nodes >= 0, nodes, nodes[:, :1])
    of_nodes = surface.cpp_object.node_normal
    sharp = gathered(surface, sharp_nodes(surface).astype(np.float64), nodes)
    means = np.stack([gathered(surface, values, nodes) for values in of_nodes.T], axis=2)
    values = np.where(sharp[..., None] > 0.5, normal[:, None], means)
    out = np.einsum("pk,pki->pi", functions, values)
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None])


def _lead_away(slave: Faceted, points: _cpp.PairingPoints, along: Array) -> Flags:
    """Points at nodes without a facet that is inclined towards the other surface. Collective.

    Args:
        slave: Surface of these nodes.
        points: The points.
        along: Unit normals towards the other surface, (points, 3).
    """
    node = nodes_of(slave, points)
    normal = np.zeros((len(slave.node_area), 3))
    normal[node] = along
    normals = normals_at_vertices(slave)
    return lead_away(slave, normal, slave.coordinates[0], normals, FLAT)[node]


def nodes_of(slave: Faceted, points: _cpp.PairingPoints) -> Indices:
    """Numbers of the owned nodes of points at nodes, (points,)."""
    return np.searchsorted(slave.node_dofs[:, 0], points.slave["dofs"][:, 0, 0])


def lead_away(slave: Faceted, along: Array, x: Array, normals: Array, parallel: float) -> Flags:
    """Owned nodes without a facet inclined towards the other surface, (nodes,). Collective.

    Args:
        slave: Surface of these nodes.
        along: Unit normals towards the other surface, (nodes, 3).
        x: Positions of the vertices of facets, (facets, vertices, 3).
        normals: Outward unit normals at these vertices, (facets, vertices, 3).
        parallel: Cosine of the angle up to which a facet counts as parallel to the other surface.
    """
    opposite = np.stack([at_vertices(slave, values) for values in along.T], axis=2)
    inward = x.mean(axis=1, keepdims=True) - x
    size = np.linalg.norm(inward, axis=2)
    ahead = np.sum(inward * opposite, axis=2) > TOWARDS * size
    flat = np.sum(normals * opposite, axis=2) > parallel
    stays = (ahead | flat).astype(np.float64)
    return np.asarray(sums(slave, stays.ravel()) == 0)
