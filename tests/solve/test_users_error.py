"""A ConvergenceError that users raise, derive from, copy and pickle."""

import copy
import pickle

import numpy as np
import pytest
from base.test_checked import refused
from scenes import WORLD, box, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs


class TooHot(qs.ConvergenceError):
    """An error with a message of its own."""


def test_text_alone_is_the_message():
    error = qs.ConvergenceError("the step is too hot")
    assert str(error) == "the step is too hot"
    assert error.reason < 0 and error.reason_name == "RAISED_BY_USER"
    assert error.residual_history == error.active_history == error.violation_history == []
    error.advise("take a fan")
    assert str(error) == "the step is too hot\n  may help: take a fan"


@pytest.mark.parametrize(
    "copied", (copy.copy, copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e)))
)
@pytest.mark.parametrize(
    "error",
    (
        TooHot("by 3 K"),
        qs.ConvergenceError(-5, [1.0, 0.5], [[1], [2]], violation_history=(1e-3,)),
        qs.ConvergenceError(-3, [1.0], [[3]], linear_reason=-11, linear=True),
    ),
    ids=lambda error: error.reason_name,
)
def test_copies_are_the_same(copied, error):
    error.advise("look at the loads")
    other = copied(error)
    assert type(other) is type(error) and str(other) == str(error)
    assert vars(other) == vars(error)
    other.advise("and at conditions")
    assert "conditions; look at the loads" in str(other)


@pytest.mark.parallel
@pytest.mark.several_ranks
def test_other_ranks_get_copies():
    """An error of one rank is of its own class on all ranks, so that all of them handle it."""

    def block(same):
        if WORLD.rank == WORLD.size - 1:
            raise TooHot("by 3 K")

    refused(TooHot, "by 3 K", block)


@pytest.mark.parallel
@pytest.mark.parametrize("where", ("drive", "solve", "on_solved"))
def test_asks_for_smaller_steps(where):
    """A function that a stepper calls cuts the step back; on one rank is enough but for solve."""
    msh = box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    stress = qs.materials.linear_elastic(u, 1.0, 0.3)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
    bc = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0)), V)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), floor)
    problem = qs.ContactProblem(F, u, contact, [bc])
    asked = []

    def refuse(place, everywhere=False):
        if place == where and not asked and (everywhere or WORLD.rank == WORLD.size - 1):
            asked.append(place)
            raise TooHot("by 3 K\nat the top")

    def drive(t, dt):
        top.value = (0.0, -0.1 * t)
        refuse("drive")

    def solve(step):
        problem.solve()
        refuse("solve", everywhere=True)

    stepper = qs.TimeStepper(problem, 1.0, drive, solve=solve)
    stepper.on_solved = lambda: refuse("on_solved")
    for _ in stepper.run(1.0):
        pass
    assert [row.result for row in stepper.log] == ["cut back", "accepted", "accepted"]
    assert next(iter(stepper.log)).reason == "by 3 K at the top"
    assert np.isclose(contact.force("slave")[1], 0.1, rtol=0.5)
