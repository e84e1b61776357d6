"""Tools that spin in time steps with friction: how they got where they are does not count."""

import numpy as np
import pytest
from rigid_scenes import TOOLS
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

CENTER = np.array([0.5, 0.5, 1.0])


def turn(angle):
    """Position of a tool that has turned about the vertical through CENTER."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.column_stack([R, CENTER - R @ CENTER])


def spun(kind, before, num_pairings):
    """Slip, friction and energy after a tool has pressed on a block and spun on it in two steps."""
    msh = box(WORLD, (3, 3, 2), "hexahedron", [0.0] * 3, [1.0] * 3, "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = TOOLS[kind](WORLD, 3)
    tool.position = turn(before)
    surface = qs.Surface(V, facets=plane(msh, 2, 1.0))
    options = {"quadrature": "nodal", "friction": qs.Coulomb(0.3)}
    contact = qs.Contact(surface, tool, "master-slave", **options)
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
    """A tool that has turned by any angle before does the same, if it is a plane."""
    first = spun(kind, 0.0, num_pairings)
    other = spun(kind, 1.0, num_pairings)
    for a, b in zip(first, other, strict=True):
        assert largest(np.asarray(a) - b) < 1e-6 * largest(np.asarray(a))
    assert first[2] > 0 and first[3] > 1e-4


@pytest.mark.parametrize("turns", ((0.2, 0.0), (0.1, -0.1), (0.3, 0.0, 0.0)))
@pytest.mark.parametrize("shape", ("cylinder", "facets"))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_a_round_tool_turns_in_place(enforcement, shape, turns):
    """Nothing changes: its points go away from where they are paired, and others come."""
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
    # The polygon has other facets there, and pairs once more in the step in which it stops.
    rtol = 2e-3 if shape == "cylinder" else 6e-3
    np.testing.assert_allclose(forces, forces[0], rtol=rtol)
    assert abs(forces[0]) > 1e-3


@pytest.mark.parametrize("num_pairings", (1, 2))
@pytest.mark.parametrize("theta", (0.0, 0.5))
def test_roll_that_turns_under_a_fluid(theta, num_pairings):
    """A cylinder that turns in place, without friction, changes nothing, however far it turns."""
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
