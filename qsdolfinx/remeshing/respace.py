"""Create new nodes at requested distances on an old boundary in 2D."""

from __future__ import annotations

import collections
import itertools
import math
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.features import Plane, plane_of
from qsdolfinx.remeshing.outline import Outline, listed
from qsdolfinx.remeshing.retriangulate import Boundary

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Part of a segment by which a chain may be too short for one more segment: rounding to the lattice
#: then does not decide in the middle between two numbers.
HALF = 0.01


class _Chain(typing.NamedTuple):
    """A part of the boundary between two corners, or all of a loop without corners.

    Attributes:
        nodes: Nodes in order; in a loop, the last node is the first one.
        tag: Tag of its facets.
    """

    nodes: Indices
    tag: int


def respace(outline: Outline, copy: Outline, angle: float, axisymmetric: bool) -> Boundary:
    """Cover a boundary by new segments, with nodes on the copy's old segments; corners are kept.

    Args:
        outline: The old body, which determines the corners and lines.
        copy: Its copy on a lattice.
        angle: Angle between neighbours (radians) from which their common node is a corner.
        axisymmetric: Whether coordinates are (r, z): where the boundary leaves the axis is a
            corner, too.

    Raises:
        RemeshError: If the boundary is not closed, or touches itself at a node.
    """
    positions: list[Array] = []
    sizes: list[float] = []
    sides: list[list[int]] = []
    planes: dict[int, Plane] = {}
    fixed: list[bool] = []
    facets: list[tuple[int, int]] = []
    tags: list[int] = []
    corners: dict[int, int] = {}

    def corner(node: int) -> int:
        if node not in corners:
            corners[node] = len(positions)
            positions.append(copy.x[node])
            sizes.append(float(copy.sizes[node]))
            sides.append([])
            fixed.append(True)
        return corners[node]

    for number, chain in enumerate(_chains(outline, angle, axisymmetric)):
        closed = chain.nodes[0] == chain.nodes[-1]
        plane = None if closed else _line_of(outline.x[chain.nodes])
        if plane is not None:
            planes[number] = plane
        x, h = _spaced(copy, chain.nodes, 3 if closed else 1)
        row = [corner(int(chain.nodes[0]))]
        for i in range(1, len(x) - 1):
            row.append(len(positions))
            positions.append(x[i])
            sizes.append(float(h[i]))
            sides.append([number])
            fixed.append(plane is not None)
        row.append(corner(int(chain.nodes[-1])))
        if closed:
            fixed[row[0]] = False
        sides[row[0]].append(number)
        sides[row[-1]].append(number)
        facets += itertools.pairwise(row)
        tags += [chain.tag] * (len(row) - 1)
    return Boundary(
        np.array(positions),
        np.array(facets, dtype=np.int64),
        np.array(tags, dtype=np.int64),
        sides,
        planes,
        np.array(fixed),
        np.array(sizes),
    )


def _line_of(x: Array) -> Plane | None:
    along = x[-1] - x[0]
    return plane_of(x, np.array([along[1], -along[0], 0.0]))


def _chains(outline: Outline, angle: float, axisymmetric: bool) -> list[_Chain]:
    """Chains of the boundary between its corners."""
    x, facets = outline.x, outline.facets
    leaving = collections.Counter(listed(facets[:, 0]))
    odd = [node for node in np.unique(facets) if leaving[int(node)] != 1]
    if odd or len(leaving) != len(facets) or len(np.unique(facets[:, 1])) != len(facets):
        where = x[odd] if odd else x[facets[0, :1]]
        raise RemeshError.at("the boundary is not closed, or touches itself,", where)
    out_of = {a: i for i, a in enumerate(listed(facets[:, 0]))}
    kind = [(int(tag), False) for tag in outline.tags]
    if axisymmetric:
        axis = np.all(x[facets, 0] <= SOLVED * np.ptp(x, axis=0).max(), axis=1)
        kind = [(tag, bool(on)) for (tag, _), on in zip(kind, axis, strict=True)]
    direction = x[facets[:, 1]] - x[facets[:, 0]]
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-300)
    following = np.array([out_of[int(b)] for b in facets[:, 1]])
    turns = np.sum(direction * direction[following], axis=1) < np.cos(angle + SOLVED)
    is_corner = {
        int(facets[i, 1]) for i in range(len(facets)) if turns[i] or kind[i] != kind[following[i]]
    }
    chains, left = [], set(range(len(facets)))
    for start in [*sorted(is_corner), *sorted(out_of)]:
        f = out_of[start]
        if f not in left:
            continue
        nodes = [start]
        first = f
        while True:
            left.discard(f)
            nodes.append(int(facets[f, 1]))
            if nodes[-1] in is_corner or nodes[-1] == start:
                break
            f = int(following[f])
        chains.append(_Chain(np.array(nodes), int(outline.tags[first])))
    return chains


def _spaced(outline: Outline, nodes: Indices, least: int) -> tuple[Array, Array]:
    """Points on a chain at the requested distances, including its ends, and sizes there."""
    x, h = outline.x[nodes], outline.sizes[nodes]
    ways = np.linalg.norm(np.diff(x, axis=0), axis=1)
    # Sizes are linear between nodes; the number of segments is ∫ ds / h.
    ratio = h[1:] / h[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(np.abs(ratio - 1) < 1e-6, h[:-1], h[:-1] * (ratio - 1) / np.log(ratio))
    counted = np.concatenate([[0.0], np.cumsum(ways / mean)])
    number = max(least, math.floor(counted[-1] + 0.5 + HALF))
    places = np.linspace(0.0, counted[-1], number + 1)
    i = np.clip(np.searchsorted(counted, places, side="right") - 1, 0, len(ways) - 1)
    part = (places - counted[i]) / (counted[i + 1] - counted[i])
    r = np.where(np.abs(ratio[i] - 1) < 1e-6, 1.0, ratio[i])
    # Sizes grow geometrically with the number of segments; the distance is the integral.
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(r == 1, part, (r**part - 1) / (r - 1))
    points = x[i] + way[:, None] * (x[i + 1] - x[i])
    points[0], points[-1] = x[0], x[-1]
    return points, h[i] * r**part
