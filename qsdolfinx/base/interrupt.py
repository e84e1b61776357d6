"""Ctrl-C and handlers of other signals while PETSc works: all ranks stop together, in order.

PETSc cannot go on after a Python exception in the midst of it: matrices stay half assembled,
vectors locked, and some of it ends the process. So what a handler of a signal raises waits for a
place where all ranks can raise.
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
    """Takes the place of handlers of signals in Python, in the main thread; elsewhere of none.

    SIGINT is noted. Handlers of other signals are called when these come; what they raise is kept.

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
        #: Whether code of the user runs, with nothing of PETSc below it.
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
        """Note the signal; pass on a second one, which leaves callbacks that hang."""
        if self._pending and self._before is not None:
            try:
                self._before(number, frame)
            except BaseException as error:
                self.at_once = error
                raise
        self._pending, self._frame = True, frame

    def _keep(self, number: int, frame: types.FrameType | None) -> None:
        """Call the handler of another signal; keep what it raises, unless the user's code runs."""
        if self.in_user_code:
            self._others[number](number, frame)
            return
        try:
            self._others[number](number, frame)
        except BaseException as error:
            # Without its frames, which would keep alive all that was there, on this rank alone.
            self._error = self._error or error.with_traceback(None)

    def requested(self, comm: MPI.Intracomm) -> bool:
        """See :func:`requested`."""
        if self.stops or comm.size != self.size:  # other ranks than those that stop
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
        """Raise what the handler has raised, or KeyboardInterrupt for another rank's."""
        self.raised, self._error = self._error or KeyboardInterrupt(), None
        self.stops = False
        raise self.raised

    def pass_on(self) -> None:
        """Raise what a handler has raised; call that of SIGINT if there has been one."""
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
            del frame  # or the traceback keeps all that was there, on this rank alone

    def leave_over(self) -> None:
        """After the last look: one rank raises at once, several leave it to the next block.

        The others may be gone, and would wait for this rank in vain elsewhere.
        """
        if self.size == 1:
            self.pass_on()
        else:
            _here.left_over, _here.left_error = self._pending, self._error

    def end(self) -> None:
        """Put the handlers back, unless somebody has set others."""
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
    """Let Ctrl-C inside the block wait for :func:`look`, or for the end. Collective.

    So does what handlers of other signals raise, such as that of SIGALRM for a limit of time; they
    are called when the signals come. What a callback has raised inside of PETSc comes out of the
    block as itself, not as an error of PETSc's.

    The handler of SIGINT that was there is called then; if it raises on any rank, as Python's own
    does, all ranks raise, the others KeyboardInterrupt. A second Ctrl-C while the first one waits
    is handled at once, wherever that is. Blocks inside of others are part of these. What comes to a
    rank of several after the last look of a block waits for the next one.

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
            comm.Barrier()  # so that no rank waits for another in what follows
        look(comm)
    except BaseException as error:
        guard.end()
        if isinstance(error, PETSc.Error) and guard.at_once is not None:
            raise guard.at_once from None  # in a callback, of which PETSc makes an error of its own
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
    """What a callback has raised, of which PETSc has made this error of its own; None otherwise."""
    cause: BaseException | None = error
    while isinstance(cause, PETSc.Error) and cause.ierr == IN_PYTHON:
        cause = cause.__cause__
    return None if cause is error else cause


@contextlib.contextmanager
def user_code() -> typing.Iterator[None]:
    """Let handlers of signals other than SIGINT raise inside the block: nothing of PETSc is below.

    A callback may set a limit of time for what it does, and catch what the handler raises.
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
