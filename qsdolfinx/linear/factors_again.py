"""Factors of a solver that an error has ended."""

from __future__ import annotations

from petsc4py import PETSc

from qsdolfinx.linear.presets import EXTRA_MEMORY

#: PETSc's error of a library that it calls.
OF_A_LIBRARY = 76


def begin_afresh(ksp: PETSc.KSP) -> None:
    """Forget what an error in the middle of a solve has left. Collective.

    Work vectors are locked, and a preconditioner counts the solves that it is in, and refuses a
    third one: one with factors is made anew, with the same options.
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
