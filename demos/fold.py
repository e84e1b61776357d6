"""Press a U-shaped spring between two planes until it is folded flat.

Plane strain, neo-Hookean quadrilaterals, E = 1, ν = 0.3: two legs (thickness 1, length 10, their
ends rounded inside) and half a ring (radius 2 inside, thickness 0.6). The whole boundary may touch
itself and two rigid frictionless planes, which close on the spring from above and below. The ends
of the legs touch first. When the distance of the planes is 2, the legs lie on each other. They are
pressed until this distance is 1.92. Only the bend stays open.

    python3 demos/fold.py --json fold.json
    mpirun -n 2 python3 demos/fold.py --cells 3 --friction 0.2 --longer 1
    python3 demos/fold.py --plot fold.png

There are --steps steps until the legs are almost closed, and half as many shorter steps after that.
A second run has twice as many cells in each direction. Legs that are mirror images do not slip on
each other, whatever the friction; --longer makes the lower leg longer. The spring is then not
symmetric, and the support at the middle of the bend carries a force. Lengths are in units of the
thickness of the legs, stresses in E; the force acts on a plane. Keys of the JSON object, for the
mesh of --cells:

- force: at the end;
- force_change: the largest difference to the finer mesh at the same stroke, over the largest force;
- symmetry_error: the largest difference between displacements and their mirror image, of all steps,
  over the stroke of a plane;
- energy_error: |work of the planes (Simpson's rule) − elastic energy − dissipation of friction|
  over the work, at the end;
- max_penetration: the largest penetration of the spring into itself, of all steps;
- facet_size: the smallest facet;
- snes_iterations: number of Newton iterations with both meshes.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common import pictures
from common.command import Command, count, option, report
from fold_bodies import LEG, OPEN, Spring
from fold_output import measure, more, summary

#: Half the distance between the planes when the legs are almost closed, and at the end.
CLOSED, FLAT = 1.04 * LEG, 0.96 * LEG


@dataclasses.dataclass
class Parameters:
    """One spring that is folded."""

    cells: int = option(4, "cells across the legs", type=count)
    friction: float = option(0.0, "Coulomb's coefficient of the spring on itself")
    longer: float = option(0.0, "additional length of the lower leg")
    steps: int = option(64, "steps until the legs almost close, a multiple of 4", type=count)
    touching: str = option("boundary", "self-contact surface", choices=("boundary", "inside"))
    sliding: str = option("small", "finite: contact geometry is updated in the step")
    enforcement: str = option("augmented-lagrangian")
    verbose: bool = option(False, "print each step")

    def __post_init__(self):
        if self.friction < 0:
            raise ValueError("--friction: must not be negative")
        if not -2 <= self.longer <= 2:
            raise ValueError("--longer: must be from -2 to 2")
        if self.steps % 4:
            raise ValueError("--steps: must be a multiple of 4")

    def strokes(self):
        """How far each plane has moved at first and after each step."""
        last = self.steps // 2
        first = [(OPEN - CLOSED) * i / self.steps for i in range(self.steps)]
        return first + [OPEN - CLOSED + (CLOSED - FLAT) * i / last for i in range(last + 1)]


def build(comm, p):
    """Build the spring, its contacts with the two planes and with itself, and the stepper."""
    spring = Spring(comm, p.cells, p.longer, p.touching)
    planes = [
        qs.RigidSurface.plane(comm, point=[0, side * OPEN], normal=[0, -side]) for side in (1, -1)
    ]
    options = {"enforcement": p.enforcement, "sliding": p.sliding}
    contacts = [qs.Contact(spring.boundary, plane, **options) for plane in planes]
    friction = qs.Coulomb(p.friction) if p.friction else None
    contacts.append(qs.Contact(spring.surface, spring.surface, friction=friction, **options))
    problem = qs.ContactProblem([spring.F], [spring.u], contacts, [spring.bcs])
    strokes = p.strokes()

    def stroke(t):
        i = min(int(t), len(strokes) - 2)
        return strokes[i] + (t - i) * (strokes[i + 1] - strokes[i])

    def drive(t, dt):
        for plane, side in zip(planes, (1, -1), strict=True):
            plane.displacement = [0, -side * (stroke(t) - stroke(t - dt))]

    return spring, contacts, qs.TimeStepper(problem, 1.0, drive, num_pairings=3)


def fold(p, comm=MPI.COMM_WORLD, on_step=None):
    """Fold one spring; return the rows of its states.

    ``on_step(row, scene)`` is called first for the initial state, and then after each step.
    """
    scene = *_, stepper = build(comm, p)
    rows = []
    for t, stroke in enumerate(p.strokes()):
        taken = sum(stepper.num_iterations for _ in stepper.run(float(t)))
        rows.append(measure(stroke, taken, *scene))
        if p.verbose:
            rows[-1].say()
        if on_step is not None:
            on_step(rows[-1], scene)
    return rows


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Fold the spring with two meshes; return the results for --json, and the rows of both."""
    finer = dataclasses.replace(p, cells=2 * p.cells)
    both = [fold(case, comm, on_step) for case in (p, finer)]
    return summary(*both), both


def main():
    p, a = Command(__doc__, Parameters, plot="draw the spring and its force").parse()
    strokes = p.strokes()
    drawn = [strokes[i] for i in (0, 5 * p.steps // 8, 7 * p.steps // 8, p.steps, -1)]
    picture = pictures.Fold(drawn, OPEN) if a.plot else None
    result, both = run(p, on_step=picture)
    report(result, a.json, ".6g", more(*both))
    if picture is not None:
        names = [f"{case} cells across" for case in (p.cells, 2 * p.cells)]
        picture.draw(a.plot, dict(zip(names, both, strict=True)))


if __name__ == "__main__":
    main()
