"""Termination of all ranks after an uncaught exception on one rank."""

from __future__ import annotations

import sys
import time
import types
import typing

from mpi4py import MPI

Hook = typing.Callable[[type[BaseException], BaseException, types.TracebackType | None], typing.Any]


class _EndingAll:
    """Exception hook that calls the previous hook, and then ends the other ranks."""

    def __init__(self, before: Hook) -> None:
        self._before = before

    def __call__(
        self, kind: type[BaseException], error: BaseException, trace: types.TracebackType | None
    ) -> None:
        """Report the exception, and end all ranks unless they fail, too."""
        self._before(kind, error, trace)
        sys.stdout.flush()
        sys.stderr.flush()
        if MPI.Is_finalized():
            return
        # Otherwise Python would finalise PETSc and MPI at exit, and wait there for the other ranks.
        # Ranks that have not failed after 5 s count as waiting.
        arrived, start = MPI.COMM_WORLD.Ibarrier(), time.monotonic()
        while not arrived.Test():
            if time.monotonic() - start > 5.0:
                rank = MPI.COMM_WORLD.rank
                print(f"qsdolfinx: rank {rank} has failed alone: ending all", file=sys.stderr)
                sys.stderr.flush()
                MPI.COMM_WORLD.Abort(1)
            time.sleep(0.01)


def end_all_ranks() -> None:
    """Let an uncaught exception on one rank terminate all ranks of ``MPI.COMM_WORLD``.

    Otherwise the other ranks wait for that rank forever, as in any MPI program.
    ``python3 -m mpi4py`` does not help with PETSc, since PETSc's finalisation waits, too. Call this
    function at the top of a script that runs on several ranks. 5 s after the exception, unless the
    other ranks have failed as well, all ranks end with exit code 1 and a line that names the failed
    rank.

    The function installs a hook that first calls the present ``sys.excepthook``. It is active until
    ``sys.excepthook`` is set again.
    """
    if MPI.COMM_WORLD.size > 1 and not isinstance(sys.excepthook, _EndingAll):
        sys.excepthook = _EndingAll(sys.excepthook)
