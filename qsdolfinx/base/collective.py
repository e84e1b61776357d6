"""Errors that reach every rank, so that a mistake seen by one rank hangs none."""

from __future__ import annotations

import contextlib
import hashlib
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.checks import Kind, check

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
    KeyboardInterrupt,
    SystemExit,
)

_ANYTHING = Kind("anything", lambda value: True)

#: Attribute of errors that all ranks raise.
_MARK = "_qsdolfinx_of_all_ranks"

#: Blocks of ``checked`` that this rank is in.
_open: list[Same] = []


class Same:
    """Takes arguments that must be the same on all ranks, see :func:`checked`."""

    def __init__(self) -> None:
        #: What was taken, as text, by name.
        self.given: dict[str, str] = {}

    def __call__(self, kind: Kind = _ANYTHING, /, **arguments: typing.Any) -> None:
        """Check arguments here, and against those of the other ranks at the end of the block.

        Args:
            kind: What they must be.
            arguments: Values by the names that the error is to give; compared by their ``repr``,
                NumPy's arrays and numbers by that of what they hold.
        """
        check(kind, **arguments)
        for name, value in arguments.items():
            plain = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
            self.given[name] = repr(plain)


@contextlib.contextmanager
def checked(comm: MPI.Intracomm) -> typing.Iterator[Same]:
    """Check the arguments of a call inside the block, with one reduction at its end. Collective.

    ::

        with checked(comm) as same:
            check(MESH, msh=msh)
            same(POSITIVE, radius=radius)

    refuses, on every rank, what any rank finds wrong, and what ``same`` was given and differs.
    Ranks may fail each for its own reason, or hand ``same`` different things. The block must hold
    no collective calls: a rank that fails leaves it early.

    Args:
        comm: Communicator of the ranks that take part.

    Yields:
        Takes the arguments that must be the same on all ranks.

    Raises:
        Exception: What the lowest failing rank raised; see :func:`collective_errors`.
        ValueError: If no rank fails, and an argument differs.
    """
    same = Same()
    error: BaseException | None = None
    _open.append(same)
    try:
        yield same
    except BaseException as e:
        error = e
    finally:
        _open.remove(same)
    _settle(comm, error, same.given)


@contextlib.contextmanager
def checked_once(comm: MPI.Intracomm) -> typing.Iterator[Same]:
    """As :func:`checked`, but inside a block of ``checked`` or ``collective_errors`` left to that.

    For what is set in callbacks, too, such as a stepper's ``drive``: another rank may have raised
    before, and would not take part in a reduction here. Collective outside of such a block.
    """
    if _open:
        yield Same()
        return
    with checked(comm) as same:
        yield same


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
    with checked(comm):
        yield


def _settle(comm: MPI.Intracomm, error: BaseException | None, given: dict[str, str]) -> None:
    """Raise what any rank has raised, or that ranks were given different things. Collective.

    One reduction of as many numbers on all ranks, whatever they were given; more only after that
    has told all of them that there is something to raise.
    """
    text = repr(sorted(given.items())).encode(errors="backslashreplace")
    digest = int.from_bytes(hashlib.blake2b(text, digest_size=7).digest(), "big")
    mine = np.array([comm.size if error is None else comm.rank, digest, -digest], dtype=np.int64)
    lowest = np.empty_like(mine)
    comm.Allreduce(mine, lowest, op=MPI.MIN)
    first, low, high = (int(number) for number in lowest)
    if first < comm.size:
        _raise_everywhere(comm, error, first)
    if low != -high:
        of_ranks = comm.allgather(given)
        for name in dict.fromkeys(name for theirs in of_ranks for name in theirs):
            if len({theirs.get(name) for theirs in of_ranks}) > 1:
                raise ValueError(f"{name}: must be the same on all ranks")


def _raise_everywhere(
    comm: MPI.Intracomm, error: BaseException | None, first: int
) -> typing.NoReturn:
    """Raise this rank's error, or what stands for that of the first rank that has one."""
    mine = (type(error).__name__, str(error)) if comm.rank == first else None
    name, text = comm.bcast(mine, root=first)
    kind = {k.__name__: k for k in _PLAIN}.get(name)
    if error is not None and (
        comm.rank == first or (kind is None and type(error).__name__ == name)
    ):
        raise _of_all(error)
    made = RuntimeError(f"{name}: {text}") if kind is None else kind(text)
    raise _of_all(made) from error


def _of_all(error: BaseException) -> BaseException:
    """Mark an error as one that all ranks raise."""
    setattr(error, _MARK, True)
    return error


def is_of_all(error: BaseException) -> bool:
    """Whether all ranks have raised together, so that collective calls are possible."""
    return bool(getattr(error, _MARK, False))
