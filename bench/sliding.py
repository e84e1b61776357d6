"""Compare contact with updated geometry (finite sliding) with small sliding.

A neo-Hookean cube is pressed on a larger one and pushed along it by --slide facets in --steps
solves, of hexahedra, on one rank. A row for each enforcement and kind of sliding: Newton and Krylov
iterations of the solves, multiplier updates, seconds, the fraction of contact in them (gap and
insertion, including the segmentation at each evaluation), and the time of contact per Newton
iteration and pair of intersecting facets. With updated geometry also the number of evaluations of
the segments, and of searches for nearby facets among them.

    python3 bench/sliding.py --cells 16 --json sliding.json
    python3 bench/sliding.py --cells 40 --enforcement penalty
    python3 bench/sliding.py --cells 8 --slide 4 --steps 20
"""

import argparse
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from mpi4py import MPI

import numpy as np
from machine import circumstances, write

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COLUMNS = (
    *("unknowns", "newton", "krylov", "updates", "seconds", "share", "us_per_pair"),
    *("evaluations", "searches"),
)


def block(corners, counts, cell, E, fixed, touching):
    """Return unknown, form, condition on the face z = fixed and its value, contact surface."""
    msh = mesh.create_box(MPI.COMM_WORLD, corners, counts, mesh.CellType[cell])
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, lame = fem.Function(V), (E / 2.6, E * 0.3 / (1.3 * 0.4))
    stress = qs.materials.neo_hookean(u, *lame)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx(degree=2)

    def at(z):
        return mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[2], z))

    moved = fem.Constant(msh, np.zeros(3))
    bc = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 2, at(fixed)), V)
    return F, u, bc, moved, qs.Surface(V, facets=at(touching))


def solve(p, sliding, enforcement):
    """Return one solve as a row."""
    size = 0.8 / p.cells
    lower = block([(0, 0, 0), (1.2, 1.2, 1)], 3 * [round(1.25 * p.cells)], "hexahedron", 1e3, 0, 1)
    upper = block([(0.1, 0.1, 1), (0.9, 0.9, 1.8)], 3 * [p.cells], "hexahedron", 5e2, 1.8, 1)
    contact = qs.Contact(upper[4], lower[4], sliding=sliding, enforcement=enforcement)
    bodies = lower, upper
    problem = qs.ContactProblem(
        [b[0] for b in bodies],
        [b[1] for b in bodies],
        [contact],
        [[b[2]] for b in bodies],
        linear_solver=p.solver,
    )
    count, start = np.zeros(3, dtype=int), time.perf_counter()
    for step in range(1, p.steps + 1):
        upper[3].value[:] = p.slide * size * step / p.steps, 0.0, -0.03
        problem.solve()
        done = problem.num_iterations, problem.num_linear_iterations, problem.num_augmentations
        count += done
    seconds = time.perf_counter() - start
    spent = {name: span.max for name, span in problem.timings.items()}
    of_contact = spent["gap"] + spent["insertion"] + spent["conversion"]
    cut, following = contact.model.gaps[0].cut, contact.model.gaps[0].following
    kept = None if following is None else following.kept_pairs
    pairs = 1 if cut is None else cut.found.of_cutter.size
    row = {
        "sliding": sliding,
        "enforcement": enforcement,
        "unknowns": problem.system.x.getSize(),
        **dict(zip(("newton", "krylov", "updates"), count.tolist(), strict=True)),
        "seconds": seconds,
        "share": of_contact / seconds,
        "us_per_pair": 1e6 * of_contact / int(count[0]) / pairs if cut else 0.0,
        "evaluations": kept.num_evaluations if kept else 0,
        "searches": kept.num_searches if kept else 0,
        "stages": spent,
    }
    problem.destroy()
    return row


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--cells", nargs="+", type=int, default=[16], help="cells along an edge, upper cube")
    add("--slide", type=float, default=1.0, help="slide, in facets of the upper cube")
    add("--steps", type=int, default=1, help="solves, each with an equal part of the slide")
    enforcements = ["penalty", "augmented-lagrangian"]
    add("--enforcement", nargs="+", choices=enforcements, default=enforcements)
    add("--solver", default="amg")
    add("--json", metavar="FILE")
    p = parser.parse_args()
    cells, rows = p.cells, []
    print(f"{'sliding':9}{'enforcement':22}" + "".join(f"{name:>12}" for name in COLUMNS))
    for p.cells in cells:
        for enforcement in p.enforcement:
            for sliding in ("small", "finite"):
                row = solve(p, sliding, enforcement)
                rows.append(row)
                text = f"{sliding:9}{enforcement:22}"
                print(text + "".join(f"{row[name]:12.4g}" for name in COLUMNS), flush=True)
    if p.json:
        write(p.json, circumstances(1) | {"slide": p.slide, "steps": p.steps, "rows": rows})


if __name__ == "__main__":
    main()
