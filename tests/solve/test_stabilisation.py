"""Stabilisation springs that support free bodies during the iteration but do not change results."""

import numpy as np
import pytest
from free_ring import FreeRing
from scenes import Pair, largest

import ufl
from dolfinx import fem

import qsdolfinx as qs

EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
#: The method of the paper: multipliers are not unknowns, and springs are in the residual.
PAPERS = {"quadrature": "nodal", "enforcement": "penalty"}


def squeezed(**options):
    """The ring after it has been squeezed and rolled."""
    case = FreeRing((32, 2), 20.0, **options)
    case.step_to(2.0)
    return case


@pytest.mark.parametrize("stiffness, constraints", ((None, "points"), (0.1, "nodes")))
def test_no_part_in_the_result(stiffness, constraints):
    """The ring is in equilibrium without the springs; plate forces are as without stabilisation."""
    settings = qs.Stabilisation(stiffness)
    case = squeezed(stabilisation=settings, constraints=constraints)
    plain = squeezed(constraints=constraints)
    assert case.problem.stabilisation_shares[-1] == 0.0
    case.problem.system.residual(case.problem.system.x.array_r)
    measures, limits = case.problem.newton.measure()
    assert np.all(measures.residuals <= 10 * limits)
    assert np.allclose(case.forces, plain.forces, rtol=1e-2)
    assert np.isclose(case.forces[0], -case.forces[1], rtol=1e-6)


@pytest.mark.parametrize("constraints", ("nodes", pytest.param("points", marks=pytest.mark.long)))
def test_ring_that_is_lost_otherwise(constraints):
    """The ring stays in contact in large steps.

    It is squeezed by a third of its radius and rolled by a facet and more in a step.
    """
    case = FreeRing((64, 3), 45.0, qs.Stabilisation(), constraints, dt_min=0.02)
    case.step_to(1.0)
    first = case.forces[0]
    case.stepper.step(2.0)
    assert case.stepper.t >= 1.5
    assert np.allclose(case.forces, [first, -first], rtol=0.05)
    assert case.problem.stabilisation_shares[-1] == 0.0
    assert case.problem.stabilisation_shares == [0.0]
    assert case.problem.num_iterations < 50


def hung(kind, solver, stabilisation, **options):
    """Solve for a block that only a tie supports, under its weight; returns the problem."""
    pair = Pair("hexahedron", law=qs.Tied(), n=(5, 3), contact_options=options)
    pair.bcs[1].clear()
    V = pair.V[1]
    pair.F[1] += ufl.inner(fem.Constant(V.mesh, (1e-3, 0.0, -1e-2)), ufl.TestFunction(V)) * ufl.dx
    problem = pair.problem(kind=kind, solver=solver, stabilisation=stabilisation)
    problem.solve()
    return problem


@pytest.mark.parametrize("options", (EXACT, PAPERS), ids=("exact", "paper"))
@pytest.mark.parametrize(
    "kind, solver", (("mpi", "direct"), ("nest", "direct"), ("mpi", "amg"), ("nest", "fieldsplit"))
)
def test_ties(kind, solver, options):
    """Springs do not change the result, and cost at most one iteration with ties."""
    problem = hung(kind, solver, qs.Stabilisation(), **options)
    expected = hung("mpi", "direct", None, **options)
    error = largest(problem.system.x.array_r - expected.system.x.array_r)
    assert error < 1e-6 * largest(expected.system.x.array_r)
    if options is EXACT:  # the first iteration has no springs
        assert problem.num_iterations <= (2 if solver == "direct" else 5)


def test_numbers_are_checked():
    with pytest.raises(ValueError, match="stiffness"):
        qs.Stabilisation(0.0)
    with pytest.warns(DeprecationWarning, match="tolerance"):
        qs.Stabilisation(tolerance=1e-7)
