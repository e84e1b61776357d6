"""Newton iterations of Norton-Hoff bodies between plates, over the rate sensitivity m.

A block, or a cylinder as the axisymmetric half-plane, of height 1 is pressed with the rate 1. The
lower plate is a plane of symmetry; the upper plate is frictionless (homogeneous flow) or sticks.
Every case is solved from rest with the default method and with PETSc's line searches in SNES,
directly and by continuation in m. "-" is a failure. Results that differ from those of continuation
with bt by more than 1e-8 are marked "*", and by more than 1e-3 "!".

    python3 bench/norton_hoff.py
    python3 bench/norton_hoff.py --cells 16 --regularisation 1e-6
"""

import argparse

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

KINDS = ("plane", "axisymmetric", "3D")
SEARCHES = ("default", "basic", "l2", "cp", "bt")
SENSITIVITIES = (1.0, 0.5, 0.15, 0.05)


def build(kind, cells, sticking, regularisation, search):
    """Return the problem and its rate sensitivity, initially 1."""
    if kind == "3D":
        msh = mesh.create_unit_cube(MPI.COMM_WORLD, *[cells] * 3)
    else:
        msh = mesh.create_unit_square(MPI.COMM_WORLD, cells, cells)
    up = msh.geometry.dim - 1
    W = qs.materials.mini_space(msh)
    w, m = fem.Function(W), fem.Constant(msh, 1.0)
    stress = qs.materials.norton_hoff(
        ufl.split(w)[0], 1.0, m, regularisation, kind == "axisymmetric"
    )

    def hold(axis, at_axis, at, value=0.0):
        facets = mesh.locate_entities_boundary(msh, up, lambda x: np.isclose(x[at_axis], at))
        V = W.sub(0).sub(axis)
        return fem.dirichletbc(value, fem.locate_dofs_topological(V, up, facets), V)

    bcs = [hold(axis, axis, 0.0) for axis in range(up + 1)] + [hold(up, up, 1.0, -1.0)]
    if sticking:
        bcs += [hold(axis, up, 1.0) for axis in range(up)]
    F = qs.materials.incompressible(w, stress)
    options = None if search == "default" else {"snes_linesearch_type": search}
    return qs.ContactProblem([F], [w], [], [bcs], petsc_options=options), m


def iterations(problem, m, target, continued, reference):
    """Return Newton iterations from rest, marked if they fail or do not reach the reference."""
    try:
        if continued:
            count = sum(n for _, n in qs.solve_with_continuation(problem, m, target))
        else:
            m.value = target
            problem.solve()
            count = problem.num_iterations
    except qs.ConvergenceError:
        return "-"
    error = np.abs(problem.u[0].x.array - reference).max(initial=0.0)
    error = MPI.COMM_WORLD.allreduce(error, op=MPI.MAX)
    return f"{count}!" if error > 1e-3 else f"{count}*" if error > 1e-8 else str(count)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=8, help="cells along an edge; in 3D half")
    parser.add_argument("--regularisation", type=float, default=1e-3)
    args = parser.parse_args()
    head = "upper plate   body          m    "
    columns = [f"{s}{suffix}" for suffix in ("", "+c") for s in SEARCHES]
    if MPI.COMM_WORLD.rank == 0:
        print(head + "".join(f"{c:>9}" for c in columns) + "    (+c: by continuation)")
    for sticking in (False, True):
        for kind in KINDS:
            cells = max(args.cells // 2, 1) if kind == "3D" else args.cells
            for target in SENSITIVITIES:
                row = []
                problem, m = build(kind, cells, sticking, args.regularisation, "bt")
                qs.solve_with_continuation(problem, m, target)
                reference = problem.u[0].x.array.copy()
                problem.destroy()
                for continued in (False, True):
                    for search in SEARCHES:
                        problem, m = build(kind, cells, sticking, args.regularisation, search)
                        row.append(iterations(problem, m, target, continued, reference))
                        problem.destroy()
                if MPI.COMM_WORLD.rank == 0:
                    plate = "sticking" if sticking else "frictionless"
                    print(f"{plate:14}{kind:14}{target:<5}" + "".join(f"{n:>9}" for n in row))


if __name__ == "__main__":
    main()
