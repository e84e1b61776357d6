"""An exception that nobody catches on one rank ends all ranks, also those that wait for it."""

from __future__ import annotations

import sys
import time
import types
import typing

from mpi4py import MPI

from qsdolfinx.base.checks import Kind, check

#: Seconds after which ranks that have not failed as well count as waiting.
GRACE = 5.0

Hook = typing.Callable[[type[BaseException], BaseException, types.TracebackType | None], typing.Any]


def _ending_all(before: Hook) -> Hook:
    def hook(
        kind: type[BaseException], error: BaseException, trace: types.TracebackType | None
    ) -> None:
        before(kind, error, trace)
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

    return hook


_installed = False


def end_all_ranks(comm: MPI.Intracomm) -> None:
    """Let ``sys.excepthook`` also end all ranks, if there are several; once.

    Args:
        comm: Communicator of what is used in parallel for the first time.
    """
    global _installed
    if comm.size > 1 and not _installed:
        _installed = True
        sys.excepthook = _ending_all(sys.excepthook)


def check_alone(kind: Kind, /, **arguments: typing.Any) -> None:
    """Check what tells the communicator: a rank without it cannot let the others know.

    It raises there alone, and if nobody catches that it ends all ranks.

    Args:
        kind: What the arguments must be.
        arguments: Values by the names that the error is to give.
    """
    try:
        check(kind, **arguments)
    except Exception:
        end_all_ranks(MPI.COMM_WORLD)
        raise
