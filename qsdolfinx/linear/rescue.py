"""A direct solver in the place of an iterative one that has failed, until contact pairs anew."""

from __future__ import annotations

from petsc4py import PETSc

from qsdolfinx.linear.presets import EXTRA_MEMORY
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.system import ContactSystem

#: Unknowns in 2D and 3D up to which a direct solver may take over: more cost too much memory.
LARGEST = {2: 2_000_000, 3: 200_000}

_REASONS = PETSc.KSP.ConvergedReason
#: Failures that another solver may not share.
_FAILURES = (
    _REASONS.DIVERGED_MAX_IT,
    _REASONS.DIVERGED_BREAKDOWN,
    _REASONS.DIVERGED_INDEFINITE_MAT,
    _REASONS.DIVERGED_INDEFINITE_PC,
)


class Rescue:
    """The tangent as one AIJ matrix, and LU factors of it as the preconditioner of a solver.

    Args:
        ksp: The linear solver that has failed.
        system: The system.
    """

    def __init__(self, ksp: PETSc.KSP, system: ContactSystem) -> None:
        self._ksp, self._system = ksp, system
        #: What is factorised.
        self.matrix: PETSc.Mat = self._formed()
        pc = ksp.getPC()
        pc.reset()
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.setNormType(PETSc.KSP.NormType.NONE)
        ksp.setOperators(system.matrix, self.matrix)
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(14, EXTRA_MEMORY)

    @staticmethod
    def helps(ksp: PETSc.KSP) -> bool:
        """Whether the last solve failed in a way that a direct solver may not share."""
        return ksp.getConvergedReason() in _FAILURES

    @staticmethod
    def is_small_enough(system: ContactSystem) -> bool:
        """Whether a problem is of a size for a direct solver."""
        dim = system.bodies[0].V.mesh.geometry.dim
        return bool(system.x.getSize() <= LARGEST[dim])

    def update(self) -> None:
        """Follow the tangent, which has changed. Collective."""
        if self.matrix.handle == self._system.matrix.handle:
            return
        formed = self._formed()
        formed.copy(self.matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        formed.destroy()

    def _formed(self) -> PETSc.Mat:
        """The tangent, as a new AIJ matrix unless it is one. Collective."""
        tangent, matrix = self._system.made.tangent, self._system.matrix
        if isinstance(tangent, Additive):
            return tangent.sum.formed()
        if matrix.getType() == PETSc.Mat.Type.NEST:
            return matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        return matrix

    def end(self) -> None:
        """Give the solver back its options. Collective."""
        pc = self._ksp.getPC()
        pc.reset()
        pc.setType(PETSc.PC.Type.NONE)
        self._ksp.setFromOptions()
        if self.matrix.handle != self._system.matrix.handle:
            self.matrix.destroy()
