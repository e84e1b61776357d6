"""Values of a body's vectors at the nodes of a surface's facets."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


class TraceValues:
    """Reads the values of a body's vectors at the trace unknowns of this rank's facets.

    Args:
        surface: The surface.
        dofs: Global unknowns to read instead of these, shape (facets, nodes, gdim).
    """

    def __init__(self, surface: Surface, dofs: npt.NDArray[np.int64] | None = None) -> None:
        dofs = surface.trace_dofs[0] if dofs is None else dofs
        self._shape, self._block = dofs.shape, surface.block
        wanted = PETSc.IS().createGeneral(dofs.ravel().astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._local = PETSc.Vec().createSeq(dofs.size, comm=PETSc.COMM_SELF)
        layout = surface.create_vec()
        self._scatter = PETSc.Scatter().create(layout, wanted, self._local, None)
        for thing in (wanted, layout):
            thing.destroy()

    def __call__(self, vec: PETSc.Vec) -> Array:
        """Values, with zeros in extra components, shape (facets, nodes, 3). Collective."""
        self._scatter.scatter(vec, self._local)
        out = np.zeros((*self._shape[:2], 3))
        out[..., : self._block] = self._local.array_r.reshape(self._shape)
        return out
