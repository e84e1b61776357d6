"""The job through qsdolfinx.

scripts/with-dolfinx python3 bench/peers/ours.py --sizes 22,18 --quadrature overlay
"""

import argparse
import pathlib
import sys
import time

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import dolfinx
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import cubes

COMM = MPI.COMM_WORLD


def create_body(n, i):
    """Form, displacement, conditions and contact surface of the lower (0) or the upper cube (1)."""
    corners = [[0.0, 0.0, i], [1.0, 1.0, i + 1]]
    msh = mesh.create_box(COMM, corners, [n] * 3, mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    # Constants, so that both bodies have the same form to compile.
    mu = fem.Constant(msh, cubes.E[i] / (2 * (1 + cubes.NU)))
    lame = fem.Constant(msh, cubes.E[i] * cubes.NU / ((1 + cubes.NU) * (1 - 2 * cubes.NU)))
    strain = ufl.sym(ufl.grad(u))
    stress = lame * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    held, touching = (
        mesh.locate_entities_boundary(msh, 2, lambda x, z=z: np.isclose(x[2], z))
        for z in (2.0 * i, 1.0)
    )
    value = np.array([0.0, 0.0, i * cubes.PRESS])
    bc = fem.dirichletbc(value, fem.locate_dofs_topological(V, 2, held), V)
    # Eight points in each cell, as the others have: exact for boxes.
    dx = ufl.dx(degree=3)
    return ufl.inner(stress, ufl.grad(v)) * dx, u, [bc], qs.Surface(V, facets=touching)


def solve(p, sizes):
    """Row of results."""
    start = time.perf_counter()
    bodies = [create_body(n, i) for i, n in enumerate(sizes)]
    coarser = int(sizes[1] < sizes[0])
    slave = {"coarser": coarser, "finer": 1 - coarser, "lower": 0, "upper": 1}[p.slave]
    contact = qs.Contact(
        bodies[slave][3],
        bodies[1 - slave][3],
        p.formulation,
        penalty="auto" if p.factor is None else cubes.penalty(sizes, p.factor),
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        gap_tolerance=p.gap_tolerance,
    )
    forms, u, bcs = ([body[i] for body in bodies] for i in range(3))
    options = None if p.rtol is None else {"snes_rtol": p.rtol}
    problem = qs.ContactProblem(forms, u, [contact], bcs, solver=p.solver, petsc_options=options)
    before = time.perf_counter()
    problem.solve()
    now = time.perf_counter()
    row = {
        "force": abs(float(contact.force("slave")[2])),
        "newton": problem.num_iterations,
        "krylov": problem.num_linear_iterations,
        "augmentations": problem.num_augmentations,
        "penalty": contact.penalty,
        "stages": {"setting up": before - start}
        | {name: span.max for name, span in problem.timings.items()},
        "solve": now - before,
    }
    problem.destroy()
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--sizes", required=True)
    add("--formulation", default="quasi-symmetric")
    add("--quadrature", choices=("nodal", "overlay"), default="overlay")
    enforcements = "penalty", "augmented-lagrangian"
    add("--enforcement", choices=enforcements, default="augmented-lagrangian")
    add("--slave", choices=("coarser", "finer", "lower", "upper"), default="coarser")
    add("--factor", type=float, help="penalty over E/h; otherwise the automatic one")
    add("--gap-tolerance", type=float, default=1e-8)
    add("--solver", default="amg")
    add("--rtol", type=float, help="residual at which Newton's method ends")
    p = parser.parse_args()
    row = solve(p, [int(n) for n in p.sizes.split(",")])
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    row["version"] = f"with DOLFINx {dolfinx.__version__} and PETSc {petsc}"
    if COMM.rank == 0:
        cubes.report(**row)


if __name__ == "__main__":
    main()
