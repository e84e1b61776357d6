"""Figures of bench/speed_report.py."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

from common.drawing import pyplot, save
from speed_front import FLOOR, front, kind_of, points

COLORS = {
    "master-slave": "tab:red",
    "double-pass": "tab:green",
    "quasi-symmetric": "tab:blue",
    "two-half-pass": "tab:purple",
}
STYLES = {"nodal": "s--", "overlay": "o-"}


def plot(result, filename):
    """Error over time, a row for each measure, a column for each enforcement."""
    measures = list(result["measures"])
    enforcements = list(dict.fromkeys(row["enforcement"] for row in result["rows"]))
    figure, grid = pyplot().subplots(
        len(measures),
        len(enforcements),
        figsize=(11, 1.4 + 4.4 * len(measures)),
        sharex=True,
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for axes, measure in zip(grid, measures, strict=True):
        for axis, enforcement in zip(axes, enforcements, strict=True):
            draw(axis, result, measure, enforcement)
        worst = ", worse of the two sides" if len(result["measures"][measure]) > 1 else ""
        axes[0].set_ylabel(f"relative error, {measure}{worst} (-)")
    for axis in grid[-1]:
        axis.set_xlabel("CPU time of the solve (s)")
    for axis, enforcement in zip(grid[0], enforcements, strict=True):
        axis.set_title(f"{result['title']}, {enforcement}", fontsize=10)
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=3, fontsize=9)
    save(figure, filename)


def draw(axis, result, measure, enforcement):
    """One panel: the kinds with this enforcement, and the front of all."""
    everything = points(result, measure)
    best = front(everything)
    right = 1.3 * max(p.seconds for p in everything)
    axis.step(
        [*(p.seconds for p in best), right],
        [*(p.error for p in best), best[-1].error],
        where="post",
        color="gold",
        lw=7,
        alpha=0.6,
        solid_capstyle="butt",
        zorder=0,
        label="Pareto front of all 16",
    )
    here = [p for p in best if p.kind.enforcement == enforcement]
    axis.plot(
        [p.seconds for p in here],
        [p.error for p in here],
        "o",
        mfc="none",
        mec="black",
        ms=12,
        mew=1.2,
        zorder=4,
        label="on the front",
    )
    for kind in dict.fromkeys(map(kind_of, result["rows"])):
        if kind.enforcement != enforcement:
            continue
        mine = sorted((p for p in everything if p.kind == kind), key=lambda p: p.level)
        axis.plot(
            [p.seconds for p in mine],
            [p.error for p in mine],
            STYLES[kind.quadrature],
            color=COLORS[kind.formulation],
            ms=4.5,
            lw=1.1,
            mfc="white" if kind.quadrature == "nodal" else None,
            label=f"{kind.formulation}, {kind.quadrature}",
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    if min(p.error for p in everything) <= FLOOR:
        axis.set_ylim(bottom=FLOOR / 3)
        axis.annotate(
            "exact: below 1e-8",
            (0.98, 0.015),
            xycoords="axes fraction",
            ha="right",
            fontsize=8,
        )
    axis.grid(which="both", alpha=0.25)
