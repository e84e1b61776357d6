"""What overlay quadrature costs more than nodal quadrature, in the time of a whole solve.

Two elastic cubes, n³ hexahedra below and (3n/4)³ above, jittered at the interface, are pressed
together: unilateral quasi-symmetric contact with the automatic penalty of each quadrature or the
same for both, conjugate gradients with algebraic multigrid. Both are solved in turn, the best of
the repeats counts.

    mpirun -n 2 python3 bench/quadrature_cost.py --cells 40     # 300,000 unknowns
    mpirun -n 2 python3 bench/quadrature_cost.py --cells 40 --factor 10
    mpirun -n 2 python3 bench/quadrature_cost.py --cells 24 --solver direct
"""

import argparse
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
E = 3e4, 1.3e4  # of the lower and the upper cube
PRESSURE = 100.0
SOLVERS = {
    "direct": {},
    "amg": {
        "ksp_type": "cg",
        "ksp_rtol": 1e-9,
        "snes_rtol": 1e-7,  # one tangent, one solve: no second step for the last digit
        "pc_type": "gamg",
        "pc_gamg_aggressive_coarsening": 1,
        "pc_gamg_threshold": 0.02,
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "jacobi",
    },
}


def create_cube(n, bottom, jitter=0.2):
    """Unit cube of n³ hexahedra with inner nodes of the interface moved in its plane."""
    corners = [[0.0, 0.0, bottom], [1.0, 1.0, bottom + 1]]
    cube = mesh.create_box(COMM, corners, [n] * 3, mesh.CellType.hexahedron)
    x = cube.geometry.x
    inner = np.isclose(x[:, 2], 1) & np.all((x[:, :2] > 1e-8) & (x[:, :2] < 1 - 1e-8), axis=1)
    phase = 2 * np.pi * n * x[inner, :2]
    x[inner, :2] += jitter / n * np.sin(0.37 * phase[:, ::-1] + [0, 1])
    return cube


def facets_at(cube, axis, value):
    return mesh.locate_entities_boundary(cube, 2, lambda x: np.isclose(x[axis], value))


def create_body(cube, modulus, bottom):
    """Form, displacement, conditions and contact surface of one cube."""
    V = fem.functionspace(cube, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    strain = ufl.sym(ufl.grad(u))
    lame = modulus * 0.3 / (1.3 * 0.4)
    stress = lame * ufl.tr(strain) * ufl.Identity(3) + modulus / 1.3 * strain
    F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
    held = [(0, 0.0), (1, 0.0)]
    if bottom == 0:
        held.append((2, 0.0))
    else:
        facets = np.sort(facets_at(cube, 2, bottom + 1))
        tags = mesh.meshtags(cube, 2, facets, np.ones_like(facets))
        ds = ufl.Measure("ds", domain=cube, subdomain_data=tags)(1)
        F += PRESSURE * v[2] * ds
    bcs = []
    for axis, value in held:
        part = V.sub(axis)
        dofs = fem.locate_dofs_topological(part, 2, facets_at(cube, axis, value))
        bcs.append(fem.dirichletbc(0.0, dofs, part))
    return F, u, bcs, qs.Surface(V, facets=facets_at(cube, 2, 1.0))


def solve(cubes, penalty, quadrature, solver):
    """Seconds of the whole job and of contact in it, iterations, unknowns."""
    COMM.barrier()
    start = time.perf_counter()
    (F0, u0, bcs0, master), (F1, u1, bcs1, slave) = (
        create_body(cube, modulus, i)
        for i, (cube, modulus) in enumerate(zip(cubes, E, strict=True))
    )
    contact = qs.Contact(slave, master, penalty=penalty, quadrature=quadrature)
    problem = qs.ContactProblem(
        [F0, F1], [u0, u1], [contact], [bcs0, bcs1], petsc_options=SOLVERS[solver]
    )
    problem.solve()
    seconds = COMM.allreduce(time.perf_counter() - start, op=MPI.MAX)
    force = contact.force("slave")[2]
    in_contact = COMM.allreduce(contact.seconds, op=MPI.MAX)
    counts = problem.num_iterations, problem.num_linear_iterations
    unknowns = sum(3 * u.function_space.dofmap.index_map.size_global for u in (u0, u1))
    problem.destroy()
    return {
        "total": seconds,
        "contact": in_contact,
        "newton": counts[0],
        "krylov": counts[1],
        "dofs": unknowns,
        "force_error": force / PRESSURE - 1,
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=24, help="along an edge of the lower cube")
    parser.add_argument("--solver", choices=tuple(SOLVERS), default="amg")
    parser.add_argument(
        "--factor", type=float, help="penalty over E/h; otherwise the automatic one"
    )
    parser.add_argument("--repeats", type=int, default=3)
    a = parser.parse_args()
    sizes = a.cells, 3 * a.cells // 4
    penalty = a.factor * E[1] * sizes[1] if a.factor else "auto"
    runs = {"nodal": [], "overlay": []}
    solve([create_cube(4, 0.0), create_cube(3, 1.0)], penalty, "nodal", a.solver)  # compiles
    for _ in range(a.repeats):
        # Both on one partition: a new one may cost other iterations.
        cubes = [create_cube(size, float(i)) for i, size in enumerate(sizes)]
        for quadrature, rows in runs.items():
            rows.append(solve(cubes, penalty, quadrature, a.solver))
    if COMM.rank == 0:
        best = {q: min(rows, key=lambda row: row["total"]) for q, rows in runs.items()}
        print(f"{best['nodal']['dofs']} unknowns, {COMM.size} ranks, {a.solver}")
        print(f"{'':8}{'total s':>9}{'contact s':>11}{'Newton':>8}{'Krylov':>8}{'force error':>13}")
        for q, row in best.items():
            print(
                f"{q:8}{row['total']:9.2f}{row['contact']:11.3f}{row['newton']:8}{row['krylov']:8}"
                f"{row['force_error']:13.1e}"
            )
        nodal, overlay = best["nodal"], best["overlay"]
        more = overlay["contact"] - nodal["contact"]
        print(
            f"overlay: {100 * more / nodal['total']:.1f} % of the nodal total more in contact, "
            f"{100 * (overlay['total'] / nodal['total'] - 1):+.1f} % in all"
        )


if __name__ == "__main__":
    main()
