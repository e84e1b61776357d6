"""Text of a ConvergenceError: three lines with the reason, possible remedies, and where to read."""

import pathlib

import numpy as np
import pytest
from scenes import WORLD, Pair, box, plane, vector_space

import ufl
from dolfinx import fem

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
    assert "stabilisation=qs.Stabilisation()" in remedy and "look at loads" in remedy
    assert "TimeStepper" not in remedy  # the bodies are linear: a smaller step does not help
    assert (ROOT / page.split()[1].rstrip(";")).exists()
    assert len(str(error)) < 700


@pytest.fixture
def rubber():
    """A neo-Hookean block between a floor and a top that moves with a prescribed displacement."""
    msh = box(WORLD, (2, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, factor, top = fem.Function(V), fem.Constant(msh, 1.0), fem.Constant(msh, (0.0, 0.0))
    stress = factor * qs.materials.neo_hookean(u, 1.0, 1.0)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
    bc = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0)), V)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), floor)
    return qs.ContactProblem([F], [u], [contact], [[bc]]), top, factor


def test_step_that_is_too_large(rubber):
    """If a cell inverts, the error names the step as the cause; smaller steps help."""
    problem, top, _ = rubber
    top.value = (0.0, -1.2)
    with pytest.raises(qs.ConvergenceError, match=r"DIVERGED_FNORM_NAN|NANORINF") as caught:
        problem.solve()
    assert "the step is too large" in str(caught.value)
    assert "coefficients" not in str(caught.value)

    def drive(t, dt):
        top.value = (0.0, -0.8 * t)

    top.value = (0.0, 0.0)
    stepper = qs.TimeStepper(problem, 0.25, drive)
    for _ in stepper.run(1.0):
        pass
    assert stepper.num_steps >= 4


def test_form_that_is_not_finite(rubber):
    """If a form is not finite at the start, the error names its coefficients."""
    problem, top, factor = rubber
    top.value = (0.0, -0.01)
    problem.solve()
    factor.value = np.nan
    with pytest.raises(qs.ConvergenceError, match="look at its coefficients") as caught:
        problem.solve()
    assert "TimeStepper" not in str(caught.value)


def test_few_iterations(rubber):
    """The error names the number of iterations that the user allows."""
    problem, top, _ = rubber
    problem.snes.setTolerances(max_it=1)
    top.value = (0.0, -0.3)
    with pytest.raises(qs.ConvergenceError, match="snes_max_it = 1 in petsc_options"):
        problem.solve()
    problem.snes.setTolerances(max_it=50)
    problem.solve()
    assert problem.num_iterations > 1


def test_remedies_are_those_of_reasons():
    error = qs.ConvergenceError(-3, [1.0, 2.0], [[3]], linear_reason=-11)
    assert "DIVERGED_LINEAR_SOLVE (-3), linear solver: DIVERGED_PCSETUP_FAILED (-11)" in str(error)
    assert 'may help: conditions may be missing; or take linear_solver="direct"' in str(error)
