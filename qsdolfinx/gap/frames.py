"""Co-rotated frames at the nodes of a surface."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


class Frames:
    """Orthonormal frames at the owned nodes: the normal, and tangents that turn with the facets.

    In 3D the first tangent is the sum, over the facets at a node, of the vectors from the node to
    the facet centres. Each vector is multiplied by a number of the facet that does not depend on
    the partition. The tangent is a material direction, and no symmetry of the mesh makes it vanish.

    Args:
        surface: The surface.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface, self._twin = surface, surface.twin()
        nv = surface.num_facet_vertices
        #: Numbers of the facets; below, unknowns of their vertices.
        self._number = surface.facet_numbers
        dofs = surface.trace_dofs[0][:, :nv]
        self._dofs = np.ascontiguousarray(dofs.ravel().astype(PETSc.IntType))

    def at(self, x: Array) -> Array:
        """Frames for given positions of the trace's nodes, as columns, (nodes, gdim, gdim).

        Collective.

        Args:
            x: Positions of the trace's nodes, shape (facets, nodes, 3).
        """
        surface, gdim = self._surface, self._surface.gdim
        self._twin.follow(np.ascontiguousarray(x))
        self._twin.measure_nodes()
        normal = np.asarray(self._twin.node_normal)
        if gdim == 2:
            along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
            return np.stack([normal[:, :2], along], axis=2)
        vertices = x[:, : surface.num_facet_vertices]
        ways = (vertices.mean(axis=1, keepdims=True) - vertices) * self._number[:, None, None]
        vec = surface.create_vec()
        vec.setValues(self._dofs, ways.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        vec.assemble()
        direction = vec.array_r[surface.node_dofs - vec.owner_range[0]].copy()
        vec.destroy()
        direction -= np.sum(direction * normal, axis=1, keepdims=True) * normal
        size = np.linalg.norm(direction, axis=1, keepdims=True)
        first = np.divide(direction, size, out=np.zeros_like(direction), where=size > 0)
        return np.stack([normal, first, np.cross(normal, first)], axis=2)


def turned(vectors: Array, before: Array, now: Array) -> Array:
    """Rotate vectors with the frames of their nodes; shape (nodes, gdim)."""
    local = np.einsum("nij,ni->nj", before, vectors)
    return np.asarray(np.einsum("nij,nj->ni", now, local))
