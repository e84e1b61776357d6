"""Functions of multipliers at contact quadrature points, as matrices."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx import _cpp
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.system.entries import Entries

Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


def of_sides(gap: WeightedGap) -> PETSc.Mat:
    """New matrix N on the unknowns of the slave that represent patches of nodes. Collective."""
    offset, unknowns, values = gap.operator.functions
    row = np.repeat(np.arange(gap.num_rows, dtype=np.int64), np.diff(offset))
    return Entries(row, unknowns, values).matrix(gap.num_rows, layout(gap.slave)[0], gap.slave.comm)


def extended(
    slave: Surface, free: Flags, numbers: Indices, num_local: int, extension: Extension | None
) -> PETSc.Mat:
    """New matrix E from free unknowns to all patches of nodes. Collective.

    Args:
        slave: Surface of the multipliers.
        free: Patches with a free unknown, (nodes, block).
        numbers: Numbers of these unknowns among the columns, over all ranks.
        num_local: Number of columns of this rank.
        extension: Patches whose multipliers are means of others; None without.
    """
    num_sides, first = layout(slave)
    dofs = slave.node_dofs[free] - first
    mat = Entries(dofs, numbers, np.ones(len(dofs))).matrix(num_sides, num_local, slave.comm)
    if extension is not None:
        at = slave.node_dofs
        row, column, value = extension.entries(at, np.ones(at.shape))
        means = PETSc.Mat().create(comm=slave.comm)
        means.setSizes(((num_sides, PETSc.DETERMINE),) * 2)
        means.setType(PETSc.Mat.Type.AIJ)
        _cpp.set_places(means.handle, row, column)  # some entries are in rows of other ranks
        _cpp.set_values(means.handle, value)
        first_means = means.matMult(mat)
        second = means.matMult(first_means)
        for part in (first_means, second):
            mat.axpy(1.0, part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            part.destroy()
        means.destroy()
    return mat


def layout(slave: Surface) -> tuple[int, int]:
    """Number of unknowns of the slave's body on this rank, and the first unknown."""
    vec = slave.create_vec()
    out = vec.getLocalSize(), vec.owner_range[0]
    vec.destroy()
    return out
