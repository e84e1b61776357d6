"""Compare velocity–pressure flow in contact with elastic contact of as many unknowns.

The forging demo, a Norton-Hoff workpiece between two elastic dies whose faces are four times finer,
makes its first steps. In the same process, two elastic blocks on non-matching meshes are pressed
together: contact and problem are made, and the problem is solved by "amg" with a penalty, from the
bodies to closed gaps. "newton" and "krylov" are the Newton iterations of the flow, over all steps
and the continuation in m, and the iterations of its linear solver per Newton iteration; "fixed" are
Krylov iterations of a single solve to a residual of 1e-8 at the end. "ratio" is the time of a
Newton iteration, including all work of the steps, over the time of the whole elastic problem.
Seconds are wall-clock seconds.

    python3 bench/flow.py --cells 8 14 --json flow.json
    python3 bench/flow.py --cells 8 --m 0.3 --enforcement augmented-lagrangian --ranks 2

Keys of the JSON object, or with several --cells of each entry of its list "rows": unknowns, newton,
krylov, fixed, seconds_per_newton, elastic_unknowns, elastic_seconds, ratio, seconds, solver and
stages.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here), str(here.parent / "demos")]

#: Number of runs of the elastic problem; the fastest counts.
REPEATS = 3


def forging(p, cells):
    """Make the first steps of the forging demo: problem, seconds, Newton and Krylov iterations."""
    from mpi4py import MPI

    from forging import Parameters, assemble
    from forging_bodies import RADIUS, create_bodies

    given = Parameters(m=p.m, enforcement=p.enforcement, solver=p.solver)
    h = RADIUS / cells
    bodies = create_bodies(MPI.COMM_WORLD, h, given.die_refinement)
    stepper = assemble(given, h, *bodies)[-1]
    problem, counts = stepper.problem, [0, 0]
    solve = problem.solve

    def counted(*args, **kwargs):
        try:
            return solve(*args, **kwargs)
        finally:
            counts[0] += problem.num_iterations
            counts[1] += problem.num_linear_iterations

    problem.solve = counted
    MPI.COMM_WORLD.barrier()
    start = time.perf_counter()
    for _ in range(p.steps):
        stepper.step()
    MPI.COMM_WORLD.barrier()
    return problem, time.perf_counter() - start, *counts


def fixed(problem):
    """Return the Krylov iterations of one solve with the tangent at the end."""
    import numpy as np

    newton = problem.newton
    newton.respond(np.cos(np.arange(problem.system.x.getLocalSize())))
    return problem.snes.getKSP().getIterationNumber()


def elastic(unknowns):
    """Return unknowns and seconds of two elastic blocks in contact, the fastest of some runs."""
    from mpi4py import MPI

    from two_blocks import box, two_bodies

    import qsdolfinx as qs

    n = min(range(4, 200), key=lambda k: abs(3 * ((k + 1) ** 3 + (4 * k // 5 + 1) ** 3) - unknowns))
    seconds = []
    for _ in range(REPEATS):
        meshes = [box("hexahedron", n, 0.0, 1.0), box("hexahedron", 4 * n // 5, 1.0, 2.0)]
        forms, u, bcs, surfaces = two_bodies(meshes, [1.0, 1.0])
        MPI.COMM_WORLD.barrier()
        start = time.perf_counter()
        contact = qs.Contact(surfaces[1], surfaces[0], enforcement="penalty")
        problem = qs.ContactProblem(forms, u, [contact], bcs, linear_solver="amg")
        problem.solve()
        MPI.COMM_WORLD.barrier()
        seconds.append(time.perf_counter() - start)
        size = problem.system.x.getSize()
        problem.destroy()
    return size, min(seconds)


def measure(p, cells):
    """Return one row."""
    elastic(2000)  # compiles the forms
    problem, seconds, newton, krylov = forging(p, cells)
    unknowns = problem.system.x.getSize()
    row = {
        "cells": cells,
        "unknowns": unknowns,
        "solver": problem.linear_solver,
        "seconds": seconds,
        "newton": newton,
        "krylov": krylov / newton,
        "fixed": fixed(problem),
        "seconds_per_newton": seconds / newton,
        "stages": {name: span.max for name, span in problem.timings.items()},
    }
    problem.destroy()
    row["elastic_unknowns"], row["elastic_seconds"] = elastic(unknowns)
    return row | {"ratio": row["seconds_per_newton"] / row["elastic_seconds"]}


def start(p, cells):
    """Return the row of a separate process, or of as many processes as there are ranks."""
    command = ["mpirun", "--oversubscribe", "-n", str(p.ranks)] if p.ranks > 1 else []
    command += [sys.executable, __file__, "--run", "--cells", str(cells), "--m", str(p.m)]
    command += ["--enforcement", p.enforcement, "--solver", p.solver, "--steps", str(p.steps)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.split("\n") if line.startswith("row ")]
    if not lines:
        sys.exit(done.stdout[-500:] + done.stderr[-2000:])
    return json.loads(lines[0][4:])


def line(r):
    """Return one line of the table."""
    return (
        f"{r['unknowns']:10}{r['solver']:>8}{r['newton']:8}{r['krylov']:8.1f}{r['fixed']:7}"
        f"{r['seconds_per_newton']:11.3f}{r['elastic_unknowns']:10}{r['elastic_seconds']:9.3f}"
        f"{r['ratio']:7.2f}"
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--cells", type=int, nargs="+", default=(8, 14), help="cells along the workpiece's radius")
    add("--m", type=float, default=0.15, help="rate sensitivity")
    enforcements = "penalty", "augmented-lagrangian"
    add("--enforcement", choices=enforcements, default="penalty")
    add("--solver", default="schur", help="solver of the flow")
    add("--steps", type=int, default=2)
    add("--ranks", type=int, default=1)
    add("--json", metavar="FILE")
    add("--run", action="store_true", help=argparse.SUPPRESS)
    p = parser.parse_args()
    if p.run:
        row = measure(p, p.cells[0])
        from mpi4py import MPI

        if MPI.COMM_WORLD.rank == 0:
            print("row " + json.dumps(row), flush=True)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    print("  unknowns  solver  newton  krylov  fixed  s/newton   elastic  seconds  ratio")
    rows = []
    for cells in p.cells:
        rows.append(start(p, cells))
        print(line(rows[-1]), flush=True)
    if p.json:
        from machine import circumstances, write

        given = {"m": p.m, "enforcement": p.enforcement, "steps": p.steps}
        result = rows[0] if len(rows) == 1 else {"rows": rows}
        write(p.json, circumstances(p.ranks) | given | result)


if __name__ == "__main__":
    main()
