"""Write the history of a run as a table."""

from __future__ import annotations

import csv
import math
import os
import pathlib
import sys
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.checks import MAPPING, check, check_file, require, shown
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.progress import bar


class History:
    """Table of numbers with one line for each step, as CSV and on the terminal.

    A terminal with tqdm installed shows a progress bar; otherwise a line is printed for each step.

    Args:
        comm: Communicator; its rank 0 writes.
        filename: CSV file, or None.
        t_end: Time at which the run ends, for the progress bar.
        verbose: Whether to print.
        append: Whether to continue an existing file after a restart: its lines with ``t`` less than
            that of the first new line are kept.

    Raises:
        OSError: If the folder of the file is missing.

    Attributes:
        rows: All lines that were added, on every rank.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        filename: str | pathlib.Path | None = None,
        t_end: float = 1.0,
        verbose: bool = True,
        append: bool = False,
    ) -> None:
        self.rows: list[dict[str, float]] = []
        self._comm, self._writes = comm, comm.rank == 0
        with checked(comm):
            self._path = None if filename is None else check_file("filename", filename)
        self._append = append
        self._verbose = verbose and self._writes
        self._bar = bar(t_end) if self._verbose and sys.stderr.isatty() else None

    def add(self, row: typing.Mapping[str, float]) -> None:
        """Add a line; the first line defines the columns. Collective.

        The value ``t`` moves the progress bar.

        Raises:
            ValueError: If its columns are not those of earlier lines, or a value is not a number.
            OSError: If the line cannot be written.
        """
        with collective_errors(self._comm):
            check(MAPPING, row=row)
            require("t" in row, "row: needs a column t, the time")
            for name, value in row.items():
                require(_is_number(value), f"row: {name!r} must be a number, not {shown(value)}")
            require(math.isfinite(row["t"]), f"row: 't' must be finite, not {shown(row['t'])}")
            columns = list(self.rows[0] if self.rows else row)
            require(set(row) == set(columns), f"row: must have the columns {', '.join(columns)}")
            if self._writes and self._path is not None:
                self._write(self._path, columns, row)
        self.rows.append(dict(row))
        if self._bar is not None:
            self._bar.update(row["t"] - self._bar.n)
        elif self._verbose:
            print(", ".join(f"{k} {_short(v)}" for k, v in row.items()), flush=True)

    def _write(
        self, path: pathlib.Path, columns: list[str], row: typing.Mapping[str, float]
    ) -> None:
        """Write a line; the first one is appended to earlier lines if these are kept."""
        lines: list[typing.Mapping[str, typing.Any]] = [{k: _exact(v) for k, v in row.items()}]
        if not self.rows:
            if self._append and path.exists():
                lines = _earlier(path, columns, row["t"]) + lines
            lines.insert(0, {column: column for column in columns})
        if self.rows:
            _append(path, columns, lines)
            return
        aside = path.with_name(path.name + ".new")
        try:
            _append(aside, columns, lines, "w")
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)

    def close(self) -> None:
        """End the progress bar."""
        if self._bar is not None:
            self._bar.close()


def _is_number(value: typing.Any) -> bool:
    """Whether a value is a Python or NumPy number; NaN is allowed for unknown values."""
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "biuf"


def _exact(value: float) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def _short(value: float) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _append(
    path: pathlib.Path,
    columns: list[str],
    lines: list[typing.Mapping[str, typing.Any]],
    mode: str = "a",
) -> None:
    """Append complete lines to a file; after an error, none."""
    size = path.stat().st_size if mode == "a" and path.exists() else 0
    try:
        with path.open(mode, newline="") as file:
            csv.DictWriter(file, columns).writerows(lines)
    except OSError:
        if path.exists():
            os.truncate(path, size)
        raise


def _earlier(path: pathlib.Path, columns: list[str], t: float) -> list[dict[str, typing.Any]]:
    """Lines of a file before a time: a run may have continued after the checkpoint."""
    with path.open(newline="") as file:
        table = csv.DictReader(file)
        if table.fieldnames is not None and list(table.fieldnames) != columns:
            raise ValueError(f"filename: {path} has other columns")
        return [line for line in table if float(line["t"]) < t]
