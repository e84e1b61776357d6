"""Run the spring of spring.py with qsdolfinx: finite sliding in self-contact.

    python3 bench/peers/ours_spring.py --refine 1 --friction 0.2

Prints the table of spring.py and a line ``RESULT {json}``. With --two, the lower and the upper half
of the surface are two surfaces.
"""

import json
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from mpi4py import MPI

import numpy as np
import ours_ring
import spring

import qsdolfinx as qs


def run(p):
    """Run the path; return a row for each step."""
    given = spring.spring(p.refine)
    body = ours_ring.Body(given, spring.moduli())
    if p.two:
        surfaces = [body.surface(given.half(sign)) for sign in (-1, 1)]
    else:
        surfaces = 2 * [body.surface(given.touching)]
    contact = qs.Contact(
        *surfaces,
        formulation=p.formulation,
        friction=qs.Coulomb(p.friction) if p.friction else None,
        sliding="finite",
        enforcement=p.enforcement,
        **{"search_radius": p.search_radius} if p.search_radius else {},
    )
    problem = qs.ContactProblem([body.F], [body.u], [contact], [body.bcs])
    rows, start = [], time.perf_counter()
    ends = body.ends.x.array.reshape(-1, 2)
    for step in spring.path(not p.pressing_only):
        begun = time.perf_counter()
        ends[body.node[given.moved]] = step
        problem.solve()
        row = spring.told(given, body.displacements(), body.forces())
        row |= {"ends": step, "newton": problem.num_iterations}
        row |= {"updates": problem.num_augmentations, "seconds": time.perf_counter() - begun}
        rows.append(row)
        print(spring.line(step, row), flush=True)
    states = {"u": np.array(body.displacements())}
    if p.output:
        np.savez(p.output, **states)
    return {"rows": rows, "seconds": time.perf_counter() - start}


def main():
    parser = ours_ring.arguments(__doc__)
    parser.add_argument("--two", action="store_true", help="two surfaces")
    parser.add_argument("--search-radius", type=float)
    parser.add_argument("--output", metavar="NPZ", help="file of final nodal displacements")
    p = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("on one rank")
    print(spring.HEADER)
    result = run(p)
    print(f"{result['seconds']:.1f} s")
    print("RESULT", json.dumps(result, default=float))


if __name__ == "__main__":
    main()
