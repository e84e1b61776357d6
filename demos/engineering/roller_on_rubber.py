"""Distance that a steel roller travels on rubber: less than its circumference, as rubber stretches.

The roller of demos/rubber.py: radius 30 mm, pressed 3 mm into a sheet 20 mm thick, and turned. In
the stick zone the rubber passes with the speed of the rim. Rubber that is elongated by a stretch λ
enters the zone more slowly by this factor, so that the roller travels R φ / λ in an angle φ.

    python3 demos/engineering/roller_on_rubber.py --plot roller_on_rubber.png
    mpirun -n 2 python3 demos/engineering/roller_on_rubber.py --facet 4 --degrees 48

Keys of the JSON object; forces are per mm of depth, stresses in the shear modulus:

- way_of_a_turn (mm): 2 π R times distance over angle, of the last 16 degrees;
- stretch: stretch of the surface in the middle half of the contact over the same degrees;
- force: on the roller, upwards, at the end;
- error_of_stretch: way_of_a_turn / (2 π R / stretch) - 1;
- error_of_published: way_of_a_turn / 175.4 - 1, with benchmark 5 of NAFEMS R0094 (Konter 2006);
- force_error: largest |force on the roller + reaction of the clamped base| / |force|.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import rubber
from common.bodies import Reaction, facets_at, integral, measure
from common.command import Command, option, report
from common.limits import check
from roller_on_rubber_plot import draw
from rubber_bodies import HEIGHT
from rubber_scenes import PRESSING, ROLLER

LIMITS = {"error_of_stretch": 1e-2, "error_of_published": 4e-2, "force_error": 1e-6}
STEP, PUBLISHED = 4.0, 175.4  # degrees; mm, per turn


@dataclasses.dataclass
class Parameters:
    """Parameters of a rolling test."""

    facet: float = option(2.0, "size of facets, mm")
    degrees: float = option(120.0, "angle of rolling")

    def __post_init__(self):
        if self.degrees < 5 * STEP:
            raise ValueError(f"--degrees: must be at least {5 * STEP:g}")


class Stretch:
    """Mean stretch along the surface, in the middle half of the contact."""

    def __init__(self, body):
        self.mesh, x = body.mesh, ufl.SpatialCoordinate(body.mesh)
        self.centre, self.half = fem.Constant(body.mesh, 0.0), fem.Constant(body.mesh, 0.0)
        tangent = (ufl.Identity(2) + ufl.grad(body.u))[:, 0]
        inside = ufl.conditional(abs(x[0] + body.u[0] - self.centre) < self.half, 1.0, 0.0)
        ds = measure(body.mesh, facets_at(body.mesh, 1, 0.0))(degree=8)
        forms = inside * ds, inside * ufl.sqrt(ufl.dot(tangent, tangent)) * ds
        self.forms = [fem.form(form) for form in forms]  # no recompilation

    def __call__(self, scene, contact):
        """Return the present value. Collective."""
        self.centre.value, self.half.value = scene.lid.center[0], contact.patch()[0] / 4
        length, stretched = (integral(self.mesh, form) for form in self.forms)
        return stretched / length


def run(p, comm=MPI.COMM_WORLD):
    """Press and roll; return the --json object, the rows of all steps, and the scene."""
    steps = round(p.degrees / STEP)
    of_rubber = rubber.Parameters("roller", p.facet, steps * STEP / 360, steps)
    scene, (contact,), stepper = rubber.build(comm, of_rubber)
    base = Reaction(scene.body.F, scene.body.V, facets_at(scene.body.mesh, 1, -HEIGHT))
    stretch_now, rows = Stretch(scene.body), []
    for t in stepper.run(scene.end):
        force, reaction = contact.force("master"), base()
        error = np.linalg.norm(force - reaction) / np.linalg.norm(force)
        angle = np.radians(max(0.0, t - PRESSING) * STEP)
        way, stretch = -scene.moved(), stretch_now(scene, contact)
        rows.append({"angle": angle, "way": way, "stretch": stretch, "error": error})
    last, before = rows[-1], rows[-5]
    turn = 2 * np.pi * (last["way"] - before["way"]) / (last["angle"] - before["angle"])
    stretch = np.mean([row["stretch"] for row in rows[-4:]])
    result = {"way_of_a_turn": turn, "stretch": stretch, "force": force[1]}
    result["error_of_stretch"] = turn / (2 * np.pi * ROLLER / stretch) - 1
    result["error_of_published"] = turn / PUBLISHED - 1
    result["force_error"] = max(row["error"] for row in rows)
    return result, rows, scene


def main():
    p, a = Command(__doc__, Parameters, plot="draw the roller, and its distance").parse()
    result, rows, scene = run(p)
    report(result, a.json, ".6g")
    check(result, LIMITS)
    if a.plot:
        draw(a.plot, result, rows, scene, PUBLISHED)


if __name__ == "__main__":
    main()
