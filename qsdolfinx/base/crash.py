"""An exception that nobody catches on one rank ends all ranks, also those that wait for it."""

from __future__ import annotations

import sys
import time
import types
import typing

from mpi4py import MPI

#: Seconds after which ranks that have not failed as well count as waiting.
GRACE = 5.0

Hook = typing.Callable[[type[BaseException], BaseException, types.TracebackType | None], typing.Any]


class _EndingAll:
    """An excepthook that calls the one before, and then sees to the other ranks."""

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
        # At its end Python would finalise PETSc and MPI, and wait there for the others.
        arrived, start = MPI.COMM_WORLD.Ibarrier(), time.monotonic()
        while not arrived.Test():
            if time.monotonic() - start > GRACE:
                rank = MPI.COMM_WORLD.rank
                print(f"qsdolfinx: rank {rank} has failed alone: ending all", file=sys.stderr)
                sys.stderr.flush()
                MPI.COMM_WORLD.Abort(1)
            time.sleep(0.01)


def end_all_ranks() -> None:
    """Let an exception that nobody catches on one rank end all ranks of ``MPI.COMM_WORLD``.

    Otherwise the others wait for that rank for ever, as in any MPI program; ``python3 -m mpi4py``
    does not help where PETSc is used, whose end waits, too. Put it at the top of a script that runs
    on several ranks. 5 s after the exception, unless the others have failed as well, all are ended
    with exit code 1 and a line that says which rank it was.

    It goes on from whatever ``sys.excepthook`` is, and stays until that is set to another one.
    """
    if MPI.COMM_WORLD.size > 1 and not isinstance(sys.excepthook, _EndingAll):
        sys.excepthook = _EndingAll(sys.excepthook)
