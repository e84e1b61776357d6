"""Two spur gears in mesh over a pitch: torques, and the pressure at the pitch point.

Involute teeth of module 4 mm, 20 and 40 teeth, pressure angle 20°, steel (E = 210 GPa, ν = 0.3),
plane strain, no friction. Three teeth of the pinion and four of the wheel are modelled, on rims;
the rim of the wheel is fixed, and the rim of the pinion is turned by a small angle, in positions
over one pitch. In the middle position a single pair of teeth is in contact, at the pitch point. In
each position the meshes are turned, and a linear problem with contact is solved.

    python3 demos/engineering/gear_pair.py --plot gear_pair.png
    mpirun -n 2 python3 demos/engineering/gear_pair.py --h 0.1 --steps 4 --json gear_pair.json

Keys of the JSON object:

- ratio_error: ratio of the torques over 2, − 1, at the pitch point;
- line_error: angle (radians) between the force and the line of action there;
- largest_ratio_error: largest ratio_error of all positions; tip edges come into contact off the
  line of action;
- hertz_error: largest pressure at the pitch point over Hertz' pressure, − 1, for the force that
  acts there and radii of curvature r sin 20°;
- pressure (MPa), torque (N m per mm): at the pitch point, Hertz' pressure, and the torque on the
  pinion;
- largest_torque (N m per mm): largest torque of all positions; two pairs are stiffer than one.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from common import machine_parts
from common.command import Command, count, option, report
from common.limits import check
from gear_pair_bodies import ANGLE, NU, E, Gear

TEETH, WIND_UP = (20, 40), 9e-4
LIMITS = {
    "ratio_error": 1e-3,
    "line_error": 1e-3,
    "largest_ratio_error": 0.01,
    "hertz_error": 0.05,
}


@dataclasses.dataclass
class Parameters:
    """Parameters of a gear pair."""

    h: float = option(0.06, "mm, size of facets on the flanks")
    steps: int = option(12, "number of positions, over a pitch", type=count)


def create(comm, h):
    """Make pinion and wheel; a tooth of the pinion is between two teeth of the wheel."""
    pitches = [2 * np.pi / teeth for teeth in TEETH]
    pinion = Gear(comm, TEETH[0], pitches[0] * np.arange(-1, 2), (0.0, 0.0), h)
    axis = pinion.profile.radius * (1 + TEETH[1] / TEETH[0])
    middles = np.pi + pitches[1] * (np.arange(-2, 2) + 0.5)
    return pinion, Gear(comm, TEETH[1], middles, (axis, 0.0), 0.8 * h)


def turn(gears, s):
    """Solve for the pinion turned by s pitches from contact of a pair at the pitch point."""
    pinion, wheel = gears
    angle = pinion.profile.pitch * (s - 0.25)
    slave = pinion.place(angle, WIND_UP)
    master = wheel.place(-angle * TEETH[0] / TEETH[1], 0.0)
    contact = qs.Contact(slave, master)
    problem = qs.ContactProblem(
        [g.F for g in gears], [g.u for g in gears], [contact], [g.bcs for g in gears]
    )
    problem.solve()
    torques = [contact.moment("slave", pinion.center)[0], contact.moment("master", wheel.center)[0]]
    traction = np.linalg.norm(slave.node_values(contact.traction("slave")), axis=1)
    peak = slave.comm.allreduce(traction.max(initial=0.0), op=MPI.MAX)
    return np.abs(torques), contact.force("slave"), peak


def hertz(pinion, wheel, force):
    """Return Hertz' pressure of two cylinders with the teeth's curvature at the pitch point."""
    curvature = sum(1 / (gear.profile.radius * np.sin(ANGLE)) for gear in (pinion, wheel))
    return np.sqrt(force * curvature * E / (2 * (1 - NU**2)) / np.pi)


def run(p, comm=MPI.COMM_WORLD):
    """Solve for all positions; return the --json object, positions and torques, and the gears."""
    gears = create(comm, p.h)
    positions = np.linspace(-0.5, 0.5, p.steps + 1)
    torques = np.array([turn(gears, s)[0] for s in positions])
    middle, force, peak = turn(gears, 0.0)  # the position that is drawn
    pressure = hertz(*gears, np.linalg.norm(force))
    return {
        "ratio_error": middle[1] / middle[0] / 2 - 1,
        "line_error": np.arctan(force[0] / force[1]) - ANGLE,
        "largest_ratio_error": np.abs(torques[:, 1] / torques[:, 0] / 2 - 1).max(),
        "hertz_error": peak / pressure - 1,
        "pressure": pressure,
        "torque": middle[0] / 1e3,
        "largest_torque": torques[:, 0].max() / 1e3,
    }, (positions, torques, gears)


def main():
    p, a = Command(__doc__, Parameters, plot="draw the gears and torques").parse()
    result, scene = run(p)
    report(result, a.json, ".4g")
    check(result, LIMITS)
    if a.plot:
        machine_parts.gear_pair(a.plot, *scene)


if __name__ == "__main__":
    main()
