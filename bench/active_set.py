"""Compare contact whose active set is unknown with a tie of the same meshes.

A sphere on a block, of hexahedra (bench/peers/sphere.py), with unilateral contact and with a tie of
all opposite surfaces, whose constraints never change. Measured from the bodies to the solution, in
one process on one rank, CPU seconds of the fastest of some runs. "newton" and "krylov" are
iterations of the whole solve, "ratio" is unilateral over tied.

    python3 bench/active_set.py --sizes 20,16 40,32 --json bench/results/active_set.json
"""

import argparse
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "peers"))

import ours
import sphere
from machine import circumstances, write

import qsdolfinx as qs

LAWS = {"tied": qs.Tied, "unilateral": qs.Unilateral}


def solve(law, bodies, p):
    """Return seconds, unknowns, iterations and the stages of one solve."""
    forms, u, bcs, surfaces = zip(*bodies, strict=True)
    for each in u:
        each.x.array[:] = 0
    start = time.process_time()
    # the tie covers all of the sphere's lower side
    contact = qs.Contact(
        *surfaces[::-1],
        law=LAWS[law](),
        enforcement=p.enforcement,
        constraints=p.constraints if law == "unilateral" else "nodes",
        search_radius=sphere.SIDE / 4,
    )
    problem = qs.ContactProblem(list(forms), list(u), [contact], list(bcs), linear_solver=p.solver)
    problem.solve()
    out = {
        "seconds": time.process_time() - start,
        "unknowns": problem.system.x.getSize(),
        "newton": problem.num_iterations,
        "krylov": problem.num_linear_iterations,
        "stages": {name: span.max for name, span in problem.timings.items()},
    }
    problem.destroy()
    return out


def rows_of(sizes, p):
    """Return a row for each contact law."""
    bodies = [ours.create_body(b, i, sphere) for i, b in enumerate(sphere.bodies(sizes))]
    rows = {}
    for _ in range(p.repeats):
        for law in LAWS:
            row = solve(law, bodies, p)
            if law not in rows or row["seconds"] < rows[law]["seconds"]:
                rows[law] = row
    for law, row in rows.items():
        row["ratio"] = row["seconds"] / rows["tied"]["seconds"]
        print(
            f"{row['unknowns']:10}  {law:11}{row['seconds']:9.2f}{row['newton']:8}"
            f"{row['krylov']:8}{row['ratio']:8.2f}",
            flush=True,
        )
    return [{"law": law} | row for law, row in rows.items()]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--sizes", nargs="+", default=["20,16", "40,32"], help="cells along an edge, LOWER,UPPER")
    add(
        "--enforcement", choices=("penalty", "augmented-lagrangian"), default="augmented-lagrangian"
    )
    add("--constraints", choices=("nodes", "points"), default="nodes")
    add("--solver", default="auto")
    add("--repeats", type=int, default=2)
    add("--json", metavar="FILE")
    p = parser.parse_args()
    print("  unknowns  contact      seconds  newton  krylov   ratio")
    rows = []
    for text in p.sizes:
        rows += rows_of([int(n) for n in text.split(",")], p)
    if p.json:
        given = {"enforcement": p.enforcement, "constraints": p.constraints}
        write(p.json, circumstances(1) | given | {"rows": rows})


if __name__ == "__main__":
    main()
