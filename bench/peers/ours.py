"""Run a job through qsdolfinx, on one rank.

scripts/with-dolfinx python3 bench/peers/ours.py --sizes 22,18 --quadrature overlay
scripts/with-dolfinx python3 bench/peers/ours.py --job hertz --sizes 13,10
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
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import cell_nodes

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import dolfinx_mesh
import jobs

COMM = MPI.COMM_WORLD


def create_body(body, i, job):
    """Return form, displacement, conditions, contact surface of the lower (0) or upper (1) body."""
    msh = dolfinx_mesh.create_mesh(COMM, body.x, body.cells)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    # Constants, so that both bodies share one compiled form.
    mu = fem.Constant(msh, job.E[i] / (2 * (1 + job.NU)))
    lame = fem.Constant(msh, job.E[i] * job.NU / ((1 + job.NU) * (1 - 2 * job.NU)))
    strain = ufl.sym(ufl.grad(u))
    stress = lame * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    held, touching = (
        dolfinx_mesh.locate(msh, s) for s in ((body.high, body.low) if i else (body.low, body.high))
    )
    value = np.array([0.0, 0.0, i * job.PRESS])
    bcs = [
        fem.dirichletbc(0.0, fem.locate_dofs_topological(W, 2, dolfinx_mesh.locate(msh, quads)), W)
        for W, quads in ((V.sub(axis), quads) for axis, quads in body.planes.items())
    ]
    bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(V, 2, held), V))
    # Eight points in each cell, as in the other programs: exact for boxes.
    dx = ufl.dx(degree=3)
    return ufl.inner(stress, ufl.grad(v)) * dx, u, bcs, qs.Surface(V, facets=touching)


def solve(p, job, sizes):
    """Return displacements and row of results."""
    start = time.perf_counter()
    bodies = [create_body(body, i, job) for i, body in enumerate(job.bodies(sizes))]
    coarser = int(sizes[1] < sizes[0])
    slave = {"coarser": coarser, "finer": 1 - coarser, "lower": 0, "upper": 1}[p.slave]
    contact = qs.Contact(
        bodies[slave][3],
        bodies[1 - slave][3],
        formulation=p.formulation,
        penalty="auto" if p.factor is None else jobs.penalty(job, sizes, p.factor),
        quadrature=p.quadrature,
        quadrature_degree=p.degree,
        enforcement=p.enforcement,
        gap_tolerance=p.gap_tolerance,
        constraints=p.constraints,
    )
    forms, u, bcs = ([body[i] for body in bodies] for i in range(3))
    options = None if p.rtol is None else {"snes_rtol": p.rtol}
    problem = qs.ContactProblem(
        forms, u, [contact], bcs, linear_solver=p.solver, petsc_options=options
    )
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
    spaces = [body[1].function_space for body in bodies]
    parts = [
        dolfinx_mesh.at_nodes(body[1].x.array, V, cell_nodes(V.mesh))
        for body, V in zip(bodies, spaces, strict=True)
    ]
    return np.concatenate(parts), row


def arguments():
    """Parse the arguments of the driver."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    jobs.add_arguments(parser)
    add("--formulation", default="quasi-symmetric")
    add("--quadrature", choices=("nodal", "overlay"), default="overlay")
    enforcements = "penalty", "augmented-lagrangian"
    add("--enforcement", choices=enforcements, default="augmented-lagrangian")
    add("--slave", choices=("coarser", "finer", "lower", "upper"), default="coarser")
    add("--constraints", choices=("nodes", "points"), default="nodes")
    add("--degree", type=int, help="quadrature degree on the overlay's segments")
    add("--factor", type=float, help="penalty over E/h; default: automatic")
    add("--gap-tolerance", type=float, default=1e-8)
    add("--solver", default="amg")
    add("--rtol", type=float, help="tolerance of Newton's method")
    return parser


def main():
    p = jobs.parse(arguments())
    u, row = solve(p, p.job, p.sizes)
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    row["version"] = f"with DOLFINx {dolfinx.__version__} and PETSc {petsc}"
    jobs.report(p.output, u, **row)


if __name__ == "__main__":
    main()
