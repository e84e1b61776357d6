"""Frictional energy in steps with much contact onset or loss, over the energy of many steps.

An elastic block is in contact with a rigid cylinder, with Coulomb's law and otherwise default
options. The cylinder

- slides on the block, after pressing, by some fraction of a facet in each step;
- is pressed and dragged at the same time, starting before contact;
- slides on the block, after pressing, and lifts off on the way.

    python3 bench/friction_energy.py
"""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
#: Size of cells, radius of the cylinder, depth, and displacements along the block.
H, RADIUS, DEPTH, WAY, SHORT = 0.1, 1.5, 0.05, 1.2, 0.03


def run(phases, touching=True):
    """Return the energy of the last phase; a phase is a tool displacement and a number of steps."""
    msh = mesh.create_rectangle(COMM, [[0, -1], [4, 0]], [40, 10], mesh.CellType.quadrilateral)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.linear_elastic(u, 1e3, 0.3), ufl.grad(v)) * ufl.dx
    top, bottom = (
        mesh.locate_entities_boundary(msh, 1, lambda x, y=y: np.isclose(x[1], y)) for y in (0, -1)
    )
    bc = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V)
    height = RADIUS + (0.0 if touching else 0.1 * DEPTH)
    tool = qs.RigidSurface.cylinder(COMM, [1.2, height], None, RADIUS)
    contact = qs.Contact(qs.Surface(V, facets=top), tool, friction=qs.Coulomb(0.2))
    problem = qs.ContactProblem([F], [u], [contact], [[bc]])
    stepper, before = None, 0.0
    for i, (way, steps) in enumerate(phases):

        def drive(t, dt, way=way):
            tool.displacement = np.array(way) * dt

        if stepper is None:
            stepper = qs.TimeStepper(problem, 1.0, max_penetration=None)
        stepper.drive, stepper.dt, stepper.dt_max = drive, 1 / steps, 1 / steps
        before = contact.dissipated_energy()
        for _ in stepper.run(i + 1.0):
            pass
    taken = contact.dissipated_energy() - before
    problem.destroy()
    return taken


def main():
    press = ((0.0, -DEPTH), 4)
    scenes = {
        "slides by 2, 1, 1/2, 1/4 facets a step": [
            run([press, ((WAY, 0.0), round(WAY / (facets * H)))])
            for facets in (2, 1, 0.5, 0.25, 0.0625)
        ],
        "pressed and dragged in 1, 2, 4, 8 steps": [
            run([((SHORT, -0.4 * DEPTH), n)], touching=False) for n in (1, 2, 4, 8, 32)
        ],
        "slides and lifts off in 1, 2, 4, 8 steps": [
            run([press, ((2 * SHORT, 0.0), 4), ((SHORT, 1.5 * DEPTH), n)]) for n in (1, 2, 4, 8, 32)
        ],
    }
    for name, energies in scenes.items():
        shown = "".join(f"{energy / energies[-1]:8.3f}" for energy in energies[:-1])
        if COMM.rank == 0:
            print(f"{name:42}{shown}", flush=True)


if __name__ == "__main__":
    main()
