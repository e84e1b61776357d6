"""Closed triangulated surface whose edges can be split, collapsed and flipped."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.remeshing.features import Edge, Features
from qsdolfinx.remeshing.outline import listed

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Point = tuple[float, float, float]
Face = tuple[int, int, int]

#: Cosine of the largest angle by which a change of the surface may rotate triangles. With 90°
#: surfaces lose their shape, with 0° no edge of a curved surface is collapsed.
TURNS = math.cos(math.radians(25))

#: Quality, 1 is best, below which no change may reduce a triangle of better quality. With 0, flat
#: triangles remain; with 1, no edge is collapsed.
LEAST_SHAPE = 0.1

#: Largest distance by which removing a node may move a line, in units of the local cell size. With
#: 0, curved lines keep all of their nodes; with 1, they lose their shape.
OFF_LINE = 0.05

#: Largest and smallest length of edges, in units of the requested size, that are not changed. Half
#: of the largest is shorter than the other, but two collapsed edges are no longer than it: splits
#: and collapses end (Botsch and Kobbelt, 2004).
LONG, SHORT = 4 / 3, 4 / 5


class Triangulation:
    """Closed surface that is changed edge by edge; lines, corners and regions are kept.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        triangles: Outward, shape (triangles, 3).
        sizes: Wanted at nodes (length), shape (nodes,).
        features: What is kept.
    """

    def __init__(self, x: Array, triangles: Indices, sizes: Array, features: Features) -> None:
        self.x: list[Point] = [(p[0], p[1], p[2]) for p in listed(x)]
        self.sizes: list[float] = listed(sizes)
        self.faces: dict[int, Face] = {
            i: (t[0], t[1], t[2]) for i, t in enumerate(listed(triangles))
        }
        self.region: dict[int, int] = dict(enumerate(listed(features.region)))
        self.lines: dict[Edge, int] = dict(features.lines)
        self.corners: set[int] = set(features.corners)
        self.star: list[set[int]] = [set() for _ in self.x]
        for number, face in self.faces.items():
            for node in face:
                self.star[node].add(number)
        self.on_line: list[set[int]] = [set() for _ in self.x]
        for a, b in self.lines:
            self.on_line[a].add(b)
            self.on_line[b].add(a)
        self._next = len(self.faces)

    # --- Queries

    def edges(self) -> list[Edge]:
        """All edges, the smaller node first, ascending."""
        found = {
            (a, b) if a < b else (b, a)
            for face in self.faces.values()
            for a, b in (face[:2], face[1:], (face[2], face[0]))
        }
        return sorted(found)

    def excess(self, edges: list[Edge]) -> Array:
        """Lengths of edges in units of the requested size there."""
        x, h, pairs = np.array(self.x), np.array(self.sizes), np.array(edges).reshape(-1, 2)
        length = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
        return np.asarray(length / (h[pairs].mean(axis=1)))

    def _length(self, a: int, b: int) -> float:
        """Length over the requested size."""
        return math.dist(self.x[a], self.x[b]) / (0.5 * (self.sizes[a] + self.sizes[b]))

    def neighbours(self, node: int) -> set[int]:
        """Nodes that share an edge with a node."""
        return {other for number in self.star[node] for other in self.faces[number]} - {node}

    def _opposite(self, number: int, a: int, b: int) -> int:
        i, j, k = self.faces[number]
        return i if i not in (a, b) else j if j not in (a, b) else k

    def _is_edge(self, a: int, b: int) -> bool:
        return not self.star[a].isdisjoint(self.star[b])

    # --- Changes

    def split_long(self) -> int:
        """Split all edges that are too long, the longest first; returns how many."""
        edges = self.edges()
        excess = self.excess(edges)
        order = np.lexsort((np.arange(len(edges)), -excess))
        count = 0
        for i in order[: int(np.sum(excess > LONG))]:
            a, b = edges[i]
            if self._is_edge(a, b):
                self._split(a, b)
                count += 1
        return count

    def _split(self, a: int, b: int) -> None:
        new = len(self.x)
        p, q = self.x[a], self.x[b]
        self.x.append(((p[0] + q[0]) / 2, (p[1] + q[1]) / 2, (p[2] + q[2]) / 2))
        self.sizes.append(0.5 * (self.sizes[a] + self.sizes[b]))
        self.star.append(set())
        self.on_line.append(set())
        for number in sorted(self.star[a] & self.star[b]):
            face, region = self.faces[number], self.region[number]
            self._remove(number)
            self._add(_replaced(face, b, new), region)
            self._add(_replaced(face, a, new), region)
        line = self.lines.pop(_edge(a, b), None)
        if line is not None:
            self.lines[_edge(a, new)] = self.lines[_edge(new, b)] = line
            self._unlink(a, b)
            self._link(a, new)
            self._link(new, b)

    def collapse_short(self) -> int:
        """Collapse edges that are too short, the shortest first; returns how many."""
        edges = self.edges()
        excess = self.excess(edges)
        order = np.lexsort((np.arange(len(edges)), excess))
        count = 0
        for i in order[: int(np.sum(excess < SHORT))]:
            a, b = edges[i]
            if not self._is_edge(a, b) or self._length(a, b) >= SHORT:
                continue
            for gone, stays in sorted(((a, b), (b, a)), key=lambda pair: self._rank(pair[0])):
                if self._may_collapse(gone, stays):
                    self._collapse(gone, stays)
                    count += 1
                    break
        return count

    def _rank(self, node: int) -> tuple[int, int]:
        return (2 if node in self.corners else 1 if self.on_line[node] else 0, -node)

    def _may_collapse(self, a: int, b: int) -> bool:
        """Whether node a may be moved into b."""
        if a in self.corners:
            return False
        if self.on_line[a]:
            if b not in self.on_line[a]:
                return False
            (other,) = self.on_line[a] - {b}
            if self._is_edge(other, b) or self._off_line(a, other, b) > OFF_LINE:
                return False
        shared = self.star[a] & self.star[b]
        opposite = {self._opposite(number, a, b) for number in shared}
        if self.neighbours(a) & self.neighbours(b) != opposite:
            return False
        if any(len(self.star[node]) <= 3 for node in opposite):
            return False
        for number in self.star[a] - shared:
            face = self.faces[number]
            if not self._may_become([face], [_replaced(face, a, b)]):
                return False
            if any(self._length(node, b) > LONG for node in face if node != a):
                return False
        return True

    def _off_line(self, node: int, first: int, second: int) -> float:
        """Distance of a node from a segment, over the requested size."""
        p, d = self.x[first], _minus(self.x[second], self.x[first])
        e = _minus(self.x[node], p)
        t = min(max(_dot(e, d) / max(_dot(d, d), 1e-300), 0.0), 1.0)
        return math.dist(e, (t * d[0], t * d[1], t * d[2])) / self.sizes[node]

    def _may_become(self, old: list[Face], new: list[Face]) -> bool:
        """Whether triangles may be replaced: none rotates too far, none becomes flat."""
        before = [self._normal(face) for face in old]
        worst = min(self.shape(face) for face in old)
        for face in new:
            if self.shape(face) < min(LEAST_SHAPE, worst):
                return False
            n = self._normal(face)
            if any(_dot(n, m) < TURNS for m in before):
                return False
        return True

    def _normal(self, face: Face) -> Point:
        """Unit normal; 0 for a triangle without area."""
        a, b, c = (self.x[node] for node in face)
        n = _cross(_minus(b, a), _minus(c, a))
        size = math.sqrt(_dot(n, n))
        return (n[0] / size, n[1] / size, n[2] / size) if size > 0 else (0.0, 0.0, 0.0)

    def shape(self, face: Face) -> float:
        """Quality of a triangle: 1 is best, 0 is flat."""
        a, b, c = (self.x[node] for node in face)
        u, v, w = _minus(b, a), _minus(c, a), _minus(c, b)
        n = _cross(u, v)
        return 2 * math.sqrt(3 * _dot(n, n)) / max(_dot(u, u) + _dot(v, v) + _dot(w, w), 1e-300)

    def _collapse(self, a: int, b: int) -> None:
        if self.on_line[a]:
            (other,) = self.on_line[a] - {b}
            line = self.lines.pop(_edge(a, b))
            del self.lines[_edge(a, other)]
            self.lines[_edge(other, b)] = line
            self._unlink(a, b)
            self._unlink(a, other)
            self._link(other, b)
        for number in sorted(self.star[a]):
            face, region = self.faces[number], self.region[number]
            self._remove(number)
            if b not in face:
                self._add(_replaced(face, a, b), region)

    def turn_edges(self) -> int:
        """Flip edges by the Delaunay criterion; returns how many."""
        count = 0
        for a, b in self.edges():
            if _edge(a, b) in self.lines or not self._is_edge(a, b):
                continue
            first, second = sorted(self.star[a] & self.star[b])
            c, d = self._opposite(first, a, b), self._opposite(second, a, b)
            if self._is_edge(c, d) or min(len(self.star[a]), len(self.star[b])) <= 3:
                continue
            if self._angle(c, a, b) + self._angle(d, a, b) <= math.pi + SOLVED:
                continue
            old = [self.faces[first], self.faces[second]]
            new = [_replaced(old[0], b, d), _replaced(old[1], a, c)]
            worst = min(self.shape(face) for face in old)
            if min(self.shape(face) for face in new) <= worst:
                continue
            n = [self._normal(face) for face in (*old, *new)]
            if all(_dot(u, v) >= TURNS or not (any(u) and any(v)) for u in n[:2] for v in n[2:]):
                region = self.region[first]
                for number in (first, second):
                    self._remove(number)
                for face in new:
                    self._add(face, region)
                count += 1
        return count

    def _angle(self, at: int, a: int, b: int) -> float:
        u, v = _minus(self.x[a], self.x[at]), _minus(self.x[b], self.x[at])
        n = _cross(u, v)
        return math.atan2(math.sqrt(_dot(n, n)), _dot(u, v))

    # --- Data structures

    def _add(self, face: Face, region: int) -> None:
        self.faces[self._next], self.region[self._next] = face, region
        for node in face:
            self.star[node].add(self._next)
        self._next += 1

    def _remove(self, number: int) -> None:
        for node in self.faces.pop(number):
            self.star[node].discard(number)
        del self.region[number]

    def _link(self, a: int, b: int) -> None:
        self.on_line[a].add(b)
        self.on_line[b].add(a)

    def _unlink(self, a: int, b: int) -> None:
        self.on_line[a].discard(b)
        self.on_line[b].discard(a)


def _replaced(face: Face, old: int, new: int) -> Face:
    a, b, c = face
    return (new if a == old else a, new if b == old else b, new if c == old else c)


def _edge(a: int, b: int) -> Edge:
    return (a, b) if a < b else (b, a)


def _minus(p: Point, q: Point) -> Point:
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


def _dot(p: Point, q: Point) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def _cross(p: Point, q: Point) -> Point:
    return (
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    )
