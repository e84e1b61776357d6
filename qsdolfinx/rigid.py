"""Rigid body modes: what holds a body, and the near-nullspace for algebraic multigrid."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.unknowns import is_vertex_vector, owned_vertices

Array = npt.NDArray[np.float64]


def displacement_space(V: fem.FunctionSpace) -> fem.FunctionSpace | None:
    """V itself or the first sub-space that is a vector field with unknowns at the vertices."""
    if is_vertex_vector(V):
        return V
    subs = (V.sub(i) for i in range(V.num_sub_spaces))
    return next((sub for sub in subs if is_vertex_vector(sub)), None)


def rigid_modes(V: fem.FunctionSpace, num_owned: int) -> Array:
    """Translations and linearised rotations about the origin, shape (modes, num_owned).

    Exact for P1, Q1 and P1 with bubble; unknowns that are not at vertices are zero.

    Args:
        V: Vector space, or sub-space, with unknowns at the vertices.
        num_owned: Owned unknowns of the whole space.
    """
    dofs, x = owned_vertices(V)
    gdim = V.mesh.geometry.dim
    rotations = [(0, 1)] if gdim == 2 else [(0, 1), (1, 2), (2, 0)]
    modes = np.zeros((gdim + len(rotations), num_owned))
    for i in range(gdim):
        modes[i, dofs[:, i]] = 1
    for mode, (i, j) in zip(modes[gdim:], rotations, strict=True):
        mode[dofs[:, i]] = -x[:, j]
        mode[dofs[:, j]] = x[:, i]
    return modes


def is_held(comm: MPI.Intracomm, modes: Array, constrained: npt.NDArray[np.int32]) -> bool:
    """Whether conditions on these owned unknowns leave no rigid mode free. Collective."""
    everywhere = comm.allreduce(modes @ modes.T, op=MPI.SUM)
    held = comm.allreduce(modes[:, constrained] @ modes[:, constrained].T, op=MPI.SUM)
    # Scaled so that a mode held in every unknown has eigenvalue 1, however large the body is.
    factor = np.linalg.inv(np.linalg.cholesky(everywhere))
    return bool(np.linalg.eigvalsh(factor @ held @ factor.T)[0] > 1e-10)
