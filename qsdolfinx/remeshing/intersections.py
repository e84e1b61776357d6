"""Find the places where a boundary intersects itself."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import geometry, mesh

from qsdolfinx.remeshing.errors import RemeshError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def check_simple(x: Array, facets: Indices) -> None:
    """Raise an error for a boundary that intersects itself.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        facets: Shape (facets, gdim).

    Raises:
        RemeshError: If there are intersections, with their places.
    """
    first, second = _candidates(x, facets)
    crossings = _crossings_3d if facets.shape[1] == 3 else _crossings_2d
    at = crossings(x, facets, first, second)
    if len(at):
        raise RemeshError.at("the boundary passes through itself", at)


def _candidates(x: Array, facets: Indices) -> tuple[Indices, Indices]:
    """Pairs of facets without a common node whose bounding boxes overlap."""
    gdim = facets.shape[1]
    cell = "triangle" if gdim == 3 else "interval"
    element = basix.ufl.element("Lagrange", cell, 1, shape=(gdim,))
    nodes, renumbered = np.unique(facets, return_inverse=True)
    msh = mesh.create_mesh(
        MPI.COMM_SELF,
        cells=renumbered.reshape(facets.shape).astype(np.int64),
        x=np.ascontiguousarray(x[nodes, :gdim]),
        e=ufl.Mesh(element),
    )
    tree = geometry.bb_tree(msh, gdim - 1)
    number = np.asarray(msh.topology.original_cell_index)
    pairs = number[geometry.compute_collisions_trees(tree, tree)].reshape(-1, 2)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    common = np.any(facets[pairs[:, 0]][:, :, None] == facets[pairs[:, 1]][:, None], axis=(1, 2))
    pairs = pairs[~common]
    return pairs[:, 0], pairs[:, 1]


def _crossings_3d(x: Array, facets: Indices, first: Indices, second: Indices) -> Array:
    """Points in which edges of the first triangles cross the second ones."""
    found = []
    a, b, c = (x[facets[second, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    for i in range(3):
        p, q = x[facets[first, i]], x[facets[first, (i + 1) % 3]]
        hp, hq = np.sum((p - a) * normal, axis=1), np.sum((q - a) * normal, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = p + (hp / (hp - hq))[:, None] * (q - p)
            sides = [np.sum(np.cross(v - u, at - u) * normal, axis=1)
                     for u, v in ((a, b), (b, c), (c, a))]  # fmt: skip
        inside = np.all(np.array(sides) > 0, axis=0)
        found.append(at[(hp * hq < 0) & inside])
    return np.concatenate(found)


def _crossings_2d(x: Array, facets: Indices, first: Indices, second: Indices) -> Array:
    """Points in which segments cross."""
    (p, q), (a, b) = (tuple(x[facets[f, i], :2] for i in (0, 1)) for f in (first, second))

    def side(u: Array, v: Array, w: Array) -> Array:
        d, e = v - u, w - u
        return np.asarray(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])

    hp, hq = side(a, b, p), side(a, b, q)
    crosses = (hp * hq < 0) & (side(p, q, a) * side(p, q, b) < 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = p + (hp / (hp - hq))[:, None] * (q - p)
    return np.pad(at[crosses], ((0, 0), (0, 1)))
