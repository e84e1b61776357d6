"""Force-controlled tools: number of Newton steps to equilibrium, and steps that are too long."""

import numpy as np
import pytest
from rigid_scenes import TOOLS, Pressed, flat
from scenes import (
    WORLD,
    box,
    clamp,
    elastic,
    largest,
    plane,
    raises_everywhere,
    vector_space,
)

import ufl
from dolfinx import fem

import qsdolfinx as qs

#: Newton iterations on linear bodies: a solve at the tool's position, one after its only step.
ONE_STEP = 2

#: A compliant tie, so that force over displacement is a finite stiffness at clamped nodes as well.
SOFT = {"enforcement": "penalty", "penalty": 50.0}


def held_at_a_side(cell, tool="analytic", sides=(0.0,), **options):
    """A block tied to a tool on its top, and clamped at sides that reach up to the tool."""
    scene = Pressed(cell, TOOLS[tool], law=qs.Tied(), **(SOFT | options))
    facets = np.concatenate([plane(scene.mesh, 0, x) for x in sides])
    bcs = [clamp(scene.V, facets)]
    scene.problem = qs.ContactProblem([scene.F], [scene.u], [scene.contact], [bcs])
    return scene


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_conditions_at_a_corner_of_the_contact(cell, tool, quadrature, formulation):
    """Force over displacement is linear, so Newton's method takes one step of the tool.

    It takes more if the tool's step is assumed to move unknowns that conditions hold.
    """
    options = {"quadrature": quadrature, "formulation": formulation}
    scene = held_at_a_side(cell, tool, **options)
    d, contact = scene.gdim, scene.contact
    held = np.isclose(scene.surface.node_x[:, 0], 0)
    assert WORLD.allreduce(np.count_nonzero(held)) > 0
    for direction in (np.eye(d)[-1], np.eye(d)[0], np.ones(d) / np.sqrt(d)):
        scene.tool.release()
        scene.tool.displacement = 0.01 * direction
        scene.problem.solve()
        borne = contact.force("slave") @ direction
        u = scene.u.x.array.copy()
        assert borne > 1e-3
        for factor in (3.0, -1.0):
            scene.tool.drive(factor * borne, direction)
            scene.tool.displacement = np.zeros(d)
            scene.u.x.array[:] = 0
            scene.problem.solve()
            moved = scene.tool.displacement
            np.testing.assert_allclose(moved, 0.01 * factor * direction, rtol=1e-7, atol=1e-10)
            np.testing.assert_allclose(contact.force("master") @ direction, -factor * borne)
            assert largest(scene.u.x.array - factor * u) < 1e-7 * largest(u)
            assert scene.problem.num_iterations <= ONE_STEP


@pytest.mark.filterwarnings("ignore:bcs")  # the tool moves clamped nodes
def test_tied_to_clamped_nodes():
    """Clamped nodes stay, whether the tool was moved before or is force-controlled at once."""
    for moved in (False, True):
        scene = held_at_a_side("triangle", enforcement="augmented-lagrangian")
        if moved:
            scene.tool.displacement = [0.0, 0.01]
            scene.problem.solve()
            scene.tool.displacement = [0.0, 0.0]
        scene.tool.drive(0.05, [0.0, 1.0])
        scene.problem.solve()
        np.testing.assert_allclose(scene.tool.displacement, 0.0, atol=1e-8)
        np.testing.assert_allclose(scene.contact.force("slave")[1], 0.05, rtol=2e-8)


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_two_tools_that_feel_each_other(cell, tool):
    """Tools tied to the top and to a side are coupled; one Newton step balances both."""
    scene = Pressed(cell, TOOLS[tool], n=2, law=qs.Tied(), **SOFT)
    d, normal = scene.gdim, np.eye(scene.gdim)[0]
    side = qs.RigidSurface.plane(WORLD, normal, -normal)
    surface = qs.Surface(scene.V, facets=plane(scene.mesh, 0, 1.0))
    second = qs.Contact(surface, side, formulation="master-slave", law=qs.Tied(), **SOFT)
    contacts, bcs = [scene.contact, second], [[clamp(scene.V, plane(scene.mesh, 0, 0.0))]]
    problem = qs.ContactProblem([scene.F], [scene.u], contacts, bcs)
    directions = -np.eye(d)[-1], np.eye(d)[-1] + 0.5 * normal
    for tool_i, force, direction in zip((scene.tool, side), (0.02, 0.05), directions, strict=True):
        tool_i.drive(force, direction)
    problem.solve()
    for contact, force, direction in zip(contacts, (0.02, 0.05), directions, strict=True):
        along = direction / np.linalg.norm(direction)
        np.testing.assert_allclose(contact.force("master") @ along, -force, rtol=2e-8)
    assert problem.num_iterations <= ONE_STEP
    alone = []
    for i in range(2):  # each moves the other
        moved = [tool_i.displacement.copy() for tool_i in (scene.tool, side)]
        (side, scene.tool)[i].release()
        (side, scene.tool)[i].displacement = np.zeros(d)
        problem.solve()
        alone.append(np.abs((scene.tool, side)[i].displacement - moved[i]).max())
        (side, scene.tool)[i].drive(0.05 if i == 0 else 0.02, directions[1 - i])
        problem.solve()
    assert min(alone) > 1e-4


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_friction_that_sticks(cell, quadrature):
    """A tool that is driven sideways while the surface sticks to it, clamped at its corner."""
    options = {"quadrature": quadrature, "friction": qs.Sticking()} | SOFT
    scene = Pressed(cell, flat, **options)
    d, contact = scene.gdim, scene.contact
    bcs = [clamp(scene.V, plane(scene.mesh, 0, 0.0)), clamp(scene.V, plane(scene.mesh, d - 1, 0.0))]
    problem = qs.ContactProblem([scene.F], [scene.u], [contact], [bcs])
    down, way = -np.eye(d)[-1], np.eye(d)[0]
    scene.tool.displacement = 0.05 * down
    problem.solve()
    closed = WORLD.allreduce(np.count_nonzero(contact.active()))
    scene.tool.drive(0.02, way)
    problem.solve()
    np.testing.assert_allclose(contact.force("slave") @ way, 0.02, rtol=2e-8)
    assert scene.tool.displacement @ way > 1e-4
    assert closed == WORLD.allreduce(np.count_nonzero(contact.active()))
    assert problem.num_iterations <= ONE_STEP


def test_a_tool_that_slips_beside_one_that_holds():
    """Friction makes the tangent unsymmetric, and still one step balances both tools.

    The effect of one tool on the other is not the effect of the other on it.
    """
    scene = Pressed("quadrilateral", flat, n=3, friction=qs.Coulomb(0.4), **SOFT)
    side = qs.RigidSurface.plane(WORLD, [1.0, 0.0], [-1.0, 0.0])
    surface = qs.Surface(scene.V, facets=plane(scene.mesh, 0, 1.0))
    second = qs.Contact(surface, side, formulation="master-slave", law=qs.Tied(), **SOFT)
    bcs = [clamp(scene.V, plane(scene.mesh, 1, 0.0))]
    problem = qs.ContactProblem([scene.F], [scene.u], [scene.contact, second], [bcs])
    for shift in (0.0, 0.5):
        scene.tool.displacement = [shift, -0.05]
        problem.solve()
    before = [contact.force("master") for contact in (scene.contact, second)]
    scene.tool.displacement = [1.0, -0.05]  # it continues to slip
    scene.tool.drive(1.1 * before[0][1], [0.0, -1.0])
    side.drive(0.02, [0.0, 1.0])
    problem.solve()
    force, slipping, active = (
        scene.contact.force("slave"),
        WORLD.allreduce(np.count_nonzero(scene.contact.slipping())),
        WORLD.allreduce(np.count_nonzero(scene.contact.active())),
    )
    np.testing.assert_allclose(force, 1.1 * before[0][1] * np.array([0.4, -1.0]), rtol=1e-7)
    np.testing.assert_allclose(second.force("slave")[1], 0.02, rtol=2e-8)
    assert slipping == active > 0
    assert problem.num_iterations <= ONE_STEP


# --- Steps that are too long


def soft_block():
    """A neo-Hookean block tied to a tool, and its problem."""
    scene = Pressed("triangle", flat, n=2, law=qs.Tied())
    F = ufl.Identity(2) + ufl.grad(scene.u)
    J = ufl.det(F)
    energy = 0.5 * (ufl.tr(F.T * F) - 2 - 2 * ufl.ln(J)) + 1.5 * ufl.ln(J) ** 2
    form = ufl.derivative(energy * ufl.dx, scene.u, ufl.TestFunction(scene.V))
    return scene, qs.ContactProblem([form], [scene.u], [scene.contact], [scene.bcs])


def test_a_step_that_bodies_cannot_follow():
    """The solve converges although a full Newton step would invert the soft, stretched block."""
    scene, problem = soft_block()
    scene.tool.drive(4.0, [0.0, 1.0])
    problem.solve()
    stretched = scene.tool.displacement[1]
    scene.tool.drive(1.0, [0.0, -1.0])
    problem.solve()
    assert stretched > 2
    np.testing.assert_allclose(scene.contact.force("slave")[1], -1.0, rtol=2e-8)
    other, easy = soft_block()
    other.tool.drive(1.0, [0.0, -1.0])
    easy.solve()
    np.testing.assert_allclose(scene.tool.displacement, other.tool.displacement, rtol=1e-6)
    assert largest(scene.u.x.array - other.u.x.array) < 1e-6


def test_solve_that_fails():
    """After a solve that fails, the angle of a moment-controlled tool is that of before."""
    msh = box(WORLD, (4, 4), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, bcs = fem.Function(V), [clamp(V, plane(msh, 1, 0.0))]
    tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(surface, tool, law=qs.Tied(), sliding="finite")
    options = {"snes_max_it": 1}
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs], petsc_options=options)
    tool.displacement, tool.rotation = [0.01, 0.02], [0.03]
    tool.drive_moment(0.1)
    raises_everywhere(WORLD, qs.ConvergenceError, "", problem.solve)
    np.testing.assert_array_equal(tool.displacement, [0.01, 0.02])
    np.testing.assert_array_equal(tool.rotation, [0.03])


@pytest.mark.parallel
def test_a_tool_that_passes_to_a_pad_on_another_rank():
    """When one pad is lowered, the tool rests on the other one alone, which another rank has."""
    tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    forms, unknowns, contacts, conditions, bases = [], [], [], [], []
    for left, height, partition in ((0.0, 1.0, "first"), (2.0, 0.95, "last")):
        msh = box(WORLD, (2, 2), "quadrilateral", [left, 0.0], [left + 1, height], partition)
        V = vector_space(msh)
        unknowns.append(fem.Function(V))
        forms.append(elastic(unknowns[-1]))
        bases.append(fem.Constant(msh, (0.0, 0.0)))
        base = fem.locate_dofs_topological(V, 1, plane(msh, 1, 0.0))
        conditions.append([fem.dirichletbc(bases[-1], base, V)])
        top = qs.Surface(V, facets=plane(msh, 1, height))
        contacts.append(qs.Contact(top, tool, search_radius=0.5))
    problem = qs.ContactProblem(forms, unknowns, contacts, conditions)
    tool.drive(0.01, [0.0, -1.0])
    for way, pressed in ((0.0, (1, 0)), (-0.2, (0, 1))):
        bases[0].value = 0.0, way
        problem.solve()
        forces = [contact.force("master")[1] for contact in contacts]
        np.testing.assert_allclose(forces, 0.01 * np.array(pressed), atol=1e-9)
