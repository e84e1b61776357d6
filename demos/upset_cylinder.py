"""Upsetting of a Norton-Hoff cylinder between rigid frictionless dies, against the closed form.

The billet (radius 10, height 15; velocity-based with the MINI element) stays a cylinder, and the
force on a die is F = π R² K √3^{m+1} (V/h)^m. The upper die moves down with the constant velocity V
to half of the height. R, h and F belong to the mesh on which the velocity is solved: with the
midpoint scheme this is half a step after the end of the last step.

    python3 demos/upset_cylinder.py --m 0.15 --rate 1 --dim 2 --json upset.json
    mpirun -n 2 python3 demos/upset_cylinder.py --m 0.5 --dim 3 --plot upset.png

Keys of the JSON object:

- force_error: largest relative deviation from the closed form, of all steps and both dies;
- volume_change: relative change of volume at the end;
- steps, snes_iterations, total_seconds.

--dim 2 is axisymmetric, --dim 3 a quarter of the cylinder, with R computed from the volume of its
polygonal mesh. In both cases no Dirichlet condition holds the billet along the axis.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures
from common.bodies import facets_at, fix
from common.command import Command, option, report
from common.measures import Clock
from forming_bodies import NortonHoff, cylinder

RADIUS, HEIGHT = 10.0, 15.0


@dataclasses.dataclass
class Parameters:
    """One upsetting; lengths, times and stresses in any consistent units."""

    m: float = option(0.15, "rate sensitivity")
    K: float = option(50.0, "consistency")
    rate: float = option(1.0, "V / initial height")
    dim: int = option(2, choices=(2, 3))
    reduction: float = option(0.5)
    num_steps: int = option(25, name="--steps")
    scheme: str = option("midpoint", choices=("midpoint", "euler"))
    formulation: str = option("quasi-symmetric", choices=("master-slave", "quasi-symmetric"))
    quadrature: str = option("overlay")
    verbose: bool = False


def build(comm, p):
    """Build billet, contacts with the dies, and the stepper."""
    billet = NortonHoff(cylinder(comm, p.dim, RADIUS, HEIGHT), p.K, p.m, 1e-4 * p.rate)
    V, up = billet.W.sub(0), p.dim - 1
    symmetry = [fix(V, axis, facets_at(billet.mesh, axis, 0.0)) for axis in range(up)]
    speed = p.rate * HEIGHT
    dt = p.reduction / p.rate / p.num_steps
    normal = np.eye(p.dim)[up]
    dies = [qs.RigidSurface.plane(comm, z * normal, s * normal) for z, s in ((0, 1), (HEIGHT, -1))]
    contacts = [
        qs.Contact(
            billet.surface(facets_at(billet.mesh, up, z)),
            die,
            formulation=p.formulation,
            quadrature=p.quadrature,
            enforcement="augmented-lagrangian",
            unknown="velocity",
            dt=dt,
        )
        for z, die in zip((0.0, HEIGHT), dies, strict=True)
    ]
    problem = qs.ContactProblem([billet.F], [billet.w], contacts, [symmetry])

    def drive(t, dt):
        dies[1].displacement = -speed * dt * normal

    def solve(step):
        qs.solve_with_continuation(problem, billet.m, p.m)

    theta = {"midpoint": 0.5, "euler": 0.0}[p.scheme]
    return billet, contacts, qs.TimeStepper(problem, dt, drive, solve=solve, theta=theta)


def section(billet, parts):
    """Compute the mean cross-section and the height of the whole billet in its present state."""
    comm, z = billet.mesh.comm, billet.mesh.geometry.x[:, billet.mesh.geometry.dim - 1]
    height = comm.allreduce(z.max(), op=MPI.MAX) - comm.allreduce(z.min(), op=MPI.MIN)
    return parts * billet.volume() / height, height


def run(p, comm=MPI.COMM_WORLD, look=None):
    """Upset the billet; return the results for --json, and the stepper.

    look is called once at the start with the mesh, and after each step with the mesh, the
    reduction, the force on a die and the force of the closed form.
    """
    clock = Clock(comm)
    look = look or (lambda *state: None)
    billet, contacts, stepper = build(comm, p)
    look(billet.mesh)
    volume, parts = billet.volume(), 1 if p.dim == 2 else 4
    sections, error, iterations = [], 0.0, 0
    stepper.on_solved = lambda: sections.append(section(billet, parts))
    history = qs.History(comm, t_end=p.reduction / p.rate, verbose=p.verbose)
    for _ in stepper.run(p.reduction / p.rate):
        area, height = sections[-1]
        exact = area * p.K * np.sqrt(3) ** (p.m + 1) * (p.rate * HEIGHT / height) ** p.m
        forces = [parts * abs(contact.force("slave")[-1]) for contact in contacts]
        error = max(error, *(abs(force / exact - 1) for force in forces))
        iterations += stepper.num_iterations
        history.add(qs.step_row(stepper) | {"force_error": error})
        look(billet.mesh, 1 - height / HEIGHT, forces[1], exact)
    history.close()
    result = {
        "force_error": error,
        "volume_change": billet.volume() / volume - 1,
        "steps": stepper.num_steps,
        "snes_iterations": iterations,
        "total_seconds": clock.seconds(),
    }
    return result, stepper


def main():
    p, a = Command(__doc__, Parameters, plot="draw billet and force").parse()
    look = pictures.Upsetting() if a.plot else None
    report(run(dataclasses.replace(p, verbose=True), look=look)[0], a.json, ".6g")
    if a.plot:
        look.draw(a.plot)


if __name__ == "__main__":
    main()
