"""Log of the attempts of a run: which were accepted, which were cut back, and why."""

from __future__ import annotations

import csv
import dataclasses
import pathlib
import typing

from mpi4py import MPI

from qsdolfinx.base.checks import check_file
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.solve.snes import OF_USER, ConvergenceError

ACCEPTED, CUT_BACK, FAILED = "accepted", "cut back", "failed"


@dataclasses.dataclass(frozen=True)
class Attempt:
    """One attempt at a step.

    Attributes:
        step: Number of the step, from 1 on.
        attempt: Number of the attempt at this step, from 1 on.
        t: Time at which the attempt ends.
        dt: Δt of the attempt.
        iterations: Newton iterations, over all contact detections.
        result: ``"accepted"``, ``"cut back"``, or ``"failed"`` if no smaller Δt is tried.
        reason: Why the attempt was not accepted; empty if it was.
        closed: Active constraints of each contact, over all ranks, when the attempt ended; empty if
            they are not known.
    """

    step: int
    attempt: int
    t: float
    dt: float
    iterations: int
    result: str
    reason: str
    closed: tuple[int, ...]


_COLUMNS = [field.name for field in dataclasses.fields(Attempt)]


class StepLog:
    """Log of all attempts of a run: a sequence of :class:`Attempt` in order; its text is a table.

    The log is the same on all ranks.

    Args:
        comm: Communicator of the run.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._comm = comm
        self._rows: list[Attempt] = []

    @property
    def rows(self) -> list[Attempt]:
        """Copy of the list of all attempts."""
        return list(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> typing.Iterator[Attempt]:
        return iter(self.rows)

    def __getitem__(self, index: int) -> Attempt:
        return self._rows[index]

    def add(self, row: Attempt) -> None:
        """Add an attempt."""
        self._rows.append(row)

    def __str__(self) -> str:
        head = f"{'step':>5} {'try':>3} {'t':>11} {'dt':>11} {'iter':>4} {'closed':>9}  result"
        return "\n".join([head, *map(_line, self._rows)])

    def write(self, filename: str | pathlib.Path) -> None:
        """Write the table to a CSV file, with the attributes as columns. Collective.

        Args:
            filename: The file; an existing one is replaced.

        Raises:
            OSError: If it cannot be written.
        """
        with checked(self._comm):
            path = check_file("filename", filename)
        with collective_errors(self._comm):
            if self._comm.rank == 0:
                with path.open("w", newline="", encoding="utf-8") as file:
                    writer = csv.writer(file)
                    writer.writerow(_COLUMNS)
                    writer.writerows([_cells(row) for row in self._rows])

    def stored(self) -> list[list[typing.Any]]:
        """Return the log as lists, for JSON."""
        return [[getattr(row, name) for name in _COLUMNS] for row in self._rows]

    def restore(self, stored: typing.Sequence[typing.Sequence[typing.Any]]) -> None:
        """Restore the log from the result of :meth:`stored`."""
        self._rows = [_attempt(values) for values in stored]


def _attempt(values: typing.Sequence[typing.Any]) -> Attempt:
    found = dict(zip(_COLUMNS, values, strict=True))
    return Attempt(**(found | {"closed": tuple(found["closed"])}))


def reason_of(error: Exception, names: typing.Sequence[str]) -> str:
    """Why an attempt has failed, in one line.

    Args:
        error: The error that it has raised.
        names: Names of the contacts.
    """
    if not isinstance(error, ConvergenceError) or error.reason == OF_USER:
        return " ".join(str(error).splitlines())
    if error.why:
        return f"{error.reason_name}: {error.why}"
    return error.reason_name + _unsettled(error.active_history, names)


def _unsettled(history: typing.Sequence[typing.Sequence[int]], names: typing.Sequence[str]) -> str:
    """Contacts whose active set still changed in the last iteration, as the end of a sentence."""
    if len(history) < 2:
        return ""
    if len(names) != len(history[-1]):  # in another problem, such as a thermal one
        names = [f"contact {i}" for i in range(len(history[-1]))]
    changes = zip(names, history[-2], history[-1], strict=True)
    texts = [f"{name} ({before} to {after} closed)" for name, before, after in changes
             if before != after]  # fmt: skip
    return f"; the active set still changes in {', '.join(texts)}" if texts else ""


def _line(row: Attempt) -> str:
    closed = "/".join(map(str, row.closed)) or "-"
    end = f"{row.result}: {row.reason}" if row.reason else row.result
    return (
        f"{row.step:5d} {row.attempt:3d} {row.t:11.5g} {row.dt:11.5g} {row.iterations:4d} "
        f"{closed:>9}  {end}"
    )


def _cells(row: Attempt) -> list[typing.Any]:
    cells = [getattr(row, name) for name in _COLUMNS[:-1]]
    return [*cells, "/".join(map(str, row.closed))]
