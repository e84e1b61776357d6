"""Check for unknowns without an equation, such as those of cells without an integral."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from qsdolfinx.compat import cell_nodes

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]


def is_everywhere(form: ufl.Form) -> bool:
    """Whether any of its integrals is over all cells of the mesh."""
    return any(
        part.integral_type() == "cell" and part.subdomain_id() == "everywhere"
        for part in form.integrals()
    )


def unrolled(blocks: Indices, size: int) -> Indices:
    """Unknowns of all components of blocks of this size."""
    return (blocks[:, None] * size + np.arange(size, dtype=np.int32)).ravel().astype(np.int32)


def check_rows(
    number: int, V: fem.FunctionSpace, free: Indices, bare: Indices, matrix: PETSc.Mat | None
) -> None:
    """Raise an error if the form of a body has no equation for free unknowns. Collective.

    These are unknowns of cells over which the form is not integrated. For a linear form they are
    also unknowns with zero rows, since these rows stay zero.

    Args:
        number: Place of the body in the list of bodies.
        V: Function space of the body.
        free: Owned unknowns without Dirichlet conditions.
        bare: Owned unknowns without an entry in K.
        matrix: Assembled K of a linear form; None for other forms.

    Raises:
        ValueError: On all ranks.
    """
    comm: MPI.Intracomm = V.mesh.comm
    found = np.intersect1d(bare, free)
    if matrix is not None:
        found = np.union1d(found, np.intersect1d(_zero_rows(matrix), free))
    counts = comm.allreduce(np.array([len(found), len(free), len(bare)]), op=MPI.SUM)
    if counts[0] == 0 or (counts[0] == counts[1] and counts[2] == 0):
        return  # a body with a zero form has only the equations of contact
    low, high = _box(V, found)
    raise ValueError(
        f"F: entry {number} gives no equation for {counts[0]} of the {counts[1]} unknowns of "
        f"u[{number}] without a condition: in cells with midpoints from {low} to {high}, over "
        "which it has no integral, or where its coefficients are zero; constrain these unknowns "
        "by Dirichlet conditions, make the body of a sub-mesh of the other cells "
        "(dolfinx.mesh.create_submesh), or give all cells a stiffness"
    )


def _zero_rows(matrix: PETSc.Mat) -> Indices:
    """Owned rows without nonzero entries, numbered from the first row of this rank."""
    diagonal = matrix.getDiagonal()
    some = np.flatnonzero(diagonal.array_r == 0)
    diagonal.destroy()
    first = matrix.getOwnershipRange()[0]
    rows = [k for k in some if not np.any(matrix.getRow(int(first + k))[1])]
    return np.array(rows, dtype=np.int32)


def _box(V: fem.FunctionSpace, unknowns: Indices) -> tuple[str, str]:
    """Corners, as texts, of the box of midpoints of these unknowns' cells. Collective."""
    msh = V.mesh
    blocks = np.unique(unknowns // V.dofmap.index_map_bs)
    cells = np.flatnonzero(np.any(np.isin(V.dofmap.list, blocks), axis=1)).astype(np.int32)
    x = _middles(msh, cells)
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high])
    msh.comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    d = msh.geometry.dim
    low, high = -corners[:3], corners[3:]
    texts = [", ".join(f"{value:.4g}" for value in corner[:d]) for corner in (low, high)]
    return f"({texts[0]})", f"({texts[1]})"


def _middles(msh: typing.Any, cells: Indices) -> Array:
    """Midpoints of cells, (cells, 3)."""
    nodes = cell_nodes(msh)[cells]
    return np.asarray(msh.geometry.x[nodes].mean(axis=1).reshape(-1, 3))
