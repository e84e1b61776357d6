"""Time steps: order, contact at the end of the step, velocity- and displacement-based bodies."""

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box, plane, raises_everywhere, slide
from step_scenes import SPEED, K, Upset

import ufl
from dolfinx import fem

import qsdolfinx as qs


@pytest.mark.parametrize("theta, order", [(0.5, (1.8, 2.4)), (0.0, (0.9, 1.1))])
def test_order(theta, order):
    """The volume drift has the expected order; the force is 4 K w V/h at the position of the solve.

    The scene is in plane strain.
    """
    drift = []
    for steps in (4, 8):
        case = Upset(n=2, dt=0.2 / SPEED / steps, theta=theta)
        solved_at = []
        case.stepper.on_solved = lambda case=case, found=solved_at: found.append(case.size())
        for _ in case.stepper.run(0.2 / SPEED):
            width, height = solved_at[-1]
            force = 4 * K * width * SPEED / height
            assert np.allclose(case.forces(), [0, force, 0, -force], rtol=1e-6, atol=1e-6 * force)
        assert len(solved_at) == case.stepper.num_steps == steps
        assert np.isclose(case.size()[1], 0.8, rtol=1e-8)
        drift.append(abs(case.stepper.motions[0].volume() - 1))
        case.problem.destroy()
    rates = np.log2(np.array(drift[:-1]) / drift[1:])
    assert np.all((order[0] < rates) & (rates < order[1])), (drift, rates)


@pytest.mark.parametrize("partition", [None, "scattered", "last"])
def test_same_history_on_any_number_of_ranks(partition):
    """A run with a velocity-based body does not depend on the number of ranks.

    It is between a rigid plane and an elastic die in total displacements.
    """
    history = []
    for comm, how in ((WORLD, partition), (MPI.COMM_SELF, None)):
        case = Upset(comm, die=True, dt=0.05, partition=how)
        rows = []
        for t in case.stepper.run(0.15):
            depth = [c.penetration() for c in case.contacts]
            weighted = [c.weighted_penetration() for c in case.contacts]
            rows.append([t, *case.forces(), *case.size(), *depth, *weighted])
        assert case.problem.bodies[1].num_assemblies == 1
        assert np.array_equal(case.stepper.motions[1].reference, case.die_mesh.geometry.x)
        assert abs(case.forces()[[1, 3]].sum()) < 1e-8 * K
        assert max(rows[-1][-2:]) < 1e-3  # at the deepest points
        history.append(np.array(rows)[:, :-2])
        case.problem.destroy()
    assert history[0].shape == history[1].shape == (3, 9)
    np.testing.assert_allclose(history[0], history[1], rtol=1e-8, atol=1e-8)
    # The die is compliant, so the block is higher than between rigid planes.
    assert history[0][-1, 6] > 0.85 + 1e-4


def indentation(num_pairings, theta, radius=1.0, depth=0.1):
    """Largest distance of active nodes from a rigid cylinder after a large step into a block."""
    msh = box(WORLD, (12, 6), "triangle", [-1.0, -1.0], [1.0, 0.0])
    W = qs.materials.mini_space(msh)
    w = fem.Function(W)
    F = qs.materials.incompressible(w, qs.materials.newtonian(ufl.split(w)[0], K))
    bcs = [slide(W.sub(0), i, plane(msh, 1, -1.0)) for i in (0, 1)]
    tool = qs.RigidSurface.cylinder(WORLD, [0.0, radius], None, radius)
    surface = qs.Surface(W.sub(0), facets=plane(msh, 1, 0.0))
    options = {"unknown": "velocity", "quadrature": "nodal", "search_radius": 1.0}
    contact = qs.Contact(surface, tool, dt=depth, **options)
    problem = qs.ContactProblem([F], [w], [contact], [bcs])

    def drive(t, dt):
        tool.displacement = [0.3 * dt, -dt]

    stepper = qs.TimeStepper(problem, depth, drive, num_pairings=num_pairings, theta=theta)
    stepper.step()
    assert np.allclose(tool.center, [0.3 * depth, radius - depth])
    closed = contact.active()
    assert WORLD.allreduce(closed.sum()) > 2
    surface.update()
    distance = np.abs(tool.distance(surface.node_x[closed])[0])
    problem.destroy()
    return WORLD.allreduce(distance.max(initial=0.0), op=MPI.MAX)


def test_pairing_at_the_end_of_the_step():
    """With θ = 0, updating contact at the end of the step closes gaps on the final meshes.

    Contact does so once by itself, since it has slid by a third of a facet.
    """
    deepest = [indentation(n, 0.0) for n in (2, 3, 4)]
    assert deepest[0] > 1e-5, deepest
    assert deepest[1] < 0.2 * deepest[0] and deepest[2] < 0.2 * deepest[1], deepest


@pytest.mark.parametrize("num_pairings", (1, 2))
def test_pairing_in_the_middle_of_the_step(num_pairings):
    """Distances from the tool on the final meshes decrease with the square of Δt."""
    deepest = [indentation(num_pairings, 0.5, depth=depth) for depth in (0.1, 0.05, 0.025)]
    assert deepest[0] > 1e-4, deepest
    assert deepest[1] < 0.35 * deepest[0] and deepest[2] < 0.35 * deepest[1], deepest


def test_driven_tool_with_two_pairings():
    """With two updates of the contact, both parts of a force-controlled tool's motion count."""
    case = Upset(dt=0.05, num_pairings=2, drive=None)
    case.tool.drive(4 * K * SPEED, [0.0, -1.0])
    case.stepper.step()
    assert np.isclose(case.tool.center[1], case.size()[1], atol=1e-7)
    assert not case.tool.displacement.any()


# --- Failures


def test_absurd_first_step():
    """A first step in which the plane would pass through the block is cut back."""
    case = Upset(dt=2.0, dt_min=1e-3)
    solved = []
    case.stepper.on_solved = lambda: solved.append(1)
    dt = case.stepper.step()
    assert case.stepper.num_cutbacks >= 2 and dt <= 0.5
    assert np.isclose(case.size()[1], 1 - SPEED * dt, rtol=1e-6)
    assert case.stepper.dt == dt and len(solved) == 1  # not called for rejected attempts


def test_penetration():
    """With a soft penalty half of the plane's displacement is penetration; it can be limited."""
    soft = {"penalty": 40.0, "enforcement": "penalty"}
    case = Upset(dt=0.02, contact=soft, max_penetration=0.01)
    assert case.stepper.step() == 0.02
    deep = max(c.penetration() for c in case.contacts)
    assert 0.009 < deep < 0.01
    case = Upset(dt=0.02, contact=soft, max_penetration=0.6 * deep)
    assert case.stepper.step() == 0.01 and case.stepper.num_cutbacks == 1
    case = Upset(dt=0.02, dt_min=0.01, contact=soft, max_penetration=0.3 * deep)
    raises_everywhere(WORLD, qs.StepError, "max_penetration", case.stepper.step)


def test_distortion():
    """The run ends before cells are flatter than allowed."""
    case = Upset(n=2, dt=0.1, min_quality=0.3)
    raises_everywhere(WORLD, qs.StepError, "mesh of u[0] is distorted", lambda: run(case, 0.95))
    assert 0.3 <= case.stepper.motions[0].quality_kept() < 0.6
    assert 0.1 < case.stepper.t < 0.9


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_graded_mesh_is_not_distorted(cell):
    """Cells that are 500 times as wide as high without any deformation may be compressed.

    They are distorted once they have lost their height, as cubes are.
    """
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    n = [2] * gdim
    msh = box(WORLD, n, cell, [0.0] * gdim, [1.0] * gdim)
    x = msh.geometry.x
    x[:, gdim - 1] = np.where(x[:, gdim - 1] > 0.9, 1.0, 1.998 * x[:, gdim - 1])
    body = Body(msh)
    body.clamp(plane(msh, gdim - 1, 0.0))
    tool = qs.RigidSurface.plane(WORLD, np.eye(gdim)[-1], -np.eye(gdim)[-1])
    contact = qs.Contact(body.side(gdim - 1, 1.0), tool)

    def drive(t, dt):
        tool.displacement[-1] = -0.01 * dt

    stepper = qs.TimeStepper(problem_of([body], [contact]), 1.0, drive)
    assert stepper.motions[0].quality() < 0.01
    stepper.step()
    motion = stepper.motions[0]
    assert 0.7 < motion.quality_kept(motion.reference + motion.values()) < 1.0
    flat = motion.reference.copy()
    flat[:, gdim - 1] = np.minimum(flat[:, gdim - 1], 0.999 + 1e-5)  # a hundredth of the height
    assert 0.005 < motion.quality_kept(flat) < 0.02


def run(case, t_end):
    return list(case.stepper.run(t_end))


# --- Sizes of steps


def test_growth():
    case = Upset(dt=0.01, dt_max=0.04, growth=2.0, easy=200)
    assert np.allclose(run(case, 0.15), [0.01, 0.03, 0.07, 0.11, 0.15], rtol=1e-12)
    case = Upset(dt=0.01, dt_max=0.04, growth=2.0, easy=1)
    case.stepper.easy = 0  # one iteration may be enough
    case.stepper.step()
    assert case.stepper.dt == 0.01  # not easy


def test_growth_with_two_pairings():
    """A step is easy if it takes few iterations for each of its solves."""
    once = Upset(dt=0.01, dt_max=0.04, growth=2.0)
    once.stepper.step()
    easy = once.stepper.num_iterations
    twice = Upset(dt=0.01, dt_max=0.04, growth=2.0, num_pairings=2, easy=easy)
    twice.stepper.step()
    assert twice.stepper.num_iterations > easy and twice.stepper.dt == 0.02


def test_lands_on_the_end():
    """Steps end exactly at the end time, without a tiny last step, and Δt stays as it was."""
    case = Upset(n=1, dt=0.07)
    times = [0.0]
    for t_end in (0.1, 0.3, 0.3 + 0.07 / 3):
        times += run(case, t_end)
        assert case.stepper.t == times[-1] == t_end
        assert np.isclose(case.tool.center[1], 1 - SPEED * t_end, rtol=1e-12)
        assert case.stepper.dt == 0.07
    assert np.diff(times).min() > 0.02 and np.diff(times).max() < 0.07 * (1 + 1e-9)
    np.testing.assert_allclose(times[1:3], [0.05, 0.1])  # two equal parts, not 0.07 and 0.03
    assert run(case, t_end) == []
    raises_everywhere(WORLD, ValueError, "t_end", lambda: case.stepper.step(0.1))


@pytest.mark.several_ranks
def test_dt_of_a_rank_alone():
    """Δt set on one rank alone is refused by all, and no step is made."""
    case = Upset(dt=0.05)
    case.stepper.dt = 0.01 if WORLD.rank else 0.05
    raises_everywhere(WORLD, ValueError, "dt", case.stepper.step)
    assert case.stepper.num_steps == 0
    case.problem.destroy()
