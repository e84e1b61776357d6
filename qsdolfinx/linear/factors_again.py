"""Reset a linear solver after an error."""

from __future__ import annotations

from petsc4py import PETSc

from qsdolfinx.linear.presets import EXTRA_MEMORY

#: PETSc's error of a library that it calls.
OF_A_LIBRARY = 76


def begin_afresh(ksp: PETSc.KSP) -> None:
    """Reset the solver after an error in the middle of a solve. Collective.

    After such an error, work vectors are locked. A preconditioner counts its nested solves and
    refuses a third one; a preconditioner with factors is created again, with the same options.
    """
    old = ksp.getPC()
    if old.getType() not in (PETSc.PC.Type.LU, PETSc.PC.Type.CHOLESKY):
        old.reset()
        return
    library, operators = old.getFactorSolverType(), old.getOperators()[:2]
    ksp.reset()
    new = PETSc.PC().create(comm=ksp.comm)
    new.setOptionsPrefix(old.getOptionsPrefix())
    new.setOperators(*operators)
    new.setType(old.getType())
    if library is not None:
        new.setFactorSolverType(library)
    new.setFromOptions()
    if library == PETSc.Mat.SolverType.MUMPS:
        new.setFactorSetUpSolverType()
        new.getFactorMatrix().setMumpsIcntl(14, EXTRA_MEMORY)
    ksp.setPC(new)
    ksp.setOperators(*operators)
