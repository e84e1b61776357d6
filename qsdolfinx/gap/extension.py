"""Multipliers where conditions hold both sides: they follow from those of the nodes around."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.gap.rows import NodeRows
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Facets between a node and the next whose multiplier may be an unknown: in a corner all nodes of a
#: triangle are held.
_SWEEPS = 2


class Extension:
    """Which components of the multipliers at the rows of a pass are no unknowns, and what they are.

    Where both bodies are held along the surface alone, as on a plane of symmetry, such a component
    is zero: beyond the plane its sign is the other. Where they are clamped as a whole it is the
    mean of the neighbours', so that a uniform multiplier stays uniform.

    Args:
        slave: Surface that carries the multiplier.
        rows: Rows of the pass.
        held: Components that conditions hold on both sides, shape (rows, width).
        clamped: Those of them at nodes that are held as a whole, of the same shape.
    """

    def __init__(self, slave: Surface, rows: NodeRows, held: Flags, clamped: Flags) -> None:
        #: Components that are no unknowns, shape (rows, width).
        self.held = held
        self._clamped = clamped
        self._slave = slave
        self._columns, (self._at, corners) = rows.dofs(held.shape[1])
        self._shape, self._corners = corners.shape, np.ascontiguousarray(corners).ravel()

    def fill(self, values: Array, closed: Flags) -> Array:
        """The multipliers with these components in place. Collective.

        Args:
            values: λ or τ, shape (rows, width).
            closed: Rows in contact; held ones that are not have no multiplier.
        """
        out = np.where(self.held, 0.0, values)
        vecs = [self._slave.create_vec() for _ in range(4)]
        local = PETSc.Vec().createSeq(len(self._corners), comm=PETSc.COMM_SELF)
        here = PETSc.IS().createGeneral(self._corners.astype(PETSc.IntType), PETSc.COMM_SELF)
        scatter = PETSc.Scatter().create(vecs[0], here, local, None)
        known = ~self.held
        for _ in range(_SWEEPS):
            sums, counts = self._sums(vecs, local, scatter, np.where(known, out, 0.0), known)
            new = self._clamped & ~known & (counts > 0)
            out[new] = sums[new] / counts[new]
            known = known | new
        for thing in (*vecs, local, here, scatter):
            thing.destroy()
        return np.where(self.held & ~closed[:, None], 0.0, out)

    def _sums(
        self,
        vecs: list[PETSc.Vec],
        local: PETSc.Vec,
        scatter: PETSc.Scatter,
        values: Array,
        known: Flags,
    ) -> tuple[Array, Array]:
        """Sums of values, and the number of known ones, over the facets around each row."""
        found = np.zeros((2, *values.shape))
        for columns in self._columns:
            for i, (array, vec, total) in enumerate(
                zip((values, known), vecs[:2], vecs[2:], strict=True)
            ):
                vec.zeroEntries()
                total.zeroEntries()
                at = self._at - vec.owner_range[0]
                vec.array[at] = array[:, columns]
                scatter.scatter(vec, local)
                corners = local.array_r.reshape(self._shape)
                around = np.broadcast_to(corners.sum(axis=1, keepdims=True), self._shape)
                local.array[:] = around.ravel()
                mode = PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE
                scatter.scatter(local, total, *mode)
                found[i, :, columns] = total.array_r[at]
        return found[0], found[1]
