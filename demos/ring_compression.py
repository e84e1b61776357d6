"""Ring compression test: a ring between two flat dies; its inner diameter measures friction.

The ring has the proportions 6:3:2 of outer diameter, inner diameter and height (30, 15 and 10 mm).
It is a velocity-based Norton-Hoff body, axisymmetric, with the MINI element, between rigid dies.
The upper die moves down with constant velocity V. Only contact holds the ring. Friction factors
refer to the flow stress at the nominal strain rate, V over the height. Without friction the radius
r of each point becomes r √(h₀/h), also the inner radius.

    python3 demos/ring_compression.py --friction tresca --m-bar 0.4 --json ring.json
    python3 demos/ring_compression.py --table
    python3 demos/ring_compression.py --plot docs/figures/ring_compression.png
    mpirun -n 2 python3 demos/ring_compression.py --friction coulomb --mu 0.1

--table prints the change of the inner diameter over the reduction for several friction factors
(Tresca). Keys of the JSON object, at the end of the compression:

- inner_radius, outer_radius: radii at mid height over their initial values;
- inner_radius_error: relative difference, with sign, of the inner radius to r √(h₀/h): an error
  without friction, the effect of friction with it;
- force: force on the upper die (N);
- dissipated_energy: energy dissipated by friction at both dies (N mm);
- volume_change: relative change of volume;
- steps, snes_iterations: their numbers.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures, tables
from common.command import Command, option, report
from common.friction import FRICTIONS, Friction
from ring_bodies import HEIGHT, K, M, Ring
from ring_output import Record

SPEED = 10.0  # V, mm/s
FACTORS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0)
FIXED = ("friction", "mu", "m_bar", "alpha")  # of --table


@dataclasses.dataclass
class Parameters:
    """One compression."""

    friction: str = option("none", choices=FRICTIONS)
    mu: float = option(0.3, "Coulomb's coefficient")
    m_bar: float = option(0.3, "friction factor: share of the shear yield stress")
    alpha: float = option(0.3, "factor of the consistency in Norton's law")
    reduction: float = option(0.5)
    num_steps: int = option(25, name="--steps")
    cells: int = option(8, "cells across the wall")
    verbose: bool = False


def build(comm, p):
    """Build ring, contacts and the stepper."""
    ring = Ring(comm, p.cells, slow=1e-3 * SPEED / HEIGHT)
    lower = qs.RigidSurface.plane(comm, [0, 0], [0, 1])
    upper = qs.RigidSurface.plane(comm, [0, HEIGHT], [0, -1])
    dt = p.reduction * HEIGHT / SPEED / p.num_steps
    friction = Friction(p, ring.mesh, K, M)
    # Gaps of nodes to a plane are exact, and nodes of a side that folds on to it are found at once.
    options = {"quadrature": "nodal", "unknown": "velocity", "dt": dt}
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
    """Compress the ring; ``on_step(ring, contacts, stepper)`` is called after each step.

    Returns:
        The results for --json; the history, one row per step, with the energies so far (the work of
        the dies is the sum of the dissipation in the ring and by friction); and the ring.
    """
    scene = ring, _, stepper = build(comm, p)
    t_end = p.reduction * HEIGHT / SPEED
    record = Record(comm, scene, t_end, SPEED, p.verbose)
    for _ in stepper.run(t_end):
        record.add_step()
        if on_step is not None:
            on_step(*scene)
    record.close()
    inner, reduction = record.last["inner_radius"], record.last["reduction"]
    error = inner * np.sqrt(1 - reduction) - 1  # without friction
    return {"inner_radius_error": error} | record.result(), record.history.rows, ring


def calibrate(p, factors=FACTORS, comm=MPI.COMM_WORLD):
    """Return what run() returns for each friction factor (Tresca); 0 is no friction."""
    laws = {factor: "tresca" if factor else "none" for factor in factors}
    return {
        factor: run(dataclasses.replace(p, friction=law, m_bar=factor, verbose=False), comm)
        for factor, law in laws.items()
    }


def main():
    command = Command(__doc__, Parameters, plot="draw the table and three rings")
    command.add_switch("--table", "print the table for several friction factors")
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
