"""Where a time step starts: displacements go on at their rate, meshes are moved by velocities."""

import pytest
from scenes import WORLD, box, elastic, largest, plane, slide, vector_space
from step_scenes import SPEED, Upset, refuse

from dolfinx import fem

import qsdolfinx as qs


class Pressed:
    """An elastic block that slides on its sides, below a plane that goes down at one speed."""

    def __init__(self, dt, solve=None, **stepping):
        self.mesh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
        self.V = V = vector_space(self.mesh)
        self.u = fem.Function(V)
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        surface = qs.Surface(V, facets=plane(self.mesh, 1, 1.0))
        options = {"enforcement": "penalty", "penalty": 50.0}
        contact = qs.Contact(surface, self.tool, "master-slave", **options)
        bcs = [slide(V, i, plane(self.mesh, i, 0.0)) for i in (0, 1)]
        self.problem = qs.ContactProblem([elastic(self.u)], [self.u], [contact], [bcs])
        self.stepper = qs.TimeStepper(self.problem, dt, self.move, solve=solve, **stepping)

    def move(self, t, dt):
        self.tool.displacement = [0.0, -0.1 * dt]


def test_displacements_go_on_at_their_rate():
    """u + Δt Δu/Δt_last, for steps of any size: the solution where loads grow at one rate."""
    starts = {}

    def solve(step):
        starts.setdefault(step, case.u.x.array.copy())  # the first step pairs twice
        case.problem.solve()

    case = Pressed(0.2, solve)
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
        assert largest(ends[i + 1] - expected) < 1e-3 * size  # not quite: the surface gets longer


def test_a_failed_attempt_predicts_anew():
    """With half of Δt half of the way is predicted, from where the step begins."""
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
    """x + θ Δt v, v being the velocity of the last step, from which the solver starts, too."""
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
    # Where the step ends: the velocity that was found, over the whole of it.
    (_, before), (w, after) = ends[1:]
    assert largest(after - before - 0.03 * motion.values(w)) < 1e-15


def test_first_step_is_made_twice():
    """The velocity that the first solve finds moves the mesh for the second."""
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
    """First where bodies are solved for, displacements predicted; then as found.

    With θ = 0 contact then pairs at the end of the step.
    """
    # Of each solve, whether contact has paired by the solution. The first is made twice.
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
