"""Symmetric matrices: how they are recognised, and stored."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np


def is_symmetric(mat: PETSc.Mat) -> bool:
    """Whether xᵀ A y = yᵀ A x for two irregular vectors. Collective."""
    if is_halved(mat):
        return True
    x, y = mat.createVecs()
    Ax, Ay = x.duplicate(), x.duplicate()
    for seed, vec in enumerate((x, y)):
        # Vectors are the same on any partition, and not by chance in A's null space.
        index = np.arange(*vec.owner_range)
        vec.array[:] = np.sin(1.0 + (seed + 1.7) * (index % 9973) ** 1.3)
    mat.mult(x, Ax)
    mat.mult(y, Ay)
    size = Ax.norm() * y.norm() + Ay.norm() * x.norm()
    out = abs(y.dot(Ax) - x.dot(Ay)) <= 1e-12 * size
    for vec in (x, y, Ax, Ay):
        vec.destroy()
    return bool(out)


def halved(mat: PETSc.Mat) -> PETSc.Mat:
    """The matrix in PETSc's symmetric format if it is symmetric, otherwise itself. Collective.

    Args:
        mat: Matrix with blocks (BAIJ), which is destroyed if there is a new one.
    """
    if not is_symmetric(mat):
        return mat
    out: PETSc.Mat = mat.convert(PETSc.Mat.Type.SBAIJ, PETSc.Mat())
    mat.destroy()
    return out


def is_halved(mat: PETSc.Mat) -> bool:
    """Whether a matrix has PETSc's symmetric format."""
    return mat.getType() in ("seqsbaij", "mpisbaij")
