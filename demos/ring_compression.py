"""Ring compression test: a ring between two flat dies, whose inner diameter tells the friction.

The ring has the proportions 6:3:2 of outer diameter, inner diameter and height (30, 15 and 10 mm).
It is a Norton-Hoff body in velocities, axisymmetric, with the MINI element, between rigid dies, of
which the upper one comes down with constant velocity V. Only contact holds the ring. Friction
factors are of the flow stress at the nominal strain rate, V over the height. Without friction every
point moves with r √(h₀/h), and so does the inner radius.

    python3 demos/ring_compression.py --friction tresca --m-bar 0.4 --json ring.json
    python3 demos/ring_compression.py --table
    python3 demos/ring_compression.py --plot docs/figures/ring_compression.png
    mpirun -n 2 python3 demos/ring_compression.py --friction coulomb --mu 0.1

--table prints the change of the inner diameter over the reduction for several friction factors
(Tresca). Keys of the JSON object, at the end of the compression:

- inner_radius, outer_radius: at mid height, over their initial values;
- inner_radius_error: of the inner radius against r √(h₀/h), relative and signed: without friction
  an error, with friction what friction does;
- force: on the upper die (N);
- dissipated_energy: that friction took, of both dies (N mm);
- volume_change: relative;
- steps, snes_iterations.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

from dolfinx import mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.bodies import facets_at
from common.command import Command, option, report
from common.friction import FRICTIONS, Friction
from forming_bodies import NortonHoff

OUTER, INNER, HEIGHT = 15.0, 7.5, 10.0  # mm
K, M, SPEED = 50.0, 0.15, 10.0  # MPa sᵐ, -, mm/s
FACTORS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0)
FIXED = ("friction", "mu", "m_bar", "alpha")  # of --table


@dataclasses.dataclass
class Parameters:
    """One compression."""

    friction: str = option("none", choices=FRICTIONS)
    mu: float = option(0.3, "Coulomb's coefficient")
    m_bar: float = option(0.3, "friction factor, of shear yield stress")
    alpha: float = option(0.3, "of Norton's law, of the consistency")
    reduction: float = option(0.5)
    num_steps: int = option(25, name="--steps")
    cells: int = option(8, "across the wall")
    verbose: bool = False


def create_ring(comm, cells):
    """The ring, a Norton-Hoff body, with its surfaces and the nodes at mid height."""
    rows = 2 * round(cells * HEIGHT / (OUTER - INNER) / 2)  # even: there are such nodes
    corners, crossed = [[INNER, 0], [OUTER, HEIGHT]], mesh.DiagonalType.crossed
    msh = mesh.create_rectangle(comm, corners, [cells, rows], diagonal=crossed)
    ring = NortonHoff(msh, K, M, slow=1e-3 * SPEED / HEIGHT)
    ring.lower, ring.upper = (ring.surface(facets_at(msh, 1, z)) for z in (0.0, HEIGHT))
    # What may fold on to a die: the sides without the facets next to the faces. With these the
    # edges would have more area than touches the die.
    sides = mesh.locate_entities_boundary(msh, 1, lambda x: (x[1] > 1e-6) & (x[1] < HEIGHT - 1e-6))
    ring.sides = ring.surface(sides)
    r, z, _ = msh.geometry.x.T
    middle = np.isclose(z, HEIGHT / 2)
    ring.middle = [np.flatnonzero(middle & np.isclose(r, radius)) for radius in (INNER, OUTER)]
    return ring


def radii(ring):
    """Inner and outer radius at mid height over their initial values. Collective."""
    local = [ring.mesh.geometry.x[nodes, 0].max(initial=0.0) for nodes in ring.middle]
    inner, outer = (ring.mesh.comm.allreduce(radius, op=MPI.MAX) for radius in local)
    return inner / INNER, outer / OUTER


def build(comm, p):
    """Ring, contacts and the stepper."""
    ring = create_ring(comm, p.cells)
    lower = qs.RigidSurface.plane(comm, [0, 0], [0, 1])
    upper = qs.RigidSurface.plane(comm, [0, HEIGHT], [0, -1])
    dt = p.reduction * HEIGHT / SPEED / p.num_steps
    friction = Friction(p, ring.mesh, K, M)
    options = {"enforcement": "augmented-lagrangian", "unknown": "velocity", "dt": dt}
    contacts = [
        qs.Contact(surface, die, friction=friction.law(), **options)
        for die, face in ((lower, ring.lower), (upper, ring.upper))
        for surface in (face, ring.sides)
    ]
    problem = qs.ContactProblem([ring.F], [ring.w], contacts)

    def drive(t, dt):
        upper.displacement = [0, -SPEED * dt]
        friction.set_rate(SPEED / (HEIGHT - SPEED * (t - dt / 2)))

    def solve(step):
        qs.solve_with_continuation(problem, ring.m, M)

    return ring, contacts, qs.TimeStepper(problem, dt, drive, solve=solve)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Compress; ``on_step(ring, contacts, stepper)`` is called after each step.

    Returns:
        What --json writes; the history, one row a step, with the energies so far: the work of the
        dies is what the ring dissipates and what friction takes; and the ring.
    """
    ring, contacts, stepper = build(comm, p)
    volume, end = ring.volume(), p.reduction * HEIGHT / SPEED
    history = qs.History(comm, t_end=end, verbose=p.verbose)
    power, work, plastic, iterations = [], 0.0, 0.0, 0
    stepper.on_solved = lambda: power.append(ring.power())
    for t in stepper.run(end):
        force = sum(contact.force("slave")[1] for contact in contacts[2:])
        work -= force * SPEED * stepper.last_dt
        plastic += power[-1] * stepper.last_dt
        taken = sum(contact.dissipated_energy() for contact in contacts)
        inner, outer = radii(ring)
        row = {"reduction": SPEED * t / HEIGHT, "inner_radius": inner, "outer_radius": outer}
        row |= {"work": work, "plastic": plastic, "friction": taken}
        row["energy_error"] = (work - plastic - taken) / work
        history.add(qs.step_row(stepper) | row)
        iterations += stepper.num_iterations
        if on_step is not None:
            on_step(ring, contacts, stepper)
    history.close()
    result = {
        "inner_radius_error": inner * np.sqrt(1 - row["reduction"]) - 1,
        "inner_radius": inner,
        "outer_radius": outer,
        "force": abs(force),
        "dissipated_energy": taken,
        "volume_change": ring.volume() / volume - 1,
        "steps": stepper.num_steps,
        "snes_iterations": iterations,
    }
    return result, history.rows, ring


def calibrate(p, factors=FACTORS, comm=MPI.COMM_WORLD):
    """What run() returns for friction factors (Tresca), of which 0 is no friction."""
    laws = {factor: "tresca" if factor else "none" for factor in factors}
    return {
        factor: run(dataclasses.replace(p, friction=law, m_bar=factor, verbose=False), comm)
        for factor, law in laws.items()
    }


def main():
    command = Command(__doc__, Parameters, plot="the table and three rings as a picture")
    command.parser.add_argument(
        "--table", action="store_true", default=False, help="for several friction factors"
    )
    p, a = command.parse()
    if a.table or a.plot:
        if a.json:
            command.error("--json is for one compression, without --table and --plot")
        command.refuse(p, FIXED, "--table and --plot have friction factors of their own (Tresca)")
        results = calibrate(p)
        tables.ring_compression(results)
        if a.plot:
            pictures.ring_compression(a.plot, results)
        return
    result, rows, _ = run(dataclasses.replace(p, verbose=True))
    more = {key: rows[-1][key] for key in ("work", "plastic", "friction", "energy_error")}
    report(result, a.json, ".6g", more)


if __name__ == "__main__":
    main()
