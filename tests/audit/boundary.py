"""The boundary of a deformed body, known on all ranks: find nearby parts, by NumPy alone."""

import dataclasses
import itertools

import numpy as np
from scipy.spatial import cKDTree

#: Corners of the facets of cells, in DOLFINx's numbering.
FACETS = {
    "triangle": ((1, 2), (0, 2), (0, 1)),
    "quadrilateral": ((0, 1), (0, 2), (1, 3), (2, 3)),
    "tetrahedron": ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    "hexahedron": (
        (0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7),
    ),
}  # fmt: skip

#: Barycentric coordinates of samples, for the corners of a simplex.
SAMPLES = {
    2: np.array([[0.95, 0.05], [0.5, 0.5], [0.05, 0.95]]),
    3: np.array([[0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9], [1 / 3, 1 / 3, 1 / 3]]),
}

#: Distance from a facet, over its size, of the test position just outside of it.
OUTSIDE = 1e-4

#: Distance over the size of a facet at which two facets touch, whatever lies between them.
TOUCH = 1e-3


def winding(p, corners):
    """Return winding numbers of closed simplices (m, d, d) around points (n, d), up to rounding."""
    out = np.zeros(len(p))
    for k in range(0, len(p), 500):
        a = [corners[None, :, i] - p[k : k + 500, None] for i in range(p.shape[1])]
        if p.shape[1] == 2:
            sine = a[0][..., 0] * a[1][..., 1] - a[0][..., 1] * a[1][..., 0]
            angle = np.arctan2(sine, np.sum(a[0] * a[1], axis=-1)) / (2 * np.pi)
        else:
            r = [np.linalg.norm(v, axis=-1) for v in a]
            triple = np.sum(a[0] * np.cross(a[1], a[2]), axis=-1)
            rest = r[0] * r[1] * r[2]
            for i, j, m in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                rest += np.sum(a[i] * a[j], axis=-1) * r[m]
            angle = np.arctan2(triple, rest) / (2 * np.pi)
        out[k : k + 500] = angle.sum(axis=1)
    return np.rint(out).astype(int)


def closest(p, corners):
    """Return the closest points of simplices (n, d, d) to points (n, d), one by one."""
    ends = itertools.combinations(range(p.shape[1]), 2)
    found, least = None, None
    for i, j in ends:
        a, e = corners[:, i], corners[:, j] - corners[:, i]
        s = np.sum((p - a) * e, axis=1) / np.sum(e * e, axis=1)
        y = a + np.clip(s, 0, 1)[:, None] * e
        d = np.linalg.norm(y - p, axis=1)
        if found is None:
            found, least = y, d
        found, least = np.where((d < least)[:, None], y, found), np.minimum(d, least)
    if p.shape[1] == 3:
        a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        n = np.cross(e, f)
        nn = np.sum(n * n, axis=1)
        u = np.sum(np.cross(p - a, f) * n, axis=1) / nn
        v = np.sum(np.cross(e, p - a) * n, axis=1) / nn
        y = a + u[:, None] * e + v[:, None] * f
        within = (u >= 0) & (v >= 0) & (u + v <= 1)
        found = np.where(within[:, None], y, found)
    return found


@dataclasses.dataclass
class Near:
    """Parts of the boundary near its sample points.

    Attributes:
        gap: Distance to the nearest other part of opposite orientation, (samples,); negative inside
            it, infinite if there is none within the search distance.
        inside: Whether the position just outside of the sample is inside the body.
        opposite: Outward normal of that part, (samples, d); NaN without such a part.
        other: Simplex of that part; -1 without such a part.
    """

    gap: np.ndarray
    inside: np.ndarray
    opposite: np.ndarray
    other: np.ndarray


class Boundary:
    """Segments or triangles around a body; those of a quadrilateral meet in its middle.

    Args:
        x: Undeformed vertices, (vertices, d).
        cells: Their corners, (cells, n).
        cell: Name of the cell shape.
        degree: Degree of the displacements; 2 only in 2D.
    """

    def __init__(self, x, cells, cell, degree=1):
        self.d, self.rest = x.shape[1], x
        local = FACETS[cell]
        facets = np.concatenate([cells[:, list(f)] for f in local])
        owner = np.tile(np.arange(len(cells)), len(local))
        key = np.sort(facets, axis=1)
        _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
        first = np.sort(first[count == 1])
        facets, inner = facets[first], x[cells[owner[first]]].mean(axis=1)
        if facets.shape[1] == 4:
            facets = facets[:, [0, 1, 3, 2]]
        n = self._vectors(x[facets[:, : self.d]])
        turned = np.sum(n * (x[facets].mean(axis=1) - inner), axis=1) < 0
        facets[turned] = facets[turned][:, ::-1]
        self.facets = facets  # corners only
        if facets.shape[1] == 4 or degree == 2:  # mid-side nodes
            middle = len(x) + np.arange(len(facets))
            self.middles = facets
            ends = [(i, (i + 1) % 4) for i in range(4)] if facets.shape[1] == 4 else []
            if ends:
                parts = [np.stack([facets[:, i], facets[:, j], middle], axis=1) for i, j in ends]
            else:
                parts = [np.stack([facets[:, 0], middle], axis=1),
                         np.stack([middle, facets[:, 1]], axis=1)]  # fmt: skip
            self.simplices = np.concatenate(parts)
            self.facet_of = np.tile(np.arange(len(facets)), len(parts))
        else:
            self.middles = np.zeros((0, 1), dtype=int)
            self.simplices, self.facet_of = facets, np.arange(len(facets))
        #: Nodes with unknowns: the vertices, and the mid-side nodes.
        self.degree = degree
        self.nodes = np.unique(facets)
        if degree == 2:
            self.nodes = np.unique(self.simplices)
        self.samples = SAMPLES[self.d]
        self.sample_simplex = np.repeat(np.arange(len(self.simplices)), len(self.samples))
        #: Pairs of a node and a simplex of a facet that contains it.
        by_facet = [facets[self.facet_of]] + [self.simplices] * (degree == 2)
        pairs = np.concatenate(
            [np.stack([c, np.arange(len(c))], axis=1) for b in by_facet for c in b.T]
        )
        self.node_simplex = np.unique(pairs, axis=0)

    def _vectors(self, corners):
        if self.d == 2:
            e = corners[:, 1] - corners[:, 0]
            return np.stack([e[:, 1], -e[:, 0]], axis=1)
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    def rest_nodes(self):
        """Return the undeformed nodes, mid-side nodes after the vertices."""
        return np.concatenate([self.rest, self.rest[self.middles].mean(axis=1)])

    def move(self, x):
        """Move to the current positions of the vertices and, if they are nodes, of the middles."""
        if len(self.middles) and self.degree == 1:
            x = np.concatenate([x[: len(self.rest)], x[self.middles].mean(axis=1)])
        self.x = x
        self.corners = x[self.simplices]
        n = self._vectors(self.corners)
        self.normals = n / np.linalg.norm(n, axis=1)[:, None]
        e = self.corners - np.roll(self.corners, 1, axis=1)
        self.size = np.linalg.norm(e, axis=2).max(axis=1)
        self.points = np.einsum("pk,skd->spd", self.samples, self.corners).reshape(-1, self.d)
        self.point_normals = self.normals[self.sample_simplex]
        self.turn = np.zeros(len(self.simplices))
        for parts in self.around():
            spread = np.arccos(np.clip(self.normals[parts] @ self.normals[parts].T, -1, 1)).max()
            self.turn[parts] = np.maximum(self.turn[parts], spread)

    def around(self):
        """Return the simplices around each node."""
        pairs = self.node_simplex
        return np.split(pairs[:, 1], np.flatnonzero(np.diff(pairs[:, 0])) + 1)

    def near(self, reach):
        """Return the parts near the samples; see :class:`Near`."""
        h = self.size[self.sample_simplex]
        outside = self.points + OUTSIDE * h[:, None] * self.point_normals
        inside = winding(outside, self.corners) >= 1
        centres = self.corners.mean(axis=1)
        found = cKDTree(self.points).query_ball_tree(cKDTree(centres), reach + self.size.max())
        i = np.repeat(np.arange(len(found)), [len(f) for f in found])
        j = np.array([g for f in found for g in f], dtype=int)
        other = self.facet_of[self.sample_simplex[i]] != self.facet_of[j]
        opposed = np.sum(self.point_normals[i] * self.normals[j], axis=1) < 0
        i, j = i[other & opposed], j[other & opposed]
        y = closest(self.points[i], self.corners[j])
        distance = np.linalg.norm(y - self.points[i], axis=1)
        keep = distance <= reach
        i, j, y, distance = i[keep], j[keep], y[keep], distance[keep]
        between = winding(0.5 * (self.points[i] + y), self.corners)
        touching = distance <= TOUCH * h[i]
        seen = touching | (between == np.where(inside[i], 2, 0))
        i, j, distance = i[seen], j[seen], distance[seen]
        order = np.lexsort((j, distance, i))
        i, j, distance = i[order], j[order], distance[order]
        first = np.unique(i, return_index=True)[1]
        gap = np.full(len(self.points), np.inf)
        opposite = np.full(self.points.shape, np.nan)
        partner = np.full(len(self.points), -1)
        at = i[first]
        gap[at] = np.where(inside[at], -1.0, 1.0) * distance[first]
        opposite[at], partner[at] = self.normals[j[first]], j[first]
        return Near(gap, inside, opposite, partner)
