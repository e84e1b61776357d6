"""The slip rate that counts as slow: which steps determine it."""

import types

import pytest
from scenes import WORLD

import qsdolfinx as qs
from qsdolfinx.friction.history import FrictionHistory

SIZE = 0.5  # of the smallest facet


def history(rate=None):
    """Return the friction of a contact with a law that needs a rate, after this largest rate."""
    made = FrictionHistory(qs.Coulomb(0.3), types.SimpleNamespace(comm=WORLD), None)
    made.law = types.SimpleNamespace(needs_rate=True)
    if rate is not None:
        made.continue_with(rate)
    return made


def learn(made, way, dt=1.0):
    """Whether a solution with this largest slip changes the rate."""
    return made.learn_rate([types.SimpleNamespace(fastest=lambda: way)], dt, SIZE)


def test_a_small_part_of_the_largest_rate():
    """Slow slip is too little to be seen, and is not of the size of rounding."""
    made = history()
    assert 1e-4 < made.slow(1.0, SIZE) / SIZE < 1e-2
    assert learn(made, 0.2) and 1e-4 < made.slow(1.0, SIZE) / 0.2 < 1e-2


@pytest.mark.parametrize("way", (0.2, 1e-6))
def test_first_step_with_slip(way):
    """The step is solved again with its rate, and then again only while rates fall by far."""
    made = history()
    assert learn(made, way)
    assert not learn(made, way / 2) and not learn(made, 2 * way)
    ways = [way * 0.1**k for k in range(1, 30)]
    solves = [learn(made, each) for each in ways]
    assert solves[0] and not solves[-1]


@pytest.mark.parametrize("factor, again", ((10.0, False), (0.5, False), (0.05, True)))
def test_later_steps(factor, again):
    """The rate stays, unless all slip is so much slower that it would count as slow."""
    assert learn(history(0.2), 0.2 * factor) == again
