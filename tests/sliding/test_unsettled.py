"""Solves whose last iteration, with other corners in contact, does not converge."""

import warnings

import numpy as np
from rough import rough_run

import qsdolfinx as qs
from qsdolfinx.solve.newton_step import NoConvergence
from qsdolfinx.solve.one_newton import OneNewton


def rough_blocks():
    """Forces on a rough block that is dragged over another one, step by step, and warnings."""
    contact, stepper = rough_run()
    forces = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in stepper.run(9.0):
            forces.append(contact.force("slave"))
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    return np.array(forces), texts


def test_the_last_solution_stays(monkeypatch):
    """If no iteration with other corners converges, the solutions without them are kept.

    A warning says so. Forces differ by what these corners carry.
    """
    forces, texts = rough_blocks()
    assert texts == []
    solve, count = OneNewton.solve, []

    def fails(self, z, *, begins=True, **options):
        if not begins:
            count.append(1)
            raise NoConvergence("as asked for")
        return solve(self, z, begins=begins, **options)

    monkeypatch.setattr(OneNewton, "solve", fails)
    others, texts = rough_blocks()
    assert len(texts) == len(count) > 0
    assert all("there is no equilibrium nearby" in text for text in texts)
    assert np.allclose(others, forces, rtol=0, atol=0.05 * np.abs(forces).max())
    assert len(others) == len(forces) == 9
