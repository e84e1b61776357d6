"""Handle Ctrl-C and other signals while PETSc runs: all ranks stop together, in a valid state.

PETSc cannot continue after a Python exception inside it: matrices remain partly assembled, vectors
locked, and some functions end the process. So the exception of a signal handler is deferred to a
place where all ranks can raise it.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import types
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

#: PETSc's error code of an exception in Python.
IN_PYTHON = -1


class _Guard:
    """Replace Python's signal handlers in the main thread; do nothing in other threads.

    SIGINT is recorded. Handlers of other signals are called when the signals arrive; their
    exceptions are stored.

    Args:
        comm: Communicator of the ranks that stop together.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.size = comm.size
        #: Whether all ranks must stop.
        self.stops = False
        #: Exception that all ranks have raised, each rank its own.
        self.raised: BaseException | None = None
        #: Exception raised by a second signal, at any place.
        self.at_once: BaseException | None = None
        self._frame: types.FrameType | None = None
        #: Whether the user's code is running, with no PETSc function that called it.
        self.in_user_code = False
        self._pending, _here.left_over = _here.left_over, False
        self._error, _here.left_error = _here.left_error, None
        self._before: typing.Callable[[int, types.FrameType | None], typing.Any] | None = None
        self._others: dict[int, typing.Any] = {}
        self._keeper = self._keep
        if threading.current_thread() is not threading.main_thread():
            return
        before = signal.getsignal(signal.SIGINT)
        if callable(before):
            self._before = before
            signal.signal(signal.SIGINT, self)
        for number in signal.valid_signals() - {signal.SIGINT}:
            if callable(other := signal.getsignal(number)):
                self._others[int(number)] = other
                signal.signal(number, self._keeper)

    def __call__(self, number: int, frame: types.FrameType | None) -> None:
        """Record the signal; pass on a second one, which can interrupt callbacks that hang."""
        if self._pending and self._before is not None:
            try:
                self._before(number, frame)
            except BaseException as error:
                self.at_once = error
                raise
        self._pending, self._frame = True, frame

    def _keep(self, number: int, frame: types.FrameType | None) -> None:
        """Call the handler of another signal; store its exception unless user code is running."""
        if self.in_user_code:
            self._others[number](number, frame)
            return
        try:
            self._others[number](number, frame)
        except BaseException as error:
            # Without the traceback, whose frames would keep objects alive on this rank alone.
            self._error = self._error or error.with_traceback(None)

    def requested(self, comm: MPI.Intracomm) -> bool:
        """See :func:`requested`."""
        if self.stops or comm.size != self.size:  # a communicator of other ranks
            return self.stops
        if self._pending:
            try:
                self._call_before()
            except BaseException as error:
                self._error = error
        self.stops = self._error is not None
        if self.size > 1:
            any_rank = np.array(self.stops)
            comm.Allreduce(MPI.IN_PLACE, any_rank, op=MPI.LOR)
            self.stops = bool(any_rank)
        return self.stops

    def stop(self) -> typing.NoReturn:
        """Raise the exception of the handler, or KeyboardInterrupt for a signal on another rank."""
        self.raised, self._error = self._error or KeyboardInterrupt(), None
        self.stops = False
        raise self.raised

    def pass_on(self) -> None:
        """Raise the stored exception of a handler; call the SIGINT handler if it was received."""
        error, self._error = self._error, None
        if error is not None:
            self._pending = False
            raise error
        self._call_before()

    def _call_before(self) -> None:
        pending, frame = self._pending, self._frame
        self._pending, self._frame = False, None
        try:
            if pending and self._before is not None:
                self._before(signal.SIGINT, frame)
        finally:
            del frame  # or the traceback keeps objects alive on this rank alone

    def leave_over(self) -> None:
        """Handle signals after the last check: now on one rank, in the next block on several.

        The other ranks may have continued, and would wait for this rank elsewhere.
        """
        if self.size == 1:
            self.pass_on()
        else:
            _here.left_over, _here.left_error = self._pending, self._error

    def end(self) -> None:
        """Restore the handlers, unless others have been set since."""
        for number, other in self._others.items():
            if signal.getsignal(number) is self._keeper:
                signal.signal(number, other)
        if self._before is not None and signal.getsignal(signal.SIGINT) is self:
            signal.signal(signal.SIGINT, self._before)


class _OfThread(threading.local):
    guard: _Guard | None = None
    left_over: bool = False
    left_error: BaseException | None = None


_here = _OfThread()


@contextlib.contextmanager
def heeded(comm: MPI.Intracomm) -> typing.Iterator[None]:
    """Defer Ctrl-C inside the block to :func:`look`, or to the end of the block. Collective.

    Exceptions of other signal handlers, such as SIGALRM for a time limit, are deferred, too; these
    handlers are called when the signals arrive. An exception of a callback inside PETSc leaves the
    block unchanged, not as an error of PETSc.

    The previous handler of SIGINT is called then. If it raises an exception on any rank, as
    Python's own handler does, all ranks raise an exception, the others KeyboardInterrupt. A second
    Ctrl-C while the first one is deferred is handled immediately. Nested blocks are part of the
    outer block. On several ranks, a signal after the last check of a block is deferred to the next
    block.

    Args:
        comm: Communicator of the ranks that take part.
    """
    if _here.guard is not None:
        outer, before = _here.guard, _here.guard.in_user_code
        outer.in_user_code = False
        try:
            yield
        finally:
            outer.in_user_code = before
        return
    guard = _here.guard = _Guard(comm)
    try:
        yield
        if guard.size > 1:
            comm.Barrier()  # so that no rank waits for another below
        look(comm)
    except BaseException as error:
        guard.end()
        if isinstance(error, PETSc.Error) and guard.at_once is not None:
            raise guard.at_once from None  # in a callback; PETSc replaces it by its own error
        if error is not guard.raised:
            guard.pass_on()
        if (original := _raised_in_callback(error)) is not None:
            raise original from None
        raise
    finally:
        guard.end()
        _here.guard = guard.raised = guard.at_once = None  # errors refer to the guard
    guard.leave_over()


def _raised_in_callback(error: BaseException) -> BaseException | None:
    """Exception of a callback that PETSc has replaced by this error; None otherwise."""
    cause: BaseException | None = error
    while isinstance(cause, PETSc.Error) and cause.ierr == IN_PYTHON:
        cause = cause.__cause__
    return None if cause is error else cause


@contextlib.contextmanager
def user_code() -> typing.Iterator[None]:
    """Allow exceptions of signal handlers, except SIGINT, inside the block: user code, not PETSc.

    A callback may set a time limit for its own work, and catch the exception of the handler.
    """
    guard = _here.guard
    if guard is None:
        yield
        return
    before, guard.in_user_code = guard.in_user_code, True
    try:
        yield
    finally:
        guard.in_user_code = before


def requested(comm: MPI.Intracomm) -> bool:
    """Whether all ranks must stop: for callbacks of PETSc, which must return first. Collective."""
    return _here.guard is not None and _here.guard.requested(comm)


def look(comm: MPI.Intracomm) -> None:
    """Raise an exception on all ranks if Ctrl-C was received on any rank. Collective.

    Raises:
        KeyboardInterrupt: Or another exception of the handler of SIGINT.
    """
    guard = _here.guard
    if guard is not None and guard.requested(comm):
        guard.stop()


def is_of_all(error: BaseException) -> bool:
    """Whether all ranks have raised an exception in :func:`look`; collective calls are possible."""
    return _here.guard is not None and error is _here.guard.raised
