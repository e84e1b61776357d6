"""Audit random scenes and histories; each number of ranks has different ones."""

from mpi4py import MPI

import numpy as np
import pytest
from audit.histories import random_history
from audit.run import following, is_of_the_library, run
from audit.scenes import random_scene

import qsdolfinx as qs

SIZE = MPI.COMM_WORLD.size
#: Scenes and histories on 1, 2 and 3 ranks; several ranks take several times as long each.
SCENES, HISTORIES = {1: 20, 2: 10}.get(SIZE, 5), {1: 8, 2: 5}.get(SIZE, 3)


def check(numbers, units=False, draw=random_scene):
    faults = []
    counts = run(numbers, units, faults.append, draw=draw)
    assert counts["FAULT"] == 0, "\n".join(faults)
    assert len(numbers) - counts["good"] <= max(1, 0.1 * len(numbers))


def test_some():
    check(range(100 * (SIZE - 1), 100 * (SIZE - 1) + SCENES))


def test_some_histories():
    check(range(50 * (SIZE - 1), 50 * (SIZE - 1) + HISTORIES), draw=random_history)


def test_friction_that_jumps_at_points():
    """A node with some active quadrature points may have no friction."""
    check([24, 39, 63, 77, 83, 414], draw=random_history)


def test_some_that_follow():
    """Audit histories with updated contact geometry."""
    numbers = range(100 * (SIZE - 1), 100 * (SIZE - 1) + SCENES)
    check(numbers, draw=following(random_scene))


def test_lines_of_scenes():
    """Reports of faults name scenes with and without a choice of constraints."""
    for scene in (random_scene(24), following(random_scene)(24, False)):
        constraints = scene.options.get("constraints")
        assert (f", {constraints}, " in str(scene)) == (constraints is not None)


def test_histories_that_follow():
    """The history variables of quadrature points are kept in a checkpoint."""
    check([20, 39], draw=following(random_history))


@pytest.mark.long
def test_many_that_follow():
    check(range(500), draw=following(random_scene))


@pytest.mark.long
def test_many_histories():
    check(range(10_000, 10_500), draw=random_history)


@pytest.mark.long
def test_many():
    check(range(10_000, 11_000))


@pytest.mark.long
def test_odd_units():
    check(range(20_000, 21_000), units=True)


def test_what_was_refused():
    """Norton's law without a slow rate, and a tool that nothing resists, by an iterative solver."""
    check([63, 88, 93, 301], draw=following(random_history))


def test_errors_of_numpy_are_faults():
    """A scene is refused by a statement of the library, not by a function that it calls."""
    for call, expected in (
        (lambda: qs.Coulomb(-1.0), True),
        (lambda: qs.RigidSurface.plane(MPI.COMM_WORLD, [0.0, 0.0], [0.0, 0.0]), True),
        (lambda: np.linalg.solve(np.zeros((1, 1)), np.ones(1)), False),
        (lambda: np.ones(2) + np.ones(3), False),
    ):
        with pytest.raises(ValueError) as caught:
            call()
        assert is_of_the_library(caught.value) == expected
