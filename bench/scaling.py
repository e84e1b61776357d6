"""Growth of time and memory with unknowns and ranks, compared with a body without contact.

Two cubes of one material (nu 0.3) on non-matching meshes, n and 4n/5 cells along an edge of the
lower and of the upper cube, are pressed together by 1 %: unilateral or tied, quasi-symmetric
contact with an augmented Lagrangian, solved by "amg". The reference is one matching body of as many
unknowns, assembled and solved by DOLFINx and PETSc alone, with the options of the same preset and
to the same accuracy: a residual below 1e-9 of the reactions, which are taken from a previous run
("residual").

Each row comes from a separate process, or from as many processes as there are ranks. Seconds are
wall-clock seconds of the slowest rank, from the given meshes to the solution; forms are compiled
before. MiB is the sum over ranks of the largest resident set. "ratio" divides seconds and memory by
those of the bonded body. "its" are Krylov iterations of all Newton steps; "fixed" is the largest
number of iterations of a linear solve to 1e-8, from a separate run with that tolerance. "contact"
is the fraction of the seconds in contact detection, gap, insertion and conversion. --partition
selects the distribution of cells over ranks: DOLFINx's partition of the cell graph; a partition cut
across the contact by qs.repartition; or one cut along it, with all contact on one rank.

    python3 bench/scaling.py --cells 13 26 40 60 --ranks 1 2 --json bench/results/scaling.json
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances, write

MODELS = ("bonded", "tied", "unilateral")
CONTACT = ("pairing", "gap", "insertion", "conversion")
#: Stages of the work, in the order of the table.
STAGES = (*CONTACT, "bulk assembly", "solve")
PARTITIONS = ("graph", "across", "along")


def run(model, options):
    """Return the row of one process, or of the ranks that mpirun has started."""
    from mpi4py import MPI

    from scaling_scene import measure

    row = measure(model, options)
    if MPI.COMM_WORLD.rank == 0:
        print("ROW " + json.dumps(row), flush=True)


def start(model, cells, ranks, p, exact=False):
    """Return the row of a new process, or None if it fails."""
    command = [sys.executable, __file__, "--run", model, "--cells", str(cells), "--cell", p.cell]
    command += ["--quadrature", p.quadrature, "--enforcement", p.enforcement]
    command += ["--partition", p.partition]
    if exact:
        command.append("--exact")
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"}
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("ROW ")]
    if not lines:
        print(done.stdout[-500:], done.stderr[-1500:], file=sys.stderr)
        return None
    return json.loads(lines[0][4:])


def rows_of(cells, ranks, p):
    """Return the rows of all models at one size."""
    rows = []
    for model in p.models:
        row = start(model, cells, ranks, p)
        if row is None:
            continue
        if model != "bonded":
            bonded = rows[0] if rows and rows[0]["model"] == "bonded" else None
            if bonded:
                for key in ("seconds", "MiB"):
                    row[f"{key}_ratio"] = row[key] / bonded[key]
            row["contact_share"] = sum(row["stages"][k] for k in CONTACT) / row["seconds"]
            if not p.no_fixed:
                exact = start(model, cells, ranks, p, exact=True)
                row["fixed"] = exact["most_iterations"] if exact else None
                row["fixed_newton"] = exact["newton"] if exact else None
        rows.append(row)
        print(line(row), flush=True)
    return rows


def head():
    names = "".join(f"{name[:9]:>10}" for name in STAGES)
    return (
        f"{'model':11}{'ranks':>6}{'unknowns':>10}{'seconds':>9}{'ratio':>6}{'MiB':>7}{'ratio':>6}"
        f"{'Newton':>7}{'its':>5}{'fixed':>6}{'gap/h':>9}{'contact':>8}{names}{'points':>8}"
    )


def line(r):
    """Return one line of the table."""

    def number(key, form):
        return format(r[key], form) if r.get(key) is not None else " " * int(form.split(".")[0])

    stages = "".join(f"{r['stages'][name]:10.3f}" for name in STAGES)
    return (
        f"{r['model']:11}{r['ranks']:6}{r['unknowns']:10}{r['seconds']:9.2f}"
        f"{number('seconds_ratio', '6.2f')}{r['MiB']:7.0f}{number('MiB_ratio', '6.2f')}"
        f"{r['newton']:7}{r['iterations']:5}{number('fixed', '6.0f')}{number('gap', '9.1e')}"
        f"{number('contact_share', '8.1%')}{stages}{r['points']:8}"
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--cells", type=int, nargs="+", default=(13, 26, 40, 60), help="along an edge, lower cube")
    add("--ranks", type=int, nargs="+", default=(1, 2))
    add("--cell", choices=("hexahedron", "tetrahedron"), default="hexahedron")
    add("--models", nargs="+", choices=MODELS, default=MODELS)
    add("--quadrature", choices=("nodal", "overlay"), default="overlay")
    enforcements = "penalty", "augmented-lagrangian"
    add("--enforcement", choices=enforcements, default="augmented-lagrangian")
    add("--partition", choices=PARTITIONS, default="graph")
    add("--no-fixed", action="store_true", help="leave out the runs with a fixed tolerance")
    add("--json", metavar="FILE")
    add("--run", choices=MODELS, help=argparse.SUPPRESS)
    add("--exact", action="store_true", help=argparse.SUPPRESS)
    p = parser.parse_args()
    if p.run:
        p.cells = p.cells[0]
        run(p.run, p)
        return
    print(head())
    rows = []
    for cells in p.cells:
        for ranks in p.ranks:
            rows += rows_of(cells, ranks, p)
    for cells in p.cells:
        speed_up(rows, cells, p)
    if p.json:
        given = {"cell": p.cell, "quadrature": p.quadrature, "enforcement": p.enforcement}
        given["partition"] = p.partition
        write(p.json, circumstances(p.ranks) | given | {"rows": rows})


def speed_up(rows, cells, p):
    """Return the speed-up between the first and the last number of ranks, for each stage."""
    if len(p.ranks) < 2:
        return
    for model in p.models:
        mine = [r for r in rows if r["cells"] == cells and r["model"] == model]
        few, many = ([r for r in mine if r["ranks"] == n] for n in (p.ranks[0], p.ranks[-1]))
        if not few or not many:
            continue
        few, many = few[0], many[0]
        stages = [
            f"{name} {few['stages'][name] / many['stages'][name]:.2f}"
            for name in STAGES
            if many["stages"][name] > 0
        ]
        many["speed_up"] = few["seconds"] / many["seconds"]
        print(
            f"{model}, {few['unknowns']} unknowns: {many['ranks']} ranks are "
            f"{many['speed_up']:.2f} times as fast as {few['ranks']} ({', '.join(stages)})"
        )


if __name__ == "__main__":
    main()
