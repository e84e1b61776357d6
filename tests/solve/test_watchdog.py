"""Full Newton steps where the line search makes hardly any progress."""

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box

import qsdolfinx as qs
from qsdolfinx.solve import watchdog as module
from qsdolfinx.solve.watchdog import PATIENCE, TRIAL, Watchdog

SHORT_STEP = module.SHORT / 2
#: Merit at the start, with 1 close to a solution.
START = 200.0


def crawl(watchdog, count):
    """Note this many short steps, none of which is followed by a full step."""
    for _ in range(count):
        assert not watchdog.wants_full_step(1.0) and watchdog.back(1.0) is None
        watchdog.note(SHORT_STEP)
    assert watchdog.wants_full_step(1.0)
    assert not watchdog.wants_full_step(4.0)


def test_full_steps_and_returns():
    """After short steps a full one; without success the run returns, and waits twice as long."""
    watchdog, start = Watchdog(START), np.array([3.0])
    watchdog.note(SHORT_STEP)
    watchdog.note(1.0)  # one short step, then a full one by itself
    crawl(watchdog, PATIENCE)
    watchdog.hold(start, 1.0)
    watchdog.note(1.0)
    for _ in range(TRIAL):
        assert watchdog.back(2.0) is None
        watchdog.note(SHORT_STEP)
        assert not watchdog.wants_full_step(1.0)
    assert watchdog.back(2.0) is start
    watchdog.note(1.0)
    crawl(watchdog, 2 * PATIENCE)
    watchdog.hold(start, 1.0)
    watchdog.note(1.0)
    assert watchdog.back(0.9) is None  # success: nothing to return to
    for _ in range(2 * TRIAL):
        assert watchdog.back(2.0) is None


@pytest.mark.parametrize("steep", (10.0, 1e4))
def test_sharp_punch_that_is_dragged(steep):
    """A sharp punch is pressed into rubber and dragged by a facet in each step.

    In each step the merit has a kink close to the solution, where a point becomes inactive. The
    line search alone took 34 to 48 iterations a step, most of them with a 32nd of the Newton step.
    """
    body = Body(box(WORLD, (50, 10), "quadrilateral", [0.0, 0.0], [1.5, 0.4], "scattered"))
    body.clamp(body.boundary(lambda x: np.isclose(x[1], 0.0)))
    out = 0.15 / steep
    x = np.array([[0.35, 0.0], [0.65, 0.0], [0.65 + out, 0.15], [0.35 - out, 0.15]])
    sides = [[0, 1], [1, 2], [2, 3], [3, 0]]
    tool = qs.RigidSurface.triangulated(WORLD, x + np.array([0.0, 0.401]), sides)
    contact = qs.Contact(body.side(1, 0.4), tool, sliding="finite")

    def drive(t, dt):
        way = np.array([[max(s - 1, 0) * 0.03, -min(s, 1) * 0.02] for s in (t - dt, t)])
        tool.displacement = way[1] - way[0]

    stepper = qs.TimeStepper(problem_of([body], [contact]), 1.0, drive, dt_max=1.0)
    for _ in stepper.run(5.0):
        pass
    assert stepper.num_cutbacks == 0
    assert max(attempt.iterations for attempt in stepper.log) <= 28
    assert contact.force("slave")[1] < -2.5
