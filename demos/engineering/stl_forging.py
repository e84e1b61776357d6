"""Forging with a die from an STL file: a hot billet is pressed into the pocket of the upper die.

A quarter of a steel billet, radius 10 mm and height 12 mm, Norton-Hoff with K = 50 MPa sᵐ and m =
0.15, stands on a flat plate; the upper die, with a pocket 4 mm deep, comes down at 10 mm/s. The
script writes the die as a binary STL file, as a CAD program would, and `qs.RigidSurface.from_stl`
reads it. There is no friction, so the power of the press equals the dissipation of the billet.

    python3 demos/engineering/stl_forging.py --plot stl_forging.png
    mpirun -n 2 python3 demos/engineering/stl_forging.py --size 3 --steps 3

Keys of the JSON object, for the whole billet:

- force (kN): force of the press at the end;
- boss (mm): height of the middle of the billet above the land of the die at the end;
- volume_error: volume of the billet at the end, relative change since the start;
- force_error: largest |force of the press - force on the plate| / |force|, of all steps;
- energy_error: dissipated work over work of the press, -1; quadrature points that come into contact
  within a step do not move with the die yet.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from closed_die_tools import skin
from common.bodies import facets_at, fix
from common.command import Command, count, option, report
from common.limits import check
from forming_bodies import NortonHoff, quarter_cylinder
from stl_forging_die import HEIGHT, profile, read_die
from stl_forging_plot import Picture

RADIUS, STROKE, SPEED = 10.0, 4.0, 10.0  # mm, mm/s
K, M = 50.0, 0.15  # MPa sᵐ, -
PENALTY = 1e5  # MPa/mm
LIMITS = {"volume_error": 5e-3, "force_error": 1e-6, "energy_error": 5e-2}


@dataclasses.dataclass
class Parameters:
    """Parameters of a forging."""

    size: float = option(1.8, "cell size, mm")
    steps: int = option(16, "number of steps for a stroke of 4 mm", type=count)
    stroke: float = option(STROKE, "stroke of the die, mm")


def build(comm, p):
    """Make the billet, the contacts with plate and die, and the stepper."""
    billet = NortonHoff(quarter_cylinder(comm, RADIUS, 0.0, HEIGHT, p.size), K, M, slow=1e-3)
    V = billet.W.sub(0)
    bcs = [fix(V, axis, facets_at(billet.mesh, axis, 0.0)) for axis in (0, 1)]
    plate, die = qs.RigidSurface.plane(comm, [0, 0, 0], [0, 0, 1]), read_die(comm)
    surface, dt = billet.surface(skin(billet.mesh)), STROKE / SPEED / p.steps
    settings = {"unknown": "velocity", "dt": dt, "penalty": PENALTY, "enforcement": "penalty"}
    settings["constraints"] = "points"  # the edge radius of the pocket is about the facet size
    contacts = [qs.Contact(surface, tool, **settings) for tool in (plate, die)]
    problem = qs.ContactProblem([billet.F], [billet.w], contacts, [bcs])

    def drive(t, dt):
        die.displacement = [0, 0, -SPEED * dt]

    def solve(step):
        qs.solve_with_continuation(problem, billet.m, M)

    return billet, contacts, qs.TimeStepper(problem, dt, drive, solve=solve)


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Forge; return the --json object, and a row of each step."""
    billet, contacts, stepper = build(comm, p)
    volume, rows, powers, work = billet.volume(), [], [], np.zeros(2)
    stepper.on_solved = lambda: powers.append(4 * billet.power())  # where v was solved
    for t in stepper.run(p.stroke / SPEED):
        below, above = (4 * contact.force("slave")[2] for contact in contacts)
        x = billet.mesh.geometry.x
        top = comm.allreduce(x[:, 2].max(initial=0.0), MPI.MAX)
        row = {"stroke": SPEED * t, "force": -above / 1e3, "boss": top - HEIGHT + SPEED * t}
        row["force_error"] = abs(below / above + 1)
        rows.append(row)
        work += np.array([-above * SPEED, powers[-1]]) * stepper.last_dt
        if on_step is not None:
            on_step(row, billet, profile, HEIGHT)
    result = {name: rows[-1][name] for name in ("force", "boss")}
    result["volume_error"] = billet.volume() / volume - 1
    result["force_error"] = max(row["force_error"] for row in rows)
    result["energy_error"] = work[1] / work[0] - 1
    return result, rows


def main():
    p, a = Command(__doc__, Parameters, plot="draw sections, and the force").parse()
    picture = Picture() if a.plot else None
    result, rows = run(p, on_step=picture)
    report(result, a.json, ".6g")
    check(result, LIMITS)
    if picture is not None:
        picture.draw(a.plot, rows)


if __name__ == "__main__":
    main()
