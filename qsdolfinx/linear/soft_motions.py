"""Correct iterative solutions along motions that the tangent hardly resists."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.system.rigid_modes import RigidMotion
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Resistance of a motion m, |A m| over |diag(A) m|, below which the motion counts as soft. Springs
#: on the diagonal have 1e-9; elastic bodies have more than the square of cell size over length.
SOFT = 1e-6


class SoftMotions:
    """Solve exactly for rigid motions with almost no resistance, after each linear solve.

    Conditions and active constraints leave these motions free, and the regularisation on the
    diagonal of the tangent is tiny, see :class:`Hold`. A residual that is negligible relative to
    the forces then moves bodies by many times their size. So the part of a solution x along these
    motions M is replaced such that Mᵀ (b - A x) = 0, as factors of the tangent would give it.

    This object must not refer to the linear solver: PETSc keeps it where Python's garbage collector
    does not see it.

    Args:
        system: The system.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        #: Owned values of the motions, shape (motions, unknowns), and the inverse of Mᵀ A M.
        self._motions: Array = np.zeros((0, 0))
        self._inverse: Array = np.zeros((0, 0))

    @property
    def count(self) -> int:
        """Number of these motions for the present tangent."""
        return len(self._motions)

    def forget(self) -> None:
        """Remove the motions: there is no tangent, or a tangent for a direct solver."""
        self._motions = np.zeros((0, 0))

    def find(self, free: Array | None = None) -> None:
        """Find the motions for the tangent that has been assembled. Collective.

        Args:
            free: Motions that active constraints do not resist, from ``Hold.free_motions``; by
                default the motions that were regularised last.
        """
        self.forget()
        system = self._system
        free = system.made.hold.held if free is None else free
        if free.shape[1] == 0:
            return
        rigid = system.made.rigid
        motions = np.array([self._values(rigid, c) for c in free.T])
        diagonal = system.matrix.getDiagonal()
        products = np.array([self.product(m) for m in motions])
        scaled = diagonal.array_r * motions
        diagonal.destroy()
        local = np.array([products @ products.T, scaled @ scaled.T])
        resisted, whole = system.comm.allreduce(local, op=MPI.SUM)
        values, vectors = np.linalg.eigh(resisted)
        soft = vectors[:, values <= SOFT**2 * np.trace(whole) / len(whole)].T
        stiffness = system.comm.allreduce((soft @ motions) @ (soft @ products).T, op=MPI.SUM)
        self._motions, self._inverse = soft @ motions, np.linalg.pinv(stiffness)

    def _values(self, rigid: RigidMotion, coefficients: Array) -> Array:
        """Owned unknowns in a motion, given by coefficients of all modes."""
        system, parts = self._system, []
        for i, (body, scale) in enumerate(zip(system.bodies, system.scales, strict=True)):
            part = rigid.displacement(coefficients, i) / scale
            part[body.owned_constrained] = 0.0  # they are zero up to rounding
            parts.append(part)
        return np.concatenate(parts)

    def product(self, values: Array) -> Array:
        """The tangent times owned values. Collective."""
        x, y = self._system.matrix.createVecs()
        x.array[:] = values
        self._system.matrix.mult(x, y)
        out: Array = y.array_r.copy()
        x.destroy()
        y.destroy()
        return out

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Correct a solution: called by PETSc at the end of a linear solve. Collective."""
        if self.count == 0 or ksp.getConvergedReason() < 0:
            return
        x.array[:] += self.change(b.array_r - self.product(x.array_r))

    def change(self, residual: Array) -> Array:
        """Correction along the motions for a solution with this residual, owned values.

        Collective.
        """
        left = self._system.comm.allreduce(self._motions @ residual, op=MPI.SUM)
        return np.asarray((self._inverse @ left) @ self._motions)
