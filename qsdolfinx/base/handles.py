"""Handles of PETSc objects for the C++ extension."""

from __future__ import annotations

from petsc4py import PETSc


def handle_of(thing: PETSc.Vec | PETSc.Mat | None) -> int:
    """Handle for the kernels, 0 for None."""
    return 0 if thing is None else int(thing.handle)
