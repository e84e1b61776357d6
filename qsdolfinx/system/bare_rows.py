"""Unknowns that a form says nothing of, such as those of cells that it is not integrated over."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl

from qsdolfinx.compat import cell_nodes

if typing.TYPE_CHECKING:
    from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]


def is_everywhere(form: ufl.Form) -> bool:
    """Whether any of its integrals is over all cells of the mesh."""
    return any(
        part.integral_type() == "cell" and part.subdomain_id() == "everywhere"
        for part in form.integrals()
    )


def unrolled(blocks: Indices, size: int) -> Indices:
    """Unknowns of blocks of this size."""
    return (blocks[:, None] * size + np.arange(size, dtype=np.int32)).ravel().astype(np.int32)


def check_rows(body: Body, matrix: PETSc.Mat) -> None:
    """Refuse a body with free unknowns that its form gives no equation. Collective.

    Those of cells that the form is not integrated over; of a form that is linear also those whose
    rows are zero, since they stay so.

    Args:
        body: The body.
        matrix: Its K, assembled, with ones or the like in the rows of Dirichlet conditions.

    Raises:
        ValueError: On all ranks.
    """
    bare = np.intersect1d(body.bare, body.free)
    if body.linear:
        some = np.intersect1d(np.flatnonzero(body.diagonal == 0), body.free)
        first = matrix.getOwnershipRange()[0]
        rows = [k for k in some if not np.any(matrix.getRow(int(first + k))[1])]
        bare = np.union1d(bare, np.array(rows, dtype=np.int64))
    counts = body.comm.allreduce(np.array([len(bare), len(body.free)]), op=MPI.SUM)
    if counts[0] == 0 or (counts[0] == counts[1] and len(body.bare) == 0):
        return
    low, high = _box(body, bare)
    raise ValueError(
        f"F: entry {body.number} gives no equation for {counts[0]} of the {counts[1]} unknowns of "
        f"u[{body.number}] that no condition holds: in cells with midpoints from {low} to {high}, "
        "over which it has no integral, or where its coefficients are zero; hold these unknowns by Dirichlet "
        "conditions, make the body of a sub-mesh of the other cells (dolfinx.mesh.create_submesh), "
        "or give all cells a stiffness"
    )


def _box(body: Body, unknowns: npt.NDArray[np.int64]) -> tuple[str, str]:
    """Corners of the box around the cells with these owned unknowns, as texts. Collective."""
    V, msh = body.V, body.V.mesh
    blocks = np.unique(unknowns // V.dofmap.index_map_bs)
    cells = np.flatnonzero(np.any(np.isin(V.dofmap.list, blocks), axis=1)).astype(np.int32)
    x = _middles(msh, cells)
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high])
    body.comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    d = msh.geometry.dim
    low, high = -corners[:3], corners[3:]
    texts = [", ".join(f"{value:.4g}" for value in corner[:d]) for corner in (low, high)]
    return f"({texts[0]})", f"({texts[1]})"


def _middles(msh: typing.Any, cells: Indices) -> Array:
    """Midpoints of cells, (cells, 3)."""
    nodes = cell_nodes(msh)[cells]
    return np.asarray(msh.geometry.x[nodes].mean(axis=1).reshape(-1, 3))
