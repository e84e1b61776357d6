"""Push two curved beams past each other: they touch, bend, slip, and separate.

Plane strain, neo-Hookean quadrilaterals, E = 1, ν = 0.3: two half-rings (radii 8 inside and 10
outside). The lower one is upright, with held ends; the upper one is its point reflection. It is
lower by --overlap than a beam that would just pass. Its ends are pushed from left to right until
the beams no longer touch. The surfaces slide along each other by tens of facets.

    python3 demos/curved_beams.py --json curved_beams.json
    mpirun -n 2 python3 demos/curved_beams.py --cells 3 --friction 0.3 --steps 128
    python3 demos/curved_beams.py --plot curved_beams.png

Similar problems are in Fischer & Wriggers (2006) and Neto et al. (2016); lengths, material and
overlap differ here. The shift s is the displacement of the upper beam's ends from its position
exactly above the lower beam. Without friction the motion at −s is the mirror image of that at s.
A soft penalty is enough, as contact is much stiffer than beams in bending. A second run has twice
as many cells in each direction. Forces (fx, fy) act on the upper beam's ends, in units of E and of
the length. Keys of the JSON object, for the mesh of --cells:

- force_x_max, force_y_max: the largest |fx| and |fy|;
- force_change: the largest difference between the curves fx(s), fy(s) of both meshes, over the
  largest force;
- kink: largest distance of a force from the cubic through the two forces before and the two after
  it, of both curves while the beams touch, over the largest force. It shows kinks of the curves
  where edges of facets meet;
- symmetry_error: the largest difference between both curves and their mirror images, fx(−s) =
  −fx(s) and fy(−s) = fy(s), over the largest force; with friction it is its effect, no error;
- energy_error: |work of the ends (Simpson's rule) − elastic energy − dissipation of friction|, the
  largest of every second step, over the largest energy; elastic includes the penalty's energy;
- max_penetration: the largest penetration of all steps;
- facet_size: the smallest facet;
- snes_iterations: number of Newton iterations with both meshes.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import beams
from common.command import Command, count, option, report
from curved_beams_bodies import OUTER, Beam
from curved_beams_output import measure, more, summary

#: Start and end of the stroke over the shift at which circles would touch.
BESIDE = 1.1


@dataclasses.dataclass
class Parameters:
    """One beam that is pushed past another."""

    cells: int = option(5, "cells across the beams", type=count)
    friction: float = option(0.0, "Coulomb's coefficient")
    steps: int = option(64, "number of steps, even", type=count)
    overlap: float = option(2.0, "overlap of the undeformed beams")
    enforcement: str = option("penalty")
    penalty: float = option(1.0, "ε, stress per length")
    verbose: bool = option(False, "print each step")

    def __post_init__(self):
        if self.friction < 0:
            raise ValueError("--friction: must not be negative")
        if self.steps % 2 or self.steps < 8:
            raise ValueError("--steps: must be even, and at least 8")
        if not 0 < self.overlap <= 3:
            raise ValueError("--overlap: must be positive and at most 3")
        if self.penalty <= 0:
            raise ValueError("--penalty: must be positive")

    def shifts(self):
        """Of the upper beam at first and after each step."""
        reach = BESIDE * np.sqrt((2 * OUTER) ** 2 - self.height() ** 2)
        return [reach * (2 * i / self.steps - 1) for i in range(self.steps + 1)]

    def height(self):
        """Of the upper beam's ends over the lower one's."""
        return 2 * OUTER - self.overlap


def build(comm, p):
    """Build both beams, the contact, and the stepper, whose time counts steps."""
    first, last = p.shifts()[0], p.shifts()[-1]
    upper = Beam(comm, p.cells, (first, p.height()), -1)
    lower = Beam(comm, p.cells, (0.0, 0.0), 1)
    contact = qs.Contact(
        upper.surface,
        lower.surface,
        sliding="finite",
        enforcement=p.enforcement,
        penalty=p.penalty,
        friction=qs.Coulomb(p.friction) if p.friction else None,
    )
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.u, lower.u], [contact], [upper.bcs, lower.bcs]
    )

    def drive(t, dt):
        upper.displacement.value[0] = (last - first) * t / p.steps

    return upper, lower, contact, qs.TimeStepper(problem, 1.0, drive)


def push(p, comm=MPI.COMM_WORLD, on_step=None):
    """Push one pair of beams; return the rows of its states.

    ``on_step(row, scene)`` is called first for the initial state, and then after each step.
    """
    scene = *_, stepper = build(comm, p)
    rows = []
    for t, shift in enumerate(p.shifts()):
        taken = sum(stepper.num_iterations for _ in stepper.run(float(t)))
        rows.append(measure(shift, taken, *scene))
        if p.verbose:
            rows[-1].say()
        if on_step is not None:
            on_step(rows[-1], scene)
    return rows


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Push the beams of two meshes; return the results for --json, and the rows of both."""
    finer = dataclasses.replace(p, cells=2 * p.cells)
    both = [push(case, comm, on_step) for case in (p, finer)]
    return summary(*both), both


def main():
    p, a = Command(__doc__, Parameters, plot="draw the beams and their forces").parse()
    shifts = p.shifts()
    drawn = [shifts[i * p.steps // 8] for i in (1, 3, 4, 5, 6, 7)]
    picture = beams.Beams(drawn) if a.plot else None
    result, both = run(p, on_step=picture)
    report(result, a.json, ".6g", more(*both))
    if picture is not None:
        names = [f"{case} cells across" for case in (p.cells, 2 * p.cells)]
        picture.draw(a.plot, dict(zip(names, both, strict=True)))


if __name__ == "__main__":
    main()
