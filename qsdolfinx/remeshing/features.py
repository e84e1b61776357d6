"""Find the features of a triangulated surface to be kept: regions, lines, corners, planes."""

from __future__ import annotations

import collections
import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.outline import listed

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Edge = tuple[int, int]

#: Part of a plane's extent to which its level is rounded if the plane is normal to an axis: a level
#: that is 0 or another round number up to rounding errors becomes this number
#: (test_a_mesh_that_stays_is_the_same_mesh).
ROUNDING = 1e-14

#: Length of lines of sharp edges that end within a region, over the size of cells there, below
#: which they are noise. With less, noise of a deformed surface makes corners; with more, true ends
#: of edges are lost.
SHORT = 2.0


#: Number of triangles that may lie on a plane by chance. With fewer, parts of curved surfaces
#: become planes, on which nodes must stay.
FEW = 8


class Plane(typing.NamedTuple):
    """A plane n·x = c, n of unit length."""

    normal: Array
    level: float


@dataclasses.dataclass
class Features:
    """Features of a closed triangulated surface that are kept.

    Attributes:
        region: Number of the region of each triangle, shape (triangles,). Lines surround regions.
        lines: Number of the line of each kept edge, by the nodes of the edge, the smaller first.
        corners: Nodes that are kept.
        planes: Planes of plane regions, by region number.
    """

    region: Indices
    lines: dict[Edge, int]
    corners: set[int]
    planes: dict[int, Plane]


def find_features(
    x: Array, triangles: Indices, tags: Indices, sizes: Array, angle: float
) -> Features:
    """Find regions, lines and corners of a closed surface.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        triangles: Outward triangles, shape (triangles, 3).
        tags: Tags of the triangles; lines between different tags are kept. Shape (triangles,).
        sizes: Cell sizes at the nodes (length), shape (nodes,).
        angle: Angle between the normals of neighbours (radians) from which their edge is kept.

    Raises:
        RemeshError: If the surface is not closed, or touches itself at an edge or node.
    """
    edges, first, second = edges_of(x, triangles)
    a, b, c = (x[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, 1e-300)
    cosine = np.sum(normals[first] * normals[second], axis=1)
    border = tags[first] != tags[second]
    kept = border | (cosine < np.cos(angle + SOLVED))
    kept[kept] = _without_noise(x, edges[kept], border[kept], sizes)
    region = _regions(len(triangles), first[~kept], second[~kept])
    lines, corners = _lines(x, edges[kept], angle)
    return Features(region, lines, corners, _planes(x, triangles, region))


def edges_of(x: Array, triangles: Indices) -> tuple[Indices, Indices, Indices]:
    """Edges of a closed surface, (edges, 2) with the smaller node first, and their triangles.

    Raises:
        RemeshError: If an edge belongs to one triangle, or more than two.
    """
    pairs = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    of = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((of, pairs[:, 1], pairs[:, 0]))
    edges, count = np.unique(pairs, axis=0, return_counts=True)
    if np.any(count != 2):
        at = x[edges[count != 2]].mean(axis=1)
        raise RemeshError.at("the boundary is not closed, or touches itself along an edge,", at)
    first, second = of[order].reshape(-1, 2).T
    return edges, first, second


def _without_noise(x: Array, edges: Indices, border: npt.NDArray[np.bool_], sizes: Array) -> Array:
    """Flags of the edges to keep: short lines that end within a region are dropped."""
    keep = np.ones(len(edges), dtype=bool)
    while True:
        at: dict[int, list[int]] = collections.defaultdict(list)
        for e in np.flatnonzero(keep):
            for node in edges[e]:
                at[int(node)].append(int(e))
        dropped = False
        for end, of_end in at.items():
            if len(of_end) != 1 or not keep[of_end[0]]:
                continue
            chain, node, length = [of_end[0]], end, 0.0
            while True:
                a, b = (int(n) for n in edges[chain[-1]])
                length += float(np.linalg.norm(x[a] - x[b]))
                node = b if node == a else a
                rest = [e for e in at[node] if e != chain[-1]]
                if len(rest) != 1 or rest[0] in chain:
                    break
                chain.append(rest[0])
            if length < SHORT * sizes[end] * (1 - SOLVED) and not border[chain].any():
                keep[chain] = False
                dropped = True
        if not dropped:
            return keep


def _regions(count: int, first: Indices, second: Indices) -> Indices:
    """Number of the connected region of each triangle, given pairs of neighbours."""
    label = np.arange(count)
    while True:
        low = np.minimum(label[first], label[second])
        new = label.copy()
        np.minimum.at(new, first, low)
        np.minimum.at(new, second, low)
        new = new[new]
        if np.array_equal(new, label):
            return np.asarray(np.unique(label, return_inverse=True)[1], dtype=np.int64).ravel()
        label = new


def _lines(x: Array, edges: Indices, angle: float) -> tuple[dict[Edge, int], set[int]]:
    """Join edges to numbered lines, and find the corners where lines end or turn."""
    at: dict[int, list[int]] = collections.defaultdict(list)
    for a, b in listed(edges):
        at[a].append(b)
        at[b].append(a)
    corners = {node for node, others in at.items() if len(others) != 2}
    for node, others in at.items():
        if len(others) == 2:
            u, v = x[node] - x[others[0]], x[others[1]] - x[node]
            cosine = u @ v / max(float(np.linalg.norm(u) * np.linalg.norm(v)), 1e-300)
            if cosine < np.cos(angle + SOLVED):
                corners.add(node)
    lines: dict[Edge, int] = {}
    number = 0
    for start in [*sorted(corners), *sorted(at)]:
        for second in sorted(at[start]):
            a, b = start, second
            if _edge(a, b) in lines:
                continue
            while True:
                lines[_edge(a, b)] = number
                if b in corners:
                    break
                a, b = b, next(n for n in at[b] if n != a)
                if _edge(a, b) in lines:
                    break
            number += 1
    return lines, corners


def _edge(a: int, b: int) -> Edge:
    return (a, b) if a < b else (b, a)


def _planes(x: Array, triangles: Indices, region: Indices) -> dict[int, Plane]:
    """Planes of regions; regions on the same plane share one object."""
    planes: dict[int, Plane] = {}
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    for number in range(int(region.max(initial=-1)) + 1):
        part = triangles[region == number]
        plane = plane_of(x[np.unique(part)], _area_vector(x, part))
        if plane is not None and (len(part) >= FEW or np.count_nonzero(plane.normal) == 1):
            same = (p for p in planes.values() if _are_one(p, plane, x[part[0]].mean(axis=0), size))
            planes[number] = next(same, plane)
    return planes


def _are_one(first: Plane, second: Plane, at: Array, size: float) -> bool:
    """Whether two planes coincide near a point of the second, relative to the body's size."""
    apart = abs(first.level - first.normal @ at)
    return bool(np.linalg.norm(first.normal - second.normal) < SOLVED and apart < SOLVED * size)


def planes_of_copy(features: Features, x: Array, triangles: Indices) -> dict[int, Plane]:
    """Planes of the plane regions in a copy of the surface, which is nearly plane there.

    Args:
        features: Features of the surface.
        x: Coordinates of the copy's nodes, shape (nodes, 3).
        triangles: Triangles of surface and copy, shape (triangles, 3).
    """
    regions_of: dict[int, list[int]] = {}
    for number, plane in features.planes.items():
        regions_of.setdefault(id(plane), []).append(number)
    out: dict[int, Plane] = {}
    for regions in regions_of.values():
        part = triangles[np.isin(features.region, regions)]
        normal = features.planes[regions[0]].normal
        if np.count_nonzero(normal) > 1:
            normal = _area_vector(x, part)
            normal = normal / np.linalg.norm(normal)
        plane = Plane(normal, float(np.median(x[np.unique(part)] @ normal)))
        out |= dict.fromkeys(regions, plane)
    return out


def _area_vector(x: Array, triangles: Indices) -> Array:
    a, b, c = (x[triangles[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a).sum(axis=0))


def plane_of(points: Array, normal: Array) -> Plane | None:
    """Plane through all points, None if there is none.

    Args:
        points: Shape (points, 3).
        normal: Normal of the plane, if there is one.
    """
    size = float(np.linalg.norm(normal))
    if size == 0:
        return None
    n = np.asarray(normal / size, dtype=np.float64)
    axis = int(np.argmax(np.abs(n)))
    if np.abs(np.delete(n, axis)).max() < SOLVED:
        n = np.asarray(np.sign(n[axis]) * np.eye(3)[axis], dtype=np.float64)
    heights, extent = points @ n, float(np.linalg.norm(np.ptp(points, axis=0)))
    if np.ptp(heights) > SOLVED * extent:
        return None
    level = float(np.median(heights))
    if np.count_nonzero(n) == 1:
        step = 2.0 ** np.floor(np.log2(ROUNDING * extent))
        level = float(np.round(level / step) * step)
    return Plane(np.asarray(n), level)
