"""Separate solids that touch, so that the surface of each solid is its own shell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Angle up to which two triangles at an edge count as one wall of two solids (radians). Rounding of
#: coordinates in single precision turns the triangles of a wall by less.
SAME_WALL = 1e-4


def separate(x: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Duplicate vertices where solids touch along edges, so that each solid has its own.

    An edge of one closed surface has two triangles. Where solids touch, an edge has more, equally
    many in both directions. Two triangles that follow each other around the edge with material in
    between are neighbours. Edges without such an order are not changed.

    Args:
        x: Vertices, shape (vertices, 3).
        triangles: Indices of their vertices, shape (triangles, 3).

    Returns:
        Vertices, repeated for each solid at such edges, and triangles.
    """
    tails = triangles.ravel()
    heads = np.roll(triangles, -1, axis=1).ravel()
    forth = tails < heads
    ends = np.sort(np.stack([tails, heads], axis=1), axis=1)
    _, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    several = count > 2
    several &= 2 * np.bincount(edge, forth, len(count)) == count
    if not several.any() or _repeated(triangles):
        return x, triangles
    order = np.argsort(edge, kind="stable")
    begin = np.cumsum(count) - count
    simple = order[begin[count == 2][:, None] + [0, 1]].astype(np.int64)
    neighbours = [simple[forth[simple[:, 0]] != forth[simple[:, 1]]]]
    for i in np.flatnonzero(several):
        sides = order[begin[i] : begin[i] + count[i]]
        neighbours.append(_around(x, triangles, sides, forth[sides]))
    at_several = np.zeros(len(x), dtype=bool)
    at_several[ends[several[edge]]] = True
    return _split(x, triangles, np.concatenate(neighbours), at_several)


def _repeated(triangles: Indices) -> bool:
    """Whether a triangle occurs twice with the same orientation."""
    first = np.argmin(triangles, axis=1)[:, None]
    rolled = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return len(np.unique(rolled, axis=0)) < len(rolled)


def _around(x: Array, triangles: Indices, sides: Indices, forth: npt.NDArray[np.bool_]) -> Indices:
    """Pairs of sides with the material of one solid in between, around one edge.

    Seen along the edge, in counter-clockwise order, material begins at a triangle that traverses
    the edge backwards and ends at a triangle that traverses it forwards.

    Args:
        x: Vertices, shape (vertices, 3).
        triangles: Indices of their vertices, shape (triangles, 3).
        sides: Sides at the edge, 3 times the triangle plus the number of its side.
        forth: Whether sides traverse the edge forwards, from the smaller to the larger index.

    Returns:
        Sides that are neighbours, shape (len(sides) / 2, 2).
    """
    cell, side = np.divmod(sides, 3)
    start, stop = np.sort([triangles[cell[0], side[0]], triangles[cell[0], (side[0] + 1) % 3]])
    axis = (x[stop] - x[start]) / np.linalg.norm(x[stop] - x[start])
    to = x[triangles[cell, (side + 2) % 3]] - x[start]
    to -= np.outer(to @ axis, axis)
    angle = np.arctan2(to @ np.cross(axis, to[0]), to @ to[0])
    order = np.argsort((angle - SAME_WALL * forth) % (2 * np.pi), kind="stable")
    balance = np.cumsum(np.where(forth[order], -1, 1))
    order = np.roll(order, -1 - int(np.argmin(balance)))
    ahead = forth[order]
    return np.stack([sides[order[~ahead]], sides[order[ahead]]], axis=1).astype(np.int64)


def _split(
    x: Array, triangles: Indices, neighbours: Indices, at_several: npt.NDArray[np.bool_]
) -> tuple[Array, Indices]:
    """Repeat vertices whose corners are not connected by neighbours.

    Args:
        x: Vertices, shape (vertices, 3).
        triangles: Indices of their vertices, shape (triangles, 3).
        neighbours: Pairs of sides that traverse the same edge in opposite directions, shape (pairs,
            2).
        at_several: Vertices that may be repeated, shape (vertices,).
    """
    one, other = neighbours.T
    of_side = np.concatenate([np.stack([one, _head(other)]), np.stack([_head(one), other])], axis=1)
    vertices = triangles.ravel()
    corners = np.flatnonzero(at_several[vertices])
    number = np.zeros(len(vertices), dtype=np.int64)
    number[corners] = np.arange(len(corners))
    links = number[of_side.T[at_several[vertices[of_side[0]]]]]
    roots, index = np.unique(components(links, len(corners)), return_inverse=True)
    old = vertices[corners[roots]]
    # The first copy of a vertex keeps its number.
    is_copy = np.ones(len(roots), dtype=bool)
    is_copy[np.unique(old, return_index=True)[1]] = False
    new = old.copy()
    new[is_copy] = len(x) + np.arange(np.count_nonzero(is_copy))
    out = vertices.copy()
    out[corners] = new[index.ravel()]
    return np.concatenate([x, x[old[is_copy]]]), out.reshape(-1, 3)


def _head(side: Indices) -> Indices:
    """Corner at which a side ends; a side has the number of the corner where it begins."""
    return np.asarray(side // 3 * 3 + (side + 1) % 3)


def components(cells: npt.NDArray[np.int_], count: int) -> npt.NDArray[np.int_]:
    """Smallest vertex that is connected to each vertex by cells."""
    parent = np.arange(count)
    while True:
        low = np.broadcast_to(parent[cells].min(axis=1, keepdims=True), cells.shape)
        new = parent.copy()
        np.minimum.at(new, parent[cells], low)
        while np.any(new[new] != new):
            new = new[new]
        if np.array_equal(new, parent):
            return parent
        parent = new
