"""Speed against error: every formulation, quadrature and enforcement on four mesh levels.

Patch test (hexahedra, non-matching, jittered) and Hertz contact in 2D (cylinder on block, slave
coarser). Seconds are those of the whole solve and of contact in it (pairing, gaps, insertion), the
best of the repeats; errors are those of the recovered traction on each side: the largest nodal one
in the patch test, L2 for Hertz. One table for each case, and one log-log figure.

    python3 bench/speed_vs_error.py --json speed.json --plot speed
"""

import argparse
import itertools
import json
import pathlib
import sys

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "demos"))

import hertz
import patch_test

COMM = MPI.COMM_WORLD
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
KINDS = tuple(
    itertools.product(FORMULATIONS, ("nodal", "overlay"), ("penalty", "augmented-lagrangian"))
)


def run_patch(n, formulation, quadrature, enforcement):
    p = patch_test.Parameters(
        master=5 * n,
        slave=3 * n,
        cell="hexahedron",
        jitter=0.25,
        formulation=formulation,
        quadrature=quadrature,
        enforcement=enforcement,
    )
    r, _ = patch_test.run(p, COMM)
    return {side: r[f"{side}_nodal_max_error"] for side in ("slave", "master")} | r


def run_hertz(n, formulation, quadrature, enforcement):
    p = hertz.Parameters(
        h=0.2 / n,
        ratio=1.5,
        formulation=formulation,
        quadrature=quadrature,
        enforcement=enforcement,
    )
    r, _ = hertz.run(p, COMM)
    return {side: r[f"l2_error_{side}"] for side in ("slave", "master")} | r


CASES = {"patch": (run_patch, (1, 2, 4, 8)), "hertz": (run_hertz, (1, 2, 4, 8))}


def measure(case, repeats):
    """Rows of one case; None in the place of errors where there is no solution."""
    run, levels = CASES[case]
    rows = []
    for level, kind in itertools.product(levels, KINDS):
        best = None
        for _ in range(repeats):
            try:
                r = run(level, *kind)
            except hertz.qs.ConvergenceError:
                continue
            if best is None or r["total_seconds"] < best["total_seconds"]:
                best = r
        row = dict(
            zip(
                ("case", "level", "formulation", "quadrature", "enforcement"),
                (case, level, *kind),
                strict=True,
            )
        )
        keys = ("dofs", "slave", "master", "total_seconds", "contact_seconds", "snes_iterations")
        rows.append(row | {key: None if best is None else best[key] for key in keys})
    return rows


def table(rows):
    """Text of one case."""
    lines = [
        f"{'formulation':17}{'quadrature':11}{'enforcement':22}{'dofs':>7}{'slave':>10}{'master':>10}"
        f"{'total s':>9}{'contact s':>10}{'its':>4}"
    ]
    for r in rows:
        start = f"{r['formulation']:17}{r['quadrature']:11}{r['enforcement']:22}"
        if r["dofs"] is None:
            lines.append(start + "  no solution")
            continue
        lines.append(
            start + f"{r['dofs']:7}{r['slave']:10.1e}{r['master']:10.1e}{r['total_seconds']:9.3f}"
            f"{r['contact_seconds']:10.4f}{r['snes_iterations']:4}"
        )
    return "\n".join(lines)


def plot(case, rows, filename):
    """Error on both sides over seconds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 5), sharey=True, layout="constrained")
    colors = dict(
        zip(FORMULATIONS, ("tab:red", "tab:green", "tab:blue", "tab:purple"), strict=True)
    )
    for axis, side in zip(axes, ("slave", "master"), strict=True):
        for kind in KINDS:
            mine = [
                r for r in rows if (r["formulation"], r["quadrature"], r["enforcement"]) == kind
            ]
            mine = [r for r in mine if r["dofs"] is not None]
            axis.loglog(
                [r["total_seconds"] for r in mine],
                [max(r[side], 1e-15) for r in mine],
                "o-" if kind[1] == "overlay" else "s--",
                color=colors[kind[0]],
                alpha=1.0 if kind[2] == "penalty" else 0.4,
                label=f"{kind[0]}, {kind[1]}" + ("" if kind[2] == "penalty" else ", augmented"),
                ms=4,
            )
        axis.set_xlabel("seconds")
        axis.set_title(f"{case}: {side} side", fontsize=10)
        axis.grid(which="both", alpha=0.3)
    axes[0].set_ylabel("error of the recovered traction")
    axes[1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(filename, dpi=110)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=list(CASES))
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument(
        "--plot", metavar="PREFIX", help="writes PREFIX_patch.png, PREFIX_hertz.png"
    )
    a = parser.parse_args()
    everything = []
    for case in a.cases:
        rows = measure(case, a.repeats)
        everything += rows
        if COMM.rank == 0:
            print(f"\n{case}, {COMM.size} ranks\n{table(rows)}", flush=True)
            if a.plot:
                plot(case, rows, f"{a.plot}_{case}.png")
    if COMM.rank == 0 and a.json:
        with open(a.json, "w") as file:
            json.dump(everything, file, indent=2)


if __name__ == "__main__":
    main()
