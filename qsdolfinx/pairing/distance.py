"""Signed distances of points of one surface from the other, in the present positions."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import basix

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.pair import overlay_rules
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Degree of the rule on the segments of an overlay, for the points at which distances are measured.
#: With 0, deep parts of a segment beside its middle would not be measured.
DEGREE = 2

#: The same degree for self-contact, whose nodes are not measured: with 2, the deepest place of a
#: segment would be missed by more.
OF_ITSELF = 8

#: Largest offset in the plane of a facet over the height above or below it; with a larger one, a
#: point is beside the surface, past its boundary or an edge.
BESIDE = 0.3


class Distances(typing.NamedTuple):
    """Penetration depths of points of one surface in the other surface.

    Attributes:
        x: The points, shape (points, 3).
        depth: Signed distance (length), positive in penetration; NaN if nothing is within the
            search distance.
        beside: Whether the other surface has a facet within the search distance, but not in front
            of the point: the depth is then relative to the plane of that facet.
    """

    x: Array
    depth: Array
    beside: Flags


def of_nodes(surface: _cpp.Surface, other: _cpp.Surface, radius: float) -> Distances:
    """Distances of the owned nodes. Collective."""
    return of_points(surface.node_x, surface.node_normal, surface, other, radius)


def of_points(
    x: Array, normal: Array, own: _cpp.Surface, other: _cpp.Surface, radius: float
) -> Distances:
    """Distances of points from the nearest visible facets that face them. Collective.

    Args:
        x: Points of a surface, shape (points, 3).
        normal: Outward unit normals at the points, of the same shape.
        own: The surface.
        other: The other surface.
        radius: Search distance (length).
    """
    closest = _cpp.closest_points(x, normal, own, other, radius)
    away, mean, reached = x - closest["x"], closest["mean_normal"], closest["found"].astype(bool)
    size = np.linalg.norm(mean, axis=1)
    n = np.divide(mean, size[:, None], out=np.zeros_like(mean), where=size[:, None] > 0)
    height, length = np.sum(away * n, axis=1), np.linalg.norm(away, axis=1)
    offset = np.linalg.norm(away - height[:, None] * n, axis=1)
    # If all facets at an edge face the point, it is in the cone of their normals.
    cone = np.sqrt(np.maximum(1 - size**2, 0.0)) / np.where(reached, size, 1.0)
    beside = reached & (offset > (BESIDE + cone) * np.abs(height))
    depth = np.where(beside, -height, -np.copysign(length, height))
    return Distances(x, np.where(reached, depth, np.nan), beside)


def overlay_points(
    cut: _cpp.Surface,
    other: _cpp.Surface,
    gdim: int,
    radius: float,
    heights: tuple[Array | None, Array | None] = (None, None),
    of_itself: bool = False,
) -> _cpp.PairingPoints:
    """Points on the facets of a surface that face the other surface. Collective.

    Args:
        cut: The surface.
        other: The other surface.
        gdim: Geometric dimension.
        radius: Search distance (length).
        heights: Heights of curved facets of both surfaces; None for flat facets.
        of_itself: Whether both surfaces are the same (self-contact). Then there are also points on
            the other surface, and more points, because its nodes are not searched.
    """
    of_facets = 0  # normals
    rules = overlay_rules(gdim, OF_ITSELF if of_itself else DEGREE)
    reach = _cpp.SearchRadius(radius)
    return _cpp.overlay_surfaces(cut, other, of_itself, reach, of_facets, *rules, *heights)


def from_shape(
    tool: RigidSurface, position: Array, points: _cpp.PairingPoints, radius: float
) -> Distances:
    """Distances of points from a tool of analytic shape.

    Args:
        tool: The tool.
        position: Position of the tool, see ``RigidSurface.position``.
        points: Points with outward normals.
        radius: Search distance (length).
    """
    x, normal = points.slave["x"], points.normal
    distance, of_tool = tool.distance(x, position)
    reached = (np.abs(distance) <= radius) & (np.sum(normal * of_tool, axis=1) < 0)
    return Distances(x, np.where(reached, -distance, np.nan), np.zeros(len(x), dtype=bool))


def on_facets(surface: _cpp.Surface, num_vertices: int) -> _cpp.PairingPoints:
    """Points on the facets, without a partner."""
    kinds = basix.CellType.interval, basix.CellType.triangle, basix.CellType.quadrilateral
    x, w = map(np.asarray, basix.make_quadrature(kinds[num_vertices - 2], DEGREE))
    return _cpp.sample_facets(surface, x, w)
