"""Tangent and forces of contact that follows the bodies, against differences."""

import numpy as np
import pytest
from following import Nested
from scenes import CELLS, FORMULATIONS, WORLD
from tangents import direction, near_solution, tangent_errors

#: Facets of the inner and of the outer one around.
SIZES = {
    "triangle": (17, 21),
    "quadrilateral": (17, 21),
    "tetrahedron": (3, 4),
    "hexahedron": (3, 4),
}
#: Largest error of the tangent, which does not differentiate where facets are clipped.
KINKS = {2: 0.12, 3: 0.12}


def scene(cell, degree, formulation):
    """Bodies that cover each other all over, beside where they were put, and a direction."""
    nested = Nested(
        cell,
        degree,
        n=SIZES[cell],
        misfit=0.06,
        stiffness=1.0,
        formulation=formulation,
        enforcement="penalty",
        penalty=100.0,
    )
    problem = nested.problem(solver="direct")
    problem.set_up()
    rng = np.random.default_rng(3)
    return nested, problem, near_solution(problem, rng, 0.01), direction(problem, rng)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_tangent(cell, formulation):
    """It is that at points with fixed places, and much worse without second derivatives."""
    nested, problem, x, d = scene(cell, 1, formulation)
    errors = []
    for with_curvature in (True, False):
        problem.system.set_curvature(with_curvature)
        errors.append(tangent_errors(problem, x, d, 1e-6))
    nested.contact.model.with_curvature = True
    full, without = errors
    assert full.asymmetry < 1e-14
    assert without.asymmetry < 1e-14
    assert full.difference < KINKS[nested.gdim]
    assert without.difference > 1.5 * full.difference


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron"))
def test_forces_are_the_gradient(cell, formulation):
    """Clipping included, on flat facets."""
    nested, problem, x, d = scene(cell, 1, formulation)
    step = 1e-5

    def energy(at):
        problem.system.residual(at)
        return nested.contact.energy

    slope = (energy(x.array_r + step * d.array_r) - energy(x.array_r - step * d.array_r)) / 2 / step
    problem.system.residual(x.array_r)
    forces = np.concatenate([body.force.array_r for body in problem.bodies])
    power = WORLD.allreduce(forces @ d.array_r)
    assert abs(power - slope) < 1e-6 * abs(power)


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_second_degree(cell):
    """Facets bend: cuts are those of the chords, and the tangent is nearly right."""
    _, problem, x, d = scene(cell, 2, "quasi-symmetric")
    problem.system.set_curvature(True)
    full = tangent_errors(problem, x, d, 1e-6)
    problem.system.set_curvature(False)
    without = tangent_errors(problem, x, d, 1e-6)
    assert full.asymmetry < 1e-14
    assert full.difference < 0.1
    assert without.difference > 1.5 * full.difference
