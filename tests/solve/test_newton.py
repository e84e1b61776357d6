"""Newton's method: where it ends, and what a refused solve leaves."""

import numpy as np
import pytest
from hard.bodies import Column, Punch, difference, solve
from hard.cases import Variant


def test_rounding_does_not_end_other_solves():
    """What rounding leaves is a small part of what a solve is asked for."""
    scene = Punch(Variant(), n=((16, 6), (7, 3)))
    problem = scene.problem()
    solve(problem)
    measures, limits = problem.newton.measure()
    assert np.all(measures.rounding < 1e-2 * 1e-9 * measures.sizes)
    assert np.all(limits <= 1e-9 * measures.sizes) and np.all(measures.residuals <= limits)


def test_refused_solves_leave_the_state():
    """A load that nothing balances; the problem can be used afterwards."""
    scene = Column(Variant())
    load = scene.press(1e-3)
    problem = scene.problem()
    solve(problem)
    before = [u.x.array.copy() for u in problem.u]
    load.value[1] = 1e-3
    with pytest.raises(RuntimeError, match="did not converge"):
        solve(problem)  # which compares the unknowns
    load.value[1] = -1e-3
    solve(problem)
    assert difference(problem.u, before) < 1e-10
    assert np.isclose(scene.contact.force("slave")[1], 1e-3)
