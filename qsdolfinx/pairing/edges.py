"""Edges of the facets of a surface, each on exactly one rank."""

from __future__ import annotations

import typing
import weakref

import numpy as np
import numpy.typing as npt

from qsdolfinx.pairing.facets import Faceted
from qsdolfinx.surface.facets import SHARP
from qsdolfinx.surface.unknowns import EDGES
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class Edges(typing.NamedTuple):
    """Edges of facets, on any rank.

    Attributes:
        x: Positions of the ends, (edges, 2, 3).
        dofs: Unknowns of the ends, and for traces of degree 2 of the midside node, (edges, places,
            block).
        owner: Ranks that own these unknowns, (edges, places).
        normal: Outward unit normals of both adjacent facets, (edges, 2, 3).
        inward: Unit vectors into both facets, perpendicular to the edge, (edges, 2, 3).
        area: Part of the area of the facets that belongs to the edge, (edges,).
    """

    x: Array
    dofs: Indices
    owner: Indices
    normal: Array
    inward: Array
    area: Array

    @property
    def are_sharp(self) -> Flags:
        """Whether each edge is sharp, (edges,)."""
        return np.asarray(np.sum(self.normal[:, 0] * self.normal[:, 1], axis=1) < np.cos(SHARP))

    @property
    def length(self) -> Array:
        """Length of each edge, (edges,)."""
        return np.asarray(np.linalg.norm(self.x[:, 1] - self.x[:, 0], axis=1))

    def some(self, which: typing.Any) -> Edges:
        """Return the edges of an index."""
        return Edges(*(values[which] for values in self))

    def at(self, place: Array) -> Array:
        """Positions at local coordinates on the edges, from 0 to 1, (edges, 3)."""
        return np.asarray(self.x[:, 0] + place[:, None] * (self.x[:, 1] - self.x[:, 0]))

    @classmethod
    def joined(cls, parts: typing.Sequence[Edges]) -> Edges:
        """Concatenate several sets of edges."""
        return cls(*(np.concatenate(values) for values in zip(*parts, strict=True)))


#: Edges of tools in their initial positions: tools only move.
_OF_TOOLS: weakref.WeakKeyDictionary[RigidSurface, Edges] = weakref.WeakKeyDictionary()


def edges_of(surface: AnySurface) -> Edges:
    """Return all edges of a surface, each on one rank. Collective.

    At the boundary of a surface an edge has only one facet, which is used for both.
    """
    if not is_rigid(surface):
        return _found(surface)
    R, t = surface.position[:, :-1], surface.position[:, -1]
    if surface not in _OF_TOOLS:
        _OF_TOOLS[surface] = _turned(_found(surface), R.T, -t @ R)
    return _turned(_OF_TOOLS[surface], R, t)


def _turned(edges: Edges, R: Array, t: Array) -> Edges:
    """Map the edges by x ↦ R x + t."""
    x, normal, inward = edges.x @ R.T + t, edges.normal @ R.T, edges.inward @ R.T
    return edges._replace(x=x, normal=normal, inward=inward)


def _found(surface: AnySurface) -> Edges:
    """Edges of the surface in its present position; see :func:`edges_of`."""
    facets = surface.as_facets()
    return edges_at(facets, facets.coordinates[0], outward_signs(facets))


def outward_signs(surface: Faceted) -> Array:
    """Signs that make area vectors computed from the facet vertices alone outward, (facets,)."""
    x, inside, _ = surface.coordinates
    return np.asarray(np.sign(np.sum((x.mean(axis=1) - inside) * _across(x), axis=1)))


def _across(x: Array) -> Array:
    """Twice the area vectors of facets with these vertices, (facets, 3)."""
    if x.shape[1] == 4:
        return np.asarray(np.cross(x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]), dtype=np.float64)
    return np.asarray(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), dtype=np.float64)


def edges_at(surface: Faceted, x: Array, signs: Array) -> Edges:
    """Edges of a surface for given vertex positions, each on one rank. Collective.

    The order of the edges does not depend on the positions.

    Args:
        surface: The surface.
        x: Vertices of its facets, (facets, vertices, 3).
        signs: See :func:`outward_signs`.
    """
    half = _of_facets(surface, x, signs)
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


def _of_facets(surface: Faceted, x: Array, signs: Array) -> Edges:
    """Edges of this rank's facets, with one normal and one inward vector each."""
    dofs, owner = surface.trace_dofs
    count, middle = surface.num_facet_vertices, x.mean(axis=1)
    across = _across(x)
    area = np.linalg.norm(across, axis=1) / 2
    normal = signs[:, None] * across / np.maximum(2 * area, 1e-300)[:, None]
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
    """Reorder the ends of each edge, the one with the lower unknown first."""
    turned = edges.dofs[:, 0, 0] > edges.dofs[:, 1, 0]
    x, dofs, owner = edges.x.copy(), edges.dofs.copy(), edges.owner.copy()
    for values in (x, dofs, owner):
        values[turned, :2] = values[turned, 1::-1]
    return edges._replace(x=x, dofs=dofs, owner=owner)
