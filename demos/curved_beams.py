"""Two curved beams that are pushed past each other: they touch, bend, slip, and part.

Plane strain, neo-Hookean quadrilaterals, E = 1, ν = 0.3: two half-rings (radii 8 inside and 10
outside), one upright, whose ends are held, and above it one upside down, its point reflection. The
centres are --overlap lower than what would just let it pass. The ends of the upper one are pushed
from left to right, until the beams no longer touch. Facets slide along each other by tens.

    python3 demos/curved_beams.py --json curved_beams.json
    mpirun -n 2 python3 demos/curved_beams.py --cells 3 --friction 0.3 --steps 128
    python3 demos/curved_beams.py --plot curved_beams.png

Such scenes are in Fischer & Wriggers (2006) and Neto et al. (2016); lengths, material and overlap
here are our own. A shift is the way of the upper beam's ends from where it stands just over the
lower one; without friction what comes before that is the mirror image of what comes after. The
penalty is soft: contact is much stiffer than beams in bending are. All is done again with twice as
many cells each way. Forces (fx, fy) are those on the upper beam's ends, in units of E and of the
length unit. Keys of the JSON object, of the mesh of --cells:

- force_x_max, force_y_max: the largest |fx| and |fy|;
- force_change: the largest difference of both curves, fx and fy over the shift, to those of the
  finer mesh, over the largest force;
- kink: how far a force is from the cubic through the two before and the two after it, the largest
  of both curves while the beams touch, over the largest force. A curve that turns where facets'
  edges meet has kinks;
- symmetry_error: the largest difference of both curves to their mirror image, fx(−s) = −fx(s) and
  fy(−s) = fy(s), over the largest force; with friction it is none, but what friction does;
- energy_error: |work of the ends (Simpson's rule) − elastic energy − energy taken by friction|, the
  largest of every second step, over the largest energy; a penalty's energy is elastic;
- max_penetration: the largest of all steps;
- facet_size: the smallest;
- snes_iterations: of both meshes.
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

#: Where the stroke begins and ends, over where circles would touch.
BESIDE = 1.1


@dataclasses.dataclass
class Parameters:
    """One beam that is pushed past another."""

    cells: int = option(5, "across the beams", type=count)
    friction: float = option(0.0, "Coulomb's coefficient")
    steps: int = option(64, "an even number", type=count)
    overlap: float = option(2.0, "of the beams, if they did not bend")
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
    """Both beams, contact, and the stepper, whose time counts steps."""
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
    """Push one pair of beams; returns the rows of its states.

    ``on_step(row, scene)`` is called after each step, and first for the beams as they are made.
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
    """Push the beams of two meshes; returns what --json writes, and the rows of both."""
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
