"""Measure wall time by stage, in Python and in PETSc's -log_view."""

from __future__ import annotations

import contextlib
import time
import typing

from mpi4py import MPI
from petsc4py import PETSc

#: Stages, in the order of the work; -log_view has them with "contact: " before the name.
STAGES = ("pairing", "gap", "insertion", "bulk assembly", "conversion", "solve")


class Span(typing.NamedTuple):
    """Wall time (s) of a stage, largest and smallest over the ranks."""

    max: float
    min: float


class Stopwatch:
    """Measure the wall time (s) of this rank in each stage.

    A stage inside another one interrupts the time of the outer stage, as in PETSc.
    """

    _running: typing.ClassVar[list[tuple[Stopwatch, str]]] = []
    _since: typing.ClassVar[float] = 0.0

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)

    @property
    def total(self) -> float:
        """Wall time (s) of all stages."""
        return sum(self.seconds.values())

    @contextlib.contextmanager
    def stage(self, name: str) -> typing.Iterator[None]:
        """Add the time of the block to a stage."""
        petsc = PETSc.Log.Stage(f"contact: {name}")
        self._book()
        Stopwatch._running.append((self, name))
        petsc.push()
        try:
            yield
        finally:
            petsc.pop()
            self._book()
            Stopwatch._running.pop()

    @staticmethod
    def _book() -> None:
        """Add the time since the last change to the present stage."""
        now = time.perf_counter()
        if Stopwatch._running:
            watch, name = Stopwatch._running[-1]
            watch.seconds[name] += now - Stopwatch._since
        Stopwatch._since = now


def spans(comm: MPI.Intracomm, watches: typing.Sequence[Stopwatch]) -> dict[str, Span]:
    """Sums of several stopwatches, with their extremes over the ranks. Collective."""
    out = {}
    for name in STAGES:
        local = sum(watch.seconds[name] for watch in watches)
        out[name] = Span(comm.allreduce(local, op=MPI.MAX), comm.allreduce(local, op=MPI.MIN))
    return out
