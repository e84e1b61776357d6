"""Ctrl-C while PETSc works: noted when it comes, heeded where all ranks can stop together."""

from __future__ import annotations

import contextlib
import signal
import threading
import types
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np


class _Guard:
    """Takes the place of SIGINT's handler in Python, in the main thread; elsewhere of none.

    Args:
        comm: Communicator of the ranks that stop together.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.size = comm.size
        #: Whether all ranks are to stop.
        self.stops = False
        #: What all of them have raised, each its own.
        self.raised: BaseException | None = None
        #: What a second signal has raised wherever that was.
        self.at_once: BaseException | None = None
        self._frame: types.FrameType | None = None
        self._pending, _here.left_over = _here.left_over, False
        self._error: BaseException | None = None
        self._before: typing.Callable[[int, types.FrameType | None], typing.Any] | None = None
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is threading.main_thread() and callable(before):
            self._before = before
            signal.signal(signal.SIGINT, self)

    def __call__(self, number: int, frame: types.FrameType | None) -> None:
        """Note the signal; pass on a second one, which leaves callbacks that hang."""
        if self._pending and self._before is not None:
            try:
                self._before(number, frame)
            except BaseException as error:
                self.at_once = error
                raise
        self._pending, self._frame = True, frame

    def requested(self, comm: MPI.Intracomm) -> bool:
        """See :func:`requested`."""
        if self.stops or comm.size != self.size:  # other ranks than those that stop
            return self.stops
        if self._pending:
            try:
                self.pass_on()
            except BaseException as error:
                self._error = error
        self.stops = self._error is not None
        if self.size > 1:
            any_rank = np.array(self.stops)
            comm.Allreduce(MPI.IN_PLACE, any_rank, op=MPI.LOR)
            self.stops = bool(any_rank)
        return self.stops

    def stop(self) -> typing.NoReturn:
        """Raise what the handler has raised, or KeyboardInterrupt for another rank's."""
        self.raised, self._error = self._error or KeyboardInterrupt(), None
        self.stops = False
        raise self.raised

    def pass_on(self) -> None:
        """Call the handler that was there before if there has been a signal."""
        pending, frame = self._pending, self._frame
        self._pending, self._frame = False, None
        try:
            if pending and self._before is not None:
                self._before(signal.SIGINT, frame)
        finally:
            del frame  # or the traceback keeps all that was there, on this rank alone

    def leave_over(self) -> None:
        """After the last look: one rank raises at once, several leave it to the next block.

        The others may be gone, and would wait for this rank in vain elsewhere.
        """
        if self.size == 1:
            self.pass_on()
        else:
            _here.left_over = self._pending

    def end(self) -> None:
        """Put the handler back, unless somebody has set another one."""
        if self._before is not None and signal.getsignal(signal.SIGINT) is self:
            signal.signal(signal.SIGINT, self._before)


class _OfThread(threading.local):
    guard: _Guard | None = None
    left_over: bool = False


_here = _OfThread()


@contextlib.contextmanager
def heeded(comm: MPI.Intracomm) -> typing.Iterator[None]:
    """Let Ctrl-C inside the block wait for :func:`look`, or for the end. Collective.

    The handler of SIGINT that was there is called then; if it raises on any rank, as Python's own
    does, all ranks raise, the others KeyboardInterrupt. A second Ctrl-C while the first one waits
    is handled at once, wherever that is. Blocks inside of others are part of these. What comes to a
    rank of several after the last look of a block waits for the next one.

    Args:
        comm: Communicator of the ranks that take part.
    """
    if _here.guard is not None:
        yield
        return
    guard = _here.guard = _Guard(comm)
    try:
        yield
        if guard.size > 1:
            comm.Barrier()  # so that no rank waits for another in what follows
        look(comm)
    except BaseException as error:
        guard.end()
        if isinstance(error, PETSc.Error) and guard.at_once is not None:
            raise guard.at_once from None  # in a callback, of which PETSc makes an error of its own
        if error is not guard.raised:
            guard.pass_on()
        raise
    finally:
        guard.end()
        _here.guard = guard.raised = guard.at_once = None  # errors refer to the guard
    guard.leave_over()


def requested(comm: MPI.Intracomm) -> bool:
    """Whether all ranks are to stop: for callbacks of PETSc, which end first. Collective."""
    return _here.guard is not None and _here.guard.requested(comm)


def look(comm: MPI.Intracomm) -> None:
    """Raise on all ranks if there was Ctrl-C on any. Collective.

    Raises:
        KeyboardInterrupt: Or what else the handler of SIGINT raises.
    """
    guard = _here.guard
    if guard is not None and guard.requested(comm):
        guard.stop()


def is_of_all(error: BaseException) -> bool:
    """Whether all ranks have raised by :func:`look`, so that collective calls are possible."""
    return _here.guard is not None and error is _here.guard.raised
