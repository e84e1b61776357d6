"""Measure each linear solver, and the solver chosen by ``solver="auto"``, scene by scene.

Two elastic blocks on non-matching meshes, linear or neo-Hookean, of degree 1 or 2, or an elastic
tool on a block in velocity and pressure (MINI elements), a Newtonian fluid or a Norton-Hoff body of
m = 0.3, are pressed together, with and without friction: from forms to closed gaps, with the
default options of contact. Printed are CPU seconds of all ranks with each solver, the choice of
"auto", and its time over the time of the best solver. A solver is left out of larger problems when
a smaller problem of its scene took more than ``--longest`` seconds.

    python3 bench/solvers.py [--dim 2 3] [--scenes linear …] [--cells 8 16 …] [--json FILE]
    mpirun -n 2 python3 bench/solvers.py

With --page nothing is measured: the tables of docs/solvers.md are made from the --json files
bench/results/solvers_*.json.
"""

import argparse
import itertools
import json
import pathlib
import sys
import time
import typing

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from flow_scene import flow
from machine import circumstances, write
from two_blocks import PRESS, box, clamp, facets_at

COMM = MPI.COMM_WORLD
HERE = pathlib.Path(__file__).resolve().parent
PAGE, MARK = HERE.parent / "docs" / "solvers.md", "<!-- made by bench/solvers.py --page -->\n"
E, MU = (3e4, 1.3e4), 0.2
#: Cells along an edge, for about 2,000 to 300,000 unknowns.
CELLS = {
    ("linear", 2): (24, 60, 140, 300),
    ("linear", 3): (8, 14, 20, 28, 36),
    ("flow", 2): (20, 50, 110, 200),
    ("flow", 3): (6, 9, 13, 18, 24),
}
SOLVERS = {"linear": ("direct", "amg"), "hyperelastic": ("direct", "amg")}
SOLVERS["Newtonian"] = SOLVERS["Norton-Hoff"] = ("direct", "schur")
#: Rate sensitivities of the flow.
RATES = {"Newtonian": None, "Norton-Hoff": 0.3}


class Case(typing.NamedTuple):
    """Name a scene without its size."""

    scene: str
    dim: int
    degree: int
    mu: float

    def __str__(self):
        kind = f"{self.scene} {self.dim}D" + (f" P{self.degree}" if self.scene not in RATES else "")
        return kind + (", friction" if self.mu else "")

    def cells(self):
        """Return the cells along an edge."""
        scene = "flow" if self.scene in RATES else "linear"
        return [max(2, n // self.degree) for n in CELLS[scene, self.dim]]


def elastic(case, n, solver):
    """Make two elastic blocks."""
    cell = "triangle" if case.dim == 2 else "tetrahedron"
    meshes = box(cell, n, 0.0, 1.0), box(cell, max(1, 4 * n // 5), 1.0, 2.0)
    law = "neo_hookean" if case.scene == "hyperelastic" else "linear_elastic"
    forms, us, bcs, surfaces = [], [], [], []
    for i, (msh, modulus) in enumerate(zip(meshes, E, strict=True)):
        V = fem.functionspace(msh, ("Lagrange", case.degree, (case.dim,)))
        u, v = fem.Function(V), ufl.TestFunction(V)
        stress = getattr(qs.materials, law)(u, modulus, 0.3)
        dx = ufl.dx(degree=2 * case.degree)  # UFL's estimate for ln J takes too long
        forms.append(ufl.inner(stress, ufl.grad(v)) * dx)
        us.append(u)
        bcs.append([clamp(V, 2.0 * i, i * PRESS)])
        surfaces.append(qs.Surface(V, facets=facets_at(msh, 1.0)))
    friction = qs.Coulomb(case.mu) if case.mu else None
    contact = qs.Contact(*surfaces[::-1], friction=friction)
    return qs.ContactProblem(forms, us, [contact], bcs, linear_solver=solver)


def measure(case, n, solver):
    """Return CPU seconds of all ranks (None if it fails), unknowns, and the solver in use."""
    COMM.barrier()
    start = time.process_time()
    if case.scene in RATES:
        m = RATES[case.scene]
        problem, _ = flow(case.dim, n, solver, "augmented-lagrangian", case.mu, m)
    else:
        problem = elastic(case, n, solver)
    try:
        problem.solve()
        seconds = COMM.allreduce(time.process_time() - start, op=MPI.SUM)
    except qs.ConvergenceError:
        seconds = None
    out = seconds, problem.system.x.getSize(), problem.linear_solver
    problem.destroy()
    return out


def rows_of(case, longest, cells, repeats=1):
    """Return a row for each size: unknowns, seconds of each solver and of "auto", its choice."""
    names = [*SOLVERS[case.scene], "auto"]
    left = set(names)
    for n in cells or case.cells():
        if left == {"auto"}:
            return
        row = {"case": str(case), "cells": n}
        for name in [name for name in names if name in left] * repeats:
            seconds, row["unknowns"], taken = measure(case, n, name)
            row[name] = fewest(seconds, row.get(name))
            if name == "auto":
                row["picked"] = taken
        left -= {s for s in left - {"auto"} if row[s] is None or row[s] > longest}
        best = fewest(*(row.get(s) for s in SOLVERS[case.scene]))
        row["ratio"] = row["auto"] / best if row["auto"] and best else None
        yield row


def fewest(*seconds):
    """Return the fewest seconds of runs that ended, None if none has ended."""
    return min((t for t in seconds if t is not None), default=None)


def cells_of(row):
    """Format seconds of direct, iterative and auto, and auto over the best, as a row of a table."""
    scene = row["case"].split()[0]
    times = [row.get(s) for s in (*SOLVERS[scene], "auto")]
    return [
        *("–" if t is None else f"{t:.2f}" for t in times),
        row["picked"],
        "–" if row["ratio"] is None else f"{row['ratio']:.2f}",
    ]


def page(results):
    """Yield the tables of the page.

    Args:
        results: Contents of the files written with --json.
    """
    for result in results:
        ranks, rows = result["ranks"], result["rows"]
        dims = sorted({word for row in rows for word in ("2D", "3D") if word in row["case"]})
        scenes = ", ".join(dict.fromkeys(row["case"].split()[0] for row in rows))
        yield f"\n## {' and '.join(dims)}, {ranks} rank{'s' * (ranks > 1)}: {scenes}\n"
        versions = result["versions"]
        yield f"`{result['command']}`, {result['date']}, {result['machine']['cpu']}, PETSc"
        yield f"{versions['petsc']}, dolfinx {versions['dolfinx']}\n"
        yield "| scene | unknowns | direct, s | iterative, s | auto, s | picked | auto / best |"
        yield "|---|---|---|---|---|---|---|"
        last = ""
        for row in rows:
            case = row["case"] if row["case"] != last else ""
            last = row["case"]
            yield f"| {case} | {row['unknowns']:,} | {' | '.join(cells_of(row))} |"
        ratios = [row["ratio"] for row in rows if row["ratio"]]
        yield f"\nRatio auto / best: at most {max(ratios):.2f}, median {np.median(ratios):.2f}."


def rewritten(text):
    """Return the text of the page with new tables below the mark."""
    files = sorted((HERE / "results").glob("solvers_*.json"))
    results = [json.loads(f.read_text(encoding="utf-8")) for f in files]
    return text.partition(MARK)[0] + MARK + "\n".join(page(results)) + "\n"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dim", type=int, nargs="+", choices=(2, 3), default=(2, 3))
    parser.add_argument("--scenes", nargs="+", choices=tuple(SOLVERS), default=tuple(SOLVERS))
    parser.add_argument("--degrees", type=int, nargs="+", choices=(1, 2), default=(1, 2))
    parser.add_argument("--mu", type=float, nargs="+", default=(0.0, MU))
    parser.add_argument("--cells", type=int, nargs="+", help="cells along an edge, all scenes")
    parser.add_argument("--longest", type=float, default=40.0, help="CPU time limit, s")
    parser.add_argument("--repeats", type=int, default=1, help="runs; the fastest counts")
    parser.add_argument("--json", type=pathlib.Path, help="output file of all rows")
    parser.add_argument("--page", action="store_true", help="write the tables of the page")
    p = parser.parse_args()
    if p.page:
        PAGE.write_text(rewritten(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
        return
    say = print if COMM.rank == 0 else lambda *args, **kwargs: None
    say("| scene | unknowns | direct, s | iterative, s | auto, s | picked | auto / best |")
    say("|---|---|---|---|---|---|---|")
    rows = []
    warm_up = Case("linear", 2, 1, 0.0)
    measure(warm_up, 4, "direct")
    for scene, dim, degree, mu in itertools.product(p.scenes, p.dim, p.degrees, p.mu):
        if scene in RATES and degree == 2:
            continue
        case = Case(scene, dim, degree, mu)
        for name in SOLVERS[scene]:  # compile the forms first
            measure(case, 2, name)
        for row in rows_of(case, p.longest, p.cells, p.repeats):
            rows.append(row)
            if p.json and COMM.rank == 0:  # each time, so that an interrupted run leaves its rows
                write(p.json, {**circumstances(COMM.size), "rows": rows}, digits=3)
            shown = " | ".join(cells_of(row))
            say(f"| {row['case']} | {row['unknowns']:,} | {shown} |", flush=True)
    ratios = [row["ratio"] for row in rows if row["ratio"]]
    say(f"\nauto / best: at most {max(ratios):.2f}, median {np.median(ratios):.2f}")


if __name__ == "__main__":
    main()
