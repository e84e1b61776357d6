"""Tangent and forces of contact that follows the bodies, against differences."""

import numpy as np
import pytest
from following import Body, Boxes, Nested, problem_of
from scenes import CELLS, FORMULATIONS, WORLD, box, plane
from tangents import direction, near_solution, tangent_errors

import qsdolfinx as qs

#: Facets of the inner and of the outer one around.
SIZES = {
    "triangle": (17, 21),
    "quadrilateral": (17, 21),
    "tetrahedron": (3, 4),
    "hexahedron": (3, 4),
}
#: Largest error of the tangent; rules are not exact on warped facets.
ERRORS = {"triangle": 1e-8, "quadrilateral": 1e-8, "tetrahedron": 1e-8, "hexahedron": 1e-3}


def scene(cell, degree, formulation):
    """Bodies that cover each other all over, beside where they were put, and a direction."""
    nested = Nested(
        cell,
        degree,
        n=SIZES[cell],
        misfit=0.06,
        stiffness=1.0,
        formulation=formulation,
        constraints="nodes",
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
    """It is the derivative through where facets are clipped, and no symmetry is lost by that."""
    _, problem, x, d = scene(cell, 1, formulation)
    errors = tangent_errors(problem, x, d, 1e-6)
    assert errors.asymmetry < 1e-14
    assert errors.difference < ERRORS[cell]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron"))
def test_forces_are_the_gradient(cell, formulation):
    """Clipping included, on flat facets."""
    nested, problem, x, d = scene(cell, 1, formulation)
    step = 1e-5

    def energy(at):
        problem.system.residual(at)
        return nested.contact.stored_energy()

    slope = (energy(x.array_r + step * d.array_r) - energy(x.array_r - step * d.array_r)) / 2 / step
    problem.system.residual(x.array_r)
    forces = np.concatenate([body.force.array_r for body in problem.bodies])
    power = WORLD.allreduce(forces @ d.array_r)
    assert abs(power - slope) < 1e-6 * abs(power)


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_second_degree(cell):
    """Facets bend: cuts are those of the chords, and forces no gradient where gaps jump there."""
    nested, problem, x, d = scene(cell, 2, "quasi-symmetric")
    errors = tangent_errors(problem, x, d, 1e-6)
    assert not nested.contact.symmetric
    assert errors.difference < 3e-3


#: Of the upper body, the slave, over the lower one.
WIDTHS = (0.95, 1.05)
#: Largest error of the tangent, with a penalty and without: G_k of open ends moves, too.
OPEN = {"penalty": 0.03, "augmented-lagrangian": 2e-3}


@pytest.mark.parametrize("enforcement", OPEN)
@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("cell", CELLS)
def test_open_ends(cell, width, formulation, enforcement):
    """What is covered moves with the ends of the other body, and the force with it."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    n = ((3, 3), (4, 4)) if gdim == 2 else ((2, 2, 2), (3, 3, 3))
    sizes = (1.0,) * gdim, (width,) * (gdim - 1) + (1.0,)
    boxes = Boxes(cell, n, sizes, start=(1 - width) / 2, skew=0.3)
    boxes.clamp_far().value[-1] = -0.1
    options = {"sliding": "finite", "constraints": "nodes", "enforcement": enforcement}
    contact = qs.Contact(boxes.above, boxes.below, formulation, **options)
    problem = boxes.problem(contact, solver="direct")
    problem.solve()
    rng = np.random.default_rng(3)
    x, d = near_solution(problem, rng, 1e-4), direction(problem, rng)
    errors = tangent_errors(problem, x, d, 1e-6)
    ends = formulation == "quasi-symmetric" or width > 1  # the slave is cut where the master ends
    assert errors.difference < (OPEN[enforcement] if ends else 1e-7)
    assert contact.symmetric == (not ends)
    assert (errors.asymmetry < 1e-14) == (not ends)


@pytest.mark.parametrize("enforcement", OPEN)
@pytest.mark.parametrize("formulation", ("quasi-symmetric", "master-slave"))
@pytest.mark.parametrize("mu, way", [(0.2, 0.3), (5.0, 0.05)], ids=("slips", "sticks"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_friction(cell, mu, way, formulation, enforcement):
    """Of forces on objective slip, their change as facets slide and turn included."""
    boxes = Boxes(cell, ((6, 3), (4, 4)), ((2.0, 1.0), (0.6, 1.0)), start=0.5, skew=0.3)
    top = boxes.clamp_far()
    options = {
        "sliding": "finite",
        "constraints": "nodes",
        "enforcement": enforcement,
        "friction": qs.Coulomb(mu),
    }
    contact = qs.Contact(boxes.above, boxes.below, formulation, **options)
    problem = boxes.problem(contact, solver="direct")
    for depth, slide in ((0.02, 0.0), (0.04, 0.0), (0.04, way)):
        top.value[:] = slide, -depth
        contact.update()
        problem.solve()
    x = near_solution(problem, np.random.default_rng(3), 1e-5)
    d = direction(problem, np.random.default_rng(4))
    assert tangent_errors(problem, x, d, 1e-7).difference < 0.02


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_round_tool(cell):
    """Gaps to a tool of known shape have its curvature."""
    gdim = 2 if cell == "triangle" else 3
    body = Body(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    tool = qs.RigidSurface.sphere(WORLD, [0.4] * (gdim - 1) + [1.9], 1.0)
    options = {
        "sliding": "finite",
        "constraints": "nodes",
        "enforcement": "penalty",
        "penalty": 1000.0,
    }
    contact = qs.Contact(body.side(gdim - 1, 1.0), tool, **options)
    problem = problem_of([body], [contact], solver="direct")
    problem.set_up()
    rng = np.random.default_rng(3)
    x, d = near_solution(problem, rng, 0.02), direction(problem, rng)
    assert tangent_errors(problem, x, d, 1e-6).difference < 1e-8
