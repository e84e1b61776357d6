"""Roll rubber: an O-ring in its groove, or a sheet under a steel roller.

Plane strain, nearly incompressible neo-Hookean rubber (shear modulus 1, ν = 0.49); steel is rigid.

oring: a section of radius 1, triangles of degree 2, in a groove of width 3, which it fills by 70 %.
A lid moves down by a quarter of the ring's height, and then to the right by --distance. The ring is
held only by contact with the groove and the lid, with friction of 0.2: it rolls.

roller: after NAFEMS R0094, benchmark 5 (Konter 2006). A roller of radius 30, friction 0.3, is
pressed by 3 into a sheet of thickness 20 that is clamped below, and turned once, by --distance in
revolutions, to the left. It is free along the sheet except for a drag of 0.015. The dimensions in
the report were not available: its displacement of a node of the roller in one turn, -175.4, is for
a model that may differ from this one. Rubber under the roller is stretched, so that the roller
moves less than its circumference, 188.5.

    python3 demos/rubber.py --scene oring --json oring.json
    mpirun -n 2 python3 demos/rubber.py --scene roller --steps 90
    python3 demos/rubber.py --scene oring --plot oring.png

Five steps press the roller; half of --steps press the ring. Lengths are in units of the ring's
radius or mm, stresses in the shear modulus. Keys of the JSON object:

- force: vertical force on the lid or the roller at the end;
- u_x: displacement along x: mean of the ring's section, or the roller's middle;
- max_penetration: the largest penetration at the end of any step;
- facet_size: the smallest facet, before deformation;
- snes_iterations: number of Newton iterations of all steps.
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
#: Kind of sliding that takes fewer iterations, for each scene.
SLIDING = dict(zip(FRICTION, ("finite", "small"), strict=True))


@dataclasses.dataclass
class Parameters:
    """One of the scenes; None stands for the default of the scene."""

    scene: str = option("oring", choices=tuple(FRICTION))
    facet: float | None = option(None, "facet size: 0.15 for the ring, 2 mm for the roller")
    distance: float | None = option(None, "lid displacement: 0.5, or turns of the roller: 1")
    steps: int | None = option(None, "50 for the ring, 90 to turn the roller", type=count)
    friction: float | None = option(None, "Coulomb's coefficient: ring 0.2, roller 0.3")
    sliding: str | None = option(None, "default finite for the ring, small for the roller")
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
    """Build the scene, its contacts, and the stepper."""
    scene = {"oring": Ring, "roller": Roller}[p.scene](comm, p)
    friction = qs.Coulomb(p.friction)
    options = {"friction": friction, "sliding": p.sliding, "enforcement": p.enforcement}
    contacts = [qs.Contact(scene.body.surface, tool, **options) for tool in scene.tools]
    problem = qs.ContactProblem([scene.body.F], [scene.body.u], contacts, [scene.body.bcs])
    return scene, contacts, qs.TimeStepper(problem, 1.0, scene.drive)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Press and roll; return the results for --json, and the rows of all steps.

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
