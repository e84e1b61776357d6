"""Exceptions that pass through PETSc, from what it calls to who has called it."""

from __future__ import annotations

import contextlib
import gc
import typing


@contextlib.contextmanager
def passing(keep: typing.Callable[[BaseException], None] | None = None) -> typing.Iterator[None]:
    """Let what is raised in the block, or in a function that is decorated, pass through PETSc.

    At each of PETSc's functions on the way petsc4py makes a text while the exception is pending. If
    garbage collection begins just then, Python drops the exception, and petsc4py (3.22) refers to
    what is no longer there: a segmentation fault. So garbage is collected before; what is made on
    the way is too little for another collection.

    Args:
        keep: Is given the exception, of which PETSc makes an error of its own.
    """
    try:
        yield
    except BaseException as error:
        if keep is not None:
            keep(error)
        gc.collect(0)
        raise
