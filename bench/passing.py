"""Half rings that pass each other with sliding="finite": iterations and energy balance.

The hub of a half ring is drawn over another half ring, both neo-Hookean, in steps of some facets. A
row for each coefficient of friction and step length: facets per step, number of steps, Newton
iterations of all steps and of the worst step; and the energy that is missing at the end: work of
the hub less frictional dissipation, over that work, or without friction over the largest stored
energy.

    python3 bench/passing.py
"""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
#: Cells along a ring and across it, overlap of the rings, and displacement of the hub.
N, OVER, WAY = (30, 2), 0.3, 4.4


def half_ring(start, center):
    """Return displacement, form, energy density, the rim as a surface, and the hub's condition."""
    msh = mesh.create_rectangle(COMM, [[0, 0], [1, 1]], N, mesh.CellType.quadrilateral)
    x = msh.geometry.x
    rim, ends = (
        mesh.locate_entities_boundary(msh, 1, where)
        for where in (lambda x: np.isclose(x[1], 1), lambda x: np.isclose(x[0] * (1 - x[0]), 0))
    )
    angle, radius = start + np.pi * x[:, 0], 0.8 + 0.2 * x[:, 1]
    x[:, 0], x[:, 1] = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, hub = fem.Function(V), fem.Constant(msh, np.zeros(2))
    F = ufl.inner(qs.materials.neo_hookean(u, 1e3 / 2.6, 577.0), ufl.grad(ufl.TestFunction(V)))
    energy = fem.form(qs.materials.neo_hookean_energy(u, 1e3 / 2.6, 577.0) * ufl.dx)
    bc = fem.dirichletbc(hub, fem.locate_dofs_topological(V, 1, ends), V)
    return u, F * ufl.dx, energy, qs.Surface(V, facets=rim), hub, bc


def run(mu, facets):
    """Return one row."""
    lower, upper = half_ring(0.0, (0.0, 0.0)), half_ring(np.pi, (-WAY / 2, 2 - OVER))
    contact = qs.Contact(
        upper[3],
        lower[3],
        friction=qs.Coulomb(mu) if mu else None,
        sliding="finite",
    )
    bodies = lower, upper
    us, forms, conditions = ([body[i] for body in bodies] for i in (0, 1, 5))
    problem = qs.ContactProblem(forms, us, [contact], [[bc] for bc in conditions])
    dt = facets * np.pi / N[0]

    def drive(t, dt):
        upper[4].value[0] = t

    stepper = qs.TimeStepper(problem, dt, drive, dt_max=dt)
    work, largest, at, force = 0.0, 0.0, 0.0, 0.0
    for t in stepper.run(WAY):
        now = -contact.force("slave")[0]
        work, at, force = work + (t - at) * (force + now) / 2, t, now
        stored = sum(COMM.allreduce(fem.assemble_scalar(body[2])) for body in bodies)
        largest = max(largest, stored)
    iterations = [row.iterations for row in stepper.log]
    missing = (work - contact.dissipated_energy()) / (work if mu else largest)
    steps = stepper.num_steps
    problem.destroy()
    return mu, facets, steps, sum(iterations), max(iterations), missing


def main():
    if COMM.rank == 0:
        print("friction  facets a step  steps  newton  worst   missing")
    for mu in (0.0, 0.3):
        for facets in (1, 2):
            *row, missing = run(mu, facets)
            if COMM.rank == 0:
                mu, facets, steps, newton, worst = row
                print(
                    f"{mu:8}{facets:15}{steps:7}{newton:8}{worst:7}{100 * missing:9.2f} %",
                    flush=True,
                )


if __name__ == "__main__":
    main()
