"""Symmetric matrices: how they are recognised, and stored."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

#: Largest difference of a row's products, over its diagonal entry, with which a matrix is stored by
#: half: rounding leaves less than 1e-13, and what is larger would be lost.
SAME = 1e-12


def is_symmetric(mat: PETSc.Mat) -> bool:
    """Whether xᵀ A y = yᵀ A x for two irregular vectors. Collective."""
    if is_halved(mat):
        return True
    x, y = mat.createVecs()
    Ax, Ay = x.duplicate(), x.duplicate()
    for seed, vec in enumerate((x, y)):
        _fill(vec, seed)  # not by chance in A's null space
    mat.mult(x, Ax)
    mat.mult(y, Ay)
    size = Ax.norm() * y.norm() + Ay.norm() * x.norm()
    out = abs(y.dot(Ax) - x.dot(Ay)) <= 1e-12 * size
    for vec in (x, y, Ax, Ay):
        vec.destroy()
    return bool(out)


def halved(mat: PETSc.Mat) -> PETSc.Mat:
    """The matrix in PETSc's symmetric format if it is symmetric, otherwise itself. Collective.

    Each row is compared: in one number for all, a soft part would be hidden by a stiff one.

    Args:
        mat: Matrix with blocks (BAIJ), which is destroyed if there is a new one.
    """
    if not is_symmetric(mat):
        return mat
    out: PETSc.Mat = mat.convert(PETSc.Mat.Type.SBAIJ, PETSc.Mat())
    x, expected = mat.createVecs()
    _fill(x, 0)
    mat.mult(x, expected)
    found, diagonal = expected.duplicate(), mat.getDiagonal()
    out.mult(x, found)
    found.axpy(-1.0, expected)
    same = bool(np.all(np.abs(found.array_r) <= SAME * np.abs(diagonal.array_r)))
    same = mat.comm.tompi4py().allreduce(same, op=MPI.LAND)
    for vec in (x, expected, found, diagonal):
        vec.destroy()
    (mat if same else out).destroy()
    return out if same else mat


def _fill(vec: PETSc.Vec, seed: int) -> None:
    """Fill with irregular numbers up to 1, which do not depend on the partition."""
    index = np.arange(*vec.owner_range)
    vec.array[:] = np.sin(1.0 + (seed + 1.7) * (index % 9973) ** 1.3)


def is_halved(mat: PETSc.Mat) -> bool:
    """Whether a matrix has PETSc's symmetric format."""
    return mat.getType() in ("seqsbaij", "mpisbaij")
