"""The automatic penalty, from the stiffness of the bodies where they touch."""

from __future__ import annotations

import math
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from qsdolfinx.surface import Surface

#: Ratio of the automatic penalty to the stiffness of the bodies. A uniform pressure p then makes a
#: gap of about 1 % of the change in length of one layer of cells, and the tangent stays well
#: conditioned.
FACTOR = 100.0


def nodal_stiffness(surface: Surface, matrix: PETSc.Mat, constrained: PETSc.Vec) -> float:
    """Mean of K_kk / S_k over the free unknowns of a surface, stress per length. Collective.

    Args:
        surface: Contact surface.
        matrix: The body's bulk block.
        constrained: Nonzero at unknowns with Dirichlet conditions.

    Returns:
        Infinity if no unknown is free: a rigid side is no bound on the penalty.
    """
    diagonal = matrix.getDiagonal()
    dofs = surface.node_dofs - diagonal.owner_range[0]
    free = constrained.array_r[dofs] == 0
    stiffness = (diagonal.array_r[dofs] / surface.node_area[:, None])[free]
    diagonal.destroy()
    total, count = surface.comm.allreduce(
        np.array([stiffness.sum(), stiffness.size], dtype=np.float64), op=MPI.SUM
    )
    return float(total / count) if count else float("inf")


def automatic_penalty(stiffness: typing.Sequence[float]) -> float:
    """The penalty, stress per length, for the nodal stiffness of the two sides.

    Raises:
        ValueError: If neither gives a positive number.
    """
    penalty = FACTOR * min(stiffness)
    if not (math.isfinite(penalty) and penalty > 0):
        raise ValueError(
            'penalty: "auto" needs unknowns without Dirichlet conditions and with stiffness on the '
            "contact surfaces; give a number instead"
        )
    return penalty
