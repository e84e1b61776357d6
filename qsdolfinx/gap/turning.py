"""Gaps between tied surfaces that turn with the slave."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.affine import trace_positions, trace_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]

#: Gap, in units of the smallest facet, that is none but for rounding.
NONE = 1e-12


class Turning:
    """What is between two surfaces when they are tied: it stays, as seen from the slave.

    Facets of curved surfaces that do not match have gaps d between them, along the normals n of the
    slave. Where both bodies turn, d does, too: R d with the rotation R that takes n to where it is
    now. A jump that was counted from d as it was would strain bodies that only turn.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        operator: Of the jump x_slave − x_master, whose mean is −d.
    """

    def __init__(self, slave: Surface, master: AnySurface, operator: _cpp.GapOperator) -> None:
        self._slave, self._node = slave, operator.row_node
        self._values = TraceValues(slave)
        self._twin = slave.twin()
        self._at: Array = trace_positions(slave).copy()
        self._base = self._at
        self._normal = self._normals(self._at)
        self._gap = self._between(master, operator)

    def _between(self, master: AnySurface, operator: _cpp.GapOperator) -> Array:
        """D of each row, (rows, 3)."""
        gdim, out = self._slave.gdim, np.zeros((len(self._node), 3))
        vecs = [trace_vec(self._slave, self._at[..., :gdim])]
        if isinstance(master, Surface):
            vecs.append(trace_vec(master, trace_positions(master)[..., :gdim]))
            out[:, :gdim] = -operator.apply(*(vec.handle for vec in vecs))
        for vec in vecs:
            vec.destroy()
        return np.where(np.abs(out) > NONE * self._slave.facet_size_range[0], out, 0.0)

    def set_offset(self, offset: PETSc.Vec | None) -> None:
        """Count displacements from where the surface was read last, and an offset. Collective."""
        at = trace_positions(self._slave)
        self._base = at.copy() if offset is None else at + self._values(offset)

    def change(self, u: PETSc.Vec, scale: float) -> Array:
        """What has changed of d, (rows, gdim), for unknowns of the slave. Collective."""
        now = self._normals(self._base + scale * self._values(u))
        return (_turned(self._normal, now, self._gap) - self._gap)[:, : self._slave.gdim]

    def _normals(self, x: Array) -> Array:
        """Normals of the rows' nodes with the facets there, (rows, 3). Collective."""
        self._twin.follow(np.ascontiguousarray(x))
        self._twin.measure_nodes()
        return np.asarray(self._twin.node_normal)[self._node]


def _turned(before: Array, now: Array, vectors: Array) -> Array:
    """Vectors turned by the smallest rotations that take one normal to the other, (n, 3)."""
    axis = np.cross(before, now)  # sin α times the axis
    cosine = np.sum(before * now, axis=1, keepdims=True)
    once = np.cross(axis, vectors)
    rest = np.cross(axis, once) / np.maximum(1 + cosine, 1e-12)
    return np.asarray(vectors + once + rest)
