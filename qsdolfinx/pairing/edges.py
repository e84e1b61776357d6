"""Creases that cross edges of the other body, ahead of all quadrature points of their facets."""

from __future__ import annotations

import typing
import weakref

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.vertices import FLAT, NOTHING, ROUNDING, Faceted, as_facets
from qsdolfinx.surface.affine import EDGES
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool, deformable

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Cosine of the angle (30°) by which facets turn at a crease.
CREASE = float(np.cos(np.pi / 6))

#: Sine of the least angle (0.5°) between creases that cross, and of a crease and a mesh line.
ACROSS, ALONG = float(np.sin(np.pi / 360)), 0.01

#: Part of the shorter edge within which a crossing is at the end of the crease, or the same as
#: another one.
AT_END = 0.01

#: Pairs of edges that are looked at at a time.
_MANY = 1_000_000


class Edges(typing.NamedTuple):
    """Edges of facets, on any rank.

    Attributes:
        x: Their ends, (edges, 2, 3).
        dofs: Unknowns of the ends, and of the node between of traces of degree 2,
            (edges, places, block).
        owner: Their owners, (edges, places).
        normal: Outward unit normals of both facets, (edges, 2, 3).
        inward: Unit vectors into both facets, across the edge, (edges, 2, 3).
        area: Area of the facets that the edge stands for, (edges,).
    """

    x: Array
    dofs: Indices
    owner: Indices
    normal: Array
    inward: Array
    area: Array

    @property
    def are_sharp(self) -> Flags:
        """Creases, (edges,)."""
        return np.asarray(np.sum(self.normal[:, 0] * self.normal[:, 1], axis=1) < CREASE)

    @property
    def length(self) -> Array:
        """Length of each, (edges,)."""
        return np.asarray(np.linalg.norm(self.x[:, 1] - self.x[:, 0], axis=1))

    def some(self, which: typing.Any) -> Edges:
        """Those of an index."""
        return Edges(*(values[which] for values in self))

    @classmethod
    def joined(cls, parts: typing.Sequence[Edges]) -> Edges:
        """All of some."""
        return cls(*(np.concatenate(values) for values in zip(*parts, strict=True)))


#: Edges of tools where these were made: they only move.
_OF_TOOLS: weakref.WeakKeyDictionary[RigidSurface, Edges] = weakref.WeakKeyDictionary()


def edges_of(surface: AnySurface) -> Edges:
    """All edges, each on one rank. Collective.

    Where a surface ends there is one facet, which counts as both.
    """
    tool = as_tool(surface)
    if tool is None:
        return _found(surface)
    R, t = tool.position[:, :-1], tool.position[:, -1]
    if tool not in _OF_TOOLS:
        _OF_TOOLS[tool] = _turned(_found(tool), R.T, -t @ R)
    return _turned(_OF_TOOLS[tool], R, t)


def _turned(edges: Edges, R: Array, t: Array) -> Edges:
    """Where x ↦ R x + t takes them."""
    x, normal, inward = edges.x @ R.T + t, edges.normal @ R.T, edges.inward @ R.T
    return edges._replace(x=x, normal=normal, inward=inward)


def _found(surface: AnySurface) -> Edges:
    """Edges where the surface is now; see :func:`edges_of`."""
    half = _of_facets(as_facets(surface))
    comm, first = surface.comm, half.owner[:, 0]
    sent = [half.some(first == rank) for rank in range(comm.size)]
    here = Edges.joined(comm.alltoall(sent))
    keys = here.dofs[:, :2, 0]
    order = np.lexsort(keys.T)
    here, keys = here.some(order), keys[order]
    as_last = np.all(keys[1:] == keys[:-1], axis=1)
    begins = np.flatnonzero(np.append(True, ~as_last)[: len(keys)])
    ends = np.flatnonzero(np.append(~as_last, True)[: len(keys)])
    one, other = here.some(begins), here.some(ends)
    return one._replace(
        normal=np.concatenate([one.normal, other.normal], axis=1),
        inward=np.concatenate([one.inward, other.inward], axis=1),
        area=one.area + np.where(begins < ends, other.area, 0.0),
    )


def _of_facets(surface: Faceted) -> Edges:
    """Those of this rank's facets, with one normal and inward vector each."""
    x, inside, _ = surface.coordinates
    dofs, owner = surface.trace_dofs
    count, middle = surface.num_facet_vertices, x.mean(axis=1)
    diagonals = (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if count == 4:
        diagonals = (x[:, 3] - x[:, 0], x[:, 2] - x[:, 1])
    across = np.cross(*diagonals)
    area = np.linalg.norm(across, axis=1) / 2
    normal = across / np.maximum(2 * area, 1e-300)[:, None]
    normal *= np.sign(np.sum((middle - inside) * normal, axis=1))[:, None]
    parts = []
    for at, (i, j) in enumerate(EDGES[count], start=count):
        places = [i, j, at] if dofs.shape[1] > count else [i, j]
        along = x[:, j] - x[:, i]
        along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
        inward = middle - x[:, i]
        inward = inward - np.sum(inward * along, axis=1)[:, None] * along
        inward = inward / np.maximum(np.linalg.norm(inward, axis=1), 1e-300)[:, None]
        found = Edges(
            x[:, [i, j]],
            dofs[:, places].astype(np.int64),
            owner[:, places].astype(np.int64),
            normal[:, None],
            inward[:, None],
            area / len(EDGES[count]),
        )
        parts.append(_ascending(found))
    return Edges.joined(parts)


def _ascending(edges: Edges) -> Edges:
    """The same with the end of the lower unknown first."""
    turned = edges.dofs[:, 0, 0] > edges.dofs[:, 1, 0]
    x, dofs, owner = edges.x.copy(), edges.dofs.copy(), edges.owner.copy()
    for values in (x, dofs, owner):
        values[turned, :2] = values[turned, 1::-1]
    return edges._replace(x=x, dofs=dofs, owner=owner)


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
    """

    slave: Surface
    master: AnySurface
    creases: tuple[bool, bool]


def pair_edges(
    role: EdgesRole, edges: tuple[Edges, Edges], radius: _cpp.SearchRadius
) -> _cpp.PairingPoints:
    """Points of creases where they cross edges of the other surface, in 3D. Collective.

    Either where creases of both cross, along the normal of both; or where a crease crosses a mesh
    line of the other's smooth sides, seen along its normal. A point counts if all facets beside it
    lead away from the other body, and none is parallel to it up to 0.5°: their own points are as
    close as it is.

    Multipliers are linear along the slave's crease. At a mesh line of the slave, as under the
    crease of a rigid tool, a point has that of the line's end next to it.

    Args:
        role: Whose they are.
        edges: Of both, see :func:`edges_of`.
        radius: Beyond which points are not paired.
    """
    of_slave = role.creases[0]
    (one, other), sharp = edges if of_slave else edges[::-1], all(role.creases)
    creases = one.some(one.are_sharp)
    others = _near(creases, other.some(other.are_sharp == sharp), radius.largest, role.slave.comm)
    found = _crossings(creases, others, radius.largest)
    sides = [creases.some(found.crease), others.some(found.edge)]
    places, normal, which = found.places, found.normal, found.crease
    if not of_slave:
        sides, places, normal, which = sides[::-1], places[:, ::-1], -normal, found.edge
    here, there = sides
    points = [_between(here, places[:, 0]), _between(there, places[:, 1])]
    several = np.bincount(which, minlength=1)[which]
    along = places[:, 0] if of_slave else np.round(places[:, 0])
    multipliers = np.zeros((len(along), role.slave.num_facet_vertices))
    multipliers[:, :2] = np.column_stack([1 - along, along])
    master = deformable(role.master)
    return _cpp.points_between(
        role.slave.cpp_object,
        None if master is None else master.cpp_object,
        points[0],
        *_side(role.slave, here, places[:, 0]),
        points[1],
        *(NOTHING if master is None else _side(master, there, places[:, 1])),
        multipliers,
        np.ascontiguousarray(normal),
        np.sum((points[1] - points[0]) * normal, axis=1),
        here.area / several,
    )


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


def _crossings(creases: Edges, edges: Edges, reach: float) -> Crossings:
    """All that count."""
    pairs = _candidates(creases, edges, reach)
    parts = [_crossing(creases, edges, i, j, reach) for i, j in pairs]
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        return Crossings(none, none, np.zeros((0, 2)), np.zeros((0, 3)))
    found = Crossings(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    order = np.lexsort((found.places[:, 0], found.crease))
    found = found.some(order)
    ends = creases.some(found.crease), edges.some(found.edge)
    near = AT_END * np.minimum(1.0, ends[1].length / np.maximum(ends[0].length, 1e-300))
    same = np.diff(found.places[:, 0], prepend=-1.0) < near
    same &= np.diff(found.crease, prepend=-1) == 0
    return found.some(~same)


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


def _crossing(creases: Edges, edges: Edges, i: Indices, j: Indices, reach: float) -> Crossings:
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
    places, is_across = _closest(here, there, along, across, normal)
    s, t = places.T
    near = AT_END * np.minimum(1.0, there.length / np.maximum(here.length, 1e-300))
    end = np.where(sharp, -ROUNDING, near)
    keep &= is_across & (s >= end) & (s < np.where(sharp, 1 - ROUNDING, 1 - near))
    keep &= (t >= -ROUNDING) & (t < np.where(sharp, 1 - ROUNDING, 1 + ROUNDING))
    gap = np.sum((_between(there, t) - _between(here, s)) * normal, axis=1)
    keep &= np.abs(gap) <= reach
    keep &= np.all(np.einsum("pfk,pk->pf", here.inward, normal) < -ROUNDING, axis=1)
    keep &= np.all(np.einsum("pfk,pk->pf", here.normal, normal) < FLAT, axis=1)
    away = np.all(np.einsum("pfk,pk->pf", there.inward, normal) > ROUNDING, axis=1)
    level = np.all(np.einsum("pfk,pk->pf", there.normal, -normal) < FLAT, axis=1)
    keep &= ~sharp | (away & level)
    return Crossings(i[keep], j[keep], places[keep], normal[keep])


def _closest(
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


def _between(edges: Edges, place: Array) -> Array:
    """Places on edges, (points, 3)."""
    return np.asarray(edges.x[:, 0] + place[:, None] * (edges.x[:, 1] - edges.x[:, 0]))


def _side(
    surface: Surface, edges: Edges, place: Array
) -> tuple[Indices, npt.NDArray[np.int32], Array]:
    """Unknowns, owners and trace functions of one side's points."""
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
    return dofs, owner, values
