"""Let exceptions pass through PETSc, from its callbacks to its caller."""

from __future__ import annotations

import contextlib
import gc
import typing


@contextlib.contextmanager
def passing(keep: typing.Callable[[BaseException], None] | None = None) -> typing.Iterator[None]:
    """Let exceptions of the block, or of a decorated function, pass through PETSc.

    At each PETSc function on the way, petsc4py creates a text while the exception is pending. If
    garbage collection starts at this moment, Python drops the exception, and petsc4py (3.22) refers
    to an object that no longer exists: a segmentation fault. So garbage is collected before. The
    few objects created on the way do not start another collection.

    Args:
        keep: Called with the exception, because PETSc replaces it by its own error.
    """
    try:
        yield
    except BaseException as error:
        if keep is not None:
            keep(error)
        gc.collect(0)
        raise
