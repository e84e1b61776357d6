"""Project new nodes onto the old boundary."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import geometry, mesh

from qsdolfinx.remeshing.features import Features

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Triangles:
    """Closest-point search on triangles, on one process.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        triangles: Shape (triangles, 3).
    """

    def __init__(self, x: Array, triangles: Indices) -> None:
        nodes, renumbered = np.unique(triangles, return_inverse=True)
        element = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
        self._mesh = mesh.create_mesh(
            MPI.COMM_SELF,
            cells=renumbered.reshape(-1, 3).astype(np.int64),
            x=np.ascontiguousarray(x[nodes]),
            e=ufl.Mesh(element),
        )
        self._number = np.asarray(self._mesh.topology.original_cell_index)
        self._x, self._triangles = x, triangles
        cells = np.arange(len(triangles), dtype=np.int32)
        self._tree = geometry.bb_tree(self._mesh, 2)
        self._middles = geometry.create_midpoint_tree(self._mesh, 2, cells)

    def closest(self, points: Array) -> tuple[Indices, Array]:
        """Closest triangles, (points,), and barycentric coordinates there, (points, 3)."""
        if len(points) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        found = geometry.compute_closest_entity(
            self._tree, self._middles, self._mesh, np.ascontiguousarray(points)
        )
        cells = self._number[found]
        return cells, closest_on_triangles(points, self._x[self._triangles[cells]])


def closest_on_triangles(points: Array, corners: Array) -> Array:
    """Barycentric coordinates of the closest point of one triangle for each point.

    Args:
        points: Shape (points, 3).
        corners: Corners of the triangles, shape (points, 3, 3).
    """
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d = points - a
    m11, m12, m22 = (np.sum(u * v, axis=1) for u, v in ((e1, e1), (e1, e2), (e2, e2)))
    r1, r2 = np.sum(d * e1, axis=1), np.sum(d * e2, axis=1)
    det = np.maximum(m11 * m22 - m12 * m12, 1e-300)
    v, w = (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det
    out = np.stack([1 - v - w, v, w], axis=1)
    outside = np.any(out < 0, axis=1)
    best = np.full(len(points), np.inf)
    for i in range(3):
        p, q = corners[:, i], corners[:, (i + 1) % 3]
        t = closest_on_segments(points, p, q)
        distance = np.linalg.norm(points - p - t[:, None] * (q - p), axis=1)
        better = outside & (distance < best)
        best[better] = distance[better]
        out[better] = 0.0
        out[better, i], out[better, (i + 1) % 3] = 1 - t[better], t[better]
    return out


def closest_on_segments(points: Array, p: Array, q: Array) -> Array:
    """Closest point of one segment for each point, as a coordinate from 0 at p to 1 at q."""
    d = q - p
    t = np.sum((points - p) * d, axis=-1) / np.maximum(np.sum(d * d, axis=-1), 1e-300)
    return np.asarray(np.clip(t, 0.0, 1.0))


class OldSurface:
    """Old surface onto which new nodes are projected, separately for regions and lines.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        triangles: Shape (triangles, 3).
        sizes: Requested sizes at nodes (length), shape (nodes,).
        features: Its regions and lines.
    """

    def __init__(self, x: Array, triangles: Indices, sizes: Array, features: Features) -> None:
        self._x, self._sizes = x, sizes
        self._parts = {}
        for number in range(int(features.region.max()) + 1):
            part = triangles[features.region == number]
            self._parts[number] = part, Triangles(x, part)
        self._lines: dict[int, list[tuple[int, int]]] = {}
        for edge, line in sorted(features.lines.items()):
            self._lines.setdefault(line, []).append(edge)

    def onto_region(self, number: int, points: Array) -> tuple[Array, Array, Array]:
        """Closest points of a region, requested sizes there, and the normals of the triangles."""
        part, search = self._parts[number]
        found, weights = search.closest(points)
        nodes = part[found]
        corners = self._x[nodes]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        at = np.einsum("pi,pij->pj", weights, corners)
        return at, np.sum(weights * self._sizes[nodes], axis=1), normal

    def onto_line(self, number: int, points: Array) -> tuple[Array, Array]:
        """Closest points of a line, and requested sizes there."""
        ends = np.array(self._lines[number])
        p, q = (self._x[ends[:, i]][None] for i in (0, 1))
        t = closest_on_segments(points[:, None], p, q)
        at = p + t[..., None] * (q - p)
        best = np.argmin(np.linalg.norm(at - points[:, None], axis=2), axis=1)
        pick = np.arange(len(points)), best
        h = self._sizes[ends[best]]
        return at[pick], (1 - t[pick]) * h[:, 0] + t[pick] * h[:, 1]
