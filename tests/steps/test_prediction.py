"""Start of a time step: displacements are extrapolated, meshes are moved by velocities."""

import numpy as np
import pytest
from following import Body, create, problem_of
from scenes import WORLD, box, elastic, largest, plane, slide, vector_space
from step_scenes import SPEED, Upset, refuse

from dolfinx import fem

import qsdolfinx as qs


class Pressed:
    """An elastic block with sliding sides, below a plane that moves down at constant speed."""

    def __init__(self, dt, solve=None, drive=None, sliding="finite", **stepping):
        self.mesh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
        self.V = V = vector_space(self.mesh)
        self.u = fem.Function(V)
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        surface = qs.Surface(V, facets=plane(self.mesh, 1, 1.0))
        options = {"enforcement": "penalty", "penalty": 50.0, "sliding": sliding}
        contact = qs.Contact(surface, self.tool, formulation="master-slave", **options)
        self.bottom = fem.Constant(self.mesh, 0.0)
        at = fem.locate_dofs_topological(V.sub(1), 1, plane(self.mesh, 1, 0.0))
        bcs = [
            slide(V, 0, plane(self.mesh, 0, 0.0)),
            fem.dirichletbc(self.bottom, at, V.sub(1)),
        ]
        self.problem = qs.ContactProblem([elastic(self.u)], [self.u], [contact], [bcs])
        self.stepper = qs.TimeStepper(self.problem, dt, drive or self.move, solve=solve, **stepping)

    def move(self, t, dt):
        self.tool.displacement = [0.0, -0.1 * dt]


@pytest.mark.parametrize("sliding", ("finite", "small"))
def test_displacements_go_on_at_their_rate(sliding):
    """The prediction is u + Δt Δu/Δt_last, for steps of any size.

    It is the solution where loads grow at a constant rate. With small sliding it is the position of
    contact detection, whatever the loads.
    """
    starts = {}

    def solve(step):
        starts.setdefault(step, case.u.x.array.copy())  # the first step is solved twice
        case.problem.solve()

    case = Pressed(0.2, solve, sliding=sliding)
    ends, times = [case.u.x.array.copy()], [0.0]
    for dt in (0.2, 0.1, 0.16, 0.04):
        case.stepper.dt = dt
        assert case.stepper.step() == dt
        ends.append(case.u.x.array.copy())
        times.append(case.stepper.t)
    assert len(starts) == 4 and largest(starts[0]) == 0
    size = largest(ends[1])
    for i in range(1, 4):
        rate = (ends[i] - ends[i - 1]) / (times[i] - times[i - 1])
        expected = ends[i] + (times[i + 1] - times[i]) * rate
        assert largest(starts[i] - expected) < 1e-14
        assert largest(ends[i] - ends[i - 1]) > 0.01 * size
        assert largest(ends[i + 1] - expected) < 1e-3 * size  # not exact: the surface gets longer


@pytest.mark.parametrize("part", (0.0, 0.5, -1.0, 1.5))
@pytest.mark.parametrize("by_conditions", (False, True))
def test_loads_that_go_on_in_part(by_conditions, part):
    """Loads that continue at a fraction of their rate, from 0 to 1, scale the prediction by it."""
    starts = []

    def solve(step):
        if step == 1:
            starts.append(case.u.x.array.copy())
        case.problem.solve()

    def drive(t, dt):
        way = 0.1 * dt * (1 if t < 0.25 else part)
        if by_conditions:
            case.bottom.value += way
        else:
            case.tool.displacement = [0.0, -way]

    case = Pressed(0.2, solve, drive)
    case.stepper.step()
    end = case.u.x.array.copy()
    case.stepper.step()
    expected = end * (1 + min(max(part, 0.0), 1.0))
    assert largest(starts[0] - expected) < 0.01 * largest(end)


@pytest.mark.parallel
def test_a_step_without_a_change_of_loads():
    """Without a change of the loads the equilibrium stays the same.

    A tip that was dragged would otherwise snap over lines of the mesh.
    """
    block = Body(box(WORLD, (20, 6), "quadrilateral", (0.0, -1.0), (3.0, 0.0)))
    tip = Body(wedge_of(6, 0.6, 0.3))
    block.clamp(plane(block.mesh, 1, -1.0))
    top = tip.clamp(plane(tip.mesh, 1, 1.5))
    bottom = tip.boundary(lambda x: np.isclose(x[1], abs(x[0] - 0.6) / 0.3))
    contact = qs.Contact(tip.surface(bottom), block.side(1, 0.0))

    def drive(t, dt):
        way = 0.1 * min(t, 9.0)
        top.value[:] = max(way - 0.5, 0.0), -0.2 * min(2 * way, 1.0)

    stepper = qs.TimeStepper(problem_of([block, tip], [contact]), 1.0, drive)
    for _ in stepper.run(9.0):
        pass
    before = tip.u.x.array.copy(), contact.force("slave")
    for _ in range(3):
        stepper.step()
        assert stepper.num_iterations == 0
        assert largest(tip.u.x.array - before[0]) < 1e-9
        np.testing.assert_allclose(contact.force("slave"), before[1], rtol=1e-7)


def wedge_of(n, x, half):
    """A wedge of n × n cells with its tip at (x, 0), up to y = 1.5."""
    s = np.linspace(0, 1, n + 1)
    across = 2 * s - 1
    nodes = [[x + half * a, abs(a) + (1.5 - abs(a)) * y] for y in s for a in across]
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)[:, [0, 1, 3, 2]]
    return create("quadrilateral", np.array(nodes), cells)


def test_a_failed_attempt_predicts_anew():
    """After a failed attempt, half of Δt predicts half of the motion from the step's start."""
    starts = []

    def solve(step):
        if step == 1:
            starts.append(case.u.x.array.copy())
        case.problem.solve()
        if len(starts) in (1, 2):
            refuse()

    case = Pressed(0.2, solve)
    case.stepper.step()
    end = case.u.x.array.copy()
    case.stepper.step()
    for start, factor in zip(starts, (1, 1 / 2, 1 / 4), strict=True):
        assert largest(start - (1 + factor) * end) < 1e-14


@pytest.mark.parametrize("theta", (0.0, 0.3, 0.5))
def test_meshes_are_moved_by_the_last_velocity(theta):
    """The mesh is moved to x + θ Δt v; the last velocity v is also the initial guess."""
    starts = []

    def solve(step):
        starts.append((case.w.x.array.copy(), case.mesh.geometry.x.copy()))
        case.problem.solve()

    case = Upset(dt=0.04, theta=theta, solve=solve)
    motion = case.stepper.motions[0]
    ends = []
    for dt in (0.04, 0.02, 0.03):
        case.stepper.dt = dt
        assert case.stepper.step() == dt
        ends.append((case.w.x.array.copy(), case.mesh.geometry.x.copy()))
    starts = starts[-2:]
    for dt, (w, x), (w_end, x_end) in zip((0.02, 0.03), starts, ends[:-1], strict=True):
        moved = theta * dt * motion.values(w_end)
        assert largest(w - w_end) == 0
        assert largest(x - x_end - moved) < 1e-15
        assert theta == 0 or largest(moved) > 0.1 * theta * dt * SPEED
    # The step ends with the velocity that was found, applied over the whole step.
    (_, before), (w, after) = ends[1:]
    assert largest(after - before - 0.03 * motion.values(w)) < 1e-15


def test_first_step_is_made_twice():
    """The first step is solved twice: the first velocity moves the mesh for the second solve."""
    starts, found = [], []

    def solve(step):
        starts.append(case.mesh.geometry.x.copy())
        case.problem.solve()
        found.append(case.w.x.array.copy())

    case = Upset(dt=0.04, theta=0.5, solve=solve)
    x = case.mesh.geometry.x.copy()
    case.stepper.step()
    assert len(starts) == 2
    values = [case.stepper.motions[0].values(w) for w in found]
    assert largest(starts[0] - x) == 0
    assert largest(starts[1] - x - 0.02 * values[0]) < 1e-15
    assert largest(case.mesh.geometry.x - x - 0.04 * values[1]) < 1e-15
    assert largest(values[0]) > 0.5 * SPEED


@pytest.mark.parametrize("theta", (0.0, 0.4))
def test_where_contact_pairs(theta):
    """Contact is first detected at the start or predicted position, then at the solution.

    Velocity-based bodies start from their position in the solve, displacements are predicted. With
    θ = 0 contact is then updated at the end of the step.
    """
    # For each solve: whether contact was updated at the solution. The first step is solved twice.
    as_found = iter([*([False] if theta else []), False, True, False, True])
    errors = []

    def solve(step):
        ended = next(as_found)
        for u, motion, probe in zip(case.u, case.stepper.motions, probes, strict=True):
            flows, here = u is case.w, motion.mesh.geometry.x.copy()
            if ended or not flows:
                factor = (theta or 1.0) * case.stepper.dt if flows else 1.0
                motion.mesh.geometry.x[:] = starts[u] + factor * motion.values()
            probe.update()
            motion.mesh.geometry.x[:] = here
            errors.append(largest(probe.node_x - paired[u].node_x))
        case.problem.solve()

    case = Upset(die=True, dt=0.04, theta=theta, num_pairings=2, solve=solve)
    paired = {case.u[0]: case.contacts[0].slave, case.u[1]: case.contacts[0].master}
    probes = [qs.Surface(side.V, facets=side.facets) for side in paired.values()]
    for dt in (0.04, 0.02):
        starts = {u: u.function_space.mesh.geometry.x.copy() for u in case.u}
        case.stepper.dt = dt
        case.stepper.step()
    assert next(as_found, None) is None
    assert max(errors) < 1e-14
    assert largest(case.u[1].x.array) > 1e-4
