"""Find points that have passed through a thin part of the other surface, and left it again.

At the end of such a motion nothing penetrates, so that depths do not show it. The paths of the
points do: they leave the part through a face whose normal agrees with their own. Paths are arcs
where a tool or a body turns, and are cut into straight pieces: the rotation is that of the tool
about its centre, or for a body the rigid motion that is closest to that of its surface.
"""

from __future__ import annotations

import functools
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact.crossing import OUTSIDE
from qsdolfinx.contact.depth import SIDES
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Placement, ToolPlace, is_analytic
from qsdolfinx.pairing.ahead import DEEPEST
from qsdolfinx.pairing.distance import on_facets

Array = npt.NDArray[np.float64]

#: Depth in the other surface, over the smallest facet, up to which a path does not count: a point
#: that slides around an edge cuts off as much of it.
THIN = 1e-3


class Passed(typing.NamedTuple):
    """Point that has passed through a part of the other surface.

    Attributes:
        depth: Distance between its path within the part and a face that it crossed.
        x: Its position afterwards, shape (gdim,).
        side: Side of the point, ``"slave"`` or ``"master"``.
    """

    depth: float
    x: tuple[float, ...]
    side: str

    def __str__(self) -> str:
        place = ", ".join(f"{x:.4g}" for x in self.x)
        return f"the point ({place}) of the {self.side}"


class _Motion(typing.NamedTuple):
    """Motion of the points and facets of one side, at the ends of its straight pieces.

    Attributes:
        facets: The facets at the end.
        facet_x: Their vertices, shape (times, facets, vertices, 3).
        x: Points of the facets, shape (times, points, 3).
        normal: Outward unit normals there, of the same shape.
    """

    facets: _cpp.Surface
    facet_x: Array
    x: Array
    normal: Array


def find_passed(model: ContactModel, before: Placement) -> Passed | None:
    """Find the point with the deepest path through a part of the other surface. Collective.

    Args:
        model: The contact, evaluated.
        before: The earlier placement of the surfaces.

    Raises:
        DegenerateFacetsError: If a facet has no area.
    """
    if not model.has_gaps or model.placement is before:
        return None
    size = model.paired.facet_size
    paths = [_Path(model.placement, before, side) for side in _sides(model)]
    num_pieces = _num_pieces(model.comm, paths, NOTICED * size)
    slave, *others = (path.motion(num_pieces) for path in paths)
    # Pieces are that far from an arc, and so cut off up to three times as much of a corner.
    least = (THIN if num_pieces == 1 else 4 * NOTICED) * size
    place = model.placement.master
    if is_analytic(place):
        found = [("slave", slave, _through_shape(place, slave, size))]
    elif model.with_itself:
        found = [("slave", slave, _through_facets(slave, slave))]
    else:
        both = zip(SIDES, (slave, *others), (*others, slave), strict=True)
        found = [(side, own, _through_facets(own, other)) for side, own, other in both]
    passed = []
    for side, own, depths in found:
        if len(depths) and depths.max() > least:
            i = int(np.argmax(depths))
            x = tuple(float(c) for c in own.x[-1, i, : model.slave.gdim])
            passed.append(Passed(float(depths[i]), x, side))
    everywhere = [p for each in model.comm.allgather(passed) for p in each]
    return max(everywhere, default=None)


def _sides(model: ContactModel) -> tuple[str, ...]:
    """Sides with facets of their own."""
    return SIDES[:1] if model.master.is_analytic or model.with_itself else SIDES


class _Path:
    """Path of one side since a placement, seen from a rigid tool if that is the master. Collective.

    Args:
        now: The present placement.
        before: The earlier one.
        side: The side.
    """

    def __init__(self, now: Placement, before: Placement, side: str) -> None:
        own, earlier = now.place(side), before.place(side)
        self._facets, was = own.facets(), earlier.facets()
        self._own, self._frame = own.path(earlier), now.master.frame(before.master)
        self._ends = was.facet_x, self._facets.facet_x
        num_vertices = self._facets.facet_x.shape[1]
        points, first = (on_facets(surface, num_vertices) for surface in (self._facets, was))
        self._x, self._normal = (first.slave["x"], points.slave["x"]), points.normal

    @property
    def turn(self) -> float:
        """Angle (radians) by which the side turns, plus that of its frame."""
        return self._own.angle + self._frame.angle

    def at(self, s: float, ends: tuple[Array, Array]) -> Array:
        """Points, (..., 3), after a part s of the motion, with given positions at its ends."""
        return self._frame.carried(self._own.between(*ends, s), s)

    def bend(self, num_pieces: int) -> float:
        """Largest distance (length) of the path of a vertex from its straight pieces. Local."""
        x = [self.at(s, self._ends) for s in np.linspace(0, 1, 2 * num_pieces + 1)]
        both = zip(x[1::2], x[:-1:2], x[2::2], strict=True)
        away = [middle - 0.5 * (a + b) for middle, a, b in both]
        return max(float(np.linalg.norm(d, axis=-1).max(initial=0.0)) for d in away)

    def motion(self, num_pieces: int) -> _Motion:
        """Positions and normals at the ends of the pieces."""
        parts = np.linspace(0, 1, num_pieces + 1)
        turns = [self._frame.turn(1 - s) @ self._own.turn(s - 1) for s in parts[:-1]]
        normals = [*(self._normal @ turn.T for turn in turns), self._normal]
        x, facet_x = (np.stack([self.at(s, ends) for s in parts]) for ends in (self._x, self._ends))
        return _Motion(self._facets, facet_x, x, np.stack(normals))


def _num_pieces(comm: MPI.Intracomm, paths: typing.Sequence[_Path], bend: float) -> int:
    """Number of straight pieces from which no path is further away than a bend. Collective.

    The distance of an arc from its chord is proportional to the square of the chord's angle, up to
    an eighth of a circle.
    """
    coarse = max(1, int(np.ceil(max(path.turn for path in paths) / (np.pi / 4))))
    found = comm.allreduce(max(path.bend(coarse) for path in paths), op=MPI.MAX)
    return coarse if found <= bend else int(np.ceil(coarse * np.sqrt(found / bend)))


def _through_facets(points: _Motion, other: _Motion) -> Array:
    """Depths of the paths of points within the other side, (points,). Collective."""
    num_pieces = len(points.x) - 1
    return _cpp.passed_depths(other.facets, num_pieces, other.facet_x, points.x, points.normal)


def _through_shape(place: ToolPlace, points: _Motion, size: float) -> Array:
    """The same for an analytic tool, at its present position. Local.

    The depth of points that have come in counts as well if contact does not see them, since the
    closest side of the tool looks the way that they do: the tool's middle is beyond the surface.
    """
    first, last = (place.tool.distance(x, place.positions()) for x in points.x[[0, -1]])
    cosine = np.sum(points.normal[-1] * last[1], axis=1)
    came = (last[0] < 0) & (first[0] > OUTSIDE * last[0])
    unseen = came & (
        (cosine > _cpp.alike_cosine) | ((cosine > _cpp.facing_cosine) & (-last[0] > DEEPEST * size))
    )
    way = np.linalg.norm(np.diff(points.x, axis=0), axis=2).sum(axis=0)
    may = (last[0] > 0) & (np.maximum(first[0], 0) + last[0] < way)
    at = np.flatnonzero(may & (cosine > 0))
    out = np.where(unseen, -last[0], 0.0)
    out[at] = _depth_within(place, points.x[:, at], points.normal[:, at])
    return out


def _depth_within(place: ToolPlace, x: Array, normal: Array) -> Array:
    """Depth of each path within an analytic tool, if it comes out; else 0.

    Along a line, the distance from a convex tool has one minimum: a piece is within the tool before
    and after it. From other tools, a path that starts outside does not come out.

    Args:
        place: The tool.
        x: Ends of the pieces of each path, shape (times, paths, 3).
        normal: Outward unit normals of the points there, of the same shape.
    """
    count = x.shape[1]
    depth: Array = np.zeros(count)
    alike: npt.NDArray[np.bool_] = np.zeros(count, dtype=bool)
    for k in range(len(x) - 1):
        distance = functools.partial(_distance_along, place, x[k], x[k + 1])
        deepest = _deepest(distance, count)
        leaves = _crossing(distance, deepest, np.ones(count))
        looks = np.sum(normal[k + 1] * distance(leaves)[1], axis=1) > _cpp.alike_cosine
        here = -distance(deepest)[0]
        alike = np.where(here > 0, looks, alike)
        depth = np.maximum(depth, here)
    return np.asarray(np.where(alike, depth, 0.0))


def _distance_along(place: ToolPlace, start: Array, end: Array, s: Array) -> tuple[Array, Array]:
    """Distances from the tool, and its normals, after parts s of straight pieces."""
    return place.tool.distance(start + s[:, None] * (end - start), place.positions())


def _deepest(distance: typing.Callable[[Array], tuple[Array, Array]], count: int) -> Array:
    """Where lines are deepest within a convex tool, as a part of their length."""
    low: Array = np.zeros(count)
    high: Array = np.ones(count)
    for _ in range(40):  # until 1e-7 of the line is left
        first, second = (2 * low + high) / 3, (low + 2 * high) / 3
        left = distance(first)[0] < distance(second)[0]
        low, high = np.where(left, low, first), np.where(left, second, high)
    return np.asarray(0.5 * (low + high))


def _crossing(
    distance: typing.Callable[[Array], tuple[Array, Array]], inside: Array, end: Array
) -> Array:
    """Where paths cross the surface, between a place inside and an end; the end if inside."""
    outside = end
    for _ in range(40):  # until 1e-12 of the path is left
        middle = 0.5 * (inside + outside)
        within = distance(middle)[0] < 0
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    return np.where(distance(end)[0] < 0, end, outside)
