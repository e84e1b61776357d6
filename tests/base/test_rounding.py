"""What counts as rounding does not decide about results."""

import sys

import numpy as np
import pytest
from audit.histories import random_history
from audit.play import Play
from audit.run import following

NAMES = ("ROUNDING", "SOLVED", "SINGLE")


def forces_of(number):
    """Forces on the slave after each unit of time of a random history."""
    play = Play(following(random_history)(number, False))
    try:
        forces = []
        for unit in range(1, len(play.history.path) + 1):
            for _ in play.stepper.run(unit):
                pass
            forces.append(play.contact.force("slave"))
    finally:
        play.problem.destroy()
    return np.array(forces)


@pytest.mark.parametrize("number", (0, 7, 20))
def test_by_a_factor(number, monkeypatch):
    """A history with sizes that are ten times as large, or a tenth, ends with the same forces."""
    modules = [module for name, module in sys.modules.items() if name.startswith("qsdolfinx.")]
    kept = [(m, name, getattr(m, name)) for m in modules for name in NAMES if hasattr(m, name)]
    assert len(kept) > 30
    forces = []
    for factor in (1.0, 10.0, 0.1):
        for module, name, value in kept:
            monkeypatch.setattr(module, name, factor * value)
        forces.append(forces_of(number))
    np.testing.assert_allclose(
        forces[1:], [forces[0]] * 2, rtol=0, atol=1e-7 * np.abs(forces[0]).max()
    )
