"""Steps of a continuation in the rate sensitivity: their size, and when they are given up."""

import contextlib

import numpy as np
import pytest
from scenes import WORLD, box
from step_scenes import Upset, refuse, same

from dolfinx import fem

import qsdolfinx as qs


class Counted(qs.ContactProblem):
    """Problem that solves if the rate sensitivity falls by no more than a factor.

    Args:
        m: The rate sensitivity.
        most: The factor.
    """

    comm, contacts, u, num_iterations = WORLD, (), (), 1
    one_step = staticmethod(contextlib.nullcontext)

    def __init__(self, m, most):
        self.m, self.most, self.last, self.tried = m, most, np.inf, []

    def destroy(self):
        pass

    def solve(self):
        now = float(self.m.value)
        self.tried.append(now)
        if now < 1 and self.last / now > self.most:
            raise qs.ConvergenceError("too far")
        self.last = now


def followed(target, most):
    """Return the values of m that were tried, and whether the target was reached."""
    m = fem.Constant(box(WORLD, (1, 1), "triangle", [0.0, 0.0], [1.0, 1.0]), 1.0)
    problem = Counted(m, most)
    try:
        qs.solve_with_continuation(problem, m, target)
    except qs.ConvergenceError:
        return np.array(problem.tried), False
    return np.array(problem.tried), True


@pytest.mark.parametrize("target", (0.5, 0.1, 1 / 64))
def test_factors(target):
    """m falls by a small factor, with few solves."""
    tried, ends = followed(target, 1e9)
    ratios = tried[:-1] / tried[1:]
    assert ends and np.isclose(tried[-1], target) and ratios.max() < 6
    assert len(ratios) <= 1 + np.log(1 / target) / np.log(2.5)


@pytest.mark.parametrize("most, ends", ((1.2, True), (1.01, False)))
def test_steps_that_fail(most, ends):
    """They are halved some times: with a hundred steps, a problem has no solution."""
    tried, reached = followed(0.1, most)
    assert reached == ends and 5 < len(tried) < 60


def test_as_before_after_a_failure(monkeypatch):
    """If a later step fails, unknowns, multipliers and m are those of before the continuation."""
    case, solved = Upset(), []
    m, problem, solve = fem.Constant(case.mesh, 1.0), case.problem, case.problem.solve
    case.tool.displacement = [0.0, -0.05]
    solve()

    def once():
        solved.append(solve() if not solved else refuse(1.0))

    monkeypatch.setattr(problem, "solve", once)
    before = case.state()[:-2]  # without the displacement of the tool, and times
    case.tool.displacement = [0.0, -0.1]
    with pytest.raises(qs.ConvergenceError):
        qs.solve_with_continuation(problem, m, 0.1)
    assert len(solved) == 1 and m.value == 1.0
    assert same(case.state()[:-2], before)
