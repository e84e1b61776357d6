"""What a ConvergenceError says: three lines, with the reason, what may help, and where to read."""

import pathlib

import pytest
from scenes import Pair

import ufl

import qsdolfinx as qs

ROOT = pathlib.Path(__file__).parents[2]


def test_three_lines():
    pair = Pair("triangle")
    pull = ufl.inner(ufl.as_vector([0.0, 1.0]), ufl.TestFunction(pair.V[1])) * ufl.dx
    problem = qs.ContactProblem(
        [pair.F[0], pair.F[1] - pull], pair.u, [pair.contact], [pair.bcs[0], []]
    )
    with pytest.raises(qs.ConvergenceError) as caught:
        problem.solve()
    error = caught.value
    reason, remedy, page = str(error).split("\n")
    assert error.reason_name in reason and f"{error.residual_history[-1]:.3g}" in reason
    assert f"{len(error.residual_history) - 1} iterations" in reason
    assert "stabilisation=qs.Stabilisation()" in remedy and "qs.TimeStepper" in remedy
    assert (ROOT / page.split()[1].rstrip(";")).exists()
    assert len(str(error)) < 700


def test_remedies_are_those_of_reasons():
    error = qs.ConvergenceError(-3, [1.0, 2.0], [[3]], linear_reason=-11)
    assert "DIVERGED_LINEAR_SOLVE (-3), linear solver: DIVERGED_PCSETUP_FAILED (-11)" in str(error)
    assert 'may help: conditions may be missing; or take solver="direct"' in str(error)
