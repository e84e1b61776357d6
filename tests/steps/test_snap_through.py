"""Steps that jump over unstable states: they are named, with the energy that they release."""

import re
import warnings

from mpi4py import MPI

import numpy as np
import pytest
from contact.test_warnings import warned
from following import Body, problem_of
from scenes import WORLD, box, plane
from steps.test_snapping import TOP, arch

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.solve.snap_through import Jump, Missed, SnapThrough

SNAPS = "snap-through: "


def jumps_of(call):
    """Warnings of a call that name a snap-through, the same on all ranks."""
    return [text for text in warned(call) if SNAPS in text]


def ways_of(stepper, tool, end=1.0):
    return np.array([TOP + 0.2 - float(tool.center[1]) for _ in stepper.run(end)])


@pytest.mark.parametrize("dt", (0.2, pytest.param(0.1, marks=pytest.mark.parallel), 0.025))
def test_arch_under_a_force(dt):
    """The step in which the arch snaps, and no other, is named, whatever its size."""
    tool, _, stepper = arch(lambda tool, t, dt: tool.drive(0.8 * t, [0.0, -1.0]), dt)
    ways, iterations = [], []
    stepper.on_solved = lambda: iterations.append(stepper.num_iterations)
    (text,) = jumps_of(lambda: ways.extend(ways_of(stepper, tool)))
    jump = 1 + int(np.argmax(np.diff(ways)))
    assert text.startswith(f"step {jump + 1}, t = ")
    part = float(re.search(r"released, ([0-9.e-]+) times the work", text).group(1))
    assert 0.02 < part < 0.3
    assert iterations[jump + 1] <= 7  # the jump does not continue


def test_arch_moved_by_displacements():
    """The remedy: the same path, with a falling force, has no jump."""

    def move(tool, t, dt):
        tool.displacement = [0.0, -0.45 * dt]

    _, contact, stepper = arch(move)
    forces = []

    def run():
        forces.extend(contact.force("master")[1] for _ in stepper.run(1.0))

    assert jumps_of(run) == []
    assert min(np.diff(forces)) < 0


def test_nothing_changes(monkeypatch):
    """Up to the end of the jump, all is the same to the last bit without the check."""

    def run():
        _, contact, stepper = arch(lambda tool, t, dt: tool.drive(0.8 * t, [0.0, -1.0]))
        out = []

        def steps():
            for _ in stepper.run(0.6):
                u = stepper.problem.u[0].x.array
                out.extend([u.copy(), contact.force("slave"), contact.pressure("slave").x.array])

        return len(jumps_of(steps)), np.concatenate(out), str(stepper.log)

    checked = run()
    monkeypatch.setattr(SnapThrough, "applies", False)
    unchecked = run()
    assert (checked[0], unchecked[0]) == (1, 0)
    np.testing.assert_array_equal(checked[1], unchecked[1])
    assert checked[2] == unchecked[2]


def test_refused():
    """If the warning is an error, the stepper stays at the end of the step before, and goes on."""
    force = [0.8]
    tool, contact, stepper = arch(lambda tool, t, dt: tool.drive(force[0] * t, [0.0, -1.0]))
    with warnings.catch_warnings(), pytest.raises(qs.ContactWarning, match=SNAPS):
        warnings.simplefilter("error", qs.ContactWarning)
        for _ in stepper.run(1.0):
            u, at = stepper.problem.u[0].x.array.copy(), float(tool.center[1])
    np.testing.assert_array_equal(stepper.problem.u[0].x.array, u)
    assert float(tool.center[1]) == at
    loaded = contact.force("master")[1]
    force[0] = 0.99 * loaded / (stepper.t + stepper.dt)  # unload
    assert jumps_of(stepper.step) == []
    assert contact.force("master")[1] == pytest.approx(0.99 * loaded, rel=1e-7)


# --- A block on a bistable foundation


def foundation(w):
    """Force per length that resists a compression w; it falls between 0.5918 and 1.4082."""
    return w**3 - 3 * w**2 + 2.5 * w


def energy(w):
    return w**4 / 4 - w**3 + 1.25 * w**2


def equilibrium(force, near):
    """Compression at a force, on the stable branch near a value."""
    roots = np.roots([1.0, -3.0, 2.5, -force])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real[np.argmin(np.abs(real - near))])


class Bistable:
    """A stiff block, guided by walls, between a bistable foundation and a force-driven plane."""

    def __init__(self, stiffness=1e4, scale=1.0):
        square = box(WORLD, (2, 2), "quadrilateral", (0.0, 0.0), (1.0, 1.0))
        self.body = body = Body(square, 1, stiffness)
        low = np.sort(plane(body.mesh, 1, 0.0))
        tags = mesh.meshtags(body.mesh, 1, low, np.ones(len(low), dtype=np.int32))
        self.low = ufl.Measure("ds", body.mesh, subdomain_data=tags)(1)
        body.F -= foundation(-body.u[1] / scale) * body.v[1] * self.low
        for value in (0.0, 1.0):
            body.hold(0, 0, value)
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        self.contact = qs.Contact(body.side(1, 1.0), self.tool)

    def stepper(self, drive, dt):
        return qs.TimeStepper(problem_of([self.body], [self.contact]), dt, drive, dt_max=dt)


@pytest.mark.parametrize("forces", ((0.6, 0.65), (0.62, 0.645)))
def test_energy(forces):
    """The bound is the work of the smaller force minus the energy of the foundation."""
    case = Bistable()
    problem = problem_of([case.body], [case.contact])
    check = SnapThrough(problem.system)
    for force in (0.3, 0.5, forces[0]):
        case.tool.drive(force, [0.0, -1.0])
        problem.solve()
    check.accept()
    start = [case.body.u.x.array.copy()]
    case.tool.drive(forces[1], [0.0, -1.0])
    texts = jumps_of(problem.solve)
    before, after = equilibrium(forces[0], 0.4), equilibrium(forces[1], 1.9)
    found = check.released(start, Missed.nothing())
    least = forces[0] * (after - before) - energy(after) + energy(before)
    assert found.least == pytest.approx(least, rel=1e-2)
    assert found.work == pytest.approx(forces[1] * (after - before), rel=1e-2)
    assert len(texts) == 1


def test_energy_on_a_stable_path():
    """Where force and motion grow together, the bound is negative: nothing is released."""
    case = Bistable()
    stepper = case.stepper(lambda t, dt: case.tool.drive(0.62 * t, [0.0, -1.0]), 0.25)
    assert jumps_of(lambda: list(stepper.run(1.0))) == []
    assert case.contact.force("slave")[1] == pytest.approx(-0.62)


def test_snap_back():
    """A soft block, moved by displacements, lets its foundation jump.

    In a small step hardly any work is done: the energy is that of the block.
    """
    case = Bistable(stiffness=1.0, scale=0.1)
    ways = []

    def drive(t, dt):
        case.tool.displacement = [0.0, -0.05 if t < 7.5 else -0.002]

    def run():
        for _ in case.stepper(drive, 1.0).run(30.0):
            low = WORLD.allreduce(case.body.u.x.array[1::2].max(initial=-1.0), op=MPI.MAX)
            ways.append(-low)

    (text,) = jumps_of(run)
    jump = 1 + int(np.argmax(np.diff(ways)))
    assert text.startswith(f"step {jump + 1}, t = ")
    assert ways[jump] - ways[jump - 1] > 0.05


@pytest.mark.parametrize("term", ("damping", "inertia"))
def test_motion_in_time(term):
    """The remedy: with damping or inertia, and small steps, the motion takes time: no jump."""
    case = Bistable()
    body = case.body
    before, earlier = fem.Function(body.V), fem.Function(body.V)
    factor = fem.Constant(body.mesh, 1.0)
    change = body.u[1] - before[1]
    if term == "inertia":
        change -= before[1] - earlier[1]
    body.F += factor * change * body.v[1] * case.low
    ways = []

    def drive(t, dt):
        case.tool.drive(0.7 * min(t, 1.0), [0.0, -1.0])
        factor.value = 0.2 / (dt if term == "damping" else dt**2)
        earlier.x.array[:] = before.x.array
        before.x.array[:] = body.u.x.array

    stepper = case.stepper(drive, 0.1)

    def run():
        ways.extend(1.0 - float(case.tool.center[1]) for _ in stepper.run(8.0))

    assert jumps_of(run) == []
    assert stepper.num_cutbacks == 0
    assert ways[-1] == pytest.approx(equilibrium(0.7, 1.9), rel=0.1)
    assert max(np.diff(ways)) < 0.3


def test_energy_from_nowhere(monkeypatch):
    """The energy that an equilibrium has gained: at this force there are two.

    That with the larger compression has more energy, and a poor first guess leads there.
    """
    case, found = Bistable(), []
    original = SnapThrough.released

    def released(check, start, missed):
        found.append(original(check, start, missed))
        return found[-1]

    monkeypatch.setattr(SnapThrough, "released", released)

    def drive(t, dt):
        case.tool.drive(0.45 * min(t, 1.0), [0.0, -1.0])
        if t > 1.1:
            case.body.u.x.array[1::2] -= 1.1

    ways = [1.0 - float(case.tool.center[1]) for _ in case.stepper(drive, 0.2).run(1.2)]
    low, high = ways[-2:]
    assert [high, low] == pytest.approx([equilibrium(0.45, x) for x in (1.7, 0.3)], rel=0.01)
    gained = energy(high) - energy(low) - 0.45 * (high - low)
    assert found[-1].gained == pytest.approx(gained, rel=0.01) and gained > 0
    assert not found[-1].is_from_nowhere  # the force has done more work
    supplied, stored = found[-1].supplied, found[-1].stored
    assert supplied == pytest.approx(0.45 * (high - low), rel=0.01)
    assert found[-1]._replace(gained=1.01 * max(supplied, 0.06 * stored)).is_from_nowhere
    assert not found[-1]._replace(supplied=0.0, gained=0.05 * stored).is_from_nowhere


@pytest.mark.parametrize("radius", (0.0, 0.1))
def test_wedge(radius):
    """A sharp wedge jumps as it slides from node to node; with a radius of two facets it does not.

    This is the remedy that the warning names.
    """
    body = Body(box(WORLD, (30, 8), "quadrilateral", (0.0, 0.0), (1.5, 0.4)))
    body.clamp(plane(body.mesh, 1, 0.0))
    half = np.arctan(0.6)
    turns = np.linspace(-half, half, 9) if radius > 0 else np.zeros(1)
    tip = radius * np.stack([np.sin(turns), 1 - np.cos(turns)], axis=1)
    x = np.array([[-0.3, 0.18], *tip, [0.3, 0.18], [0.0, 0.28]])
    x += [0.5, 0.401]
    numbers = np.arange(len(x))
    tool = qs.RigidSurface.triangulated(WORLD, x, np.stack([numbers, np.roll(numbers, -1)], axis=1))
    contact = qs.Contact(body.side(1, 0.4), tool)

    def drive(t, dt):
        tool.displacement = [0.0, -0.06] if t <= 1 else [0.02, 0.0]

    stepper = qs.TimeStepper(problem_of([body], [contact]), 1.0, drive, dt_max=1.0)
    texts = jumps_of(lambda: list(stepper.run(7.0)))
    assert (len(texts) > 0) == (radius == 0)
    assert all("round them" in text for text in texts)


@pytest.mark.parallel
def test_step_with_energy_from_nowhere(monkeypatch):
    """Such a step is cut back, with the reason in the log; a single solve warns."""
    case = Bistable()
    steps = []

    def find(check, start, missed):
        wrong = bool(steps) and steps[-1] > 0.1
        return Jump(SNAPS + "stores more energy", True) if wrong else None

    monkeypatch.setattr(SnapThrough, "find", find)

    def drive(t, dt):
        steps.append(dt)
        case.tool.drive(0.3 * t, [0.0, -1.0])

    stepper = case.stepper(drive, 0.2)
    assert jumps_of(stepper.step) == []
    assert (stepper.num_cutbacks, stepper.t) == (1, 0.1)
    assert "stores more energy" in stepper.log[0].reason
    steps.append(1.0)
    assert len(jumps_of(stepper.problem.solve)) == 1


def test_end_of_a_beam():
    """A cylinder slides off the end of a bent beam, in coarse steps without friction.

    In one of them Newton's method finds the beam wedged beside the cylinder, with four times its
    energy. That step is cut back, and its force never exceeds what small steps have.
    """
    msh = box(WORLD, (40, 2), "quadrilateral", (0.0, 0.0), (2.0, 0.1))
    body = Body(msh, 2, 1e4)
    body.clamp(plane(msh, 0, 0.0))
    tool = qs.RigidSurface.cylinder(WORLD, (1.8, 0.2), None, 0.1)
    facets = np.concatenate([plane(msh, 1, 0.1), plane(msh, 0, 2.0)])
    contact = qs.Contact(body.surface(facets), tool)

    def place(t):
        return np.array([0.4 * max(t - 1, 0), -0.4 * min(t, 1)])

    def drive(t, dt):
        tool.displacement = place(t) - place(t - dt)

    stepper = qs.TimeStepper(problem_of([body], [contact]), 0.05, drive, dt_max=0.05)
    forces, iterations = [], []

    def run():
        for _ in stepper.run(1.8):
            forces.append(abs(contact.force("slave")))
            iterations.append(stepper.num_iterations)

    texts = jumps_of(run)
    assert np.max(forces) < 0.5
    assert any("stores more energy" in attempt.reason for attempt in stepper.log)
    assert len(texts) == 1  # off the end
    free = np.flatnonzero(np.max(forces, axis=1) > 0)[-1] + 1
    assert 0 < free < len(forces) - 1
    assert iterations[free + 1 :] == [0] * (len(forces) - free - 1)  # the jump does not continue
