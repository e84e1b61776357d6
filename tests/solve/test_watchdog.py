"""Full Newton steps where the line search makes hardly any progress."""

import numpy as np
import pytest
from following import Dragged

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
    scene = Dragged((50, 10), steep, 0.03)
    assert scene.most_iterations(5.0) <= 28
    assert scene.contact.force("slave")[1] < -2.5
