"""Moments over time steps: forces act at the end of the step, about the tool's position then."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

WAY = 0.3


def carried(kind, theta=0.5):
    """A block pressed by 10 on a plane and moved sideways with it; stepper, contact and plane."""
    msh = box(WORLD, (4, 4), "quadrilateral", [-0.5, 0.0], [0.5, 1.0], "scattered")
    V = vector_space(msh)
    u, top = fem.Function(V), plane(msh, 1, 1.0)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"unknown": kind} | ({"dt": 1.0} if kind == "velocity" else {})
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, floor, quadrature="overlay", penalty=1e4, **options)
    motion = fem.Constant(msh, np.zeros(2))
    bc = fem.dirichletbc(motion, fem.locate_dofs_topological(V, 1, top), V)
    problem = qs.ContactProblem([elastic(u, E=1e3, nu=0.0)], [u], [contact], [[bc]])

    def drive(t, dt):
        floor.displacement = [WAY * dt, 0.0]
        if kind == "velocity":
            motion.value = [WAY, -0.01]
        else:
            motion.value = [WAY * t, -0.01]

    return qs.TimeStepper(problem, 1.0, drive, theta=theta), contact, floor


@pytest.mark.parametrize("kind, theta", (("displacement", 0.5), ("velocity", 0.5), ("velocity", 0)))
def test_a_block_that_is_carried(kind, theta):
    """A block that moves with the tool has no moment about the tool's centre in any step."""
    stepper, contact, floor = carried(kind, theta)
    seen = []
    stepper.on_solved = lambda: seen.append(contact.moment("slave")[0])
    for i in range(1, 4):
        stepper.step()
        force = contact.force("slave")[1]
        assert force > 5
        assert abs(contact.moment("slave")[0]) < 1e-8 * force
        assert abs(contact.moment("master")[0]) < 1e-8 * force
        assert abs(seen[-1]) < 1e-8 * force
        # About a fixed point, the lever arm of the force is the displacement of the block.
        np.testing.assert_allclose(contact.moment("slave", [0.0, 0.0]), WAY * i * force, rtol=1e-8)
    np.testing.assert_allclose(floor.center, [3 * WAY, 0.0], atol=1e-12)


def rolled(gdim, theta, friction=None, **options):
    """A viscous block under a ball that moves and rotates: stepper, contact and ball."""
    shape = (8, 2) if gdim == 2 else (4, 3, 2)
    cell = "triangle" if gdim == 2 else "hexahedron"
    low, high = [-1.0, *[-0.5] * (gdim - 2), -0.5], [1.0, *[0.5] * (gdim - 2), 0.0]
    msh = box(WORLD, shape, cell, low, high, "scattered")
    V = vector_space(msh)
    v = fem.Function(V)
    ball = qs.RigidSurface.sphere(WORLD, [0.1, *[0.07] * (gdim - 2), 2.0], 2.0)
    surface = qs.Surface(V, facets=plane(msh, gdim - 1, 0.0))
    options |= {"unknown": "velocity", "dt": 1.0, "friction": friction}
    contact = qs.Contact(surface, ball, **options)
    bcs = [clamp(V, plane(msh, gdim - 1, -0.5))]
    problem = qs.ContactProblem([elastic(v, E=1e3)], [v], [contact], [bcs])

    def drive(t, dt):
        ball.displacement = [0.04, *[0.0] * (gdim - 2), -0.05]
        ball.rotation = [0.03] if gdim == 2 else [0.01, -0.03, 0.02]

    return qs.TimeStepper(problem, 1.0, drive, theta=theta), contact, ball


@pytest.mark.parametrize(
    "gdim, theta, options",
    (
        (2, 0.5, {}),
        (2, 0.0, {"enforcement": "penalty", "penalty": 1e4}),
        (2, 1.0, {"constraints": "points"}),
        (2, 0.5, {"sliding": "finite"}),
        (3, 0.5, {"quadrature": "nodal"}),
    ),
)
def test_a_round_tool_without_friction(gdim, theta, options):
    """Without friction every force acts through the centre of a round tool, wherever the mesh is.

    This holds within the step and after it.
    """
    stepper, contact, ball = rolled(gdim, theta, **options)
    seen = []
    stepper.on_solved = lambda: seen.append(contact.moment("master"))
    for _ in range(2):
        stepper.step()
        force = np.linalg.norm(contact.force("slave"))
        assert force > 1
        for moment in (seen[-1], contact.moment("master"), contact.moment("slave", ball.center)):
            np.testing.assert_allclose(moment, 0, atol=1e-10 * force)


@pytest.mark.parametrize("gdim, theta", ((2, 0.5), (3, 0.0)))
def test_torque_is_that_of_the_friction_that_acts(gdim, theta):
    """Torque · ω + force · v is the power of the nodal forces, at the nodes of the solution."""
    stepper, contact, ball = rolled(gdim, theta, qs.Coulomb(0.3), constraints="nodes")
    powers, v, omega = [], np.zeros(3), np.array([0.01, -0.03, 0.02])
    v[[0, gdim - 1]] = 0.04, -0.05

    def read():
        surface = contact.slave
        f, r = np.zeros((2, len(surface.node_area), 3))
        f[:, :gdim] = surface.node_values(contact.traction("slave")) * surface.node_area[:, None]
        r[:, :gdim] = surface.node_x[:, :gdim] - ball.center
        spin = np.array([0.0, 0.0, 0.03]) if gdim == 2 else omega
        powers.append(-WORLD.allreduce(np.sum(f * (v + np.cross(spin, r)))))

    stepper.on_solved = read
    for _ in range(2):
        stepper.step()
        spin = np.array([0.03]) if gdim == 2 else omega
        torque, force = contact.moment("master"), contact.force("master")
        assert np.linalg.norm(torque) > 0.1 * np.linalg.norm(force)
        np.testing.assert_allclose(torque @ spin + force @ v[:gdim], powers[-1], rtol=1e-10)


def test_a_surface_that_another_contact_has_read_since():
    """Moments refer to the solution, even if another contact has updated the shared surfaces.

    The moments of both sides balance.
    """
    pair = Pair("triangle")
    pair.problem().solve()
    sides = ("slave", "master")
    before = [pair.contact.moment(side)[0] for side in sides]
    assert abs(before[0]) > 1e-3 and abs(sum(before)) < 1e-2 * abs(before[0])
    for msh in pair.meshes:
        msh.geometry.x[:, 0] += 0.5
    qs.Contact(pair.slave, pair.master).update()
    after = [pair.contact.moment(side)[0] for side in sides]
    np.testing.assert_allclose(after, before, rtol=1e-10)
