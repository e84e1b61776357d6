"""Averaged normals at the vertices of a moving surface, and their derivatives."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.facets import Faceted, at_vertices, sums
from qsdolfinx.surface.unknowns import EDGES

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Vertices next to each vertex along edges, so that a × b of the tangents towards them has the same
#: orientation at all vertices, by the number of vertices of a facet; in 2D b is the third axis.
NEXT: dict[int, list[tuple[int, ...]]] = {
    2: [(1,), (0,)],
    3: [(1, 2), (2, 0), (0, 1)],
    4: [(1, 2), (3, 0), (0, 3), (2, 1)],
}


def area_factors(count: int, degree: int) -> tuple[Array, Array, float]:
    """Factors of a facet's nodes in d₁ and d₂, so that f d₁ × d₂ is the area vector at a vertex.

    In 2D d₂ is the third axis, and its factors are 0. For flat triangles the vector is constant; on
    bilinear facets that at the centre is used.

    Args:
        count: Vertices of a facet.
        degree: Degree of the facets.

    Returns:
        The factors of d₁ and d₂, (vertices, nodes), and f.
    """
    if count == 4 and degree == 1:
        diagonals = np.array([[-1.0, 0, 0, 1], [0, -1, 1, 0]])
        return np.tile(diagonals[0], (4, 1)), np.tile(diagonals[1], (4, 1)), 0.5
    edges, num_nodes = EDGES[count], count if degree == 1 else count + len(EDGES[count])
    out = np.zeros((2, count, num_nodes + (count == 4)))
    for i, neighbours in enumerate(NEXT[count]):
        for k, j in enumerate(neighbours):
            sign = -1.0 if count == 2 and i == 1 else 1.0
            if degree == 1:
                out[k, i, [i, j]] = -sign, sign
                continue
            middle = count + edges.index((min(i, j), max(i, j)))
            out[k, i, [i, j, middle]] = -3 * sign, -sign, 4 * sign
    return out[0], out[1], 0.5 if count == 3 else 1.0


def cross_matrix(a: Array) -> Array:
    """[a]ₓ, so that [a]ₓ b = a × b, (…, 3, 3)."""
    x, y, z = np.moveaxis(a, -1, 0)
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class VertexNormals:
    """Unit normals m = Σ s_f/|Σ s_f| of vertices that are on no sharp edge.

    s_f is the area vector of a facet at the vertex, or at its centre, see :func:`area_factors`.

    Args:
        facets: The surface.
        sharp: Owned nodes on sharp edges; their normals are 0.
    """

    def __init__(self, facets: Faceted, sharp: Flags) -> None:
        self._facets, self._smooth = facets, ~sharp
        count = facets.num_facet_vertices
        self._d1, self._d2, self._factor = area_factors(count, facets.degree)
        x, inside, _ = facets.coordinates
        first, second = _edges(*area_factors(count, 1)[:2], x)
        area = np.cross(first[:, 0], second[:, 0])
        out = np.sum(area * (x.mean(axis=1) - inside), axis=1)
        self._signs: Array = self._factor * np.where(out > 0, 1.0, -1.0)

    def at(self, x: Array) -> NormalsThere:
        """Normals for nodes of the facets at positions x, (facets, nodes, 3). Collective."""
        area = self._signs[:, None, None] * np.cross(*_edges(self._d1, self._d2, x))
        total = [sums(self._facets, a.ravel()) for a in np.moveaxis(area, 2, 0)]
        sum_there = np.where(self._smooth[:, None], np.stack(total, axis=1), 0.0)
        length = np.linalg.norm(sum_there, axis=1)
        normal = sum_there / np.where(length > 0, length, 1.0)[:, None]
        return NormalsThere(self, x, normal, length)

    def derivative(self, there: NormalsThere, wanted: Flags) -> PETSc.Mat:
        """∂m/∂x in the rows of selected vertices: a new matrix of the body's layout. Collective.

        Args:
            there: The normals.
            wanted: Owned nodes whose rows are computed.
        """
        facets, gdim = self._facets, self._facets.gdim
        dofs = facets.trace_dofs[0][:, : there.x.shape[1]].astype(np.int64)
        values = [np.where(wanted, there.length, 0.0), *there.normal.T]
        length, *components = (at_vertices(facets, v) for v in values)
        some = np.flatnonzero(np.any(length > 0, axis=1))
        m, length = np.stack(components, axis=2)[some], length[some]
        across = np.eye(3) - m[..., :, None] * m[..., None, :]
        across /= np.where(length > 0, length, np.inf)[..., None, None]
        d1, d2 = (cross_matrix(d) for d in _edges(self._d1, self._d2, there.x[some]))
        # δs = f (δd₁ × d₂ + d₁ × δd₂)
        by = self._signs[some, None, None, None, None] * (
            self._d2[..., None, None] * d1[:, :, None] - self._d1[..., None, None] * d2[:, :, None]
        )
        found = np.einsum("fkab,fkjbc->fkajc", across, by)[:, :, :gdim, :, :gdim]
        row = np.broadcast_to(dofs[some][:, : m.shape[1], :, None, None], found.shape)
        column = np.broadcast_to(dofs[some][:, None, None], found.shape)
        vec = facets.create_vec()
        mat = new_matrix(vec.getSizes(), vec.getSizes(), (row, column, found), facets.comm)
        vec.destroy()
        return mat


def _edges(first: Array, second: Array, x: Array) -> tuple[Array, Array]:
    """d₁ and d₂ at the vertices of facets with these nodes, (facets, vertices, 3).

    Args:
        first: Factors of the nodes in d₁, (vertices, nodes).
        second: Factors of the nodes in d₂.
        x: Positions of the nodes, (facets, nodes, 3).
    """
    d1, d2 = (np.einsum("vn,fnd->fvd", factors, x) for factors in (first, second))
    if len(first) == 2:
        d2[..., 2] = 1.0
    return d1, d2


class NormalsThere(typing.NamedTuple):
    """Normals of a surface for given vertex positions.

    Attributes:
        of: Normals of the surface in any position.
        x: Positions of the nodes of the facets, (facets, nodes, 3).
        normal: m of owned nodes, 0 on sharp edges, (nodes, 3).
        length: |Σ s_f|, 0 on sharp edges, (nodes,).
    """

    of: VertexNormals
    x: Array
    normal: Array
    length: Array

    def vec(self) -> PETSc.Vec:
        """The normals as a new vector of the body or tool. Collective."""
        facets = self.of._facets
        out = facets.create_vec()
        dofs = facets.node_dofs
        out.array[dofs - out.owner_range[0]] = self.normal[:, : dofs.shape[1]]
        return out

    def turn(self, entries: typing.Sequence[tuple[npt.NDArray[np.int64], ...]]) -> PETSc.Mat:
        """∂m/∂x in the rows that are columns of given matrix entries. Collective.

        Args:
            entries: Rows, columns and values of the entries; columns are components of normals.
        """
        facets = self.of._facets
        vec = facets.create_vec()
        for _, column, _ in entries:
            one = np.ones(len(column))
            vec.setValues(column.astype(PETSc.IntType), one, PETSc.InsertMode.ADD_VALUES)
        vec.assemble()
        wanted = np.any(vec.array_r[facets.node_dofs - vec.owner_range[0]] > 0, axis=1)
        vec.destroy()
        return self.of.derivative(self, np.asarray(wanted))


def new_matrix(
    rows: tuple[int, int],
    columns: tuple[int, int],
    entries: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
    comm: typing.Any,
) -> PETSc.Mat:
    """New matrix from entries of any rank; repeated entries are summed. Collective."""
    out = PETSc.Mat().create(comm=comm)
    out.setSizes((rows, columns))
    out.setType(PETSc.Mat.Type.AIJ)
    row, column = (np.array(values, dtype=np.int64).ravel() for values in entries[:2])
    _cpp.set_places(out.handle, row, column)
    _cpp.set_values(out.handle, np.array(entries[2], dtype=np.float64).ravel())
    return out
