"""Motion of rigid tools: prescribed, advanced, and force-controlled; Hertz contact."""

import numpy as np
import pytest
from rigid_scenes import TOOLS, Pressed, flat, sphere_facets
from scenes import LAWS, WORLD, box, elastic, largest, plane, raises_everywhere, slide, vector_space

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import active_set, terms
from qsdolfinx.surface.affine import rotation_matrix
from qsdolfinx.tools.driven import Driven

QUADRATURES = ("nodal", "overlay")


def gaps_at_rest(scene):
    """ḡ for u = 0, with the tool at its position after the motion."""
    scene.problem.set_up()
    zero = scene.surface.create_vec()
    terms.evaluate(scene.contact.model, zero, None)
    return scene.contact.weighted_gap()


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_displacement_or_pairing_anew(cell, tool, quadrature):
    """A plane displaced over a step, or advanced to the same position, gives the same gaps."""
    scene = Pressed(cell, TOOLS[tool], quadrature=quadrature, normals="facet")
    scene.tool.displacement = np.array([0.03, -0.02, -0.05])[-scene.gdim :]
    before = gaps_at_rest(scene)
    scene.tool.advance()
    raises_everywhere(WORLD, RuntimeError, "update", scene.problem.solve)
    scene.contact.update()
    np.testing.assert_array_equal(scene.tool.displacement, 0)
    np.testing.assert_allclose(gaps_at_rest(scene), before, atol=1e-14)
    assert largest(before - 0.05) < 1e-14


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_rotation_or_pairing_anew(cell):
    """A rotated plane gives the gaps of an advanced one to second order in the angle.

    The gap is open.
    """
    errors = []
    for angle in (0.04, 0.02):
        scene = Pressed(cell, flat, quadrature="nodal")
        scene.tool.displacement[-1] = 0.1
        scene.tool.advance()
        scene.contact.update()
        scene.tool.rotation[0] = angle
        before = gaps_at_rest(scene)
        scene.tool.advance()
        scene.contact.update()
        errors.append(largest(gaps_at_rest(scene) - before))
        assert largest(before + 0.1) > 0.4 * angle
    assert 0.2 < errors[1] / errors[0] < 0.3


def test_position():
    """Successive motions compose, about a centre that moves with the tool."""
    tool = qs.RigidSurface.plane(WORLD, [1.0, 0.0], [0.0, 1.0])
    tool.displacement, tool.rotation = [2.0, 0.0], np.pi / 2
    tool.advance()
    np.testing.assert_allclose(tool.center, [3, 0])
    np.testing.assert_allclose(tool.distance([[2.5, 7.0, 0.0]])[0], 0.5)
    tool.rotation = np.pi / 2
    tool.advance()
    distance, normal = tool.distance([[7.0, 0.25, 0.0]])
    np.testing.assert_allclose(distance, -0.25)
    np.testing.assert_allclose(normal, [[0, -1, 0]], atol=1e-15)
    other = qs.RigidSurface.plane(WORLD, [1.0, 0.0], [0.0, 1.0])
    other.position = tool.position
    np.testing.assert_allclose(other.distance([[7.0, 0.25, 0.0]])[0], -0.25)
    solid = flat(WORLD, 3)
    solid.rotation, solid.displacement = [0.3, -0.2, 0.5], [1.0, 2.0, 3.0]
    A, b = solid.motion
    x = np.array([0.2, 0.3, -0.6])
    solid.advance()
    np.testing.assert_allclose(solid.position @ np.append(x, 1), x + A @ x + b)
    np.testing.assert_allclose(A @ [0.3, -0.2, 0.5], 0, atol=1e-15)  # the axis does not rotate


def test_parts_of_a_motion():
    """A motion made in two parts, about different axes, ends where the whole motion ends."""
    ends = []
    for part in (None, ([0.1, 0.4, -0.2], [0.3, 0.1, -0.4])):
        tool = flat(WORLD, 3)
        tool.displacement, tool.rotation = [1.0, 2.0, 3.0], [0.3, -0.2, 0.5]
        if part is not None:
            tool.go_ahead(*map(np.array, part))
        tool.advance()
        ends.append(tool.position)
    np.testing.assert_allclose(*ends, atol=1e-14)


@pytest.mark.parametrize("gdim", (2, 3))
def test_moment_on_a_rotated_tool(gdim):
    """Derivatives of positions by an angle about a fixed axis, after any other rotation."""
    axis = np.array([1.0]) if gdim == 2 else np.array([2.0, -1.0, 2.0]) / 3
    rotation, driven = np.array([0.7, -0.4, 0.3])[: len(axis)], Driven(1.0, axis, turns=True)
    center, x, h = np.array([0.1, 0.2, 0.3])[:gdim], np.array([1.0, -0.5, 0.8])[:gdim], 1e-4

    def at(s):
        moved, turned = driven.moved(np.zeros(gdim), rotation, s)
        return center + rotation_matrix(turned) @ (x - center) + moved

    first, second = driven.field(rotation, center), driven.curvature(rotation, center)
    np.testing.assert_allclose(first.A @ x + first.b, (at(h) - at(-h)) / (2 * h), atol=1e-7)
    change = (at(h) - 2 * at(0.0) + at(-h)) / h**2
    np.testing.assert_allclose(second.A @ x + second.b, change, atol=1e-6)


@pytest.mark.parametrize("gdim", (2, 3))
def test_mirrored_tools_are_refused(gdim):
    tool = flat(WORLD, gdim)
    before = tool.position.copy()
    mirror = np.column_stack([np.diag([-1.0] + [1.0] * (gdim - 1)), np.zeros(gdim)])
    call = lambda: setattr(tool, "position", mirror)  # noqa: E731
    raises_everywhere(WORLD, ValueError, "must be a rotation", call)
    np.testing.assert_array_equal(tool.position, before)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("quadrature, degree", (("nodal", 1), ("overlay", 1), ("overlay", 2)))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_as_a_body_that_is_moved(cell, formulation, quadrature, degree, law):
    """A deformable master with the same rigid motion of all nodes gives the same result."""
    gdim = 2 if cell == "triangle" else 3
    low, high = [-0.3] * (gdim - 1) + [1.0], [1.4] * gdim
    other = box(WORLD, [5] * (gdim - 1) + [1], cell, low, high, "backward")
    facets = plane(other, gdim - 1, 1.0)
    part = mesh.create_submesh(other, gdim - 1, facets)[0]
    center = [0.5] * (gdim - 1) + [1.0]
    options = {"formulation": formulation, "quadrature": quadrature, "penalty": 50.0}
    # On uneven quadrilaterals the quadrature depends on the first vertex of a segment, which the
    # sub-mesh changes.
    options["quadrature_degree"] = 8

    def tool(*_):
        return qs.RigidSurface.from_mesh(part, [0.5] * (gdim - 1) + [5.0], center)

    n = 4 - degree
    scene = Pressed(cell, tool, n, degree, law=law(), **options)
    scene.tool.displacement[-1] = -0.03
    scene.tool.displacement[0] = 0.02
    scene.tool.rotation[-1 if gdim == 2 else 0] = 0.08
    scene.problem.solve()

    V = vector_space(other)
    value, u = fem.Function(V), fem.Function(V)
    A, b = scene.tool.motion
    value.interpolate(lambda x: A @ x[:gdim] + b[:, None])
    every = np.arange(V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts, dtype=np.int32)
    rigid = qs.Surface(V, facets=facets)
    slave = Pressed(cell, flat, n, degree, quadrature=quadrature)
    contact = qs.Contact(slave.surface, rigid, law=law(), **options)
    bcs = [slave.bcs, [fem.dirichletbc(value, every)]]
    problem = qs.ContactProblem([slave.F, elastic(u)], [slave.u, u], [contact], bcs)
    problem.solve()

    active = WORLD.allreduce(active_set.num_closed(contact.model))
    rows = WORLD.allreduce(contact.model.gaps[0].num_rows)
    scale = largest(slave.u.x.array)
    assert largest(scene.u.x.array - slave.u.x.array) < 1e-7 * scale
    assert (
        largest(np.nan_to_num(scene.contact.weighted_gap() - contact.weighted_gap())) < 1e-7 * 0.03
    )
    np.testing.assert_allclose(scene.contact.force("master"), contact.force("master"), atol=1e-7)
    np.testing.assert_allclose(
        scene.contact.moment("slave", center), contact.moment("slave", center), atol=1e-7
    )
    assert active == rows if law is qs.Tied else 0 < active < rows


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("tool", TOOLS)
def test_tied_tool_pulls(tool, quadrature):
    scene = Pressed("quadrilateral", TOOLS[tool], law=qs.Tied(), quadrature=quadrature, nu=0.0)
    scene.is_uniform(-0.01)


# --- Force


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
@pytest.mark.parametrize("facets", (False, True))
def test_driving_force(facets, gdim, quadrature, enforcement):
    """A ball is pressed in from a distance, further, and less far; the path has no effect."""

    def ball(comm, gdim):
        center = [0.5] * (gdim - 1) + [2.05]
        if facets:
            return sphere_facets(comm, 24, center, 1.0)
        return qs.RigidSurface.sphere(comm, center, 1.0)

    scene = Pressed(
        "triangle" if gdim == 2 else "hexahedron",
        ball,
        n=8 if gdim == 2 else 4,
        quadrature=quadrature,
        enforcement=enforcement,
        penalty=300.0,
    )
    down = -np.eye(gdim)[-1]
    depths = []
    for force in (0.02, 0.1, 0.02):
        scene.tool.drive(force, 3 * down)
        scene.problem.solve()
        held = scene.contact.force("master")
        assert abs(held @ down + force) < 1.1e-8 * force
        assert 0 < WORLD.allreduce(active_set.num_closed(scene.contact.model))
        depths.append(-scene.tool.displacement[-1])
    assert 0.05 < depths[0] < depths[1]
    assert np.isclose(depths[0], depths[2], rtol=1e-5)
    # The same displacement, prescribed, gives the same solution.
    u = scene.u.x.array.copy()
    scene.u.x.array[:] = 0
    scene.tool.release()
    scene.contact.reset()
    scene.problem.solve()
    assert largest(scene.u.x.array - u) < 1e-6 * largest(u)


@pytest.mark.parametrize("solver", ("lu", "cg", "nest"))
def test_driven_displacement_in_closed_form(solver):
    scene = Pressed("hexahedron", flat)
    scene.tool.drive(0.07, [0, 0, -1])
    options = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-7}
    scene.problem = qs.ContactProblem(
        [scene.F],
        [scene.u],
        [scene.contact],
        [scene.bcs],
        petsc_options=None if solver == "lu" else options,
        kind="nest" if solver == "nest" else "mpi",
    )
    scene.problem.solve()
    expected = -0.07 * (1 / scene.modulus + scene.compliance)
    np.testing.assert_allclose(scene.tool.displacement, [0, 0, expected], rtol=1e-7)
    assert scene.problem.num_iterations <= (3 if solver == "lu" else 6)


def test_one_tool_on_two_bodies():
    """The driving force of one tool is shared equally between two equal blocks."""
    scenes = [Pressed("triangle", flat) for _ in range(2)]
    tool = flat(WORLD, 2)
    contacts = [
        qs.Contact(s.surface, tool, formulation="master-slave", penalty=1e3) for s in scenes
    ]
    problem = qs.ContactProblem(
        [s.F for s in scenes], [s.u for s in scenes], contacts, [s.bcs for s in scenes]
    )
    tool.drive(0.2, [0, -1])
    problem.solve()
    for contact in contacts:
        np.testing.assert_allclose(contact.force("master"), [0, 0.1], atol=1e-8)
    assert problem.blocks.block(0, 1) is None


def test_between_a_fixed_and_a_driven_tool():
    """Tools alone support the block vertically."""
    scene = Pressed("quadrilateral", flat, n=4, held=False)
    bottom = qs.RigidSurface.plane(WORLD, [0.0, -0.02], [0.0, 1.0])
    surface = qs.Surface(scene.V, facets=plane(scene.mesh, 1, 0.0))
    second = qs.Contact(surface, bottom, formulation="master-slave", penalty=1e3)
    problem = qs.ContactProblem([scene.F], [scene.u], [scene.contact, second], [scene.bcs])
    scene.tool.drive(0.3, [0, -1])
    problem.solve()
    np.testing.assert_allclose(scene.contact.force("master"), [0, 0.3], atol=3e-9)
    np.testing.assert_allclose(second.force("master"), [0, -0.3], atol=3e-9)


def test_forces_that_nothing_balances():
    scene = Pressed("triangle", flat)
    tool = scene.tool
    for force, direction, name in ((0, [0, 1], "force"), (1.0, [0, 0], "direction")):
        raises_everywhere(WORLD, ValueError, name, lambda f=force, d=direction: tool.drive(f, d))
    raises_everywhere(WORLD, ValueError, "direction", lambda: tool.drive(1.0, [0.0, 1.0, 0.0]))
    tool.drive(-1.0, [0, -1])
    raises_everywhere(WORLD, ValueError, "pulls", scene.problem.solve)
    tool.drive(1.0, [0, 1])  # away from the block
    tool.displacement[:] = [0.0, -0.01]
    before = scene.u.x.array.copy()
    raises_everywhere(WORLD, qs.ConvergenceError, "NOT_BALANCED", scene.problem.solve)
    np.testing.assert_array_equal(tool.displacement, [0.0, -0.01])
    np.testing.assert_array_equal(scene.u.x.array, before)


# --- Hertz


def graded_block(n):
    """A block of 20 × 10 below y = 0, with smaller cells around the origin."""
    msh = box(WORLD, [4 * n, 2 * n], "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
    x = msh.geometry.x
    for i in range(2):
        x[:, i] = 10 * np.sinh(5 * x[:, i]) / np.sinh(5)
    return msh


@pytest.mark.parametrize("tool", ("analytic", "facets"))
@pytest.mark.parametrize("quadrature", QUADRATURES)
def test_hertz(tool, quadrature):
    """Rigid cylinder on elastic block, plane strain: a² = 4 F R / (π E*), p₀ = 2 F / (π a)."""
    R, force, E, nu = 8.0, 10.0, 200.0, 0.3
    msh = graded_block(20)
    V = vector_space(msh)
    u = fem.Function(V)
    bcs = [slide(V, 1, plane(msh, 1, -10.0)), slide(V, 0, plane(msh, 1, -10.0))]
    near = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], 0) & (np.abs(x[0]) < 3.0)
    )
    slave = qs.Surface(V, facets=near)
    if tool == "analytic":
        cylinder = qs.RigidSurface.cylinder(WORLD, [0.0, R], None, R)
    else:
        angle = np.linspace(-0.5, 0.5, 401)
        x = np.stack([R * np.sin(angle), R - R * np.cos(angle)], axis=1)
        cells = np.stack([np.arange(400), np.arange(400) + 1], axis=1)
        cylinder = qs.RigidSurface.triangulated(WORLD, x, cells)
    contact = qs.Contact(slave, cylinder, quadrature=quadrature, search_radius=1.0)
    cylinder.drive(force, [0.0, -1.0])
    problem = qs.ContactProblem([elastic(u, E, nu)], [u], [contact], [bcs])
    problem.solve()
    a = np.sqrt(4 * force * R * (1 - nu**2) / (np.pi * E))
    peak = 2 * force / (np.pi * a)
    t = contact.traction("slave")
    local = slave.node_dofs[:, 1] - V.dofmap.index_map.local_range[0] * 2
    x, p, area = slave.node_x[:, 0], -t.x.array[local], slave.node_area
    exact = peak * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
    error = np.sqrt(WORLD.allreduce(area @ (p - exact) ** 2) / WORLD.allreduce(area @ exact**2))
    radius = contact.patch()[1]
    assert abs(largest(p) / peak - 1) < 0.02
    assert error < 0.05
    assert abs(radius / a - 1) < 0.06
    np.testing.assert_allclose(contact.force("master"), [0, force], rtol=1e-7, atol=2e-4)
