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


@pytest.mark.parametrize("factor, again", ((1.02, False), (0.98, False), (1.5, True), (0.5, True)))
def test_first_step_with_slip(factor, again):
    """The step is solved again if its rate differs by more than some per cent."""
    made = history()
    assert learn(made, 0.2)
    assert learn(made, 0.2 * factor) == again


@pytest.mark.parametrize("factor, again", ((10.0, False), (0.5, False), (0.05, True)))
def test_later_steps(factor, again):
    """The rate stays, unless all slip is so much slower that it would count as slow."""
    assert learn(history(0.2), 0.2 * factor) == again
