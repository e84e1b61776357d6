"""The history of a run as a table."""

from __future__ import annotations

import csv
import pathlib
import sys
import typing

from mpi4py import MPI

import numpy as np

from qsdolfinx.stepper import TimeStepper


def step_row(stepper: TimeStepper) -> dict[str, float]:
    """What every run can say of its last step. Collective.

    Returns:
        Step, time, Δt, Newton iterations and failed attempts; for each contact the force on the
        slave, the area in contact and the deepest penetration; the volume of each mesh.
    """
    row: dict[str, float] = {
        "step": stepper.num_steps,
        "t": stepper.t,
        "dt": stepper.last_dt,
        "iterations": stepper.num_iterations,
        "cutbacks": stepper.num_cutbacks,
    }
    for i, contact in enumerate(stepper.problem.contacts):
        force = contact.force("slave")
        row |= {f"force_{i}_{axis}": float(f) for axis, f in zip("xyz", force, strict=False)}
        row[f"area_{i}"] = contact.patch()[0]
        gaps = np.abs(contact.gap()) if contact.law.linear else contact.gap()
        local = float(np.nanmax(gaps)) if np.isfinite(gaps).any() else 0.0
        row[f"penetration_{i}"] = contact.comm.allreduce(max(local, 0.0), op=MPI.MAX)
    for i, motion in enumerate(stepper.motions):
        row[f"volume_{i}"] = motion.volume()
    return row


class History:
    """Table of numbers, one line a step, as CSV and on the terminal.

    On a terminal with tqdm at hand there is a progress bar; otherwise one plain line a step.

    Args:
        comm: Communicator; its rank 0 writes.
        filename: CSV file, or None.
        t_end: Time at which the run ends, for the bar.
        verbose: Whether to print.
        append: Whether to go on with a file that is there, after a restart.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        filename: str | pathlib.Path | None = None,
        t_end: float = 1.0,
        verbose: bool = True,
        append: bool = False,
    ) -> None:
        #: All lines, on every rank.
        self.rows: list[dict[str, float]] = []
        self._writes = comm.rank == 0
        self._path = None if filename is None else pathlib.Path(filename)
        self._append = append and self._path is not None and self._path.exists()
        self._verbose = verbose and self._writes
        self._bar = _bar(t_end) if self._verbose and sys.stderr.isatty() else None

    def add(self, row: typing.Mapping[str, float]) -> None:
        """Add a line; the first one names the columns, its ``t`` moves the bar."""
        self.rows.append(dict(row))
        if not self._writes:
            return
        if self._path is not None:
            new = len(self.rows) == 1 and not self._append
            with self._path.open("w" if new else "a", newline="") as file:
                table = csv.DictWriter(file, list(self.rows[0]))
                if new:
                    table.writeheader()
                table.writerow({k: repr(v) if isinstance(v, float) else v for k, v in row.items()})
        if self._bar is not None:
            self._bar.update(row["t"] - self._bar.n)
        elif self._verbose:
            print(
                ", ".join(
                    f"{k} {v:.5g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()
                ),
                flush=True,
            )

    def close(self) -> None:
        """End the progress bar."""
        if self._bar is not None:
            self._bar.close()


def _bar(t_end: float) -> typing.Any:
    """Progress bar over time, None without tqdm."""
    try:
        import tqdm
    except ImportError:
        return None
    return tqdm.tqdm(total=t_end, unit="t", bar_format="{l_bar}{bar}| t = {n:.4g} of {total:.4g}")
