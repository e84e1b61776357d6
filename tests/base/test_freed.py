"""Objects are freed with the error that mentions them, on all ranks at the same time.

If they were freed by garbage collection, ranks would free PETSc's objects at different times, and
the next object would make them hang.
"""

import gc
import weakref

import pytest
from scenes import WORLD, Pair

import qsdolfinx as qs
from qsdolfinx.base.collective import checked


class Thing:
    """Something that a frame of the traceback refers to."""


@pytest.fixture(autouse=True)
def by_counting():
    """Turn garbage collection off."""
    gc.disable()
    yield
    gc.enable()


def caught(failing, kinds):
    """Raise errors of several ranks in a block; return a reference to what is used there."""
    thing = Thing()
    try:
        with checked(WORLD):
            if WORLD.rank in failing:
                raise kinds[WORLD.rank % 2](f"{thing} on rank {WORLD.rank}")
    except (KeyError, ValueError):
        return weakref.ref(thing)


@pytest.mark.parallel
@pytest.mark.parametrize("failing", ((0,), (0, 1, 2), (1, 2)))
@pytest.mark.parametrize("kinds", ((ValueError, ValueError), (ValueError, KeyError)))
def test_block(failing, kinds):
    """The error of this rank, of another rank, and both."""
    found = caught(failing, kinds)
    assert found is None or found() is None


@pytest.mark.parallel
@pytest.mark.parametrize(
    "refused",
    (
        lambda pair, contact: contact.force("left"),
        lambda pair, contact: contact.set_penalty(-1.0),
        lambda pair, contact: qs.ContactProblem(pair.F, pair.u, [contact], linear_solver="best"),
        lambda pair, contact: qs.ContactProblem(pair.F, pair.u, [contact, contact]),
        lambda pair, contact: qs.ContactProblem(pair.F[:1], pair.u, [contact]),
    ),
)
def test_contact(refused):
    """A contact that a refused call has used; the next contact is made without a hang."""
    pair = Pair("quadrilateral")

    def call():
        contact = qs.Contact(pair.slave, pair.master)
        with pytest.raises(ValueError) as caught:
            refused(pair, contact)
        del caught
        return weakref.ref(contact)

    assert call()() is None
    qs.Contact(pair.slave, pair.master)


@pytest.mark.parallel
def test_solve_that_fails():
    """The error of a solve; its traceback refers to the problem, and with it to its matrices."""
    problem = Pair("quadrilateral").problem(petsc_options={"snes_max_it": 0})

    def call():
        try:
            problem.solve()
        except qs.ConvergenceError as error:
            return weakref.ref(error)

    assert call()() is None
