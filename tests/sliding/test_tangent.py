"""The derivative of R(z) with finite sliding agrees with differences."""

import numpy as np
import pytest
from following import Body, problem_of, rotation
from friction.test_friction import quadratic_space
from scenes import WORLD, Pair, box, drag_top, largest, plane, vector_space
from system.test_equations import away, equations_of, errors

import qsdolfinx as qs
from qsdolfinx.pairing.pair import LEAST_COVER
from qsdolfinx.system.equations import Equations

#: Cells and their spaces.
KINDS = {
    "triangle": vector_space,
    "quadrilateral": vector_space,
    "tetrahedron": vector_space,
    "hexahedron": vector_space,  # facets are warped
    "quadrilateral, P2": quadratic_space,
    "tetrahedron, P2": quadratic_space,
}


def near(equations, pressure):
    """Return unknowns near a state that presses all nodes by a given amount."""
    z, scale = away(equations, size=0.01)
    for i, body in enumerate(equations.system.bodies):
        equations.part(z, i)[:] = body.with_conditions(equations.part(z, i))
    for values in equations.multipliers(z):
        values.normal[:] += pressure
    return z, scale


def closed(equations):
    """Return unknowns with all points in contact."""
    z, scale = near(equations, 5.0)
    assert all(np.all(e.active) for e in equations.evaluate(z).passes)
    return z, scale


def closed_in_part(equations, size=0.15):
    """Return unknowns with partly active segments, whose points move with the segments."""
    z, scale = near(equations, 0.0)
    trial = equations.evaluate(z).passes[0].normal.trial
    mean = np.divide(*WORLD.allreduce(np.array([trial.sum(), len(trial)])))
    for values in equations.multipliers(z):
        values.normal[::2] += size - mean
        values.normal[1::2] -= size + mean
    active = equations.evaluate(z).passes[0].active
    count = WORLD.allreduce(np.array([np.count_nonzero(active), len(active)]))
    assert 0 < count[0] < count[1]
    return z, scale


@pytest.mark.parametrize(
    ("kind", "formulation", "state"),
    [
        (kind, ("master-slave", "quasi-symmetric")[i % 2], state)
        for i, kind in enumerate(KINDS)
        for state in (closed, closed_in_part)
    ],
)
def test_derivative(kind, formulation, state):
    """The derivative by all unknowns is right, also at open ends and for moving functions."""
    options, cell = {"sliding": "finite"}, kind.partition(",")[0]
    space = KINDS[kind]
    pair = Pair(cell, formulation=formulation, space=space, contact_options=options, wave=0.02)
    _, equations = equations_of(pair)
    assert errors(equations, *state(equations)) < 1e-8


@pytest.mark.parametrize("state", (closed, closed_in_part))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
def test_friction(cell, state):
    """The same holds with slip, whose limits move with the points and which turns with facets."""
    options = {"sliding": "finite", "friction": qs.Coulomb(0.3)}
    pair = Pair(cell, contact_options=options, wave=0.02)
    _, equations = equations_of(pair)
    assert errors(equations, *state(equations)) < 1e-8


@pytest.mark.parametrize(
    "options", ({"friction_penalty": 30.0}, {"unknown": "velocity", "dt": 0.5})
)
def test_factors(options):
    """Equations of slips have a factor of their own, and velocities count times the step."""
    options |= {"sliding": "finite", "friction": qs.Coulomb(0.3)}
    pair = Pair("triangle", contact_options=options, wave=0.02)
    _, equations = equations_of(pair)
    assert errors(equations, *closed_in_part(equations)) < 1e-8


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_round_tool(cell, friction):
    """Gaps to an analytic tool have its curvature, and slips its tangent planes."""
    gdim = 2 if cell == "triangle" else 3
    body = Body(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    tool = qs.RigidSurface.sphere(WORLD, [0.4] * (gdim - 1) + [1.9], 1.0)
    contact = qs.Contact(body.side(gdim - 1, 1.0), tool, sliding="finite", friction=friction)
    problem = problem_of([body], [contact], solver="direct")
    problem.set_up()
    equations = Equations(problem.system)
    z, scale = near(equations, 5.0)
    assert WORLD.allreduce(int(np.count_nonzero(equations.evaluate(z).passes[0].active))) > 3
    assert errors(equations, z, scale) < 1e-8


def test_round_tool_on_rings():
    """The same holds where areas grow with the radius."""
    body = Body(box(WORLD, (3, 3), "triangle", (0.2, 0.0), (1.2, 1.0)), axisymmetric=True)
    body.clamp(plane(body.mesh, 1, 0.0))
    tool = qs.RigidSurface.sphere(WORLD, [0.0, 1.9], 1.0)
    equations = equations_between([body], body.side(1, 1.0), tool, friction=qs.Coulomb(0.3))
    assert errors(equations, *near(equations, 5.0)) < 1e-8


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_without_cover(cell):
    """Points with nothing opposite are not active at any pressure, and the derivative is right."""
    up = (2 if cell == "triangle" else 3) - 1
    low = Body(box(WORLD, [3] * (up + 1), cell, [0.0] * (up + 1), [1.0] * (up + 1)))
    ends = [-1.0] * up + [1.0], [2.0] * up + [2.0]
    high = Body(box(WORLD, [8] * up + [1], cell, *ends))
    low.clamp(plane(low.mesh, up, 0.0))
    high.clamp(plane(high.mesh, up, 2.0))
    options = {"enforcement": "penalty", "penalty": 1e4}
    equations = equations_between([high, low], high.side(up, 1.0), low.side(up, 1.0), **options)
    z, scale = near(equations, 1e5)  # so large that points so far away would be active
    scale[:] = 1e4
    equations.bodies_of(scale)[:] = 0.0  # the areas that are added to these are constant
    active = equations.evaluate(z).passes[0].active
    num_alone = equations.passes[0].gap.num_alone
    assert WORLD.allreduce(num_alone) > 0
    paired = len(active) - num_alone
    assert active[:paired].all() and not active[paired:].any()
    assert errors(equations, z, scale) < 1e-8


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_nodes_that_lose_cover(cell, formulation, friction):
    """What a node that was covered loses is added to it, and the derivative contains this part."""
    up = (2 if cell == "triangle" else 3) - 1
    low = Body(box(WORLD, [3] * (up + 1), cell, [-0.35] * up + [0.0], [1.35] * up + [1.0]))
    high = Body(box(WORLD, [3] * up + [1], cell, [-1.0] * up + [1.0], [2.0] * up + [2.0]))
    low.clamp(plane(low.mesh, up, 0.0))
    options = {"formulation": formulation, "friction": friction}
    equations = equations_between([high, low], high.side(up, 1.0), low.side(up, 1.0), **options)
    z, scale = near(equations, 5.0)
    equations.part(z, 0).reshape(-1, up + 1)[:, 0] -= 0.1
    equations.evaluate(z)
    gap = equations.passes[0].gap
    covered = gap.cut.found.cover[:, 0] / gap.slave.node_area
    assert WORLD.allreduce(int(np.count_nonzero((covered > 0.01) & (covered < LEAST_COVER)))) > 0
    assert errors(equations, z, scale) < 1e-8


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("opposite", ("tool", "body"))
@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_facets_that_lean(cell, opposite, friction):
    """Facets at angles from 45° to 66° have a part of their weight, which turns with both."""
    gdim = 2 if cell == "triangle" else 3
    low, high = [0.0] * gdim, [1.0] * gdim
    body = Body(box(WORLD, [3] * gdim, cell, low, high, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    bodies, top, angle = [body], body.side(gdim - 1, 1.0), np.radians(53.0)
    if opposite == "tool":
        corners = [[-0.3, 0.98], [0.4, 0.98], [0.8, 0.98 + 0.4 * np.tan(angle)]]
        sides = [[0, 1], [1, 2]]
        if gdim == 3:
            corners = [[x, y, z] for y in (-0.3, 1.4) for x, z in corners]
            sides = [[0, 4, 1], [0, 3, 4], [1, 5, 2], [1, 4, 5]]
        other = qs.RigidSurface.triangulated(WORLD, corners, sides)
    else:
        ends = [-0.2, *[0.1] * (gdim - 2), 0.98], [0.9] * (gdim - 1) + [2.0]
        second = Body(box(WORLD, [2] * gdim, cell, *ends))
        x, facets = second.mesh.geometry.x, plane(second.mesh, gdim - 1, 0.98)
        x[:, gdim - 1] += np.maximum(x[:, 0] - 0.35, 0.0) * np.tan(angle)
        bodies.append(second)
        other = second.surface(facets)
    equations = equations_between(bodies, top, other, friction=friction)
    z, scale = near(equations, 50.0)
    active, gap = equations.evaluate(z).passes[0].active, equations.passes[0].gap
    x = gap.following.points(gap.cut)[0]
    assert WORLD.allreduce(int(np.count_nonzero(active[: len(x)] & (x[:, 0] > 0.42)))) > 0
    assert errors(equations, z, scale) < 1e-8


def equations_between(bodies, *surfaces, **options):
    problem = problem_of(bodies, [qs.Contact(*surfaces, sliding="finite", **options)])
    problem.set_up()
    return Equations(problem.system)


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_rings(cell):
    """The same holds for rings, whose areas grow with their radius."""
    sizes = ((3, 2), (0.2, 0.5), (1.0, 1.0)), ((4, 2), (0.3, 1.0), (1.2, 1.5))
    bodies = [
        Body(box(WORLD, n, cell, low, high, "scattered"), axisymmetric=True)
        for n, low, high in sizes
    ]
    for body, at in zip(bodies, (0.5, 1.5), strict=True):
        body.clamp(plane(body.mesh, 1, at))
    sides = [body.side(1, 1.0) for body in bodies]
    equations = equations_between(bodies, *sides, friction=qs.Coulomb(0.3))
    assert errors(equations, *closed_in_part(equations, 0.5)) < 1e-8


def uneven_facets(gdim):
    """Corners and facets of a rigid surface over a block, with an edge."""
    corners = [[-0.3, 1.0], [0.45, 0.98], [1.4, 1.01]]
    if gdim == 2:
        return corners, [[0, 1], [1, 2]]
    corners = [[x, y, z] for y in (-0.3, 1.4) for x, z in corners]
    return corners, [[0, 4, 1], [0, 3, 4], [1, 5, 2], [1, 4, 5]]


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("driven", (False, True))
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_tool_of_facets(cell, driven, friction):
    """A body in front of a faceted rigid tool, with segmentation of both; a force moves the tool.

    The tool's row and column have the curvature of gaps and the motion of points, too.
    """
    gdim = 2 if cell == "quadrilateral" else 3
    body = Body(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    tool = qs.RigidSurface.triangulated(WORLD, *uneven_facets(gdim))
    top = body.side(gdim - 1, 1.0)
    if driven:
        tool.drive(0.1, [0.4] + [0.0] * (gdim - 2) + [-1.0])
    equations = equations_between([body], top, tool, friction=friction)
    assert len(equations.tools) == int(driven)
    assert errors(equations, *closed_in_part(equations, 1.0)) < 1e-8


#: Rotations of bodies within a step: in the plane, or about an axis that is not in the surface.
TURN, AXIS = np.radians(15.0), {2: None, 3: (0.2, 1.0, 0.4)}


def turned_from_a_step(problem, bodies, center):
    """Unknowns near bodies that turn with friction left from the last step, and the equations.

    Args:
        problem: The problem, after a step with friction.
        bodies: Displacements of the bodies.
        center: A point that stays where it is.
    """
    equations, gdim = Equations(problem.system), len(center)
    z, (_, scale) = equations.first(), away(equations, size=0.01)
    rng, R = np.random.default_rng((5, WORLD.rank)), rotation(TURN, AXIS[gdim])
    for i, u in enumerate(bodies):
        part, x = equations.part(z, i), u.function_space.tabulate_dof_coordinates()[:, :gdim]
        now = x + u.x.array.reshape(-1, gdim) - center
        part += (now @ (R - np.eye(gdim)).T).ravel()[: len(part)]
        part += 0.005 * rng.uniform(-1, 1, len(part))
        part[:] = equations.system.bodies[i].with_conditions(part)
    return equations, z, scale


def keeps_friction(equations, z):
    """Assert that tractions have a part that multipliers of nodes do not contain. Collective."""
    at = equations.evaluate(z).passes
    rest, tractions = (
        largest(*values)
        for values in (
            [p.slip.state.rest for p in equations.passes],
            [e.tangential.traction for e in at],
        )
    )
    assert rest > 0.01 * tractions > 0


@pytest.mark.parametrize("options", ({}, {"friction_penalty": 30.0}))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("kind", KINDS)
def test_friction_that_turns(kind, formulation, options):
    """The derivative is right where friction of the last step turns with bodies that turn."""
    options = {"sliding": "finite", "friction": qs.Coulomb(0.3)} | options
    cell = kind.partition(",")[0]
    pair = Pair(cell, formulation, space=KINDS[kind], contact_options=options, wave=0.02)
    drag_top(pair, 0.02, -0.05)
    problem = pair.problem(solver="direct")
    qs.TimeStepper(problem, 1.0).step()
    equations, z, scale = turned_from_a_step(problem, pair.u, np.zeros(pair.gdim))
    keeps_friction(equations, z)
    assert errors(equations, z, scale) < 1e-8


@pytest.mark.parametrize("options", ({}, {"friction_penalty": 30.0}))
@pytest.mark.parametrize("shape", ("sphere", "facets"))
@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_friction_that_turns_with_a_tool(cell, shape, options):
    """The same holds for tools that turn, round or made of facets."""
    gdim = 2 if cell == "triangle" else 3
    body = Body(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    if shape == "sphere":
        tool = qs.RigidSurface.sphere(WORLD, [0.4] * (gdim - 1) + [1.99], 1.0)
    else:
        tool = qs.RigidSurface.triangulated(WORLD, *uneven_facets(gdim))
    options = {"sliding": "finite", "friction": qs.Coulomb(0.3)} | options
    contact = qs.Contact(body.side(gdim - 1, 1.0), tool, **options)
    problem = problem_of([body], [contact], solver="direct")

    def drive(t, dt):
        tool.displacement = [0.02, *[0.0] * (gdim - 2), -0.05]

    qs.TimeStepper(problem, 1.0, drive).step()
    axis = AXIS[gdim]
    tool.rotation = TURN if axis is None else TURN * np.array(axis) / np.linalg.norm(axis)
    equations, z, scale = turned_from_a_step(problem, [body.u], tool.center[:gdim])
    keeps_friction(equations, z)
    assert errors(equations, z, scale) < 1e-8
