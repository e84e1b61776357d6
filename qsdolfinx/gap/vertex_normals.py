"""Averaged normals at the vertices of a moving surface, and their derivatives."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.facets import Faceted, at_vertices, sums

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: By the number of vertices of a facet: factors of the vertices in d₁ and d₂, and f, so that f d₁ ×
#: d₂ is the area vector at the centre; in 2D d₂ is the third axis.
AREA_VECTOR: dict[int, tuple[list[float], list[float], float]] = {
    2: ([-1, 1], [0, 0], 1.0),
    3: ([-1, 1, 0], [-1, 0, 1], 0.5),
    4: ([-1, 0, 0, 1], [0, -1, 1, 0], 0.5),
}


def cross_matrix(a: Array) -> Array:
    """[a]ₓ, so that [a]ₓ b = a × b, (…, 3, 3)."""
    x, y, z = np.moveaxis(a, -1, 0)
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class VertexNormals:
    """Unit normals m = Σ s_f/|Σ s_f| of vertices that are on no sharp edge.

    s_f is the area vector of a facet at its centre.

    Args:
        facets: The surface.
        sharp: Owned nodes on sharp edges; their normals are 0.
    """

    def __init__(self, facets: Faceted, sharp: Flags) -> None:
        self._facets, self._smooth = facets, ~sharp
        x, inside, _ = facets.coordinates
        self._d1, self._d2, self._factor = AREA_VECTOR[x.shape[1]]
        area = np.cross(*self._edges(x))
        out = np.sum(area * (x.mean(axis=1) - inside), axis=1)
        self._signs: Array = self._factor * np.where(out > 0, 1.0, -1.0)

    def _edges(self, x: Array) -> tuple[Array, Array]:
        """d₁ and d₂ of facets with these vertices, (facets, 3)."""
        d1, d2 = (np.einsum("v,fvd->fd", np.array(d, float), x) for d in (self._d1, self._d2))
        if len(self._d1) == 2:
            d2[:, 2] = 1.0
        return d1, d2

    def at(self, x: Array) -> NormalsThere:
        """Normals for vertices at positions x, (facets, vertices, 3). Collective."""
        count = x.shape[1]
        area = self._signs[:, None] * np.cross(*self._edges(x))
        total = [sums(self._facets, np.repeat(a, count)) for a in area.T]
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
        d1, d2 = (cross_matrix(d) for d in self._edges(there.x[some]))
        # δs = f (δd₁ × d₂ + d₁ × δd₂)
        by = self._signs[some, None, None, None] * (
            np.array(self._d2)[None, :, None, None] * d1[:, None]
            - np.array(self._d1)[None, :, None, None] * d2[:, None]
        )
        found = np.einsum("fkab,fjbc->fkajc", across, by)[:, :, :gdim, :, :gdim]
        row = np.broadcast_to(dofs[some][:, :, :, None, None], found.shape)
        column = np.broadcast_to(dofs[some][:, None, None], found.shape)
        vec = facets.create_vec()
        mat = new_matrix(vec.getSizes(), vec.getSizes(), (row, column, found), facets.comm)
        vec.destroy()
        return mat


class NormalsThere(typing.NamedTuple):
    """Normals of a surface for given vertex positions.

    Attributes:
        of: Normals of the surface in any position.
        x: Positions of the vertices, (facets, vertices, 3).
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
