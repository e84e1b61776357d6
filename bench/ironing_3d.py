"""Compare ironing in 3D with multigrid, step by step, with a tie of the same meshes.

A cylinder's segment, ten times stiffer than a slab below it, is pressed down and drawn along it.
The meshes of linear hexahedra match nowhere. Each step moves the segment's top. Unilateral contact
updates its contact pairs and finds its active set (and its stick and slip state); a tie has the
same constraints in every step. CPU seconds on one rank of all steps, contact detection and assembly
included, without the set-up of forms. "newton" and "krylov" are iterations of all steps, "ratio" is
that of the seconds, over tied.

    python3 bench/ironing_3d.py --cells 16 32 --json bench/results/ironing_3d.json
"""

import argparse
import pathlib
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances, write

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
NU = 0.3
RADIUS = 4.0
PRESSING, DEPTH, ADVANCE = 3, 0.03, 0.01  # pressing steps; depth; advance of a step along the slab

CONTACTS = {
    "tied": {"law": qs.Tied(), "search_radius": 1.0},
    "unilateral": {},
    "friction": {"friction": qs.Coulomb(0.3)},
}


def create_body(E, low, high, cells, touching, shape=None):
    """Return form, displacement, conditions, surface and the constant that moves the held side."""
    msh = mesh.create_box(COMM, [low, high], cells, mesh.CellType.hexahedron)
    held = low[2] if touching == high[2] else high[2]
    msh.topology.create_connectivity(2, 3)
    facets, fixed = (
        mesh.locate_entities_boundary(msh, 2, lambda x, z=z: np.isclose(x[2], z))
        for z in (touching, held)
    )
    if shape is not None:
        msh.geometry.x[:] = shape(msh.geometry.x)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    mu = fem.Constant(msh, E / (2 * (1 + NU)))
    lame = fem.Constant(msh, E * NU / ((1 + NU) * (1 - 2 * NU)))
    strain = ufl.sym(ufl.grad(u))
    stress = lame * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
    moved = fem.Constant(msh, np.zeros(3))
    bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 2, fixed), V)]
    form = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=3)
    return form, u, bcs, qs.Surface(V, facets=facets), moved


def segment(x):
    """Make the lower side of a block on z = 0 round."""
    out = x.copy()
    out[:, 2] += (1 - x[:, 2] / 0.8) * (x[:, 0] - 0.9) ** 2 / (2 * RADIUS)
    return out


def create_bodies(n):
    """Make the segment, and a slab with ``n`` cells across."""
    m = round(0.73 * n)
    slab = create_body(1.0, (0, 0, -1.0), (3.2, 1.0, 0), [round(3.2 * n), n, n], 0)
    tool = create_body(10.0, (0.3, 0, 0), (1.5, 1.0, 0.8), [round(1.2 * m), m, m], 0, segment)
    return tool, slab


def iron(bodies, arguments, p):
    """Return the row of one contact."""
    forms, u, bcs, surfaces, (moved, _) = zip(*bodies, strict=True)
    for each in u:
        each.x.array[:] = 0

    def drive(t, dt):
        moved.value[:] = max(t - PRESSING, 0) * ADVANCE, 0, -DEPTH * min(t / PRESSING, 1)

    contact = qs.Contact(*surfaces, enforcement=p.enforcement, **arguments)
    problem = qs.ContactProblem(forms, u, [contact], bcs, linear_solver=p.solver)
    stepper = qs.TimeStepper(problem, 1.0, drive)
    newton = krylov = 0
    start = time.process_time()
    for _ in stepper.run(float(p.steps)):
        newton += problem.num_iterations
        krylov += problem.num_linear_iterations
    row = {
        "seconds": time.process_time() - start,
        "unknowns": problem.system.x.getSize(),
        "steps": stepper.num_steps,
        "cutbacks": stepper.num_cutbacks,
        "newton": newton,
        "krylov": krylov,
        "force": [float(f) for f in contact.force("slave")],
    }
    problem.destroy()
    return row


def rows_of(cells, p):
    """Return a row of each contact, for slabs with these numbers of cells."""
    bodies = create_bodies(cells)
    rows = [{"contact": c} | iron(bodies, CONTACTS[c], p) for c in CONTACTS]
    for row in rows:
        row["ratio"] = row["seconds"] / rows[0]["seconds"]
        print(
            f"{row['unknowns']:10}  {row['contact']:11}{row['seconds']:9.2f}{row['newton']:8}"
            f"{row['krylov']:8}{row['ratio']:8.2f}",
            flush=True,
        )
    return rows


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--cells", nargs="+", type=int, default=[16, 32], help="cells across the slab")
    add("--steps", type=int, default=9)
    add(
        "--enforcement", choices=("penalty", "augmented-lagrangian"), default="augmented-lagrangian"
    )
    add("--solver", default="amg")
    add("--json", metavar="FILE")
    p = parser.parse_args()
    print("  unknowns  contact      seconds  newton  krylov   ratio")
    rows = [row for cells in p.cells for row in rows_of(cells, p)]
    if p.json:
        given = {"enforcement": p.enforcement, "solver": p.solver}
        write(p.json, circumstances(1) | given | {"rows": rows})


if __name__ == "__main__":
    main()
