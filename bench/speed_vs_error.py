"""Speed and error of formulations, quadratures and enforcements on four mesh levels.

The cases are in speed_scenes.py. Measured are CPU seconds of all ranks, from the given bodies to
the solution: contact and problem are made, and the problem is solved, or all steps are made. Meshes
and errors are not included. The least of up to --repeats runs counts, in which the kinds of contact
alternate; a kind that took ten seconds is not run again. Writes a summary speed_vs_error_CASE.json
to --json-dir.

With --page nothing is measured: the tables of docs/speed-vs-error.md and the figures are made from
the summaries. The advice of the page, above its tables, is written by hand: read it again then.

    python3 bench/speed_vs_error.py
    mpirun -n 2 python3 bench/speed_vs_error.py --cases patch hertz2d --levels 0 1 2 --repeats 1
    python3 bench/speed_vs_error.py --page
"""

import argparse
import gc
import itertools
import json
import pathlib
import statistics
import sys
import time

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances, write
from speed_scenes import CASES, SIDES, Kind

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
ROOT = pathlib.Path(__file__).resolve().parent.parent
RESULTS, DOCS = ROOT / "bench" / "results", ROOT / "docs"
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")
#: All combinations but double-pass with an augmented Lagrangian, which cannot close every gap.
KINDS = [
    Kind(*kind)
    for kind in itertools.product(FORMULATIONS, ("nodal", "overlay"), ENFORCEMENTS)
    if kind[::2] != ("double-pass", "augmented-lagrangian")
]
#: The reference kind.
BASE = Kind("quasi-symmetric", "overlay", "penalty")
#: Errors by quantity: the worst of some entries of a summary's rows.
MEASURES = {"displacement": ("displacement",), "energy norm": ("energy",), "traction": SIDES}
#: CPU seconds after which a kind is not run again.
LONG = 10.0
#: Relative error below which a solution counts as exact: multipliers are augmented to 1e-8.
EXACT = 1e-8
#: Lines of the page between which --page writes.
BEGIN, END = "<!-- made by bench/speed_vs_error.py --page -->", "<!-- end -->"


def kind_of(row):
    """Return the kind of a row of a summary."""
    return Kind(*(row[field] for field in Kind._fields))


def name(kind):
    """Return the name of a kind in words."""
    return " ".join(kind).replace("augmented-lagrangian", "AL")


# --- Measurement


def run_once(scene, kind):
    """Return seconds, fraction of contact in them, and errors of a run; no errors if it fails."""
    gc.collect()
    COMM.barrier()
    cpu, wall = time.process_time(), time.perf_counter()
    contacts, problem, solve = scene.assemble(kind)
    try:
        solve()
        failure = None
    except (qs.ConvergenceError, qs.StepError) as error:
        failure = str(error)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    seconds = COMM.allreduce(cpu)
    # The library's stopwatch measures wall time.
    in_contact = COMM.allreduce(sum(c.model.watch.total for c in contacts), op=MPI.MAX)
    share = min(in_contact / COMM.allreduce(wall, op=MPI.MAX), 1.0)
    errors = {} if failure else scene.errors(contacts)
    problem.destroy()
    if failure and COMM.rank == 0:
        print(f"{name(kind)}: no solution after {seconds:.1f} s: {failure}")
    return {"seconds": seconds, "contact": share, **errors}


def fastest(scene, kinds, repeats):
    """Return the fastest run of each kind; kinds alternate, so that other load affects them all."""
    runs = {kind: [] for kind in kinds}
    for _ in range(repeats):
        for kind, rows in runs.items():
            if sum(row["seconds"] for row in rows) <= LONG:
                rows.append(run_once(scene, kind))
    return [min(rows, key=lambda row: row["seconds"]) for rows in runs.values()]


def measure(case, levels, repeats, kinds=KINDS):
    """Return the summary of a case: a row for each kind, with lists over the levels."""
    cls = CASES[case]
    shared = cls.prepare(COMM, levels)
    compiled = cls(COMM, min(levels), shared)
    for quadrature in ("nodal", "overlay"):  # forms are compiled before the timing
        run_once(compiled, BASE._replace(quadrature=quadrature))
    rows = [kind._asdict() for kind in kinds]
    h, unknowns = [], []
    for level in levels:
        scene = cls(COMM, level, shared)
        h.append(float(scene.h))
        unknowns.append(scene.dofs)
        for row, found in zip(rows, fastest(scene, kinds, repeats), strict=True):
            for key in ("seconds", "contact", *cls.errors_of):
                row.setdefault(key, []).append(found.get(key))
            if COMM.rank == 0:
                told = "".join(f" {key} {value:.2e}" for key, value in found.items())
                print(f"{scene.dofs:8} {name(kind_of(row)):35}{told}", flush=True)
    return {
        "case": case,
        **circumstances(COMM.size),
        "h": h,
        "unknowns": unknowns,
        "reference": cls.describe(shared),
        "rows": rows,
    }


# --- The page


def worst(row, measure):
    """Return the errors of all levels, the worse of the two sides; None without a solution."""
    levels = zip(*(row[key] for key in MEASURES[measure]), strict=True)
    return [None if None in errors else max(errors) for errors in levels]


def measures(result):
    """Return the quantities with errors in a summary."""
    return [m for m, keys in MEASURES.items() if all(key in result["rows"][0] for key in keys)]


def percent(error):
    """Format with two digits."""
    if error is None:
        return "no solution"
    if error < EXACT:
        return "exact"
    return f"{100 * error:.0f}" if error >= 0.0995 else f"{100 * error:#.2g}"


def table(head, rows):
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def finest(results):
    """Return error and time of all kinds on the finest level, the time relative to BASE."""
    columns, heads = [], [""]
    for result in results:
        rows = {kind_of(row): row for row in result["rows"]}
        base = rows[BASE]["seconds"][-1]
        for measure in measures(result):
            norm = ", energy norm" if measure == "energy norm" else ""
            heads.append(CASES[result["case"]].title + norm)
            columns.append(
                {
                    k: f"{percent(worst(r, measure)[-1])}, {r['seconds'][-1] / base:.2f}"
                    for k, r in rows.items()
                }
            )
    return table(heads, [[name(k), *(column[k] for column in columns)] for k in columns[0]])


def case_table(result):
    """Return errors, seconds and fraction of contact of every kind and level."""
    keys = [key for measure in reversed(measures(result)) for key in MEASURES[measure]]
    heads = [
        f"h = {h:.3g}, {unknowns:,} unknowns"
        for h, unknowns in zip(result["h"], result["unknowns"], strict=True)
    ]
    rows = []
    for row in result["rows"]:
        cells = [name(kind_of(row))]
        for i, seconds in enumerate(row["seconds"]):
            errors = [percent(row[key][i]) for key in keys]
            text = "no solution" if "no solution" in errors else " / ".join(errors)
            cells.append(f"{text}; {seconds:.3g} s, {100 * row['contact'][i]:.0f} %")
        rows.append(cells)
    return table([" / ".join(keys), *heads], rows)


def circumstances_of(results):
    """Return command, date, machine and versions, once for all cases that have the same."""
    groups = {}
    for r in results:
        versions = ", ".join(f"{key} {value}" for key, value in r["versions"].items())
        text = (
            f"`{r['command']}`, {r['date']}, {r['ranks']} rank{'s' * (r['ranks'] > 1)}, "
            f"{r['machine']['cpu']}, {versions}"
        )
        groups.setdefault(text, []).append(CASES[r["case"]].title)
    return "\n".join(f"- {', '.join(titles)}: {text}" for text, titles in groups.items())


def tables(results):
    """Return the text that --page writes between its two lines."""
    shares = {
        quadrature: statistics.median(
            share
            for result in results
            for row in result["rows"]
            if row["quadrature"] == quadrature
            for share in row["contact"]
        )
        for quadrature in ("overlay", "nodal")
    }
    parts = [
        "## On the finest meshes",
        f"Error in %, and CPU time relative to {name(BASE)} contact (AL: augmented Lagrangian):",
        finest(results),
        "Measured with",
        circumstances_of(results),
        f"The share of contact in the CPU time has a median of {100 * shares['overlay']:.0f} % "
        f"(nodal: {100 * shares['nodal']:.0f} %) over all solves.",
        "## All meshes",
        "Errors in % (below 1e-8: exact), CPU seconds, and share of contact in the CPU time.",
    ]
    for result in results:
        title = CASES[result["case"]].title
        parts += [
            f"### {title}",
            f"![{title}: error over CPU time](figures/speed_{result['case']}.png)",
        ]
        told = [f"{key}: {v:{',' if v > 1e3 else '.4g'}}" for key, v in result["reference"].items()]
        parts += [f"Reference solution: {'; '.join(told)}."] if told else []
        parts.append(case_table(result))
    return "\n\n".join(parts)


def rewritten(page, results):
    """Return the text of the page with new tables."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n\n{tables(results)}\n\n{END}{rest.split(END)[1]}"


# --- Figures

COLORS = dict(zip(FORMULATIONS, ("tab:red", "tab:green", "tab:blue"), strict=True))
STYLES = {"nodal": "s--", "overlay": "o-"}


def plot(result, filename):
    """Draw error over time, a row for each measure, a column for each enforcement."""
    from common.drawing import pyplot, save

    shown, title = measures(result), CASES[result["case"]].title
    figure, grid = pyplot().subplots(
        len(shown),
        len(ENFORCEMENTS),
        figsize=(11, 1.2 + 3.9 * len(shown)),
        sharex=True,
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for axes, measure in zip(grid, shown, strict=True):
        for axis, enforcement in zip(axes, ENFORCEMENTS, strict=True):
            draw(axis, result, measure, enforcement)
        side = ", worse of the two sides" if measure == "traction" else ""
        axes[0].set_ylabel(f"relative error, {measure}{side} (-)")
    for axis, enforcement in zip(grid[0], ENFORCEMENTS, strict=True):
        axis.set_title(f"{title}, {enforcement}")
    for axis in grid[-1]:
        axis.set_xlabel("CPU time of the solve (s)")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncol=3)
    save(figure, filename)


def draw(axis, result, measure, enforcement):
    """Draw one panel: the kinds with this enforcement."""
    least = min(e for row in result["rows"] for e in worst(row, measure) if e is not None)
    for row in result["rows"]:
        if row["enforcement"] == enforcement:
            errors = [e and max(e, EXACT) for e in worst(row, measure)]
            axis.plot(
                row["seconds"],
                [float("nan") if e is None else e for e in errors],
                STYLES[row["quadrature"]],
                color=COLORS[row["formulation"]],
                mfc="white" if row["quadrature"] == "nodal" else None,
                label=f"{row['formulation']}, {row['quadrature']}",
            )
    axis.set(xscale="log", yscale="log")
    if least < EXACT:
        axis.set_ylim(bottom=EXACT / 3)
        axis.annotate("exact: below 1e-8", (0.98, 0.015), xycoords="axes fraction", ha="right")
    axis.grid(which="both")
    for scale, (low, high) in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
        if high < 100 * low:
            label_within_decades(scale)


def label_within_decades(scale):
    """Label 1, 2 and 5 in each decade: otherwise a short axis would have one label, or none."""
    from matplotlib.ticker import LogLocator, NullFormatter

    scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    scale.set_major_formatter("{x:g}")
    scale.set_minor_formatter(NullFormatter())


def load(folder):
    """Return summaries of all cases with a file."""
    files = (folder / f"speed_vs_error_{case}.json" for case in CASES)
    return [json.loads(f.read_text(encoding="utf-8")) for f in files if f.exists()]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=list(CASES))
    parser.add_argument(
        "--levels", nargs="+", type=int, help="mesh levels, 0 is the coarsest; four by default"
    )
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json-dir", type=pathlib.Path, default=RESULTS, metavar="FOLDER")
    parser.add_argument("--page", action="store_true", help="write the page's tables, figures")
    p = parser.parse_args()
    if p.levels is not None and min(p.levels) < 0:
        parser.error("--levels must not be negative")
    if p.repeats < 1:
        parser.error("--repeats must be at least 1")
    if p.page:
        results, page = load(p.json_dir), DOCS / "speed-vs-error.md"
        page.write_text(rewritten(page.read_text(encoding="utf-8"), results), encoding="utf-8")
        for result in results:
            plot(result, DOCS / "figures" / f"speed_{result['case']}.png")
        return
    for case in p.cases:
        result = measure(case, sorted(set(p.levels or CASES[case].levels)), p.repeats)
        if COMM.rank == 0:
            write(p.json_dir / f"speed_vs_error_{case}.json", result, digits=4)


if __name__ == "__main__":
    main()
