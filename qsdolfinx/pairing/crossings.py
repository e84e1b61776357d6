"""Edge-to-edge contact in 3D: points where sharp edges cross edges of the other body."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.pairing.ahead import (
    FLAT,
    PARALLEL,
    PRESSED_FLAT,
    TOWARDS,
    UPRIGHT,
    between,
    deepest,
    linear,
    with_own_multipliers,
)
from qsdolfinx.pairing.edges import Edges
from qsdolfinx.pairing.points import PairingSide
from qsdolfinx.surface.facets import SHARP
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Part of the shorter edge within which a crossing counts as at the end of the sharp edge, or as
#: the same as another crossing. With less, two points close to each other have the same gap, and
#: their multipliers are not determined.
AT_END = 0.1

#: Largest depth of a crossing over the distance from the sharp edge to the closest point of the
#: other surface: the points on the faces detect wedges sharper than about 6°.
WAYS = 20.0

#: Least part of a facet size between two points on a sharp edge for further points between them, if
#: both bodies are deformable. With less, there are more points than an edge has motions.
BENDS = 0.5

#: Part of a facet size between the points of a sharp edge at which its depth is measured. With 1,
#: an edge could be deep between them.
SAMPLED = 0.25


class Crossings(typing.NamedTuple):
    """Points where sharp edges cross edges of the other body.

    Attributes:
        crease: Index of the sharp edge, (points,).
        edge: Index of the other edge, (points,).
        places: Positions along both edges, from 0 to 1, (points, 2).
        normal: Normals from the body of the sharp edge to the other body, (points, 3).
    """

    crease: Indices
    edge: Indices
    places: Array
    normal: Array

    def some(self, which: typing.Any) -> Crossings:
        """Return the crossings of an index."""
        return Crossings(*(values[which] for values in self))


class EdgesRole(typing.NamedTuple):
    """The two surfaces whose edges cross, and the kinds of edges.

    Attributes:
        slave: Surface that carries the multipliers.
        master: The other surface, or a rigid tool.
        creases: For the slave and for the master, whether its edges are sharp edges, or mesh lines
            of its smooth patches; at least one is True.
        moved: Slave and master in their present positions; None for the positions as they were
            read.
    """

    slave: Surface
    master: AnySurface
    creases: tuple[bool, bool]
    moved: tuple[_cpp.Surface, _cpp.Surface] | None = None

    @property
    def objects(self) -> tuple[_cpp.Surface, _cpp.Surface]:
        """Both surfaces as objects of the extension, the one with the sharp edges first."""
        slave, master = self.moved or (s.as_facets().cpp_object for s in (self.slave, self.master))
        return (slave, master) if self.creases[0] else (master, slave)


def pair_edges(
    role: EdgesRole, edges: tuple[Edges, Edges], radius: _cpp.SearchRadius
) -> _cpp.PairingPoints:
    """Find points of sharp edges where they cross edges of the other surface, in 3D. Collective.

    Either sharp edges of both surfaces cross, and the gap is along their common normal; or a sharp
    edge crosses a mesh line of a smooth patch of the other surface, seen along the normal of the
    patch. A point is used if no adjacent facet is inclined towards the other body by more than 20°,
    and none is parallel to it up to 0.5°: the points of such facets are as close as the point
    itself.

    Multipliers are linear along a sharp edge of the slave. A point opposite a sharp edge of the
    master has its own multiplier, see :func:`with_own_multipliers`. A sharp edge that crosses mesh
    lines of a rigid tool has to be an edge of the slave.

    Args:
        role: The two surfaces.
        edges: Edges of both surfaces, see :func:`edges_of`.
        radius: Search distance: points farther away are not paired.
    """
    of_slave = role.creases[0]
    (one, other), sharp = edges if of_slave else edges[::-1], all(role.creases)
    creases = one.some(one.are_sharp)
    others = _near(creases, other.some(other.are_sharp == sharp), radius.largest, role.slave.comm)
    found = _crossings(creases, others, (radius.largest, deepest(role.slave)))
    found = found.some(~_lead_through(role, creases, others, found, radius.largest))
    surfaces = role.slave, role.master
    own, opposite = surfaces if of_slave else surfaces[::-1]
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
        return with_own_multipliers(surfaces, facing.opposite, at_crease, -facing.normal)
    several = np.bincount(facing.crease, minlength=1)[facing.crease]
    multipliers = np.zeros((len(several), role.slave.num_facet_vertices))
    multipliers[:, :2] = np.column_stack([1 - facing.place, facing.place])
    return between(
        surfaces,
        at_crease,
        facing.opposite,
        facing.normal,
        (multipliers, np.zeros(len(several), dtype=np.uint8)),
        here.area / several,
    )


def deepest_of_creases(
    role: EdgesRole, edges: tuple[Edges, Edges], reach: float
) -> tuple[float, tuple[float, ...]]:
    """Largest penetration of sharp edges of both bodies where they cross, in 3D. Collective.

    It is measured along the common normal; crossings with a facet normal along it up to 5° do not
    count.

    Args:
        role: The two surfaces.
        edges: Edges of both surfaces in their present positions.
        reach: Search distance (length).

    Returns:
        The largest depth, 0 if there is none, and its position, (3,).
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


def deepest_on_faces(
    role: EdgesRole, edges: Edges, reach: float
) -> tuple[float, tuple[float, ...]]:
    """Largest penetration of sharp edges of one body in faces of the other one, in 3D. Collective.

    Edges of which a facet lies on the other surface, up to half of the angle of a sharp edge, do
    not count: the points of this facet are as deep. So the rim of a flat punch that facets resolve
    does not count (tests/sliding/test_deep_edges.py).

    Args:
        role: The two surfaces, of which one has sharp edges.
        edges: Its edges in their present positions.
        reach: Search distance (length).

    Returns:
        The largest depth, 0 if there is none, and its position, (3,).
    """
    comm, box = role.slave.comm, role.objects[1].node_x
    low, high = box.min(axis=0, initial=np.inf), box.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    near = np.all((edges.x.max(axis=1) >= low - reach) & (edges.x.min(axis=1) <= high + reach), 1)
    creases = edges.some(edges.are_sharp & near)
    parts = np.ceil(creases.length / (SAMPLED * role.slave.facet_size_range[0]))
    parts = np.clip(parts, 1, 200).astype(np.int64)  # for facets of very different sizes
    crease = np.repeat(np.arange(len(parts)), parts + 1)
    first = np.repeat(np.cumsum(parts + 1) - parts - 1, parts + 1)
    place = (np.arange(len(crease)) - first) / parts[crease]
    closest, x, here = _closest(role, creases, crease, place, reach)
    depth = np.sum((closest["x"] - x) * closest["normal"], axis=1)
    counts = closest["found"].astype(bool) & _leads_away(
        here, -closest["normal"], float(np.cos(SHARP / 2))
    )
    counts &= ~_are_beside(x, closest, role.slave.facet_size_range[0])
    counts &= depth <= deepest(role.slave)
    at = int(np.argmax(np.where(counts, depth, 0.0))) if len(depth) else -1
    most: tuple[float, tuple[float, ...]] = (0.0, (0.0,) * 3)
    if at >= 0 and counts[at]:
        most = max(most, (float(depth[at]), tuple(map(float, x[at]))))
    return max(comm.allgather(most))


class Facing(typing.NamedTuple):
    """Points of sharp edges, and the opposite points.

    Attributes:
        crease: Index of the sharp edge, (points,).
        place: Position along it, from 0 to 1, (points,).
        opposite: Opposite points on the other surface.
        normal: Unit normals from the body of the sharp edge to the other body, (points, 3).
    """

    crease: Indices
    place: Array
    opposite: PairingSide
    normal: Array

    @classmethod
    def joined(cls, parts: typing.Sequence[Facing]) -> Facing:
        """Concatenate several sets of points."""
        if len(parts) == 1:
            return parts[0]
        sides = [dataclasses.astuple(part.opposite) for part in parts]
        opposite = PairingSide(*(np.concatenate(values) for values in zip(*sides, strict=True)))
        crease, place, normal = (np.concatenate([part[i] for part in parts]) for i in (0, 1, 3))
        return cls(crease, place, opposite, normal)


def _degrees(own: AnySurface, opposite: AnySurface) -> tuple[int, int]:
    """Degrees of displacements on a line in a facet: parallel to a side, and otherwise."""
    least, along, twice = own.degree, opposite.degree, opposite.num_facet_vertices == 4
    return max(least, along), max(least, 2 * along if twice else along)


def _between(
    role: EdgesRole, creases: Edges, found: Crossings, degrees: tuple[int, int], reach: float
) -> tuple[Indices, Array]:
    """Further points between crossings, and between crossings and ends of edges. Collective.

    Surfaces of higher degree may protrude there. Together with the points at both ends, there are
    as many points as a function of this degree has values.

    Returns:
        Indices of the sharp edges, and positions from 0 to 1 along them; both (places,).
    """
    count = len(creases.area)
    of_ends: npt.NDArray[np.int64] = np.arange(count)
    crease = np.concatenate([found.crease, of_ends, of_ends])
    place = np.concatenate([found.places[:, 0], np.zeros(count), np.ones(count)])
    order = np.lexsort((place, crease))
    crease, place = crease[order], place[order]
    part = AT_END if is_rigid(role.master) else BENDS
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
    """Whether sharp edges are parallel to sides of quadrilaterals between two points. Collective.

    Args:
        role: The two surfaces.
        creases: All sharp edges.
        crease: Index of the sharp edge, (intervals,).
        ends: Positions of both points along the edge, (intervals,) each.
        reach: Search distance (length).
    """
    middle, part = (ends[0] + ends[1]) / 2, 0.05 * (ends[1] - ends[0])
    found = [_closest(role, creases, crease, middle + step * part, reach)[0] for step in (-1, 1)]
    linear_values = [linear(role.slave, closest["shape_values"]) for closest in found]
    # The vertices of a facet are (0, 0), (1, 0), (0, 1), (1, 1).
    at = [np.column_stack([v[:, 1] + v[:, 3], v[:, 2] + v[:, 3]]) for v in linear_values]
    same = np.all(found[0]["dofs"] == found[1]["dofs"], axis=(1, 2))
    change = np.abs(at[1] - at[0]) / 0.1
    return np.asarray(same & (change.min(axis=1) < AT_END))


def _closest(
    role: EdgesRole, creases: Edges, crease: Indices, place: Array, reach: float
) -> tuple[dict[str, typing.Any], Array, Edges]:
    """Closest points of the other surface to points of sharp edges, and these. Collective."""
    here = creases.some(crease)
    x, normal = here.at(place), here.normal.sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    return _cpp.closest_points(x, normal, *role.objects, reach), x, here


def _facing(role: EdgesRole, creases: Edges, places: tuple[Indices, Array], reach: float) -> Facing:
    """Points of sharp edges that face the other surface, with their opposites. Collective."""
    crease, place = places
    closest, x, here = _closest(role, creases, crease, place, reach)
    normal = -closest["normal"]
    keep = closest["found"].astype(bool) & _leads_away(here, normal, FLAT)
    keep &= ~_are_beside(x, closest, role.slave.facet_size_range[0])
    keep &= np.sum((x - closest["x"]) * normal, axis=1) <= deepest(role.slave)
    names = ("x", "dofs", "owner", "shape_values")
    side = PairingSide(**{name: closest[name][keep] for name in names})
    return Facing(crease[keep], place[keep], side, normal[keep])


def _lead_through(
    role: EdgesRole, creases: Edges, others: Edges, found: Crossings, reach: float
) -> Flags:
    """Crossings that are deep but outside the body, or much deeper than the closest surface point.

    Such crossings are not contacts. An edge behind the plane of a wall may be above the face at
    which the wall ends. A wall of a tool that has entered a body through one face would be pressed
    out through the opposite face. Collective.

    Args:
        role: The two surfaces.
        creases: All sharp edges.
        others: All edges of the other body.
        found: The crossings.
        reach: Search distance (length).

    Returns:
        Flags of the crossings, (points,).
    """
    closest, x, _ = _closest(role, creases, found.crease, found.places[:, 0], reach)
    there = others.some(found.edge).at(found.places[:, 1])
    depth = np.sum((x - there) * found.normal, axis=1)
    shortest = np.linalg.norm(closest["x"] - x, axis=1)
    rounding = SOLVED * role.slave.facet_size_range[0]
    is_out = np.sum((x - closest["x"]) * closest["mean_normal"], axis=1) > rounding
    leads = (depth > WAYS * shortest + rounding) | (is_out & (depth > rounding))
    return np.asarray(closest["found"].astype(bool) & leads)


def _are_beside(x: Array, closest: dict[str, typing.Any], size: float) -> Flags:
    """Whether points are beside their closest surface points, where the surface ends or turns away.

    Args:
        x: The points, (points, 3).
        closest: The closest points, see ``closest_points``.
        size: Size of facets, in which rounding is measured.
    """
    mean, away = closest["mean_normal"], x - closest["x"]
    length = np.maximum(np.linalg.norm(mean, axis=1), 1e-300)
    height = np.sum(away * mean, axis=1) / length
    offset = np.linalg.norm(away - (height / length)[:, None] * mean, axis=1)
    # If all facets at an edge face the point, it is in the cone of their normals.
    cone = np.sqrt(np.maximum(1 - length**2, 0.0)) / length
    return np.asarray(offset > cone * np.abs(height) + SOLVED * size)


def _leads_away(edges: Edges, normal: Array, flat: float) -> Flags:
    """Whether no facet is inclined towards the other body along the normal, or parallel."""
    inward = np.einsum("pfk,pk->pf", edges.inward, normal)
    level = np.einsum("pfk,pk->pf", edges.normal, normal)
    return np.asarray(np.all((inward < TOWARDS) & (level < flat), axis=1))


def _near(creases: Edges, edges: Edges, reach: float, comm: MPI.Intracomm) -> Edges:
    """Edges of the other body that may cross sharp edges of this rank. Collective."""
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
    """Find all crossings that are used, each once.

    Args:
        creases: The sharp edges.
        edges: Edges that they may cross.
        reach: Largest gap and largest depth (length).
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
    """Positions along sharp edges from an end that does not depend on the partition, (points,)."""
    along = creases.x[:, 1] - creases.x[:, 0]
    along = np.round(along / np.maximum(creases.length, 1e-300)[:, None], 6)
    leading = np.argmax(along != 0, axis=1)
    turned = along[np.arange(len(along)), leading] < 0
    places = found.places[:, 0]
    return np.where(turned[found.crease], 1 - places, places)


def _candidates(
    creases: Edges, edges: Edges, reach: float
) -> typing.Iterator[tuple[Indices, Indices]]:
    """Yield pairs of a sharp edge and an edge with bounding boxes within reach, in batches."""
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
    many = 1_000_000  # pairs at a time: some 100 bytes of memory each
    parts = np.searchsorted(np.cumsum(count), np.arange(0, int(count.sum()) + many, many))
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
    """Crossings of these pairs that are used."""
    here, there = creases.some(i), edges.some(j)
    along, across = here.x[:, 1] - here.x[:, 0], there.x[:, 1] - there.x[:, 0]
    sharp = there.are_sharp
    normal = np.where(sharp[:, None], np.cross(along, across), -there.normal.sum(axis=1))
    size = np.linalg.norm(normal, axis=1)
    least = np.sin(PARALLEL) * np.linalg.norm(along, axis=1) * np.linalg.norm(across, axis=1)
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
    # Of an edge along the normal, only the end protrudes.
    keep &= np.abs(np.sum(along * normal, axis=1)) < UPRIGHT * np.linalg.norm(along, axis=1)
    keep &= _leads_away(here, normal, FLAT) & (~sharp | _leads_away(there, -normal, FLAT))
    return Crossings(i[keep], j[keep], places[keep], normal[keep])


def _lines_closest(
    here: Edges, there: Edges, along: Array, across: Array, normal: Array
) -> tuple[Array, Flags]:
    """Closest points of two lines seen along a normal, and whether the lines cross."""

    def seen(v: Array) -> Array:
        return np.asarray(v - np.sum(v * normal, axis=1)[:, None] * normal)

    a, b, c = seen(along), seen(across), seen(there.x[:, 0] - here.x[:, 0])
    of_area = np.sum(np.cross(a, b) * normal, axis=1)
    least = np.sin(PARALLEL) * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    is_across = np.abs(of_area) > np.maximum(least, 1e-300)
    of_area = np.where(is_across, of_area, 1.0)
    s = np.sum(np.cross(c, b) * normal, axis=1) / of_area
    t = np.sum(np.cross(c, a) * normal, axis=1) / of_area
    return np.column_stack([s, t]), is_across


def _side(surface: AnySurface, edges: Edges, place: Array) -> PairingSide:
    """The side of a body, or of a rigid tool, at points of its edges."""
    nodes, block = surface.as_facets().trace_dofs[0].shape[1:]
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
