"""Solves whose last iteration, with other corners in contact, does not converge."""

import warnings

import numpy as np
from following import Body, problem_of
from scenes import WORLD, box, plane

import qsdolfinx as qs
from qsdolfinx.solve.newton_step import NoConvergence
from qsdolfinx.solve.one_newton import OneNewton

PUSH = 0.5


def over_the_edge():
    """Forces on a block that is dragged over the edge of a base, step by step, and warnings."""
    base = Body(box(WORLD, (10, 5), "quadrilateral", (0.0, -1.0), (2.0, 0.0)))
    block = Body(box(WORLD, (7, 5), "quadrilateral", (0.9, 0.0), (1.7, 0.6)))
    base.clamp(plane(base.mesh, 1, -1.0))
    moved = block.clamp(plane(block.mesh, 1, 0.6))
    top = base.boundary(lambda x: np.isclose(x[1], 0.0) | (np.isclose(x[0], 2.0) & (x[1] > -0.6)))
    low = block.boundary(lambda x: np.isclose(x[1], 0.0) | (np.isclose(x[0], 1.7) & (x[1] < 0.4)))
    contact = qs.Contact(block.surface(low), base.surface(top))
    problem = problem_of([base, block], [contact])

    def drive(t, dt):
        moved.value[:] = np.interp(t, [0, 1, 4], [0, 0, PUSH]), -0.06 * min(t, 1.0)

    forces, texts = [], []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in qs.TimeStepper(problem, 0.25, drive).run(4.0):
            forces.append(contact.force("slave"))
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    return np.array(forces), texts


def test_the_last_solution_stays(monkeypatch):
    """If no iteration with other corners converges, the solutions without them are kept.

    A warning says so. Forces differ by what these corners carry.
    """
    forces, texts = over_the_edge()
    assert texts == []
    solve, count = OneNewton.solve, []

    def fails(self, z, *, begins=True, **options):
        if not begins:
            count.append(1)
            raise NoConvergence("as asked for")
        return solve(self, z, begins=begins, **options)

    monkeypatch.setattr(OneNewton, "solve", fails)
    others, texts = over_the_edge()
    assert len(texts) == len(count) > 0
    assert all("there is no equilibrium nearby" in text for text in texts)
    assert np.allclose(others, forces, rtol=0, atol=0.05 * np.abs(forces).max())
    assert len(others) == len(forces) == 16
