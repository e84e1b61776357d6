"""Time and Krylov iterations of the solver presets over the size of a problem.

Two elastic blocks on non-matching meshes, n and 4n/5 cells along an edge of the lower and the upper
one, squares or cubes, are pressed together by a displacement: unilateral quasi-symmetric contact
with an augmented Lagrangian. Printed are wall seconds of the solve, from forms to closed gaps,
Newton and Krylov iterations.

    python3 bench/presets.py --dim 3 --cells 10 20 30
    mpirun -n 2 python3 bench/presets.py --dim 2 --cells 100 200 400

With --scene flow the lower block is viscoplastic, in velocity and pressure, see flow_scene.py; for
--m below 1 it is solved by continuation, and iterations are those of all its solves.

    python3 bench/presets.py --scene flow --dim 3 --cells 6 8 10 --m 0.15
"""

import argparse
import math
import pathlib
import sys
import time

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from flow_scene import flow
from two_blocks import box, two_bodies

COMM = MPI.COMM_WORLD
E = 3e4, 1.3e4  # of the lower and the upper block
SOLVERS = {"elastic": ("direct", "amg", "fieldsplit"), "flow": ("direct", "schur")}


def elastic(dim, n, solver, enforcement):
    """Two elastic blocks."""
    cell = "quadrilateral" if dim == 2 else "hexahedron"
    meshes = box(cell, n, 0.0, 1.0), box(cell, 4 * n // 5, 1.0, 2.0)
    forms, u, bcs, surfaces = two_bodies(meshes, E)
    contact = qs.Contact(*surfaces[::-1], enforcement=enforcement)
    return qs.ContactProblem(forms, u, [contact], bcs, solver=solver)


def measure(p, n, solver):
    """Seconds, Newton and Krylov iterations, unknowns."""
    COMM.barrier()
    start = time.perf_counter()
    if p.scene == "elastic":
        problem = elastic(p.dim, n, solver, p.enforcement)
        steps = [None]
    else:
        problem, m = flow(p.dim, n, solver, p.enforcement, p.mu)
        steps = np.geomspace(1.0, p.m, 1 if p.m == 1 else 1 + math.ceil(math.log(1 / p.m, 4)))
    counts = np.zeros(2, dtype=int)
    for step in steps:
        if step is not None:
            m.value = step
        problem.solve()
        counts += problem.num_iterations, problem.num_linear_iterations
    seconds = COMM.allreduce(time.perf_counter() - start, op=MPI.MAX)
    unknowns = problem.system.x.getSize()
    problem.destroy()
    return seconds, counts, unknowns


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dim", type=int, choices=(2, 3), default=3)
    parser.add_argument("--cells", type=int, nargs="+", default=(10, 16, 24))
    parser.add_argument("--scene", choices=tuple(SOLVERS), default="elastic")
    parser.add_argument("--solvers", nargs="+", help="default: all that the scene is for")
    parser.add_argument("--m", type=float, default=1.0, help="rate sensitivity of --scene flow")
    parser.add_argument("--mu", type=float, default=0.0, help="Coulomb friction of --scene flow")
    parser.add_argument(
        "--enforcement", choices=("penalty", "augmented-lagrangian"), default="augmented-lagrangian"
    )
    p = parser.parse_args()
    p.solvers = p.solvers or SOLVERS[p.scene]
    say = print if COMM.rank == 0 else lambda *args, **kwargs: None
    say(f"{'unknowns':>10}" + "".join(f"{name + ': s':>14}{'its':>11}" for name in p.solvers))
    for n in p.cells:
        columns = []
        for solver in p.solvers:
            seconds, (newton, krylov), unknowns = measure(p, n, solver)
            columns.append(f"{seconds:14.2f}{f'{newton}/{krylov}':>11}")
        say(f"{unknowns:10}" + "".join(columns), flush=True)


if __name__ == "__main__":
    main()
