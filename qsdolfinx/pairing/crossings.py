"""Creases that cross edges of the other body, ahead of all quadrature points of their facets."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.ahead import (
    FLAT,
    PRESSED_FLAT,
    TOWARDS,
    between,
    deepest,
    linear,
    of_tool,
    with_own_multipliers,
)
from qsdolfinx.pairing.edges import Edges
from qsdolfinx.pairing.facets import as_facets
from qsdolfinx.pairing.points import PairingSide
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, deformable

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Sine of the least angle (0.5°) between creases that cross, and of a crease and a mesh line.
ACROSS, ALONG = float(np.sin(np.pi / 360)), 0.01

#: Cosine of the angle (20°) between a crease and the normal below which its end alone is ahead.
UPRIGHT = float(np.cos(np.pi / 9))

#: Part of an edge within which a place is on its end: rounding.
ROUNDING = 1e-9

#: Part of the shorter edge within which a crossing is at the end of the crease, or the same as
#: another one.
AT_END = 0.1

#: Part of a facet's size by which places are apart that are the same: rounding.
SAME = 1e-6

#: How many times as deep a crossing may be as what is closest to the crease there: wedges that are
#: sharper than some 6° are seen by their faces.
WAYS = 20.0

#: Part of a facet between whose ends two bodies have points: both give way there.
BENDS = 0.5

#: Pairs of edges that are looked at at a time.
_MANY = 1_000_000


class Crossings(typing.NamedTuple):
    """Where creases cross edges of the other body.

    Attributes:
        crease: Which of the creases, (points,).
        edge: Which of the edges, (points,).
        places: Where on both, from 0 to 1, (points, 2).
        normal: From the crease's body to the other one, (points, 3).
    """

    crease: Indices
    edge: Indices
    places: Array
    normal: Array

    def some(self, which: typing.Any) -> Crossings:
        """Those of an index."""
        return Crossings(*(values[which] for values in self))


class EdgesRole(typing.NamedTuple):
    """Whose edges cross.

    Attributes:
        slave: Surface that carries the multipliers.
        master: The other one, or a rigid tool.
        creases: Whether they are creases of the slave's, and of the master's, or mesh lines of its
            smooth sides; not those of both.
        moved: Slave and master where they are; None where they were read.
    """

    slave: Surface
    master: AnySurface
    creases: tuple[bool, bool]
    moved: tuple[_cpp.Surface, _cpp.Surface] | None = None

    @property
    def objects(self) -> tuple[_cpp.Surface, _cpp.Surface]:
        """Both as objects of the extension, that of the creases first."""
        slave, master = self.moved or (as_facets(s).cpp_object for s in (self.slave, self.master))
        return (slave, master) if self.creases[0] else (master, slave)


def pair_edges(
    role: EdgesRole, edges: tuple[Edges, Edges], radius: _cpp.SearchRadius
) -> _cpp.PairingPoints:
    """Points of creases where they cross edges of the other surface, in 3D. Collective.

    Either where creases of both cross, along the normal of both; or where a crease crosses a mesh
    line of the other's smooth sides, seen along its normal. A point counts if no facet beside it
    leads towards the other body by more than 20°, and none is parallel to it up to 0.5°: their own
    points are as close as it is.

    Multipliers are linear along the slave's crease; a point that is opposite to a crease of the
    master has one of its own, see :func:`with_own_multipliers`. Only a crease on a rigid tool has
    to be the slave's, if the other surface is smooth there.

    Args:
        role: Whose they are.
        edges: Of both, see :func:`edges_of`.
        radius: Beyond which points are not paired.
    """
    of_slave = role.creases[0]
    (one, other), sharp = edges if of_slave else edges[::-1], all(role.creases)
    creases = one.some(one.are_sharp)
    others = _near(creases, other.some(other.are_sharp == sharp), radius.largest, role.slave.comm)
    found = _crossings(creases, others, (radius.largest, deepest(role.slave)))
    found = found.some(~_lead_through(role, creases, others, found, radius.largest))
    bodies = role.slave, deformable(role.master)
    own, opposite = bodies if of_slave else bodies[::-1]
    parts = [
        Facing(
            found.crease,
            found.places[:, 0],
            _side(opposite, others.some(found.edge), found.places[:, 1]),
            found.normal,
        )
    ]
    degrees = _degrees(own, opposite)
    if not sharp and max(degrees) > 1:
        places = _between(role, creases, found, degrees, radius.largest)
        parts.append(_facing(role, creases, places, radius.largest))
    facing = Facing.joined(parts)
    here = creases.some(facing.crease)
    at_crease = _side(own, here, facing.place)
    if not of_slave:
        return with_own_multipliers(bodies, facing.opposite, at_crease, -facing.normal)
    several = np.bincount(facing.crease, minlength=1)[facing.crease]
    multipliers = np.zeros((len(several), role.slave.num_facet_vertices))
    multipliers[:, :2] = np.column_stack([1 - facing.place, facing.place])
    return between(
        bodies,
        at_crease,
        facing.opposite,
        facing.normal,
        (multipliers, np.zeros(len(several), dtype=np.uint8)),
        here.area / several,
    )


def deepest_of_creases(
    role: EdgesRole, edges: tuple[Edges, Edges], reach: float
) -> tuple[float, tuple[float, ...]]:
    """How deep creases of both bodies are in each other where they cross, in 3D. Collective.

    Along the normal of both, where no facet is parallel to that up to 5°.

    Args:
        role: Whose they are.
        edges: Of both, where they are.
        reach: Length beyond which nothing is in reach.

    Returns:
        The largest depth, 0 if there is none, and where, (3,).
    """
    creases, other = (each.some(each.are_sharp) for each in edges)
    others = _near(creases, other, reach, role.slave.comm)
    found = _crossings(creases, others, (reach, deepest(role.slave)))
    found = found.some(~_lead_through(role, creases, others, found, reach))
    here, there = creases.some(found.crease), others.some(found.edge)
    steep = _leads_away(here, found.normal, PRESSED_FLAT)
    steep &= _leads_away(there, -found.normal, PRESSED_FLAT)
    x, y = here.at(found.places[:, 0])[steep], there.at(found.places[:, 1])[steep]
    depth = np.sum((x - y) * found.normal[steep], axis=1)
    at = int(np.argmax(depth)) if len(depth) else -1
    most = (float(depth[at]), tuple(map(float, x[at]))) if at >= 0 else (0.0, (0.0,) * 3)
    return max((0.0, (0.0,) * 3), *role.slave.comm.allgather(most))


class Facing(typing.NamedTuple):
    """Points of creases, and what is opposite.

    Attributes:
        crease: Which of the creases, (points,).
        place: Where on it, from 0 to 1, (points,).
        opposite: The other surface's side.
        normal: Unit normals from the crease's body to the other one, (points, 3).
    """

    crease: Indices
    place: Array
    opposite: PairingSide
    normal: Array

    @classmethod
    def joined(cls, parts: typing.Sequence[Facing]) -> Facing:
        """All of some."""
        if len(parts) == 1:
            return parts[0]
        sides = [dataclasses.astuple(part.opposite) for part in parts]
        opposite = PairingSide(*(np.concatenate(values) for values in zip(*sides, strict=True)))
        crease, place, normal = (np.concatenate([part[i] for part in parts]) for i in (0, 1, 3))
        return cls(crease, place, opposite, normal)


def _degrees(own: Surface | None, opposite: Surface | None) -> tuple[int, int]:
    """Degrees of displacements along a line within a facet: along a side, and elsewhere."""
    along = 1 if opposite is None else opposite.degree
    twice = opposite is not None and opposite.num_facet_vertices == 4
    least = 1 if own is None else own.degree
    return max(least, along), max(least, 2 * along if twice else along)


def _between(
    role: EdgesRole, creases: Edges, found: Crossings, degrees: tuple[int, int], reach: float
) -> tuple[Indices, Array]:
    """Places between crossings, and between them and the ends of creases. Collective.

    Surfaces may come up there: with those at both ends there are as many as a function of the
    degree has values.

    Returns:
        Which of the creases, and places from 0 to 1; both (places,).
    """
    count = len(creases.area)
    of_ends: npt.NDArray[np.int64] = np.arange(count)
    crease = np.concatenate([found.crease, of_ends, of_ends])
    place = np.concatenate([found.places[:, 0], np.zeros(count), np.ones(count)])
    order = np.lexsort((place, crease))
    crease, place = crease[order], place[order]
    part = AT_END if isinstance(role.master, RigidSurface) else BENDS
    least = part * role.slave.facet_size_range[0] / np.maximum(creases.length[crease[1:]], 1e-300)
    wide = (np.diff(crease) == 0) & (np.diff(place) > least)
    crease, ends = crease[:-1][wide], (place[:-1][wide], place[1:][wide])
    along: Flags = np.ones(len(crease), dtype=bool)
    if degrees[0] < degrees[1]:
        along = _are_along_sides(role, creases, crease, ends, reach)
    out: tuple[list[Indices], list[Array]] = ([], [])
    for degree, which in zip(degrees, (along, ~along), strict=True):
        first, last = (end[which, None] for end in ends)
        out[0].append(np.repeat(crease[which], degree - 1))
        out[1].append((first + (last - first) * np.arange(1, degree) / degree).ravel())
    return np.concatenate(out[0]), np.concatenate(out[1])


def _are_along_sides(
    role: EdgesRole, creases: Edges, crease: Indices, ends: tuple[Array, Array], reach: float
) -> Flags:
    """Whether creases go along sides of quadrilaterals between two places. Collective.

    Args:
        role: Whose they are.
        creases: All of them.
        crease: Which, (intervals,).
        ends: Both places, (intervals,) each.
        reach: Length beyond which nothing is in reach.
    """
    middle, part = (ends[0] + ends[1]) / 2, 0.05 * (ends[1] - ends[0])
    found = [_closest(role, creases, crease, middle + step * part, reach)[0] for step in (-1, 1)]
    linear_values = [linear(role.slave, closest["shape_values"]) for closest in found]
    # Of the vertices (0, 0), (1, 0), (0, 1), (1, 1) of a facet.
    at = [np.column_stack([v[:, 1] + v[:, 3], v[:, 2] + v[:, 3]]) for v in linear_values]
    same = np.all(found[0]["dofs"] == found[1]["dofs"], axis=(1, 2))
    change = np.abs(at[1] - at[0]) / 0.1
    return np.asarray(same & (change.min(axis=1) < AT_END))


def _closest(
    role: EdgesRole, creases: Edges, crease: Indices, place: Array, reach: float
) -> tuple[dict[str, typing.Any], Array, Edges]:
    """What is closest to places of creases, the places, and the creases. Collective."""
    here = creases.some(crease)
    x, normal = here.at(place), here.normal.sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    return _cpp.closest_points(x, normal, *role.objects, reach), x, here


def _facing(role: EdgesRole, creases: Edges, places: tuple[Indices, Array], reach: float) -> Facing:
    """What is opposite to places of creases. Collective."""
    crease, place = places
    closest, x, here = _closest(role, creases, crease, place, reach)
    normal = -closest["normal"]
    keep = closest["found"].astype(bool) & _leads_away(here, normal)
    keep &= ~_are_beside(x, closest, role.slave.facet_size_range[0])
    keep &= np.sum((x - closest["x"]) * normal, axis=1) <= deepest(role.slave)
    if role.creases[0] and not isinstance(role.master, Surface):
        return Facing(crease[keep], place[keep], of_tool(closest["x"][keep]), normal[keep])
    names = ("x", "dofs", "owner", "shape_values")
    side = PairingSide(**{name: closest[name][keep] for name in names})
    return Facing(crease[keep], place[keep], side, normal[keep])


def _lead_through(
    role: EdgesRole, creases: Edges, others: Edges, found: Crossings, reach: float
) -> Flags:
    """Crossings that are deep but not in the body, or have a much shorter way out. Collective.

    An edge behind the plane of a wall may be above the face that this ends at; and a tool's wall
    that has come in by one face of a body would be pressed out by the opposite one.

    Args:
        role: Whose they are.
        creases: All creases.
        others: All edges of the other body.
        found: The crossings.
        reach: Length beyond which nothing is in reach.

    Returns:
        Which of the crossings, (points,).
    """
    closest, x, _ = _closest(role, creases, found.crease, found.places[:, 0], reach)
    there = others.some(found.edge).at(found.places[:, 1])
    depth = np.sum((x - there) * found.normal, axis=1)
    shortest = np.linalg.norm(closest["x"] - x, axis=1)
    rounding = SAME * role.slave.facet_size_range[0]
    is_out = np.sum((x - closest["x"]) * closest["mean_normal"], axis=1) > rounding
    leads = (depth > WAYS * shortest + rounding) | (is_out & (depth > rounding))
    return np.asarray(closest["found"].astype(bool) & leads)


def _are_beside(x: Array, closest: dict[str, typing.Any], size: float) -> Flags:
    """Whether places look past what is closest to them: that ends there, or turns away.

    Args:
        x: The places, (points, 3).
        closest: What is closest, see ``closest_points``.
        size: Of facets, in which rounding is measured.
    """
    mean, away = closest["mean_normal"], x - closest["x"]
    length = np.maximum(np.linalg.norm(mean, axis=1), 1e-300)
    height = np.sum(away * mean, axis=1) / length
    offset = np.linalg.norm(away - (height / length)[:, None] * mean, axis=1)
    # At an edge that all its facets see the place from, it is in the cone of their normals.
    cone = np.sqrt(np.maximum(1 - length**2, 0.0)) / length
    return np.asarray(offset > cone * np.abs(height) + SAME * size)


def _leads_away(edges: Edges, normal: Array, flat: float = FLAT) -> Flags:
    """Whether no facet leads towards what is there along the normal, or is parallel to it."""
    inward = np.einsum("pfk,pk->pf", edges.inward, normal)
    level = np.einsum("pfk,pk->pf", edges.normal, normal)
    return np.asarray(np.all((inward < TOWARDS) & (level < flat), axis=1))


def _near(creases: Edges, edges: Edges, reach: float, comm: MPI.Intracomm) -> Edges:
    """Edges of the other body that may cross creases of this rank. Collective."""
    box: Array = np.full((2, 3), np.nan)
    if len(creases.area):
        ends = creases.x.reshape(-1, 3)
        box = np.stack([ends.min(axis=0) - reach, ends.max(axis=0) + reach])
    low, high = edges.x.min(axis=1), edges.x.max(axis=1)
    sent = [
        edges.some(np.all((high >= lower) & (low <= upper), axis=1))
        for lower, upper in comm.allgather(box)
    ]
    return Edges.joined(comm.alltoall(sent))


def _crossings(creases: Edges, edges: Edges, reach: tuple[float, float]) -> Crossings:
    """All that count.

    Args:
        creases: The creases.
        edges: What they may cross.
        reach: How far they may be apart, and how deep (length).
    """
    pairs = _candidates(creases, edges, max(reach))
    parts = [_crossing(creases, edges, i, j, reach) for i, j in pairs]
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        return Crossings(none, none, np.zeros((0, 2)), np.zeros((0, 3)))
    found = Crossings(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    along = _from_the_same_end(creases, found)
    order = np.lexsort((along, found.crease))
    found, along = found.some(order), along[order]
    ends = creases.some(found.crease), edges.some(found.edge)
    near = AT_END * np.minimum(1.0, ends[1].length / np.maximum(ends[0].length, 1e-300))
    same = np.diff(along, prepend=-1.0) < near
    same &= np.diff(found.crease, prepend=-1) == 0
    return found.some(~same)


def _from_the_same_end(creases: Edges, found: Crossings) -> Array:
    """Places along creases from the same end on any number of ranks, (points,)."""
    along = creases.x[:, 1] - creases.x[:, 0]
    along = np.round(along / np.maximum(creases.length, 1e-300)[:, None], 6)
    leading = np.argmax(along != 0, axis=1)
    turned = along[np.arange(len(along)), leading] < 0
    places = found.places[:, 0]
    return np.where(turned[found.crease], 1 - places, places)


def _candidates(
    creases: Edges, edges: Edges, reach: float
) -> typing.Iterator[tuple[Indices, Indices]]:
    """Pairs of a crease and an edge whose boxes are within reach, some at a time."""
    if not (len(creases.area) and len(edges.area)):
        return
    low, high = creases.x.min(axis=1) - reach, creases.x.max(axis=1) + reach
    axis = int(np.argmax(np.ptp(edges.x.reshape(-1, 3), axis=0)))
    order = np.argsort(edges.x[:, :, axis].min(axis=1), kind="stable")
    lower, upper = edges.x.min(axis=1)[order], edges.x.max(axis=1)[order]
    longest = float((upper - lower)[:, axis].max())
    start = np.searchsorted(lower[:, axis], low[:, axis] - longest, side="left")
    end = np.searchsorted(lower[:, axis], high[:, axis], side="right")
    count = end - start
    parts = np.searchsorted(np.cumsum(count), np.arange(0, int(count.sum()) + _MANY, _MANY))
    for first, last in zip(parts, [*parts[1:], len(count)], strict=True):
        some = np.arange(first, last)
        i = np.repeat(some, count[some])
        offset = np.arange(len(i)) - np.repeat(np.cumsum(count[some]) - count[some], count[some])
        j = np.repeat(start[some], count[some]) + offset
        near = np.all((upper[j] >= low[i]) & (lower[j] <= high[i]), axis=1)
        yield i[near], order[j[near]]


def _crossing(
    creases: Edges, edges: Edges, i: Indices, j: Indices, reach: tuple[float, float]
) -> Crossings:
    """Of these pairs those that count."""
    here, there = creases.some(i), edges.some(j)
    along, across = here.x[:, 1] - here.x[:, 0], there.x[:, 1] - there.x[:, 0]
    sharp = there.are_sharp
    normal = np.where(sharp[:, None], np.cross(along, across), -there.normal.sum(axis=1))
    size = np.linalg.norm(normal, axis=1)
    least = ACROSS * np.linalg.norm(along, axis=1) * np.linalg.norm(across, axis=1)
    keep = size > np.where(sharp, least, 1e-300)
    normal = normal / np.maximum(size, 1e-300)[:, None]
    outward = np.sum(normal * here.normal.sum(axis=1), axis=1)
    normal *= np.where(sharp, np.sign(outward), 1.0)[:, None]
    places, is_across = _lines_closest(here, there, along, across, normal)
    s, t = places.T
    near = AT_END * np.minimum(1.0, there.length / np.maximum(here.length, 1e-300))
    end = np.where(sharp, -ROUNDING, near)
    keep &= is_across & (s >= end) & (s < np.where(sharp, 1 - ROUNDING, 1 - near))
    keep &= (t >= -ROUNDING) & (t < np.where(sharp, 1 - ROUNDING, 1 + ROUNDING))
    gap = np.sum((there.at(t) - here.at(s)) * normal, axis=1)
    keep &= (gap <= reach[0]) & (gap >= -min(reach))
    keep &= np.abs(np.sum(along * normal, axis=1)) < UPRIGHT * np.linalg.norm(along, axis=1)
    keep &= _leads_away(here, normal) & (~sharp | _leads_away(there, -normal))
    return Crossings(i[keep], j[keep], places[keep], normal[keep])


def _lines_closest(
    here: Edges, there: Edges, along: Array, across: Array, normal: Array
) -> tuple[Array, Flags]:
    """Where lines are closest to each other seen along a normal, and whether they cross there."""

    def seen(v: Array) -> Array:
        return np.asarray(v - np.sum(v * normal, axis=1)[:, None] * normal)

    a, b, c = seen(along), seen(across), seen(there.x[:, 0] - here.x[:, 0])
    of_area = np.sum(np.cross(a, b) * normal, axis=1)
    least = ALONG * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    is_across = np.abs(of_area) > np.maximum(least, 1e-300)
    of_area = np.where(is_across, of_area, 1.0)
    s = np.sum(np.cross(c, b) * normal, axis=1) / of_area
    t = np.sum(np.cross(c, a) * normal, axis=1) / of_area
    return np.column_stack([s, t]), is_across


def _side(surface: Surface | None, edges: Edges, place: Array) -> PairingSide:
    """The side of a body, or of a rigid tool, at places of its edges."""
    if surface is None:
        return of_tool(edges.at(place))
    nodes, block = surface.trace_dofs[0].shape[1:]
    dofs = np.full((len(place), nodes, block), -1, dtype=np.int64)
    owner = np.full((len(place), nodes), -1, dtype=np.int32)
    values = np.zeros((len(place), nodes))
    at, s = [0, 1], place
    functions = np.column_stack([1 - s, s])
    if edges.dofs.shape[1] == 3:
        at = [0, 1, surface.num_facet_vertices]
        functions = np.column_stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
    dofs[:, at], owner[:, at], values[:, at] = edges.dofs, edges.owner, functions
    return PairingSide(edges.at(place), dofs, owner, values)
