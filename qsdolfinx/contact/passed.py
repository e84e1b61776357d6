"""Find points that have passed through a thin part of the other surface, and left it again.

At the end of such a motion nothing penetrates, so that depths do not show it. The paths of the
points do: they leave the part through a face whose normal agrees with their own.
"""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.crossing import OUTSIDE
from qsdolfinx.contact.depth import SIDES
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Placement, ToolPlace, is_analytic
from qsdolfinx.pairing.distance import on_facets

Array = npt.NDArray[np.float64]

#: Length of the path within the other part, in units of the smallest facet, below which a straight
#: path may have cut off a corner that the point has gone around.
CORNER = 0.01

#: Depth, in units of the smallest facet, of points beside the middle of a tool that counts.
DEEP = 0.5

#: Number of bisections of a path.
BISECTIONS = 40


class Passed(typing.NamedTuple):
    """Point that has passed through a part of the other surface.

    Attributes:
        length: Length of its path within the part.
        x: Its position afterwards, shape (gdim,).
        side: Side of the point, ``"slave"`` or ``"master"``.
    """

    length: float
    x: tuple[float, ...]
    side: str

    def __str__(self) -> str:
        place = ", ".join(f"{x:.4g}" for x in self.x)
        return f"the point ({place}) of the {self.side}"


class _Motion(typing.NamedTuple):
    """Motion of the points and facets of one side.

    Attributes:
        facets: The facets at the end.
        start_x: Their vertices at the start, shape (facets, vertices, 3).
        start: Points of the facets at the start, shape (points, 3).
        end: These points at the end, of the same shape.
        normal: Outward unit normals at the end, of the same shape.
    """

    facets: _cpp.Surface
    start_x: Array
    start: Array
    end: Array
    normal: Array


def find_passed(model: ContactModel, before: Placement) -> Passed | None:
    """Find the point with the longest path through a part of the other surface. Collective.

    Args:
        model: The contact, evaluated.
        before: The earlier placement of the surfaces.

    Raises:
        DegenerateFacetsError: If a facet has no area.
    """
    if not model.has_gaps or model.placement is before:
        return None
    least = CORNER * model.paired.facet_size
    slave, place = _motion(model, before, "slave"), model.placement.master
    if is_analytic(place):
        found = [("slave", slave, _through_shape(place, slave, model.paired.facet_size))]
    elif model.with_itself:
        found = [("slave", slave, _through_facets(slave, slave))]
    else:
        master = _motion(model, before, "master")
        both = zip(SIDES, (slave, master), (master, slave), strict=True)
        found = [(side, own, _through_facets(own, other)) for side, own, other in both]
    passed = []
    for side, own, lengths in found:
        if len(lengths) and lengths.max() > least:
            i = int(np.argmax(lengths))
            x = tuple(float(c) for c in own.end[i, : model.slave.gdim])
            passed.append(Passed(float(lengths[i]), x, side))
    everywhere = [p for each in model.comm.allgather(passed) for p in each]
    return max(everywhere, default=None)


def _motion(model: ContactModel, before: Placement, side: str) -> _Motion:
    """Motion of one side since a placement; a rigid tool stays where it is now. Collective."""
    facets, earlier = (place.place(side).facets() for place in (model.placement, before))
    num_vertices = facets.facet_x.shape[1]
    points, first = (on_facets(surface, num_vertices) for surface in (facets, earlier))
    start_x, start = (
        model.placement.master.carried(x, before.master)
        for x in (earlier.facet_x, first.slave["x"])
    )
    return _Motion(facets, start_x, start, points.slave["x"], points.normal)


def _through_facets(points: _Motion, other: _Motion) -> Array:
    """Lengths of the paths of points within the other side, (points,). Collective."""
    return _cpp.passed_lengths(other.facets, other.start_x, points.start, points.end, points.normal)


def _through_shape(place: ToolPlace, points: _Motion, size: float) -> Array:
    """The same for an analytic tool, at its present position. Local.

    The depth of points that have come in counts as well if contact does not see them, since the
    closest side of the tool looks the way that they do: the tool's middle is beyond the surface.
    """
    first, last = (place.tool.distance(x, place.positions()) for x in (points.start, points.end))
    cosine = np.sum(points.normal * last[1], axis=1)
    came = (last[0] < 0) & (first[0] > OUTSIDE * last[0])
    unseen = came & (
        (cosine > _cpp.alike_cosine) | ((cosine > _cpp.facing_cosine) & (-last[0] > DEEP * size))
    )
    way = np.linalg.norm(points.end - points.start, axis=1)
    may = (last[0] > 0) & (np.maximum(first[0], 0) + last[0] < way)
    at = np.flatnonzero(may & (cosine > 0))
    out = np.where(unseen, -last[0], 0.0)
    out[at] = way[at] * _part_within(place, points.start[at], points.end[at], points.normal[at])
    return out


def _part_within(place: ToolPlace, start: Array, end: Array, normal: Array) -> Array:
    """Part of each path within an analytic tool, if it comes out; else 0.

    Along a line, the distance from a convex tool has one minimum: the path is within the tool from
    before it to after it. From other tools, a path that starts outside does not come out.
    """

    def distance(s: Array) -> tuple[Array, Array]:
        return place.tool.distance(start + s[:, None] * (end - start), place.positions())

    low: Array = np.zeros(len(start))
    high: Array = np.ones(len(start))
    for _ in range(BISECTIONS):
        first, second = (2 * low + high) / 3, (low + 2 * high) / 3
        left = distance(first)[0] < distance(second)[0]
        low, high = np.where(left, low, first), np.where(left, second, high)
    deepest = 0.5 * (low + high)
    enters, leaves = (_crossing(distance, deepest, np.full(len(start), s)) for s in (0.0, 1.0))
    alike = np.sum(normal * distance(leaves)[1], axis=1) > _cpp.alike_cosine
    return np.where(alike & (distance(deepest)[0] < 0), leaves - enters, 0.0)


def _crossing(
    distance: typing.Callable[[Array], tuple[Array, Array]], inside: Array, end: Array
) -> Array:
    """Where paths cross the surface, between a place inside and an end; the end if inside."""
    outside = end
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        within = distance(middle)[0] < 0
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    return np.where(distance(end)[0] < 0, end, outside)
