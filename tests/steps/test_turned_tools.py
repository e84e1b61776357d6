"""Tools that rotate in time steps with friction: their earlier rotation has no effect."""

import numpy as np
import pytest
from rigid_scenes import TOOLS
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs

CENTER = np.array([0.5, 0.5, 1.0])


def turn(angle):
    """Position of a tool that is rotated about the vertical through CENTER."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.column_stack([R, CENTER - R @ CENTER])


def spun(kind, before, num_pairings):
    """Slip, friction and energy after a tool was pressed on a block and rotated, in two steps."""
    msh = box(WORLD, (3, 3, 2), "hexahedron", [0.0] * 3, [1.0] * 3, "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = TOOLS[kind](WORLD, 3)
    tool.position = turn(before)
    surface = qs.Surface(V, facets=plane(msh, 2, 1.0))
    options = {"quadrature": "nodal", "friction": qs.Coulomb(0.3)}
    contact = qs.Contact(surface, tool, formulation="master-slave", **options)
    bcs = [clamp(V, plane(msh, 2, 0.0))]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])

    def drive(t, dt):
        tool.displacement = [0.0, 0.0, -0.05 if t < 1.5 else 0.0]
        tool.rotation = [0.0, 0.0, 0.0 if t < 1.5 else 0.03]

    stepper = qs.TimeStepper(problem, 1.0, drive, num_pairings=num_pairings)
    for _ in range(3):
        stepper.step()
    order = np.lexsort(np.round(surface.node_x, 6).T)
    slip, tau = contact.slip()[order], contact.tangential_multiplier()[order]
    closed = WORLD.allreduce(np.count_nonzero(contact.active()))
    assert closed == WORLD.allreduce(len(slip))
    return slip, tau, contact.dissipated_energy(), contact.moment("slave")[2]


@pytest.mark.parametrize("num_pairings", (1, 2))
@pytest.mark.parametrize("kind", TOOLS)
def test_where_the_tool_comes_from(kind, num_pairings):
    """A plane that was rotated by any angle before gives the same results."""
    first = spun(kind, 0.0, num_pairings)
    other = spun(kind, 1.0, num_pairings)
    for a, b in zip(first, other, strict=True):
        assert largest(np.asarray(a) - b) < 1e-6 * largest(np.asarray(a))
    assert first[2] > 0 and first[3] > 1e-4


@pytest.mark.parametrize("turns", ((0.2, 0.0), (0.1, -0.1), (0.3, 0.0, 0.0)))
@pytest.mark.parametrize("shape", ("cylinder", "facets"))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_a_round_tool_turns_in_place(enforcement, shape, turns):
    """Rotation of a round tool in place changes nothing, although its contact points change."""
    msh = box(WORLD, (12, 4), "quadrilateral", [0.0, -1.0], [3.0, 0.0], "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    radius, center = 1.6, [1.5, 1.6]
    if shape == "cylinder":
        tool = qs.RigidSurface.cylinder(WORLD, center, None, radius)
    else:
        angle = np.linspace(-np.pi, np.pi, 80, endpoint=False)
        x = radius * np.column_stack([np.cos(angle), np.sin(angle)]) + center
        i = np.arange(80)
        tool = qs.RigidSurface.triangulated(WORLD, x, np.column_stack([i, (i + 1) % 80]), center)
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, tool, quadrature="overlay", enforcement=enforcement)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, -1.0))]])

    def drive(t, dt):
        tool.displacement = [0.0, -0.03 if t < 1.5 else 0.0]
        tool.rotation = 0.0 if t < 1.5 else turns[round(t) - 2]

    stepper = qs.TimeStepper(problem, 1.0, drive)
    forces = []
    for _ in stepper.run(1.0 + len(turns)):
        forces.append(contact.force("master")[1])
    # The polygon has other facets there, and contact is updated once more in the step of the stop.
    rtol = 2e-3 if shape == "cylinder" else 8e-3
    np.testing.assert_allclose(forces, forces[0], rtol=rtol)
    assert abs(forces[0]) > 1e-3


@pytest.mark.parametrize("num_pairings", (1, 2))
@pytest.mark.parametrize("theta", (0.0, 0.5))
def test_roll_that_turns_under_a_fluid(theta, num_pairings):
    """A frictionless cylinder that rotates in place changes nothing, at any angle."""
    found = []
    for angle in (0.0, 0.05, 0.3):
        msh = box(WORLD, (16, 8), "quadrilateral", [0.0, 0.0], [2.0, 1.0])
        V = vector_space(msh)
        u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
        roll = qs.RigidSurface.cylinder(WORLD, [1.0, -0.8], None, 0.8)
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        options = {"quadrature": "overlay", "enforcement": "augmented-lagrangian", "dt": 1.0}
        contact = qs.Contact(surface, roll, unknown="velocity", **options)
        bcs = [fem.dirichletbc(top, dofs, V)]
        problem = qs.ContactProblem([elastic(u, E=100.0)], [u], [contact], [bcs])

        def drive(t, dt, roll=roll, top=top, angle=angle):
            top.value[:] = (0.0, -0.025 if t < 1.5 else -0.005)
            roll.rotation = [angle if 2.5 < t < 4.5 else 0.0]

        stepper = qs.TimeStepper(problem, 1.0, drive, theta=theta, num_pairings=num_pairings)
        forces = []
        for _ in stepper.run(5.0):
            forces.append(contact.force("slave"))
        found.append(np.array(forces))
    assert np.all(found[0][:, 1] > 0.3)
    for forces in found[1:]:
        np.testing.assert_allclose(forces, found[0], rtol=2e-3, atol=1e-3)


ROLLER = np.array([0.5, -1.0])


def pressed_block():
    """A block on the roller: residual, displacement and conditions; value at its top; surface."""
    msh = box(WORLD, (6, 6), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "scattered")
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    dofs = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
    bcs = [fem.dirichletbc(top, dofs, V)]
    return (elastic(u, E=1e3), u, bcs), top, qs.Surface(V, facets=plane(msh, 1, 0.0))


def rigid_roller(shape):
    """A round tool of radius 1; with facets of 0.05 a rotation by facets maps it to itself."""
    if shape == "cylinder":
        return qs.RigidSurface.cylinder(WORLD, ROLLER, None, 1.0)
    i = np.arange(126)
    x = np.column_stack([np.cos(2 * np.pi * i / 126), np.sin(2 * np.pi * i / 126)]) + ROLLER
    return qs.RigidSurface.triangulated(WORLD, x, np.column_stack([i, (i + 1) % 126]), ROLLER)


def elastic_roller():
    """Half of an elastic ring: residual, displacement and conditions; value at its hub; surface."""
    msh = box(WORLD, (4, 63), "quadrilateral", [0.5, 0.0], [1.0, 63 * 0.05])
    outside, inside = plane(msh, 0, 1.0), plane(msh, 0, 0.5)
    radius, angle = msh.geometry.x[:, 0].copy(), msh.geometry.x[:, 1] + np.pi / 2 - 31.5 * 0.05
    msh.geometry.x[:, :2] = ROLLER + (radius * np.stack([np.cos(angle), np.sin(angle)])).T
    V = vector_space(msh)
    u, hub, v = fem.Function(V), fem.Function(V), ufl.TestFunction(V)
    bcs = [fem.dirichletbc(hub, fem.locate_dofs_topological(V, 1, inside))]
    F = ufl.inner(qs.materials.neo_hookean(u, 4e4, 6e4), ufl.grad(v)) * ufl.dx(degree=3)
    return (F, u, bcs), hub, qs.Surface(V, facets=outside)


def forces(contact, problem, drive):
    """Contact forces of three steps."""
    stepper = qs.TimeStepper(problem, 1.0, drive)
    return np.array([contact.force("slave")[1] for _ in stepper.run(3.0)])


@pytest.mark.parametrize("depths", ((0.02, 0.02, 0.02), (0.005, 0.01, 0.02)))
@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)))
@pytest.mark.parametrize("shape", ("cylinder", "facets"))
def test_a_roller_that_turns_as_it_begins_to_press(shape, friction, depths):
    """A rotation as a roller begins to press does not change forces, as the distance is the same.

    A gap that is linear in the rotation would open by R φ²/2, 0.12 facets.
    """

    def pressed(angle):
        (F, u, bcs), top, surface = pressed_block()
        tool = rigid_roller(shape)
        contact = qs.Contact(surface, tool, friction=friction)

        def drive(t, dt):
            top.value[1], tool.rotation = -depths[round(t) - 1], angle

        return forces(contact, qs.ContactProblem([F], [u], [contact], [bcs]), drive)

    turn = 4 * 2 * np.pi / 126
    rests = pressed(0.0 if friction is None else turn / 4)
    assert np.all(rests > 1.0)
    np.testing.assert_allclose(pressed(turn), rests, rtol=1e-2)
    np.testing.assert_allclose(pressed(-turn), rests, rtol=1e-2)


@pytest.mark.parametrize("role", ("slave", "master"))
def test_a_body_that_turns_as_it_begins_to_press(role):
    """A rotation does not change forces either if the roller is a body rotated by its hub."""

    def pressed(angle):
        (F, u, bcs), top, surface = pressed_block()
        (F_roller, u_roller, bcs_roller), hub, outside = elastic_roller()
        both = [outside, surface] if role == "slave" else [surface, outside]
        contact = qs.Contact(*both, formulation="master-slave")

        def drive(t, dt):
            top.value[1] = -0.01 * t
            c, s = np.cos(angle * t) - 1, np.sin(angle * t)
            hub.interpolate(lambda x: np.array([[c, -s], [s, c]]) @ (x[:2] - ROLLER[:, None]))

        forms, unknowns = [F, F_roller], [u, u_roller]
        problem = qs.ContactProblem(forms, unknowns, [contact], [bcs, bcs_roller])
        return np.abs(forces(contact, problem, drive))

    rests = pressed(0.0)
    assert np.all(rests > 1.0)
    np.testing.assert_allclose(pressed(0.2), rests, rtol=1e-2)
