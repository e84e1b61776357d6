"""Raise errors on all ranks, so that an error on one rank does not make others hang."""

from __future__ import annotations

import contextlib
import hashlib
import pickle
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.checks import Kind, check

_ANYTHING = Kind("anything", lambda value: True)

#: Attribute that marks errors raised on all ranks.
_MARK = "_qsdolfinx_of_all_ranks"

#: Open blocks of ``checked`` on this rank.
_open: list[Same] = []


class Same:
    """Collect arguments that must be the same on all ranks, see :func:`checked`."""

    def __init__(self) -> None:
        #: Collected arguments as text, by name.
        self.given: dict[str, str] = {}

    def __call__(self, kind: Kind = _ANYTHING, /, **arguments: typing.Any) -> None:
        """Check arguments on this rank now, and compare them between ranks at the end of the block.

        Args:
            kind: Admissible kind of the arguments.
            arguments: Values by argument name, for the error message. They are compared by their
                ``repr``; NumPy arrays and numbers are compared by their values.
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

    raises an error on every rank if any rank finds an error, or if arguments of ``same`` differ
    between ranks. Each rank may fail for its own reason, or pass other arguments to ``same``. The
    block must not contain collective calls: a rank that fails leaves it early.

    Args:
        comm: Communicator of the ranks that take part.

    Yields:
        Callable for arguments that must be the same on all ranks.

    Raises:
        Exception: The exception of the lowest failing rank; see :func:`collective_errors`.
        ValueError: If no rank fails, and an argument differs.
    """
    same = Same()
    error: BaseException | None = None
    _open.append(same)
    try:
        yield same
    except BaseException as e:
        error = e.with_traceback(e.__traceback__ and e.__traceback__.tb_next)
    finally:
        _open.remove(same)
    wanted = _settled(comm, error, same.given)
    try:
        if wanted is not None:
            raise wanted
    finally:
        # No traceback may contain a frame that refers to its error, as the frame of this function
        # does: these objects, and all that the frames refer to, such as PETSc's, would be freed by
        # the next garbage collection, at another time on each rank, and the ranks would hang.
        del error, wanted


@contextlib.contextmanager
def checked_once(comm: MPI.Intracomm) -> typing.Iterator[Same]:
    """As :func:`checked`; inside a block of ``checked`` or ``collective_errors``, use that block.

    It is for settings that may be made in callbacks, too, such as a stepper's ``drive``: another
    rank may have raised an error before, and would not take part in a reduction here. Collective
    outside such a block.
    """
    if _open:
        yield Same()
        return
    with checked(comm) as same:
        yield same


@contextlib.contextmanager
def collective_errors(comm: MPI.Intracomm) -> typing.Iterator[None]:
    """Raise exceptions of any rank inside the block on every rank.

    The block must not contain collective calls: a rank that fails leaves it early. The exception of
    the lowest failing rank is raised on all ranks. Collective.

    Args:
        comm: Communicator of the ranks that take part.

    Raises:
        Exception: The exception raised inside the block on any rank. Ranks that did not raise it
            get a copy; or a RuntimeError with its text, if pickle cannot copy it.
    """
    with checked(comm):
        yield


def _settled(
    comm: MPI.Intracomm, error: BaseException | None, given: dict[str, str]
) -> BaseException | None:
    """The error that this rank has to raise: for the error of any rank, or unlike arguments.

    There is one reduction of the same size on all ranks, whatever the arguments. Further
    communication follows only if this reduction shows all ranks that there is an error. Collective.
    """
    text = repr(sorted(given.items())).encode(errors="backslashreplace")
    digest = int.from_bytes(hashlib.blake2b(text, digest_size=7).digest(), "big")
    mine = np.array([comm.size if error is None else comm.rank, digest, -digest], dtype=np.int64)
    lowest = np.empty_like(mine)
    comm.Allreduce(mine, lowest, op=MPI.MIN)
    first, low, high = (int(number) for number in lowest)
    if first < comm.size:
        return _of_first(comm, error, first)
    if low != -high:
        of_ranks = comm.allgather(given)
        for name in dict.fromkeys(name for theirs in of_ranks for name in theirs):
            if len({theirs.get(name) for theirs in of_ranks}) > 1:
                return ValueError(f"{name}: must be the same on all ranks")
    return None


def _of_first(comm: MPI.Intracomm, error: BaseException | None, first: int) -> BaseException:
    """This rank's error, or a copy of the error of the first rank with an error. Collective."""
    mine = (type(error).__name__, str(error), _pickled(error)) if comm.rank == first else None
    name, text, copy = comm.bcast(mine, root=first)
    if error is not None and (
        comm.rank == first or (copy is None and type(error).__name__ == name)
    ):
        return _of_all(error)
    made = RuntimeError(f"{name}: {text}") if copy is None else pickle.loads(copy)
    made.__cause__ = error
    return _of_all(made)


def _pickled(error: BaseException | None) -> bytes | None:
    """The error as bytes from which other ranks can make a copy; None if that is not possible."""
    try:
        copy = pickle.dumps(error)
        return copy if type(pickle.loads(copy)) is type(error) else None
    except Exception:  # errors with any arguments of their own
        return None


def _of_all(error: BaseException) -> BaseException:
    """Mark an error as raised on all ranks."""
    setattr(error, _MARK, True)
    return error


def is_of_all(error: BaseException) -> bool:
    """Whether all ranks have raised an error together, so that collective calls are possible."""
    return bool(getattr(error, _MARK, False))
