"""Steps of more than a facet against rigid tools: the prediction moves bodies with the tools."""

import numpy as np
import pytest
from following import Body, but_for, problem_of
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.surface.affine import rotation_matrix, rotation_vector

N, PRESS = 16, 0.1
TOOLS = {
    "plane": lambda: qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0]),
    "facets": lambda: qs.RigidSurface.triangulated(
        WORLD, np.array([[2.0, 1.0], [0.5, 1.0], [-1.0, 1.0]]), [[1, 0], [2, 1]], [0.5, 1.0]
    ),
}


class Pressed:
    """A block of height 4, held at its bottom, pressed by a tool on its top."""

    def __init__(self, kind, drive, **options):
        msh = box(WORLD, (N, 2 * N), "quadrilateral", [0.0, -3.0], [1.0, 1.0], "scattered")
        V = vector_space(msh)
        self.u, self.tool = fem.Function(V), TOOLS[kind]()
        surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
        options = {"penalty": 1e4, "search_radius": 1 / N} | options
        self.contact = qs.Contact(surface, self.tool, **options)
        self.problem = qs.ContactProblem(
            [elastic(self.u, E=4.0, nu=0.0)],
            [self.u],
            [self.contact],
            [[clamp(V, plane(msh, 1, -3.0))]],
        )
        self.stepper = qs.TimeStepper(self.problem, 1.0, lambda t, dt: drive(self.tool, t, dt))

    @property
    def force(self):
        return self.contact.force("slave")[1]


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("kind", TOOLS)
def test_pressed_by_more_than_a_facet(kind, quadrature, enforcement):
    """A tool that moves down, down, up by half, and down is never lost."""
    heights = np.cumsum([-PRESS / 8, -PRESS, -PRESS, PRESS / 2, -PRESS / 2, -PRESS])

    def drive(tool, t, dt):
        before = np.append(0.0, heights)
        moved = np.interp([t - dt, t], np.arange(7.0), before)
        tool.displacement = [0.0, moved[1] - moved[0]]

    formulation = "master-slave" if quadrature == "nodal" else "quasi-symmetric"
    options = {"quadrature": quadrature, "enforcement": enforcement, "formulation": formulation}
    case = Pressed(kind, drive, **options)
    stiffness = 1 / (1 + (1e-4 if enforcement == "penalty" else 0))
    for t in case.stepper.run(6.0):
        height = np.interp(t, np.arange(7.0), np.append(0.0, heights))
        assert np.isclose(case.force, height * stiffness, rtol=1e-6)


def test_driven_by_a_force():
    """A force-controlled tool is predicted as well, and stays if the force stays."""
    forces = [0.02, 0.12, 0.22, 0.22, 0.32]
    case = Pressed("plane", lambda tool, t, dt: tool.drive(forces[round(t) - 1], [0.0, -1.0]))
    for force in forces:
        case.stepper.step()
        assert np.isclose(case.force, -force, rtol=1e-6)
    assert np.isclose(case.tool.position[1, 2], -forces[-1], rtol=1e-6)
    assert case.stepper.num_cutbacks == 0


@pytest.mark.parametrize("kind", ("displacement", "velocity"))
def test_motion_of_the_tool_is_what_was_asked_for(kind):
    """However its motion is split, the tool ends where displacement and rotation put it."""

    def drive(tool, t, dt):
        tool.displacement = [0.01 * np.sin(3 * t) * dt, -0.002 * dt]
        tool.rotation = 0.002 * np.cos(2 * t) * dt

    options = {"unknown": "velocity", "dt": 1.0} if kind == "velocity" else {}
    case = Pressed("plane", drive, **options)
    alone = TOOLS["plane"]()
    for t in case.stepper.run(5.0):
        drive(alone, t, case.stepper.last_dt)
        alone.advance()
        np.testing.assert_allclose(case.tool.position, alone.position, atol=1e-14)


@pytest.mark.parametrize("gdim", (2, 3))
def test_rotation_vector(gdim):
    """rotation_vector is the inverse of rotation_matrix, also next to zero and to half a turn."""
    rng = np.random.default_rng(3)
    for angle in (0.0, 1e-12, 1e-5, 0.7, 2.5, np.pi - 1e-9, np.pi - 1e-12):
        axis = rng.normal(size=1 if gdim == 2 else 3)
        vector = angle * axis / np.linalg.norm(axis)
        found = rotation_vector(rotation_matrix(vector))
        np.testing.assert_allclose(found, vector, atol=1e-7 if angle > 3 else 1e-14)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("facets", (1.0, 5.0))
def test_a_round_tool_that_starts_to_slide(quadrature, facets):
    """The step in which a tool starts to slide, by this many facets, keeps the contact force."""
    msh = box(WORLD, (40, 4), "quadrilateral", [-2.0, -1.0], [2.0, 0.0], "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.cylinder(WORLD, [-1.0, 1.0], None, 1.0)
    contact = qs.Contact(
        qs.Surface(V, facets=plane(msh, 1, 0.0)),
        tool,
        quadrature=quadrature,
        enforcement="augmented-lagrangian",
    )
    problem = qs.ContactProblem(
        [elastic(u, E=1e3)], [u], [contact], [[clamp(V, plane(msh, 1, -1.0))]]
    )

    def drive(t, dt):
        tool.displacement = [0.0, -0.02] if t < 1.5 else [0.1 * facets, 0.0]

    stepper = qs.TimeStepper(problem, 1.0, drive)
    forces = []
    for _ in range(2):
        stepper.step()
        forces.append(contact.force("slave"))
    assert forces[0][1] < -10
    np.testing.assert_allclose(forces[1], forces[0], atol=0.015 * abs(forces[0][1]))


@pytest.mark.parametrize("degrees, most", ((5.0, 0.005), (15.0, 0.02)))
def test_blocks_that_turn_together(degrees, most):
    """With small sliding and no friction, the force rotates with the bodies.

    They rotate about the middle of the contact.
    """
    low = Body(box(WORLD, (5, 2, 2), "tetrahedron", (0, -1, 0), (3, 0, 1)), stiffness=1e3)
    high = Body(box(WORLD, (3, 2, 2), "tetrahedron", (1, 0, 0), (2, 0.8, 1)), stiffness=1e3)
    ends, middle = [], np.array([1.5, 0.0, 0.0])
    for body, at in ((low, -1.0), (high, 0.8)):
        ends.append(fem.Function(body.V))
        dofs = fem.locate_dofs_topological(body.V, 2, plane(body.mesh, 1, at))
        body.bcs.append(fem.dirichletbc(ends[-1], dofs))
    slave = but_for(high, plane(high.mesh, 1, 0.8))  # the contact area, and the walls
    contact = qs.Contact(slave, low.side(1, 0.0), sliding="small")

    def turn(t):
        return rotation_matrix([0.0, 0.0, np.radians(degrees) * max(t - 1.0, 0.0)])

    def drive(t, dt):
        for end, press in zip(ends, (0.0, -0.03), strict=True):
            offset = np.array([0.0, press * min(t, 1.0), 0.0]) - middle
            end.interpolate(lambda x, o=offset: turn(t) @ (x + o[:, None]) + middle[:, None] - x)

    stepper = qs.TimeStepper(problem_of([low, high], [contact]), 1.0, drive)
    for t in stepper.run(4.0):
        force = turn(t).T @ contact.force("slave")
        assert np.linalg.norm(force[[0, 2]]) < most * force[1]  # 0.09 with old normals
