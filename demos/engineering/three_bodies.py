"""Three elastic bodies in a stack: run, stop, and restart on any number of ranks.

A bridge bearing: a pad of PTFE, 200 x 200 x 20 mm, lies on a pier of concrete, 100 mm high; on it
lies a longer steel plate of 40 mm, which goes down by 0.2 mm and then, as the bridge gets warm, 20
mm along x. The pad sticks to the pier (μ = 0.4) and slides under the plate (μ = 0.05). The meshes
do not match. Poisson's ratios are 0, so the load is that of bars in series.

    mpirun -n 2 python3 demos/engineering/three_bodies.py --output bearing --plot three_bodies.png
    python3 demos/engineering/three_bodies.py --output bearing --restart

The first command writes fields for ParaView, a table and, half way along x, a checkpoint. Then, as
the second command, it restarts a new scene from the checkpoint, and compares with the table.

Keys of the JSON object:

- load, drag (kN): force of the pad on the plate at the end, along z and -x;
- load_error: error of the load after pressing, relative to bars in series (the plate is longer);
- drag_error: error of the drag, relative to Coulomb's law (faces are not quite flat);
- balance_error: largest |sum of the forces on the pad| / load;
- restart_error: largest |force of the restarted run - force in the table| / load.
"""

import dataclasses
import pathlib
import sys
import tempfile

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common.command import Command, count, option, report
from common.limits import check
from common.output import Output
from three_bodies_bodies import ALONG, DOWN, MU, Block
from three_bodies_output import compare, table
from three_bodies_plot import Picture

LIMITS = {"load_error": 2e-3, "drag_error": 1e-4, "balance_error": 1e-6, "restart_error": 1e-9}


@dataclasses.dataclass
class Parameters:
    """Parameters of a run."""

    cells: int = option(6, "number of cells across the pad", type=count)
    steps: int = option(4, "steps down; twice as many along x", type=count)
    output: str | None = option(None, "folder of all files", metavar="FOLDER")
    restart: bool = option(False, "only restart from the checkpoint in --output")

    def __post_init__(self):
        if self.restart and not self.output:
            raise ValueError("--restart needs the --output of the run before")


def build(comm, p):
    """Return bodies and contacts by name, and the stepper."""
    fewer = {"pier": 1, "pad": 0, "plate": 2}
    bodies = {name: Block(comm, name, max(1, p.cells - n)) for name, n in fewer.items()}
    pad, plate = bodies["pad"], bodies["plate"]
    contacts = {
        name: qs.Contact(face, bodies[name].face, friction=qs.Coulomb(MU[name]))
        for name, face in (("pier", pad.lower), ("plate", pad.upper))
    }
    F, u, bcs = ([getattr(b, name) for b in bodies.values()] for name in ("F", "u", "bcs"))
    problem = qs.ContactProblem(F, u, [*contacts.values()], bcs)

    def drive(t, dt):
        plate.moved.value = np.array([ALONG * max(0.0, t - 1) / 2, 0, -DOWN * min(t, 1)])

    return bodies, contacts, qs.TimeStepper(problem, 1 / p.steps, drive)


def make_steps(p, scene, folder=None, on_step=lambda t, bodies: None):
    """Run all remaining steps, and write files if a folder is given; return a row each."""
    bodies, contacts, stepper = scene
    out = Output(stepper.problem.comm, folder, 3.0, verbose=False)
    for name, body in bodies.items():
        near = {} if name == "pad" else contacts[name].field_sources("master")
        out.add_fields(name, body.mesh, {"displacement": body.u} | near, {})
    for t in stepper.run(3.0):
        forces = {name: contact.force("slave") for name, contact in contacts.items()}
        row = {f"{name}_{axis}": f for name in forces for axis, f in zip("xyz", forces[name])}
        out.write(t, {"t": t} | row)
        if folder and stepper.num_steps == 2 * p.steps:
            qs.save_run(stepper, out.folder / "checkpoint")
        on_step(t, bodies)
    out.close()
    return out.history.rows


def run(p, comm=MPI.COMM_WORLD, on_step=lambda t, bodies: None):
    """Run and restart; return the --json object, and the rows of both runs."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(p.output or comm.bcast(scratch))
        if not p.restart:
            make_steps(p, build(comm, p), folder, on_step)
        scene = *_, stepper = build(comm, p)
        qs.load_run(stepper, folder / "checkpoint")
        again, rows = make_steps(p, scene), table(folder / "history.csv", comm)
    return compare(rows, again), rows, again


def main():
    p, a = Command(__doc__, Parameters, plot="draw the bearing, and forces of both runs").parse()
    picture = Picture()
    result, *rows = run(p, on_step=picture)
    report(result, a.json, ".6g")
    check(result, LIMITS)
    if a.plot and not p.restart:
        picture.draw(a.plot, *rows)


if __name__ == "__main__":
    main()
