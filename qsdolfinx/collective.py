"""Errors that reach every rank, so that a mistake seen by one rank hangs none."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI


@contextlib.contextmanager
def collective_errors(comm: MPI.Intracomm) -> typing.Iterator[None]:
    """Raise on every rank what any rank raises inside the block.

    The block must hold no collective calls: a rank that fails leaves it early. The exception of the
    lowest failing rank is raised on all of them. Collective.

    Args:
        comm: Communicator of the ranks that take part.

    Raises:
        Exception: Whatever was raised inside the block on any rank.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as e:
        error = e
    first = comm.allreduce(comm.rank if error else comm.size, op=MPI.MIN)
    if first == comm.size:
        return
    message = comm.bcast((type(error), str(error)) if error else None, root=first)
    if comm.rank == first:
        assert error is not None
        raise error
    kind, text = message
    raise kind(text) from error
