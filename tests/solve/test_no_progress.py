"""Newton's method ends early where it makes no progress, and says why it has not converged."""

import types

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box, plane

import qsdolfinx as qs
from qsdolfinx.solve.no_progress import Progress


def progress_of(merits, sets=None, steps=None):
    """Progress of a run, and the number of iterates after which it is faulted, None if never."""
    contact = types.SimpleNamespace(called=lambda i: f"contact {i}")
    progress = Progress(types.SimpleNamespace(comm=WORLD, contacts=[contact]))
    for k, merit in enumerate(merits):
        closed = np.zeros(4, dtype=bool)
        closed[: 0 if sets is None else sets[k]] = WORLD.rank == WORLD.size - 1
        side = types.SimpleNamespace(closed=closed, sticking=closed)
        at = types.SimpleNamespace(passes=[side])
        progress.add(at, merit, 1.0 if steps is None else steps[k], [int(closed.sum())])
        fault = progress.fault()
        if fault is not None:
            return fault, k + 1
    return progress.late(), None


def test_iterates_that_repeat():
    """A cycle of active sets ends after two periods with the same sets, steps and merits."""
    merits = [9.0, 5.0, *(4.0, 3.0, 2.0) * 4]
    sets = [3, 2, *(1, 2, 4) * 4]
    for change in (0.0, 2e-3):  # cycles converge, too
        text, count = progress_of(merits * (1 - change * np.arange(14)), sets)
        assert count == 8 and "repeat every 3 iterations" in text
        assert "contact 0 has between 1 and 4 active constraints" in text


@pytest.mark.parametrize(
    "merits, sets",
    (
        (np.tile([4.0, 3.0, 2.0], 5) * 0.9 ** np.arange(15), [1, 2, 4] * 5),  # they decrease
        ([4.0, 3.0, 2.0] * 2, [1, 2, 4, 1, 3, 4]),  # another set
        (np.full(12, 3.0), [2] * 12),  # the same set all along, as at rounding level
        (0.99 ** np.arange(40), [1, 2] * 20),  # slow
    ),
)
def test_what_is_no_cycle(merits, sets):
    assert progress_of(merits, sets)[1] is None


def test_text_of_a_run_that_is_late():
    text, _ = progress_of(1 / np.arange(1.0, 21.0), np.arange(20) % 3, np.full(20, 0.1))
    assert "from 0.0909 to 0.05" in text and "10 steps were cut to less than 0.25" in text
    assert "between 0 and 2 active" in text


def hook():
    """A frictionless hook of degree 2 whose nose is pushed onto a rigid catch, and its stepper."""
    nose = [7.6, 8.4, 8.8, 10.0], [0.0, 1.0, 1.0, 0.0]
    msh = box(WORLD, (30, 3), "quadrilateral", (0.0, 0.0), (10.0, 0.8))
    x = msh.geometry.x
    x[:, 1] -= np.interp(x[:, 0], *nose) * (1 - x[:, 1] / 0.8)
    body = Body(msh, degree=2, stiffness=1000.0)
    end = body.clamp(plane(msh, 0, 0.0))
    touching = body.boundary(
        lambda x: np.isclose(x[1], -np.interp(x[0], *nose)) | np.isclose(x[0], 10.0)
    )
    x = np.array([[12.4, -1.2], [11.8, -0.3], [11.4, -0.3], [10.6, -1.2]])
    tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2], [2, 3]])
    contact = qs.Contact(body.surface(touching), tool, sliding="finite", name="nose")
    problem = problem_of([body], [contact])

    def drive(t, dt):
        end.value[0] = 5.0 * t

    return problem, contact, qs.TimeStepper(problem, 0.35, drive)


def test_a_hook_that_touches_its_catch():
    """The start is far from the solution, and Newton's method would cycle, with period 6."""
    _, contact, stepper = hook()
    stepper.step()
    stepper.dt = 0.025
    stepper.step()
    assert stepper.num_cutbacks == 0
    assert abs(contact.force("slave")[1]) > 0.01 and stepper.num_iterations < 20


def test_error_says_why():
    """An error has the reason in words, as has the log of the steps."""
    msh = box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    body = Body(msh)
    top = body.clamp(plane(msh, 1, 1.0))
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(body.side(1, 0.0), floor, name="foot")
    problem = problem_of([body], [contact], petsc_options={"snes_max_it": 3})

    def drive(t, dt):
        top.value[1] = -0.5 * t

    drive(1.0, 1.0)
    with pytest.raises(qs.ConvergenceError) as caught:
        problem.solve()
    error = caught.value
    assert error.reason_name == "DIVERGED_MAX_IT" and "in the last" in error.why
    assert error.why in str(error) and len(str(error).split("\n")) == 3
    stepper = qs.TimeStepper(problem, 1.0, drive, dt_min=1.0)
    with pytest.raises(qs.StepError, match="in the last"):
        stepper.step()
    assert error.why in stepper.log[-1].reason
