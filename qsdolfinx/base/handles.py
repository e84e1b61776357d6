"""PETSc's objects as the extension takes them."""

from __future__ import annotations

from petsc4py import PETSc


def handle_of(thing: PETSc.Vec | PETSc.Mat | None) -> int:
    """Handle for the kernels, 0 where there is nothing."""
    return 0 if thing is None else int(thing.handle)
