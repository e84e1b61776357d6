"""Read the output of the bridge bearing, and compare it with the restarted run."""

import csv

import numpy as np

from three_bodies_bodies import DOWN, MU, SIDE, YOUNG, Z


def table(filename, comm):
    """Read the table of the first run, one dictionary per row. Collective."""
    rows = None
    if comm.rank == 0:
        with open(filename, newline="") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return comm.bcast(rows)


def force(row, name):
    """Return the force of the pier or the plate on the pad (N)."""
    return np.array([row[f"{name}_{axis}"] for axis in "xyz"])


def compare(rows, again):
    """Return the --json object.

    Args:
        rows: Rows of the whole run.
        again: Rows of the run restarted from the checkpoint.
    """
    pressed = min(rows, key=lambda row: abs(row["t"] - 1))
    bars = DOWN * SIDE**2 / sum((Z[name][1] - Z[name][0]) / YOUNG[name] for name in Z)
    drag, _, load = force(rows[-1], "plate") * [1, 1, -1]
    total = [force(row, "pier") + force(row, "plate") for row in rows]
    pairs = list(zip(again, rows[-len(again) :], strict=True))
    apart = [force(a, name) - force(b, name) for a, b in pairs for name in MU]
    return {
        "load": load / 1e3,
        "drag": drag / 1e3,
        "load_error": -pressed["plate_z"] / bars - 1,
        "drag_error": drag / (MU["plate"] * load) - 1,
        "balance_error": np.abs(total).max() / load,
        "restart_error": np.abs(apart).max() / load,
    }
