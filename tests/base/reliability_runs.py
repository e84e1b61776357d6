"""Programs that ``test_reliability.py`` starts and stops: ``reliability_runs.py NAME FOLDER``."""

import os
import pathlib
import resource
import signal
import sys

import numpy as np

here = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(here))

from scenes import WORLD, Pair, box, plane, vector_space  # noqa: E402
from step_scenes import Upset, same  # noqa: E402

from dolfinx import fem  # noqa: E402

import qsdolfinx as qs  # noqa: E402


def say(*words):
    """Print a line with one write, so that output of other ranks does not split it."""
    if WORLD.rank == 0:
        sys.stdout.flush()
        os.write(1, (" ".join(map(str, words)) + "\n").encode())


def last():
    return WORLD.rank == WORLD.size - 1


def thrown(folder):
    """One rank raises an error in ``drive`` that is not caught."""

    def drive(t, dt):
        if last():
            raise KeyError("load table")

    Upset(drive=drive).stepper.step()


def _alone(make, *right):
    """Call with None as first argument on the last rank, which hides the communicator."""
    make(*([None, *right[1:]] if last() else right))


def no_space(folder):
    """Use None instead of a space for the first surface, before any handler is installed."""
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
    _alone(lambda V: qs.Surface(V, facets=plane(msh, 1, 0.0)), vector_space(msh))


def no_communicator(folder):
    """Use None instead of a communicator for the first tool."""
    _alone(qs.RigidSurface.plane, WORLD, [0.0, 0.0], [0.0, 1.0])


def no_slave(folder):
    """Use None instead of a slave for a contact of two bodies."""
    pair = Pair("triangle")
    _alone(qs.Contact, pair.slave, pair.master)


def no_unknowns(folder):
    """Use None instead of the unknowns for a problem."""
    pair = Pair("triangle")
    _alone(lambda u: qs.ContactProblem(pair.F, u, [pair.contact], pair.bcs), pair.u)


def interrupted(folder):
    """Ctrl-C in the middle of a step is caught, and the run continues."""
    case = Upset(die=True, n=4)
    case.stepper.step()
    state, forces = case.state(), case.forces()
    evaluate, count = case.problem.bodies[0].residual, []

    def interrupt(x):
        count.append(1)
        if len(count) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return evaluate(x)

    case.problem.bodies[0].residual = interrupt
    try:
        case.stepper.step()
    except KeyboardInterrupt:
        assert same(state, case.state()) and np.array_equal(forces, case.forces())
        say("as before")
    case.stepper.step()
    reference = Upset(die=True, n=4)
    reference.stepper.step()
    reference.stepper.step()
    assert np.allclose(case.forces(), reference.forces(), rtol=1e-9, atol=1e-9)
    say("went on")


def endless(folder):
    """Solve until interrupted from outside."""
    pair = Pair("triangle", n=(40, 30))
    problem = pair.problem()
    problem.solve()
    say("ready")
    while True:
        pair.u[0].x.array[:] = pair.u[1].x.array[:] = 0
        problem.solve()


def killed(folder):
    """Kill the program while the second checkpoint is half written, after a complete first one."""
    case = Upset()
    case.stepper.step()
    qs.save_run(case.stepper, folder / "state", values={"step": 1})
    case.stepper.step()
    savez = np.savez

    def half(path, **arrays):
        savez(path, **arrays)
        with open(path, "r+b") as file:
            file.truncate(100)
        if last():
            os.kill(os.getpid(), signal.SIGKILL)

    np.savez = half
    qs.save_run(case.stepper, folder / "state", values={"step": 2})


def loaded(folder):
    """Load the checkpoint, continue, and print the stored step."""
    case = Upset()
    values = qs.load_run(case.stepper, folder / "state")
    case.stepper.step()
    say("step", values["step"], case.stepper.num_steps)


def saved_again(folder):
    """Save over a checkpoint, and over an incomplete one."""
    case = Upset()
    qs.save_run(case.stepper, folder / "state", values={"step": 5})
    say("step", qs.load_run(case.stepper, folder / "state")["step"])


def full_disk(folder):
    """Write a checkpoint, a table and fields when files cannot grow any more."""
    case = Upset()
    case.stepper.step()
    qs.save_run(case.stepper, folder / "state", values={"step": 1})
    before = case.state()
    history = qs.History(WORLD, folder / "run.csv", verbose=False)
    history.add(qs.step_row(case.stepper))
    field = fem.Function(vector_space(case.mesh))
    writer = qs.FieldWriter(folder / "fields.xdmf", case.mesh, {"u": field})
    writer.write(0.0)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, limits[1]))
    for name, call in (
        ("checkpoint", lambda: qs.save_run(case.stepper, folder / "state", values={"step": 2})),
        ("table", lambda: history.add(qs.step_row(case.stepper))),
        ("fields", lambda: writer.write(1.0)),
    ):
        try:
            call()
        except (OSError, RuntimeError) as error:
            say(name, "refused", type(error).__name__, error)
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert same(before, case.state())
    say("left", sorted(path.name for path in folder.iterdir()))


if __name__ == "__main__":
    qs.end_all_ranks()
    globals()[sys.argv[1]](pathlib.Path(sys.argv[2]))
