"""Frames of the nodes of a surface, which turn with it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import trace_vec
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


class Frames:
    """Orthonormal frames at the owned nodes: the normal, and what turns with the facets around it.

    In 3D a second direction is the sum over the facets at a node of an edge of each, times a number
    that belongs to the facet: a direction of the material, which no symmetry of the mesh cancels.

    Args:
        surface: The surface.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface, self._twin = surface, surface.twin()
        dofs = surface.trace_dofs[0][:, :, 0]
        least = dofs[:, : surface.num_facet_vertices].min(axis=1, initial=2**62)
        #: Numbers of the facets, the same on any rank that has them.
        self._number: Array = 1.5 + np.sin(1.0 + 1.7 * (least % 9973))

    def at(self, x: Array) -> Array:
        """Frames with the trace's nodes at these places, columns, (nodes, gdim, gdim). Collective.

        Args:
            x: Shape (facets, nodes, 3).
        """
        surface, gdim = self._surface, self._surface.gdim
        self._twin.follow(np.ascontiguousarray(x))
        self._twin.measure_nodes()
        normal = np.asarray(self._twin.node_normal)
        if gdim == 2:
            along = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
            return np.stack([normal[:, :2], along], axis=2)
        edge = (x[:, 1] - x[:, 0]) * self._number[:, None]
        vec = trace_vec(surface, np.repeat(edge[:, None], x.shape[1], axis=1))
        direction = vec.array_r[surface.node_dofs - vec.owner_range[0]].copy()
        vec.destroy()
        direction -= np.sum(direction * normal, axis=1, keepdims=True) * normal
        size = np.linalg.norm(direction, axis=1, keepdims=True)
        first = np.divide(direction, size, out=np.zeros_like(direction), where=size > 0)
        return np.stack([normal, first, np.cross(normal, first)], axis=2)


def turned(vectors: Array, before: Array, now: Array) -> Array:
    """Vectors that turn with frames, shape (nodes, gdim)."""
    local = np.einsum("nij,ni->nj", before, vectors)
    return np.asarray(np.einsum("nij,nj->ni", now, local))
