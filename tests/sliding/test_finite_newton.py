"""Newton's method with finite sliding: deep presses, long slides, bodies that separate."""

import warnings

import numpy as np
import pytest
from following import Boxes, total
from scenes import largest

import qsdolfinx as qs

KINDS = {
    "augmented": {},
    "penalty": {"enforcement": "penalty"},
    "master-slave": {"formulation": "master-slave"},
    "soft": {"enforcement": "penalty", "penalty": 300.0},
}
kinds = pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)


def press(depth, across=0.0, gap=0.0, cell="quadrilateral", swap=False, first=True, **options):
    """Press a block into a wider one and drag it, at once or pressed first."""
    scene = Boxes(cell, ((12, 4), (5, 4)), ((2.4, 1.0), (1.0, 1.0)), start=0.7, gap=gap)
    top = scene.clamp_far()
    surfaces = scene.above, scene.below
    contact = qs.Contact(*(surfaces[::-1] if swap else surfaces), sliding="finite", **options)
    problem = scene.problem(contact)
    top.value[-1] = -depth
    if first and across:
        problem.solve()
    top.value[0] = across
    problem.solve()
    return scene, contact, problem


@kinds
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_press_by_a_third_of_a_facet(cell, options):
    _, contact, problem = press(0.06, cell=cell, **options)
    assert problem.num_iterations <= 12
    assert contact.force("slave")[1] > 3


@kinds
def test_press_by_a_third_of_the_body(options):
    _, contact, problem = press(0.3, **options)
    assert problem.num_iterations <= 40
    assert 15 < contact.force("slave")[1] < 26


@kinds
@pytest.mark.parametrize("facets", (1, 3))
def test_slide(facets, options):
    """Without friction only the ends of the block give a tangential force."""
    _, contact, problem = press(0.03, 0.2 * facets, **options)
    assert problem.num_iterations <= 14
    force = contact.force("slave")
    assert abs(force[0]) < 1e-2 * force[1]


def test_slide_far():
    """Slides by six facets in one solve, with a penalty, need few iterations."""
    scene = Boxes("quadrilateral", ((30, 4), (5, 4)), ((6.0, 1.0), (1.0, 1.0)), start=1.03)
    top = scene.clamp_far()
    contact = qs.Contact(scene.above, scene.below, sliding="finite", enforcement="penalty")
    problem = scene.problem(contact)
    top.value[1] = -0.05
    problem.solve()
    for _ in range(2):
        top.value[0] += 0.2 * 6
        problem.solve()
        assert problem.num_iterations <= 12


@pytest.mark.parametrize("options", [KINDS["penalty"], KINDS["augmented"]])
@pytest.mark.parametrize("gap", (0.1, 0.5))
def test_gap_that_closes(gap, options):
    """Bodies that start apart come into contact, with the forces of bodies that start in touch."""
    _, contact, _ = press(gap + 0.03, gap=gap, **options)
    _, touching, _ = press(0.03, **options)
    force, expected = contact.force("slave"), touching.force("slave")
    assert largest(force - expected) < 1e-6 * largest(expected)


@pytest.mark.parametrize("options", [KINDS["penalty"], KINDS["augmented"]])
@pytest.mark.parametrize("gap", (1.0, 3.0))
def test_bodies_never_pass_silently(gap, options):
    """Beyond the search distance bodies give a force, an error or a warning, never nothing."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            _, contact, _ = press(gap + 0.03, gap=gap, **options)
        except qs.ConvergenceError:
            return
    warned = any(issubclass(entry.category, qs.ContactWarning) for entry in seen)
    assert warned or contact.force("slave")[1] > 1


@kinds
def test_slide_off_the_end(options):
    """No force remains once a block has left the other block, and there is no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ContactWarning)
        scene, contact, _ = press(0.03, 1.8, **options)
    assert largest(contact.force("slave")) < 1e-9
    assert largest(*(np.abs(total(b.internal_forces())) for b in scene.bodies)) < 1e-6


@pytest.mark.parametrize("start", (0.73, 0.6))
def test_ends_at_nodes(start):
    """The block, the master, ends between slave nodes, or initially at slave nodes."""
    scene = Boxes("quadrilateral", ((12, 4), (5, 4)), ((2.4, 1.0), (1.0, 1.0)), start=start)
    top = scene.clamp_far()
    contact = qs.Contact(scene.below, scene.above, sliding="finite")
    problem = scene.problem(contact)
    top.value[-1] = -0.01
    problem.solve()
    assert problem.num_iterations <= 30


@pytest.mark.parametrize(
    ("cell", "formulation", "mu", "depth", "enforcement"),
    [
        ("triangle", "quasi-symmetric", 1.0, 0.06, "augmented-lagrangian"),
        ("triangle", "quasi-symmetric", 5.0, 0.1, "penalty"),
        ("tetrahedron", "master-slave", 5.0, 0.06, "augmented-lagrangian"),
    ],
)
def test_one_step_or_two(cell, formulation, mu, depth, enforcement):
    """One step equals two where full steps would invert elements in the first iterations."""
    forces = []
    for steps in (1, 2):
        gdim = 2 if cell == "triangle" else 3
        n = ((6, 3), (4, 4)) if gdim == 2 else ((4, 3, 2), (2, 2, 2))
        ones, part = (1.0,) * (gdim - 1), (0.6,) * (gdim - 1)
        scene = Boxes(cell, n, ((2.0, *ones), (*part, 1.0)), start=0.5, skew=0.3)
        top = scene.clamp_far()
        friction = qs.Coulomb(mu)
        options = {"enforcement": enforcement, "friction": friction, "sliding": "finite"}
        contact = qs.Contact(scene.above, scene.below, formulation=formulation, **options)
        problem = scene.problem(contact, solver="direct")
        for i in range(steps):
            contact.update()
            top.value[-1] = -depth * (i + 1) / steps
            problem.solve()
        forces.append(contact.force("slave"))
    assert np.linalg.norm(forces[0] - forces[1]) < 0.05 * np.linalg.norm(forces[1])
