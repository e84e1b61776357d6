"""Steps so large that bodies and tools pass through each other are cut back."""

import re
import warnings

import numpy as np
import pytest
from free_ring import FreeRing
from rigid_scenes import Pressed, flat, flat_facets
from scenes import WORLD, box, clamp, elastic, plane, raises_everywhere, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import terms
from qsdolfinx.contact.crossing import deepest_crossing, motion_since

GAP, DEEP, SPEED = 0.5, 0.1, 0.6
N = 4


class Falling:
    """A tool, or another block, that moves down on a block through a gap of two facets.

    Args:
        kind: ``"plane"``, ``"facets"`` or ``"body"``.
        speed: Downward velocity, length per time.
        stepping: Options of the TimeStepper.
    """

    def __init__(self, kind, speed=SPEED, sliding="small", **stepping):
        msh = box(WORLD, (N, N), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
        V = vector_space(msh)
        self.u = [fem.Function(V)]
        bcs, F = [[clamp(V, plane(msh, 1, 0.0))]], [elastic(self.u[0], nu=0.0)]
        slave, high = qs.Surface(V, facets=plane(msh, 1, 1.0)), 1.0 + GAP
        if kind == "plane":
            master = qs.RigidSurface.plane(WORLD, [0.0, high], [0.0, -1.0])
        elif kind == "facets":
            x = np.array([[1.5, high], [0.5, high], [-0.5, high]])
            master = qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 1]], [0.5, high + 1])
        else:
            upper = box(WORLD, (3, 1), "quadrilateral", [-0.5, high], [1.5, high + 1.0])
            W = vector_space(upper)
            self.u.append(fem.Function(W))
            F.append(elastic(self.u[1], E=1e4, nu=0.0))
            way = fem.Constant(upper, (0.0, 0.0))
            everywhere = plane(upper, 1, high + 1.0)
            dofs = fem.locate_dofs_topological(W, 1, everywhere)
            bcs.append([fem.dirichletbc(way, dofs, W)])
            master = qs.Surface(W, facets=plane(upper, 1, high))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # no contact pairs
            options = {"penalty": 1e4, "search_radius": 0.2, "sliding": sliding}
            self.contact = qs.Contact(slave, master, formulation="master-slave", **options)
        self.problem = qs.ContactProblem(F, self.u, [self.contact], bcs)

        def drive(t, dt):
            if kind == "body":
                way.value = (self.side * max(t - 1, 0), -speed * min(t, 1.0 if self.side else t))
            else:
                master.displacement = [self.side * dt, 0.0 if self.side else -speed * dt]

        self.side = 0.0

        self.stepper = qs.TimeStepper(self.problem, 1.0, drive, **stepping)

    def aside(self, speed):
        """From now on, move along the block's surface."""
        self.side = speed

    @property
    def force(self):
        return self.contact.force("slave")[1]


@pytest.mark.parametrize("speed", (SPEED, 1.4))
@pytest.mark.parametrize("kind", ("plane", "facets", "body"))
def test_found_however_deep(kind, speed):
    """The step is cut back until contact is found, and the result is that of small steps."""
    case = Falling(kind, speed)
    for _ in case.stepper.run((GAP + DEEP) / speed):
        pass
    assert case.stepper.num_cutbacks > 0
    assert np.isclose(case.force, -DEEP, rtol=1e-2)
    small = Falling(kind, speed, dt_max=1.0)
    small.stepper.dt = 0.1 / speed
    for _ in small.stepper.run((GAP + DEEP) / speed):
        small.stepper.dt = 0.1 / speed
    assert small.stepper.num_cutbacks == 0
    assert np.isclose(case.force, small.force, rtol=1e-6)


@pytest.mark.parametrize("kind", ("plane", "facets", "body"))
def test_without_a_limit_it_is_warned_of(kind):
    """Without a limit of the penetration, the solve gives a warning."""
    case = Falling(kind, max_penetration=None)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        case.stepper.step()
    assert case.force == 0 and case.stepper.num_cutbacks == 0
    warned = any(issubclass(w.category, qs.ReachWarning) for w in found)
    assert WORLD.allgather(warned) == [True] * WORLD.size


def test_says_where_and_how_deep():
    case = Falling("plane", 1.4, dt_min=1.0)
    with pytest.raises(qs.StepError, match=r"penetration of 0\.9 at \(.*, 1\) of the slave"):
        case.stepper.step()
    raises_everywhere(
        WORLD, qs.StepError, "max_penetration (by default) = 0.125", case.stepper.step
    )
    assert case.stepper.t == 0 and not np.any(case.u[0].x.array)


def test_what_comes_near_or_slides_is_not_cut_back():
    """Motion by many facets, along the surface or towards it, is not cut back."""
    case = Falling("plane", 0.99 * GAP)
    case.stepper.step()
    assert case.stepper.num_cutbacks == 0 and case.force == 0
    case = Falling("facets", 0.0)
    case.stepper.drive = lambda t, dt: setattr(case.stepper.tools[0], "displacement", [0.9, 0.0])
    case.stepper.step()
    assert case.stepper.num_cutbacks == 0


@pytest.mark.parametrize("turn", (30.0, 45.0))
def test_free_ring_is_not_lost_in_silence(turn):
    """In each completed step the ring is between the plates, and the forces balance."""
    case = FreeRing((64, 3), turn, dt_min=0.2)
    case.stepper.step()
    squeezed = case.forces[0]
    try:
        for t in (1.5, 2.0):
            case.step_to(t)
            assert np.allclose(case.forces, [squeezed, -squeezed], rtol=0.05)
    except qs.StepError as error:
        assert "qs.Stabilisation" in str(error) or "penetration" in str(error)
    lower, upper = case.forces
    assert np.isclose(lower, -upper, rtol=1e-5) and np.isclose(lower, squeezed, rtol=0.05)


def test_rotation_of_a_tool_is_limited():
    """The rotation per step is limited before a solve; enough steps make the whole rotation."""
    case = Falling("facets", 0.0, max_rotation=0.3)

    def drive(t, dt):
        case.stepper.tools[0].rotation = 2.0 * np.pi * dt

    case.stepper.drive = drive
    for _ in case.stepper.run(1.0):
        assert case.stepper.last_dt * 2 * np.pi <= 0.3
    assert case.stepper.num_steps >= 21
    assert np.allclose(case.stepper.tools[0].position[:, :2], np.eye(2), atol=1e-12)


def test_rotation_of_surfaces_is_limited():
    """Steps are cut back for a ring that rolls by 30° per unit of time.

    Its normals turn by that and more.
    """
    case = FreeRing((48, 3), 30.0, max_rotation=np.radians(20.0))
    case.step_to(2.0)
    assert case.stepper.num_cutbacks > 0


@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("kind", ("plane", "facets", "body"))
def test_slip_is_limited(kind, sliding):
    """A tool presses and then slides: with facets of 1/4, a slip of 0.3 is 1.2 facets."""
    ways = []
    for max_slip in (None, 1.1, 0.5):
        case = Falling(kind, GAP + 0.02, sliding, max_slip=max_slip)
        for _ in case.stepper.run(1.0):
            pass
        case.aside(1e-9)  # stops, so that no downward motion is predicted
        case.stepper.dt = 0.1
        case.stepper.step()
        case.aside(0.3)
        case.stepper.dt = 1.0
        case.stepper.step()
        ways.append(0.3 * case.stepper.last_dt)
    assert ways[0] == 0.3
    assert np.allclose(ways[1:], [0.15, 0.075])


def test_slip_along_a_round_tool_is_the_arc():
    """A cylinder that rotates in place slips by its radius times the angle, not by the chord."""
    n, radius, angle = 8, 0.5, 0.8
    msh = box(WORLD, (n, n), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.cylinder(WORLD, [0.5, 1.0 + radius], None, radius)
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(surface, tool, sliding="finite")
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])

    def drive(t, dt):
        tool.displacement = [0.0, -0.005 if t < 1.5 else 0.0]
        tool.rotation = 0.0 if t < 1.5 else angle

    stepper = qs.TimeStepper(problem, 1.0, drive, dt_min=1.0, max_slip=1.0)
    stepper.step()
    with pytest.raises(qs.StepError, match="a slip of") as found:
        stepper.step()
    facets = float(re.search(r"a slip of (\S+) facets", str(found.value))[1])
    assert np.isclose(facets, n * radius * angle, rtol=0.03)


def test_a_limit_below_what_counts_as_closed():
    """A tiny penetration of a penalty contact, without a position, is refused all the same."""
    msh = box(WORLD, (3, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(surface, tool, penalty=1e9, enforcement="penalty")
    bcs = [clamp(V, plane(msh, 1, 0.0))]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])

    def drive(t, dt):
        tool.displacement = [0.0, -0.01]

    stepper = qs.TimeStepper(problem, 1.0, drive, dt_min=0.6, max_penetration=1e-13)
    with pytest.raises(qs.StepError, match="a penetration of"):
        stepper.step()
    assert contact.settings.allowed_gap > 1e-13


@pytest.mark.parametrize("limit", ("auto", 0.13))
def test_small_steps_add_up(limit):
    """A depth that grows by little in each step is found as in a large step."""
    scene = Pressed("quadrilateral", flat, n=4, penalty=1e-3, enforcement="penalty")

    def drive(t, dt):
        scene.tool.displacement = [0.0, -0.02]

    stepper = qs.TimeStepper(scene.problem, 1.0, drive, dt_min=1.0, max_penetration=limit)
    largest = 0.5 * scene.surface.facet_size_range[1] if limit == "auto" else limit
    with pytest.raises(qs.StepError, match=f"penetration of .*max_penetration.* = {largest:.4g}"):
        for _ in stepper.run(20.0):
            assert scene.contact.penetration() <= largest
    assert scene.contact.penetration() > largest - 0.021


@pytest.mark.parametrize("tool", (flat, flat_facets))
def test_motion_beside_a_tool(tool):
    """A body that is carried by a tool, which rotates away from its origin, does not come closer.

    Points that were outside are outside.
    """
    scene = Pressed("quadrilateral", tool, penalty=1.0, enforcement="penalty")
    model, u, x = scene.contact.model, fem.Function(scene.V), scene.V.tabulate_dof_coordinates()
    before = None
    for motion in (((0.3, 1.5), 0.4), ((0.2, -0.1), 0.8)):
        scene.tool.displacement, scene.tool.rotation = motion
        position = np.array([*scene.tool.motion.A, scene.tool.motion.b])
        moved = x[:, :2] + u.x.array.reshape(-1, 2)
        u.x.array[:] += (moved @ position[:2].T + position[2]).ravel()
        scene.tool.advance()
        scene.u.x.array[:] = u.x.array
        scene.contact.update()
        scene.problem.set_up()
        terms.evaluate(model, u.x.petsc_vec, None)
        if before is not None:
            assert motion_since(model, before) < 1e-12
            assert deepest_crossing(model, before, 0.1, 1e-3) is None
        before = model.placement
