"""Newton's method: convergence criteria, and the state after a solve that fails."""

import numpy as np
import pytest
from hard.bodies import Column, Punch, difference, solve
from hard.cases import Variant
from scenes import Pair

import qsdolfinx as qs


def test_rounding_does_not_end_other_solves():
    """The rounding estimate is a small part of the tolerance of a solve."""
    scene = Punch(Variant(), n=((16, 6), (7, 3)))
    problem = scene.problem()
    solve(problem)
    measures, limits = problem.newton.measure()
    assert np.all(measures.rounding < 1e-2 * 1e-9 * measures.sizes)
    assert np.all(limits <= 1e-9 * measures.sizes) and np.all(measures.residuals <= limits)


def test_refused_solves_leave_the_state():
    """A load without equilibrium raises an error; then the problem can still be used."""
    scene = Column(Variant())
    load = scene.press(1e-3)
    problem = scene.problem()
    solve(problem)
    before = [u.x.array.copy() for u in problem.u]
    load.value[1] = 1e-3
    with pytest.raises(RuntimeError, match="did not converge"):
        solve(problem)  # this also compares the unknowns
    load.value[1] = -1e-3
    solve(problem)
    assert difference(problem.u, before) < 1e-10
    assert np.isclose(scene.contact.force("slave")[1], 1e-3)


def test_ends_that_are_not_ours_are_judged():
    """A run that ends by its number of iterations or a short step must have forces in balance."""
    for law in (qs.Tied(), qs.Unilateral()):
        options = {"enforcement": "penalty", "quadrature": "nodal"}
        pair = Pair("quadrilateral", n=(5, 3), law=law, wave=0.05, contact_options=options)
        pair.problem().solve()
        force = pair.contact.force("slave")
        for u in pair.u:
            u.x.array[:] = 0.0
        problem = pair.problem(petsc_options={"snes_type": "ksponly"})  # always one step
        if isinstance(law, qs.Tied):
            problem.solve()
            np.testing.assert_allclose(pair.contact.force("slave"), force, rtol=1e-8, atol=1e-10)
        else:
            with pytest.raises(qs.ConvergenceError, match="DIVERGED_MAX_IT"):
                problem.solve()
