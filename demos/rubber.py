"""Rubber that is rolled: an O-ring in its groove, and a sheet under a steel roller.

Plane strain, nearly incompressible neo-Hookean rubber (shear modulus 1, ν = 0.49); steel is rigid.

oring: a section of radius 1, triangles of degree 2, in a groove 3 wide that fills it by 70 %. A lid
comes down by a quarter of its height, and then goes to the right by --distance. Nothing but
contact, with friction of 0.2 with the groove and the lid, holds the ring: it rolls.

roller: after the scene of NAFEMS R0094, benchmark 5 (Konter 2006). A roller of radius 30, friction
0.3, is pressed 3 into a sheet 20 thick that is clamped below, and turned once, by --distance in
revolutions, to the left; it is free along the sheet but for a drag of 0.015. The report's own
dimensions were not at hand: -175.4, its displacement of a node of the roller in one turn, is for a
scene that may differ from this one. Rubber under the roller is stretched, so that it comes less far
than its circumference, 188.5.

    python3 demos/rubber.py --scene oring --json oring.json
    mpirun -n 2 python3 demos/rubber.py --scene roller --steps 90
    python3 demos/rubber.py --scene oring --plot oring.png

Five steps press the roller, half of the --steps the ring. Lengths are in units of the ring's radius
or mm, stresses in the shear modulus. Keys of the JSON object:

- force: on the lid or the roller, vertical, at the end;
- u_x: how far the ring has come, the mean of the section, or the roller's middle;
- max_penetration: at the end of a step, the largest of all;
- facet_size: the smallest, before deformation;
- snes_iterations: of all steps.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common.command import Command, count, option, report
from common.rubber import Rubber as Picture
from rubber_bodies import LENGTH, MARGIN
from rubber_output import measure, more, summary
from rubber_scenes import ROLLER, Ring, Roller

FRICTION = {"oring": 0.2, "roller": 0.3}
FACET, DISTANCE, STEPS = (dict(zip(FRICTION, each)) for each in ((0.15, 2.0), (0.5, 1.0), (50, 90)))
#: Of the two the one that takes fewer iterations.
SLIDING = dict(zip(FRICTION, ("finite", "small"), strict=True))


@dataclasses.dataclass
class Parameters:
    """One of the scenes; what is None is as the scene needs it."""

    scene: str = option("oring", choices=tuple(FRICTION))
    facet: float | None = option(None, "size of facets: 0.15, or 2 mm")
    distance: float | None = option(None, "of the lid: 0.5; or turns of the roller: 1")
    steps: int | None = option(None, "50, or 90 for the roller once pressed", type=count)
    friction: float | None = option(None, "Coulomb's coefficient: 0.2, or 0.3")
    sliding: str | None = option(None, "finite for the ring, small for the roller")
    enforcement: str = option("penalty")
    verbose: bool = option(False, "print each step")

    def __post_init__(self):
        defaults = {"facet": FACET, "distance": DISTANCE, "steps": STEPS}
        for name, values in (defaults | {"friction": FRICTION, "sliding": SLIDING}).items():
            if getattr(self, name) is None:
                setattr(self, name, values[self.scene])
        largest = {"oring": 0.5, "roller": 10.0}[self.scene]
        if not 0 < self.facet <= largest:
            raise ValueError(f"--facet: must be positive and at most {largest}")
        if self.friction <= 0:
            raise ValueError("--friction: must be positive, nothing rolls without it")
        room = {"oring": 0.6, "roller": (LENGTH - 2 * MARGIN) / (2 * np.pi * ROLLER)}[self.scene]
        if not 0 <= self.distance <= 1.05 * room:
            raise ValueError(f"--distance: must be from 0 to {1.05 * room:.3g}")


def build(comm, p):
    """The scene, its contacts, and the stepper."""
    scene = {"oring": Ring, "roller": Roller}[p.scene](comm, p)
    friction = qs.Coulomb(p.friction)
    options = {"friction": friction, "sliding": p.sliding, "enforcement": p.enforcement}
    contacts = [qs.Contact(scene.body.surface, tool, **options) for tool in scene.tools]
    problem = qs.ContactProblem([scene.body.F], [scene.body.u], contacts, [scene.body.bcs])
    return scene, contacts, qs.TimeStepper(problem, 1.0, scene.drive)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Press and roll; returns what --json writes, and the rows of all steps.

    ``on_step(row, scene)`` is called after each step.
    """
    scene, contacts, stepper = build(comm, p)
    rows = []
    for t in stepper.run(scene.end):
        rows.append(measure(t, scene, contacts, stepper))
        if p.verbose:
            rows[-1].say()
        if on_step is not None:
            on_step(rows[-1], scene)
    return summary(rows, scene), rows


def main():
    p, a = Command(__doc__, Parameters, plot="draw the rubber and the forces").parse()
    picture = Picture() if a.plot else None
    result, rows = run(p, on_step=picture)
    report(result, a.json, ".6g", more(p, rows))
    if picture is not None:
        picture.draw(a.plot, rows)


if __name__ == "__main__":
    main()
