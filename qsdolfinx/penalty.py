"""The automatic penalty, from the stiffness of the bodies where they touch."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from qsdolfinx.surface import Surface

#: Ratio of the automatic penalty to the stiffness of the bodies. A uniform pressure p then makes a
#: gap of about 1 % of the change in length of one layer of cells, and the tangent stays well
#: conditioned.
FACTOR = 100.0


def nodal_stiffness(surface: Surface, diagonal: PETSc.Vec, constrained: PETSc.Vec) -> float:
    """Mean of K_kk / S_k over the free nodes of a surface, stress per length. Collective.

    Args:
        surface: Contact surface.
        diagonal: Diagonal of the body's bulk block.
        constrained: Nonzero at unknowns with Dirichlet conditions.

    Returns:
        Infinity if no node is free: a rigid side is no bound on the penalty.
    """
    dofs = surface.node_dofs - diagonal.owner_range[0]
    free = ~np.any(constrained.array_r[dofs] != 0, axis=1)
    stiffness = diagonal.array_r[dofs].mean(axis=1)[free] / surface.node_area[free]
    total, count = surface.comm.allreduce(
        np.array([stiffness.sum(), np.count_nonzero(free)], dtype=np.float64), op=MPI.SUM
    )
    return float(total / count) if count else float("inf")
