"""Errors that reach every rank, so that a mistake seen by one rank hangs none."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI

#: Exceptions that can be raised on other ranks from their text alone.
_PLAIN = (
    ValueError,
    TypeError,
    RuntimeError,
    IndexError,
    OSError,
    FileNotFoundError,
    FileExistsError,
    NotADirectoryError,
    PermissionError,
)


@contextlib.contextmanager
def collective_errors(comm: MPI.Intracomm) -> typing.Iterator[None]:
    """Raise on every rank what any rank raises inside the block.

    The block must hold no collective calls: a rank that fails leaves it early. The exception of the
    lowest failing rank is raised on all of them. Collective.

    Args:
        comm: Communicator of the ranks that take part.

    Raises:
        Exception: Whatever was raised inside the block on any rank. Ranks that did not raise it get
            a RuntimeError in its place if it is not a built-in exception made from a single text.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as e:
        error = e
    first = comm.allreduce(comm.rank if error else comm.size, op=MPI.MIN)
    if first == comm.size:
        return
    name, text = comm.bcast((type(error).__name__, str(error)) if error else None, root=first)
    if comm.rank == first:
        assert error is not None
        raise error
    kind = {k.__name__: k for k in _PLAIN}.get(name)
    if kind is None and type(error).__name__ == name:
        assert error is not None
        raise error
    raise (RuntimeError(f"{name}: {text}") if kind is None else kind(text)) from error


def check_agreement(comm: MPI.Intracomm, **arguments: object) -> None:
    """Refuse arguments that differ between ranks. Collective, not for use in collective_errors.

    Args:
        comm: Communicator of the ranks that take part.
        arguments: Values by the names that the error is to give; compared by their ``repr``.

    Raises:
        ValueError: If one of them differs.
    """
    mine = {name: repr(value) for name, value in arguments.items()}
    first = comm.bcast(mine, root=0)
    for name in first:
        if comm.allreduce(mine.get(name) != first[name], op=MPI.LOR):
            raise ValueError(f"{name}: must be the same on all ranks")
