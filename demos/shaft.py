"""Turn an elastic shaft in an elastic bore by 90° in large steps, after a press fit.

Plane strain, neo-Hookean rings, ν = 0.3: a shaft of radius 1 (E = 2, held at radius 0.3) in a bore
that is smaller by --interference (E = 1, held at radius 2, 1.4 times as many facets). The contact
geometry is updated within a solve (finite sliding), so that no time stepper is needed. For each
step the shaft's core is turned, with a rotation of the whole shaft as the first guess, and the
problem is solved again.

    python3 demos/shaft.py --mu 0.2 --json shaft.json
    mpirun -n 2 python3 demos/shaft.py --cell triangle --steps 18
    python3 demos/shaft.py --plot shaft.png

With friction the shaft sticks at first. Six small steps (the run-in) turn it by 1.5 times the angle
at which, in small strains, the whole shaft slips; --steps steps do the rest of --turn. Reactions
are sums of residuals over held nodes, which are not in contact; N is the sum of the normal forces.
Lengths are in units of the shaft's radius, stresses in E of the bore. The terminal also shows the
pressure over Lamé's for small strains, and the torque over μ N r. Keys of the JSON object:

- moment_error: net moment of the reactions about the axis, the largest of all solves, over the
  torque; without friction over N r;
- force_error: net force of the reactions, the largest of all solves, over N;
- work_error: work of the torque (trapezoidal rule) against elastic and dissipated energy, over the
  work, for the steps after the run-in; without friction over the elastic energy;
- torque: torque on the shaft at the end;
- steps: number of steps without the run-in;
- snes_iterations: number of Newton iterations of all solves.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures
from common.command import Command, count, option, report
from shaft_bodies import CELLS, create_bodies, slip_angle
from shaft_output import closed_forms, measure, summary

RUN_IN = 6  # steps, with friction


@dataclasses.dataclass
class Parameters:
    """One press fit in which the shaft is turned."""

    mu: float = option(0.0, "Coulomb's coefficient")
    steps: int = option(9, type=count)
    turn: float = option(90.0, "angle in degrees, anticlockwise")
    interference: float = option(0.02)
    facets: int = option(48, "facets of the shaft", type=count)
    cell: str = option("quadrilateral", choices=CELLS)
    formulation: str = option("quasi-symmetric", choices=("quasi-symmetric", "master-slave"))
    enforcement: str = option("augmented-lagrangian")

    def __post_init__(self):
        if self.mu < 0:
            raise ValueError("--mu: must not be negative")
        if not 0 < self.interference < 0.2:
            raise ValueError("--interference: must be positive and below 0.2")
        if self.facets < 8:
            raise ValueError("--facets: must be at least 8")
        if abs(self.turn) > 90 * self.steps:
            raise ValueError("--steps: must be at least one for each 90° of --turn")
        if abs(self.turn) <= self.run_in():
            raise ValueError(f"--turn: must be more than the {self.run_in():.3g}° of the run-in")

    def run_in(self):
        """Return the angle (degrees) of the run-in, in which slip begins."""
        return 1.5 * np.degrees(slip_angle(self.mu, self.interference))

    def turns(self):
        """Return the angle (degrees) of each solve, and how far the first guess turns the shaft."""
        begin = np.copysign(self.run_in(), self.turn)
        step = (self.turn - begin) / self.steps
        run_in = [(begin * i / RUN_IN, 0.0) for i in range(1, RUN_IN + 1)] if self.mu else []
        return [(0.0, 0.0), *run_in, *((begin + step * i, step) for i in range(1, self.steps + 1))]


def build(comm, p):
    """Build shaft, bore, contact and problem."""
    bodies = shaft, bore = create_bodies(comm, p.facets, p.cell, p.interference)
    contact = qs.Contact(
        shaft.surface,
        bore.surface,
        formulation=p.formulation,
        enforcement=p.enforcement,
        friction=qs.Coulomb(p.mu) if p.mu else None,
        sliding="finite",
    )
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )
    return shaft, bore, contact, problem


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Press and turn; return the results for --json, all rows, and what build() returns.

    ``on_step(row, scene)`` is called after each solve.
    """
    scene = shaft, *_, problem = build(comm, p)
    rows = []
    for angle, guess in p.turns():
        shaft.turn(np.radians(angle), np.radians(guess))
        problem.solve()
        rows.append(measure(angle, *scene))
        if on_step is not None:
            on_step(rows[-1], scene)
    return summary(p, rows), rows, scene


def main():
    p, a = Command(__doc__, Parameters, plot="draw the shaft and its torque").parse()
    if a.plot:
        pictures.shaft(a.plot, p, run)
    if a.json or not a.plot:
        result, rows, _ = run(p)
        report(result, a.json, ".6g", closed_forms(p, rows[-1]))


if __name__ == "__main__":
    main()
