"""Round a copy of a body to a lattice, so that remeshing does not depend on rounding errors."""

from __future__ import annotations

import itertools

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import geometry, mesh

from qsdolfinx.remeshing.outline import Outline

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Largest spacing of the lattice, over the requested cell size at a node and the shortest edge
#: there: solver errors, some 1e-9 of it, rarely move a node to another lattice point
#: (test_rounding_does_not_decide). It is less than 1e-3, by a factor that prevents round sizes from
#: giving powers of two.
SPACING = 0.77e-3

#: Threshold between two lattice points, over their distance, above which values are rounded to the
#: second one. It is far from the fractions in symmetric bodies, such as 0, 1/2, 2/5 or 1/3.
TURN = (5**0.5 - 1) / 2


def on_lattice(outline: Outline) -> tuple[Outline, Outline]:
    """Sort the nodes of a body by their places, and create a copy rounded to a lattice.

    Positions and sizes of the copy are bitwise identical for all bodies that differ by solver
    errors only. Decisions based on them are therefore the same on any number of ranks, also where
    lengths are equal by symmetry. The lattice has its own spacing at each node.

    Args:
        outline: The body.

    Returns:
        The body and its copy, with the sizes of the copy.
    """
    x, cells = outline.x, outline.cells
    a, b = np.concatenate(
        [cells[:, pair] for pair in itertools.combinations(range(cells.shape[1]), 2)]
    ).T
    length = np.linalg.norm(x[a] - x[b], axis=1)
    spacing = outline.sizes.copy()
    np.minimum.at(spacing, a, length)
    np.minimum.at(spacing, b, length)
    rounded = _rounded(x, spacing[:, None])
    sizes = _rounded(outline.sizes, outline.sizes)
    order = np.lexsort(rounded.T)
    number = np.argsort(order)
    cells = np.sort(number[cells], axis=1)
    cells = cells[np.lexsort(cells.T)]
    facets = number[outline.facets]
    by_nodes = np.lexsort(np.sort(facets, axis=1).T)
    if outline.gdim == 3:  # each facet begins with its smallest node
        turns = (np.argmin(facets, axis=1)[:, None] + np.arange(3)) % 3
        facets = np.take_along_axis(facets, turns, axis=1)
    body = Outline(x[order], facets[by_nodes], outline.tags[by_nodes], cells, sizes[order])
    return body, body._replace(x=rounded[order])


def _rounded(values: Array, lengths: Array) -> Array:
    """Round values to lattices with a spacing of SPACING times the lengths, a power of two."""
    with np.errstate(divide="ignore"):
        step = np.exp2(np.floor(np.log2(SPACING * lengths)))
    return np.asarray(step * np.floor(values / step + (1 - TURN)))


class FromLattice:
    """Map from the copy on the lattice back to the body, linear in each cell.

    Args:
        body: The body.
        copy: Its copy on the lattice.
    """

    def __init__(self, body: Outline, copy: Outline) -> None:
        gdim = body.gdim
        element = basix.ufl.element(
            "Lagrange", "triangle" if gdim == 2 else "tetrahedron", 1, shape=(gdim,)
        )
        self._mesh = mesh.create_mesh(
            MPI.COMM_SELF,
            cells=copy.cells,
            x=np.ascontiguousarray(copy.x[:, :gdim]),
            e=ufl.Mesh(element),
        )
        self._cells = copy.cells[np.asarray(self._mesh.topology.original_cell_index)]
        self._x, self._ways = copy.x, body.x - copy.x
        count = np.arange(len(copy.cells), dtype=np.int32)
        self._tree = geometry.bb_tree(self._mesh, gdim)
        self._middles = geometry.create_midpoint_tree(self._mesh, gdim, count)

    def __call__(self, x: Array) -> Array:
        """Map points of the copy to places in the body, (points, 3)."""
        if len(x) == 0:
            return x
        found = geometry.compute_closest_entity(
            self._tree, self._middles, self._mesh, np.ascontiguousarray(x)
        )
        nodes = self._cells[found]
        gdim = nodes.shape[1] - 1
        corners = self._x[nodes][..., :gdim]
        edges = corners[:, 1:] - corners[:, :1]
        # The pseudo-inverse gives a closest place in flat cells, too.
        inverse = np.linalg.pinv(edges.transpose(0, 2, 1), rcond=1e-9)
        part = np.einsum("pij,pj->pi", inverse, x[:, :gdim] - corners[:, 0])
        # Points outside the copy are mapped like points on it.
        weights = np.clip(np.column_stack([1 - part.sum(axis=1), part]), 0.0, 1.0)
        weights /= weights.sum(axis=1, keepdims=True)
        return np.asarray(x + np.einsum("pi,pij->pj", weights, self._ways[nodes]))
