"""Messages: through Python's logging, on rank 0, and to the terminal unless that is set up."""

from __future__ import annotations

import contextlib
import logging
import sys
import time
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.contact.advice import ContactWarning
from qsdolfinx.solve.snes import ConvergenceError

if typing.TYPE_CHECKING:
    from qsdolfinx.solve.problem import ContactProblem

logger = logging.getLogger("qsdolfinx")


class _Terminal(logging.Handler):
    """Prints what nobody else takes, as logging does with what is worse than a message.

    Args:
        logger: The logger that it belongs to.
    """

    def __init__(self, logger: logging.Logger) -> None:
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        others = [*self._logger.handlers]
        if self._logger.propagate:
            others += logging.getLogger().handlers
        if not any(other is not self and not self.is_nobody(other) for other in others):
            self.show(record.getMessage())

    def is_nobody(self, handler: logging.Handler) -> bool:
        """Whether a handler shows nothing, though not on the user's wish."""
        return False

    def show(self, text: str) -> None:
        """Print a message; the stream is that of the moment."""
        print(f"qsdolfinx: {text}", file=sys.stdout, flush=True)


class _Warnings(_Terminal):
    """Shows our warnings: FFCx, which DOLFINx imports, turns Python's over to logging.

    There a handler that shows nothing is all that takes them.
    """

    def is_nobody(self, handler: logging.Handler) -> bool:
        return isinstance(handler, logging.NullHandler)

    def show(self, text: str) -> None:
        ours = (ContactWarning, *ContactWarning.__subclasses__())
        if MPI.COMM_WORLD.rank == 0 and any(f": {w.__name__}: " in text for w in ours):
            print(text.rstrip(), file=sys.stderr, flush=True)


logger.addHandler(_Terminal(logger))
_python = logging.getLogger("py.warnings")
_python.addHandler(_Warnings(_python))
if logger.level == logging.NOTSET:
    logger.setLevel(logging.INFO)


def say(comm: MPI.Intracomm, text: str) -> None:
    """Log a message (INFO) on rank 0."""
    if comm.rank == 0:
        logger.info(text)


@contextlib.contextmanager
def summary(problem: ContactProblem) -> typing.Iterator[None]:
    """Log one line about the solve in the block. Collective, if the problem is verbose."""
    if not problem.verbose:
        yield
        return
    begin = time.perf_counter()
    try:
        yield
    except ConvergenceError as error:
        say(problem.comm, f"solve failed: {error.reason_name}, {_effort(problem, begin)}")
        raise
    say(problem.comm, f"solve: {_effort(problem, begin)}; {_outcome(problem)}")


def _effort(problem: ContactProblem, begin: float) -> str:
    """Iterations and time."""
    parts = [f"{problem.num_iterations} Newton, {problem.num_linear_iterations} linear iterations"]
    if problem.violation_history:
        parts.append(f"{problem.num_augmentations} updates of multipliers")
    return ", ".join([*parts, f"{time.perf_counter() - begin:.2f} s"])


def _outcome(problem: ContactProblem) -> str:
    """Active nodes, gaps and forces; of several contacts one after the other. Collective."""
    contacts = problem.contacts
    rows = [sum(len(p.row_node) for p in contact.passes) for contact in contacts]
    rows = problem.comm.allreduce(np.array(rows, dtype=np.int64), op=MPI.SUM).tolist()
    active = problem.active_history[-1] if problem.active_history else [0] * len(contacts)
    gap = max((contact.penetration() for contact in contacts), default=0.0)
    forces = [float(np.linalg.norm(contact.force("slave"))) for contact in contacts]
    counts = " + ".join(f"{a} of {n}" for a, n in zip(active, rows, strict=True))
    return (
        f"active nodes {counts or 0}, largest gap violation {gap:.3g}, "
        f"force {' + '.join(f'{f:.6g}' for f in forces) or 0}"
    )
