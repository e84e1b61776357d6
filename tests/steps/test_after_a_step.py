"""State that a solve outside of the stepper finds after a step, a failed step, or a restart."""

import pathlib

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    drag_top,
    elastic,
    plane,
    raises_everywhere,
    vector_space,
)
from step_scenes import Upset, refuse, same

from dolfinx import fem

import qsdolfinx as qs

DOWN = 0.02


class Plane:
    """A block that is clamped at its bottom, and a plane that a stepper lowers onto its top."""

    def __init__(self, drive=None, n=4, **options):
        msh = box(WORLD, (n, n), "triangle", [0.0, 0.0], [1.0, 1.0])
        V = vector_space(msh)
        self.u = fem.Function(V)
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
        options = {"enforcement": "augmented-lagrangian"} | options
        self.contact = qs.Contact(surface, self.tool, **options)
        bcs = [clamp(V, plane(msh, 1, 0.0))]
        self.problem = qs.ContactProblem([elastic(self.u)], [self.u], [self.contact], [bcs])
        self.drive = drive or self.lower
        self.stepper = qs.TimeStepper(self.problem, 1.0, lambda t, dt: self.drive(t, dt))

    def lower(self, t, dt):
        self.tool.displacement = [0.0, -DOWN * dt]

    def force(self):
        return self.contact.force("slave")

    def state(self):
        motion = self.tool.displacement.copy(), self.tool.rotation.copy()
        gaps = self.contact.gap(), self.contact.weighted_gap()
        shown = *map(np.nan_to_num, gaps), self.contact.multiplier()
        return [self.u.x.array.copy(), self.tool.position, *motion, *shown]


def raise_here(t, dt):
    raise KeyError("load table")


# --- A failed step


@pytest.mark.parametrize("steps", (0, 2))
def test_failed_drive(steps):
    """A failed step restores the tool and the contact pairs: a solve continues from there."""
    case = Plane()
    case.problem.solve()
    for _ in range(steps):
        case.stepper.step()
    before, force = case.state(), case.force()
    for fails in (raise_here, lambda t, dt: refuse(1.0)):
        case.drive = fails
        with pytest.raises((KeyError, qs.StepError)):
            case.stepper.step()
        assert same(before, case.state())
    case.problem.solve()
    np.testing.assert_allclose(case.force(), force, rtol=1e-8, atol=1e-12)


def test_tools_are_told_nothing_by_a_failed_step():
    """A force that one rank has set, before another raised, has no effect on the next solve."""
    case = Plane()

    def drive(t, dt):
        case.lower(t, dt)
        case.tool.rotation = 0.1
        last = WORLD.rank == WORLD.size - 1
        if not last or WORLD.size == 1:
            case.tool.drive(3.0, [0.0, -1.0])
        if last:
            raise RuntimeError("alone")

    case.drive = drive
    raises_everywhere(WORLD, RuntimeError, "alone", case.stepper.step)
    assert case.tool.driven is None and not case.tool.displacement.any()
    assert not case.tool.rotation.any()
    case.problem.solve()


@pytest.mark.parametrize("what", ("displacement", "rotation", "position"))
def test_one_rank_raises_before_it_moves_the_tool(what):
    """If one rank raises before it sets the tool's motion, the other ranks do not hang."""
    case = Plane()

    def drive(t, dt):
        if WORLD.rank == WORLD.size - 1:
            raise RuntimeError("no such row in the table")
        setattr(case.tool, what, getattr(case.tool, what))
        case.tool.drive(1.0, [0.0, -1.0])

    case.drive = drive
    raises_everywhere(WORLD, RuntimeError, "no such row", case.stepper.step)


# --- A completed step


@pytest.mark.parametrize("moving", (True, False))
def test_solve_after_a_step(moving):
    """A solve after a step, with nothing changed, leaves forces and positions as they are."""
    case = Plane(None if moving else lambda t, dt: None)
    case.tool.displacement = [0.0, -DOWN]
    for _ in range(2):
        case.stepper.step()
    force, u, position = case.force(), case.u.x.array.copy(), case.tool.position
    assert np.linalg.norm(force) > 0.1 * DOWN
    for _ in range(2):
        case.problem.solve()
        np.testing.assert_allclose(case.force(), force, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(case.u.x.array, u, atol=1e-8 * DOWN)
    assert np.array_equal(position, case.tool.position)


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
def test_solve_between_steps_moves_the_tool(friction):
    """A displacement of the tool between two steps acts as in a step.

    Slip is measured from there.
    """
    options = {"quadrature": "nodal", "friction": friction}  # independent of facet sizes
    case, other = Plane(**options), Plane(**options)
    for each in (case, other):
        each.stepper.step()
    for moved in ([0.1 * DOWN, -DOWN], [-0.1 * DOWN, 0.0]):
        case.tool.displacement = moved
        case.problem.solve()
        other.drive = lambda t, dt, d=moved: setattr(other.tool, "displacement", d)
        other.stepper.step()
        np.testing.assert_allclose(case.force(), other.force(), rtol=1e-6, atol=1e-12)
        assert abs(case.force()[0]) > 0.01 * DOWN or friction is None
        case.tool.advance()
        case.contact.update()


def test_pairing_anew_after_a_step():
    """The user's ``contact.update()`` after a step starts from the current mesh.

    It does not start from the mesh on which contact was detected.
    """
    case = Plane()
    for _ in range(2):
        case.stepper.step()
    force = case.force()
    case.contact.update()
    case.problem.solve()
    np.testing.assert_allclose(case.force(), force, rtol=1e-7, atol=1e-12)


def test_solve_after_a_step_between_two_bodies():
    """A solve after a step keeps force and slip for two bodies with non-matching meshes.

    One body is dragged over the other with friction, and sticks.
    """
    options = {"quadrature": "overlay", "friction": qs.Coulomb(10.0)}
    pair = Pair("triangle", contact_options=options)
    drag_top(pair, 0.0)
    problem = pair.problem()
    stepper = qs.TimeStepper(problem, 1.0)
    stepper.step()
    drag_top(pair, 0.01)
    stepper.step()
    force, slip = pair.contact.force("slave"), pair.contact.slip()
    problem.solve()
    scale = np.linalg.norm(force)
    np.testing.assert_allclose(pair.contact.force("slave"), force, atol=0.02 * scale)
    np.testing.assert_allclose(pair.contact.slip(), slip, atol=1e-3)


def test_solve_after_a_step_in_velocities():
    """After a step, a solve finds the velocities with which the next step begins.

    The mesh has moved.
    """
    case, other = Upset(theta=0.0, growth=1.0), Upset(theta=0.0, growth=1.0)
    for each in (case, other):
        each.stepper.step()
    case.move(0.0, case.stepper.last_dt)
    case.problem.solve()
    other.stepper.step()
    np.testing.assert_allclose(case.forces(), other.forces(), rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(case.w.x.array, other.w.x.array, atol=1e-6)


# --- A restart


@pytest.fixture
def folder(tmp_path_factory):
    """A folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0)) / "state"


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_shown_after_a_restart(folder, enforcement, friction):
    """After a restart, forces are the saved ones, also after a solve with no motion."""
    options = {"quadrature": "nodal", "enforcement": enforcement, "friction": friction}
    runs = [Plane(**options) for _ in range(2)]

    def drive(t, dt):
        runs[0].tool.displacement = [0.3 * DOWN * dt, -DOWN * dt]

    runs[0].drive = drive
    for _ in range(2):
        runs[0].stepper.step()
    qs.save_run(runs[0].stepper, folder)
    qs.load_run(runs[1].stepper, folder)
    force = runs[0].force()
    assert abs(force[0]) > 0.01 * abs(force[1]) or friction is None
    exact = enforcement != "penalty"  # a penalty uses nodal areas, which belong to another mesh
    tolerance = (1e-6 if exact else 1e-2) * np.linalg.norm(force)
    np.testing.assert_allclose(runs[1].force(), force, atol=tolerance)
    assert np.array_equal(runs[1].contact.active(), runs[0].contact.active())
    depth = runs[0].contact.penetration()
    np.testing.assert_allclose(runs[1].contact.penetration(), depth, atol=1e-3 * DOWN)
    runs[1].problem.solve()
    np.testing.assert_allclose(runs[1].force(), force, atol=tolerance)


def test_shown_after_a_restart_of_flow(folder):
    """After a restart, multipliers are the same; forces differ to first order in the time step.

    Areas have changed with the flow since contact was detected.
    """
    errors = []
    for dt in (0.04, 0.02):
        runs = [Upset(dt=dt, growth=1.0) for _ in range(2)]
        for _ in range(2):
            runs[0].stepper.step()
        qs.save_run(runs[0].stepper, folder)
        qs.load_run(runs[1].stepper, folder)
        for first, second in zip(runs[0].contacts, runs[1].contacts, strict=True):
            np.testing.assert_allclose(second.multiplier(), first.multiplier(), rtol=1e-5)
        errors.append(np.abs(runs[1].forces()[1::2] / runs[0].forces()[1::2] - 1))
    assert np.all(errors[0] < 0.04) and np.all(errors[1] < 0.6 * errors[0])
