"""Vertices at sharp edges with finite sliding carry force from first contact on."""

import pathlib
import warnings

import numpy as np
import pytest
from following import Body, Boxes, moment, problem_of, rotation, total
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space
from system.test_equations import away, errors

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.normal_rows import LEAST_PROXIMAL

FINITE = {"sliding": "finite", "constraints": "points"}
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


class OnCorner:
    """Box that stands on a corner on another box; either box is the slave.

    Args:
        cell: Cell type of both.
        depth: Initial depth of the corner in the other box.
        swapped: Whether the lower box is the slave.
        turn: Matrix that rotates everything.
        bend: How far the lower box is distorted: its upper face is curved, and in 3D its
            quadrilaterals are warped and no parallelograms.
    """

    def __init__(self, cell, depth=0.0, swapped=False, turn=None, bend=0.0, **contact):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        n = ((3,) * gdim, (4,) * gdim)
        low = np.array([-0.55, *((-0.47,) * (gdim - 2)), -1.0]), np.zeros(gdim)
        meshes = [box(WORLD, k, cell, a, a + 1, "scattered") for k, a in zip(n, low, strict=True)]
        faces = [[plane(meshes[0], gdim - 1, 0.0)], [plane(meshes[1], i, 0.0) for i in range(gdim)]]
        far = [[plane(meshes[0], gdim - 1, -1.0)], [plane(meshes[1], i, 1.0) for i in range(gdim)]]
        x = meshes[0].geometry.x
        product = x[:, 0] ** 2 / 2 if gdim == 2 else x[:, 0] * x[:, 1]
        x[:, gdim - 1] -= bend * product * (1 + x[:, gdim - 1])
        x[:, : gdim - 1] += 0.3 * bend * product[:, None]
        tilt = rotation(0.7)
        if gdim == 3:
            diagonal = np.ones(3) / np.sqrt(3)
            across = np.cross(diagonal, [0.0, 0.0, 1.0])
            tilt = rotation(np.arcsin(np.linalg.norm(across)), across) @ rotation(0.3, diagonal)
            tilt = rotation(0.12, [1.0, 0.2, 0.0]) @ tilt
        x = meshes[1].geometry.x
        x[:, :gdim] = x[:, :gdim] @ tilt.T
        x[:, gdim - 1] -= depth
        self.turn = np.eye(gdim) if turn is None else turn
        for msh in meshes:
            msh.geometry.x[:, :gdim] = msh.geometry.x[:, :gdim] @ self.turn.T
        self.bodies = [Body(msh) for msh in meshes]
        self.held = [b.clamp(np.concatenate(f)) for b, f in zip(self.bodies, far, strict=True)]
        surfaces = [b.surface(np.concatenate(f)) for b, f in zip(self.bodies, faces, strict=True)]
        first, second = surfaces if swapped else surfaces[::-1]
        self.upper = "master" if swapped else "slave"
        self.contact = qs.Contact(first, second, **(FINITE | contact))
        self.problem = problem_of(self.bodies, [self.contact])

    def move(self, *way):
        """Set the displacement of the far sides of the upper box."""
        self.held[1].value[:] = self.turn @ np.array(way)


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("swapped", (False, True))
@pytest.mark.parametrize("cell", CELLS)
def test_derivative(cell, swapped, friction):
    """The derivative of forces and of corner constraints by all unknowns, with active corners.

    Facets opposite are curved between the normals at their nodes, which all facets there rotate.
    """
    scene = OnCorner(cell, 0.02, swapped, bend=0.5, friction=friction)
    assert error_at_vertices(scene.problem) < 1e-9


def error_at_vertices(problem):
    """Error of the derivative of forces and of vertex constraints, with one active vertex."""
    problem.set_up()
    equations = Equations(problem.system)
    z, scale = away(equations, size=0.002)
    for i, body in enumerate(equations.system.bodies):
        equations.part(z, i)[body.owned_constrained] = 0.0
    sides, *vertices = equations.multipliers(z)
    sides.normal[:] = -1e6  # inactive
    for values in vertices:
        values.normal[:] += 5.0
        if values.tangential is not None:
            values.tangential[:] += 1.0
    at = equations.evaluate(z)
    closed = [WORLD.allreduce(np.count_nonzero(p.normal.active)) for p in at.passes]
    assert closed[0] == 0 and sum(closed) == 1
    first = len(equations.system.bodies) + 1
    passes = range(first, first - 1 + len(equations.passes))

    def of_vertices(values):
        rows = [equations.layout.part(values, i) for i in passes]
        return np.concatenate([equations.bodies_of(values), *rows])

    return errors(equations, z, scale, of=of_vertices)


@pytest.mark.parametrize("swapped", (False, True))
@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_directions_across_edges(cell, swapped):
    """The force of a corner turns gradually while the corner slides over edges of curved facets.

    A jump at an edge leaves no equilibrium to a corner that should rest there.
    """
    scene = OnCorner(cell, 0.02, swapped)
    scene.problem.set_up()
    equations = Equations(scene.problem.system)
    z = equations.first()
    low, high = (equations.part(z, i).reshape(-1, 3) for i in range(2))
    x, y, height = (scene.bodies[0].places[:, k] for k in range(3))
    low[:, 2] = -0.5 * (x**2 + y**2) * (1 + height)
    sides, *vertices = equations.multipliers(z)
    sides.normal[:] = -1e6  # inactive
    for values in vertices:
        values.normal[:] = 50.0
    start, directions = high.copy(), []
    for part in np.linspace(0.0, 1.0, 101):
        way = part * np.array([0.25, 0.21])  # over edges of both directions
        high[:] = start + np.append(way, -0.5 * way @ way)
        of_upper = equations.part(equations.evaluate(z).contact, 1).reshape(-1, 3)
        force = total(of_upper)
        directions.append(force / np.linalg.norm(force))
    turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    assert np.linalg.norm(directions[-1] - directions[0]) > 0.2
    assert turns.max() < 0.02  # 0.10 to 0.13 with the slopes of heights


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_derivative_below_a_tool(cell, degree, friction):
    """The same for the tip of a rigid tool: the facets opposite are those of the slave."""
    msh = box(WORLD, (3, 3), cell, [-0.55, -1.0], [0.45, 0.0], "scattered")
    body = Body(msh, degree=degree)
    body.clamp(plane(body.mesh, 1, -1.0))
    x = np.array([[-0.3, 0.4], [0.0, -0.02], [0.3, 0.4]])
    tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2]])
    contact = qs.Contact(body.side(1, 0.0), tool, **FINITE, friction=friction)
    assert error_at_vertices(problem_of([body], [contact])) < 1e-8


@pytest.mark.parametrize("swapped", (False, True))
@pytest.mark.parametrize("cell", CELLS)
def test_from_the_first_touch(cell, swapped):
    """Forces grow with the depth; they balance, and there is no penetration."""
    forces, size = [], 0.25
    for part in (0.02, 0.1):
        scene = OnCorner(cell, 0.0, swapped)
        scene.move(*(0.0,) * (scene.gdim - 1), -part * size)
        scene.problem.solve()
        forces.append(scene.contact.force(scene.upper)[-1])
        assert scene.contact.penetration() < 0.03 * part * size  # facets are treated as curved
        assert largest(scene.contact.force("slave") + scene.contact.force("master")) < 1e-12
    assert forces[0] > 0 and abs(forces[1] / forces[0] / 5 - 1) < 0.1


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_turned(cell):
    """Rotating everything rotates forces, also with friction; total force and moment vanish."""
    forces = []
    for angle in (0.0, 0.9):
        axis = () if cell == "triangle" else ([0.3, 0.5, 0.2],)
        scene = OnCorner(cell, turn=rotation(angle, *axis), friction=qs.Coulomb(0.2))
        for way in ((0.0, -0.02), (0.03, -0.03)):
            scene.move(way[0], *(0.0,) * (scene.gdim - 2), way[1])
            scene.problem.solve()
        forces.append(scene.turn.T @ scene.contact.force("slave"))
        inside = [body.internal_forces() for body in scene.bodies]
        found = [moment(body.places, f) for body, f in zip(scene.bodies, inside, strict=True)]
        size = largest(*inside)
        assert largest(sum(total(f) for f in inside)) < 1e-10 * size
        assert largest(sum(found)) < 1e-8 * size
    np.testing.assert_allclose(*forces, rtol=1e-8, atol=1e-8 * largest(forces[0]))


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("shape", ("plane", "facets"))
def test_on_a_tool(cell, shape):
    """A box on its corner on an analytic or faceted flat tool has the results of small sliding."""
    forces = []
    for sliding in ("small", "finite"):
        scene = OnCorner(cell)
        gdim, body = scene.gdim, scene.bodies[1]
        up, start = np.eye(gdim)[-1], np.zeros(gdim)
        tool = qs.RigidSurface.plane(WORLD, start, up)
        if shape == "facets":
            x, facets = np.array([[1.0, 0.0], [0.1, 0.0], [-1.0, 0.0]]), [[0, 1], [1, 2]]
            if gdim == 3:
                x = np.array([[-1.1, -1, 0], [1, -1.2, 0], [1, 1, 0], [-1, 1.1, 0]])
                facets = [[0, 1, 2], [0, 2, 3]]
            tool = qs.RigidSurface.triangulated(WORLD, x, facets)
        faces = scene.contact.slave
        contact = qs.Contact(faces, tool, **(FINITE | {"sliding": sliding}))
        problem = problem_of([body], [contact])
        scene.move(*(0.0,) * (gdim - 1), -0.02)
        problem.solve()
        forces.append(contact.force("slave"))
        assert contact.penetration() < 1e-10
    assert forces[0][-1] > 0
    np.testing.assert_allclose(*forces, rtol=1e-7, atol=1e-7 * largest(forces[0]))


def test_onto_a_corner():
    """A half disc next to a block meets its corner and climbs onto it."""
    block = Body(box(WORLD, (15, 5), "quadrilateral", (0.0, -1.0), (3.0, 0.0), "scattered"))
    msh = box(WORLD, (24, 3), "quadrilateral", (0.0, 0.0), (1.0, 1.0), "scattered")
    rim, hub = plane(msh, 1, 1.0), plane(msh, 1, 0.0)
    x = msh.geometry.x
    angle, radius = np.pi * (1 + x[:, 0]), 0.25 + 0.25 * x[:, 1]
    x[:, 0], x[:, 1] = -0.75 + radius * np.cos(angle), 0.45 + radius * np.sin(angle)
    disc = Body(msh)
    block.clamp(plane(block.mesh, 1, -1.0))
    drawn = disc.clamp(hub)
    faces = np.concatenate([plane(block.mesh, 1, 0.0), plane(block.mesh, 0, 0.0)])
    friction = qs.Coulomb(0.2)
    contact = qs.Contact(disc.surface(rim), block.surface(faces), friction=friction, **FINITE)

    def drive(t, dt):
        drawn.value[0] = t

    stepper = qs.TimeStepper(problem_of([block, disc], [contact]), 0.1, drive, dt_max=0.1)
    forces = []
    for _ in stepper.run(2.5):
        forces.append(contact.force("slave"))
        assert contact.penetration() < 0.01
    assert max(step.iterations for step in stepper.log) <= 25
    ratios = [-force[0] / (0.2 * force[1]) for force in forces if force[1] > 1e-3]
    assert max(ratios) > 2.0  # the corner lifts it
    assert 0.8 < ratios[-1] < 1.0 + 1e-6  # everything slips along the top


class OnTip:
    """Tip of a rigid tool in front of the flat side of a box, in 2D."""

    def __init__(self, cell, down=0.0, **contact):
        self.body = Body(box(WORLD, (8, 4), cell, [-1.0, -1.0], [1.0, 0.0], "scattered"))
        self.body.clamp(plane(self.body.mesh, 1, -1.0))
        x = np.array([[-0.58, 0.6], [0.02, 0.0], [0.62, 0.6]]) - [0.0, down]
        self.tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2]])
        self.contact = qs.Contact(self.body.side(1, 0.0), self.tool, **(FINITE | contact))
        self.problem = problem_of([self.body], [self.contact])


@pytest.mark.parametrize("cell", CELLS[:2])
def test_derivative_before_a_tip(cell):
    """The derivative of forces and of tip constraints by all unknowns, with an active tip."""
    scene = OnTip(cell, 0.02)
    scene.problem.set_up()
    equations = Equations(scene.problem.system)
    z, scale = away(equations, size=0.002)
    equations.part(z, 0)[equations.system.bodies[0].owned_constrained] = 0.0
    sides, tip = equations.multipliers(z)
    sides.normal[:] = -1e6  # inactive
    tip.normal[:] += 5.0
    at = equations.evaluate(z)
    assert [WORLD.allreduce(np.count_nonzero(p.normal.active)) for p in at.passes] == [0, 1]

    def of_tip(values):
        return np.concatenate([equations.bodies_of(values), equations.layout.part(values, 2)])

    assert errors(equations, z, scale, of=of_tip) < 1e-8


def test_tip_far_from_a_solution():
    """Far from a solution, where points of gaps are fixed, tip and body are coupled symmetrically.

    The gap is that to a curved facet, as in the work of the force.
    """
    scene = OnTip("quadrilateral", 0.02)
    scene.problem.set_up()
    equations = Equations(scene.problem.system)
    z, _ = away(equations, size=0.02)
    equations.multipliers(z)[1].normal[:] += 5.0
    equations.set_proximal(LEAST_PROXIMAL, far=True)
    J = equations.derivative.of(equations.evaluate(z)).getValues(range(len(z)), range(len(z)))
    tip = equations.layout.first_of_pass(1)
    force, gap = J[:tip, tip], J[tip, :tip]
    assert largest(force) > 0
    assert np.abs(gap - force).max() < 1e-12 * np.abs(force).max()


@pytest.mark.parametrize(("cell", "mu"), (("triangle", 0.0), ("quadrilateral", 0.3)))
def test_tip_that_slides(cell, mu):
    """A tool tip carries force from first contact on and as it slides, without penetration."""
    friction = qs.Coulomb(mu) if mu else None
    scene, size = OnTip(cell, friction=friction), 0.25
    forces = []
    for part in (0.02, 0.1):
        scene.tool.displacement = [0.0, -part * size]
        scene.problem.solve()
        forces.append(-scene.contact.force("slave")[1])
    small = OnTip(cell, sliding="small")
    small.tool.displacement = [0.0, -0.02 * size]
    small.problem.solve()
    assert abs(forces[0] / -small.contact.force("slave")[1] - 1) < 0.1
    assert abs(forces[1] / forces[0] / 5 - 1) < 0.1
    for step in range(1, 6):
        scene.tool.displacement = [0.3 * size * step, -0.1 * size]
        scene.problem.solve()
        along, down = scene.contact.force("slave")
        assert scene.problem.num_iterations <= 25
        assert abs(-down / forces[1] - 1) < 0.4
        assert abs(abs(along / down) - mu) < 0.1 or step == 1
        assert scene.contact.penetration() < 0.02 * size


@pytest.mark.parametrize("shift", (0.0, 0.013))
def test_punch_with_walls(shift):
    """A flat punch half a facet deep with named walls: inclined facets beside it get no walls."""
    forces = []
    for sliding in ("small", "finite"):
        msh = box(WORLD, (20, 10), "quadrilateral", [-1.0, -1.0], [1.0, 0.0], "scattered")
        V = vector_space(msh)
        u = fem.Function(V)
        x = np.array([[-0.6, 0.6], [-0.6, 0.0], [0.6, 0.0], [0.6, 0.6]])
        x[:, 0] += shift
        punch = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2], [2, 3]])
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        contact = qs.Contact(surface, punch, sliding=sliding)
        punch.displacement = [0.0, -0.05]
        bcs = [clamp(V, plane(msh, 1, -1.0))]
        problem = qs.ContactProblem([elastic(u, 1e3)], [u], [contact], [bcs])
        problem.solve()
        forces.append(contact.force("slave")[1])
        assert problem.num_iterations <= 12
        assert contact.penetration() < 0.05 * 0.1
    assert abs(forces[1] / forces[0] - 1) < 0.03


@pytest.mark.parametrize("sliding", ("finite", "small"))
def test_vertices_of_a_wavy_block(sliding):
    """Each vertex has its own multiplier: forces are as symmetric as the block.

    Formerly they were not, and depended on the ranks: multipliers of walls were means of their
    neighbours.
    """
    msh = box(WORLD, (3, 2, 3), "hexahedron", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0])
    walls = [plane(msh, axis, value) for axis in (0, 1) for value in (0.0, 1.0)]
    facets, top = np.concatenate([plane(msh, 2, 0.0), *walls]), plane(msh, 2, 1.0)
    x = msh.geometry.x
    x[:, 2] += 0.05 * (1 - np.cos(3 * np.pi * x[:, 0])) * (1 - x[:, 2])
    V = vector_space(msh)
    u = fem.Function(V)
    stress = qs.materials.neo_hookean(u, 0.4, 0.5)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx(degree=3)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=np.unique(facets)), floor, sliding=sliding)
    problem = qs.ContactProblem([F], [u], [contact], [[clamp(V, top, [0.0, 0.0, -0.02])]])
    problem.solve()
    assert problem.num_iterations <= 6
    assert abs(contact.force("slave")[2] / 0.0143480060 - 1) < 1e-7  # on any number of ranks
    assert abs(contact.moment("slave", about=[0.5, 0.5, 0.5])[0]) < 1e-12
    assert contact.penetration() < 1e-9


def test_pad_with_walls():
    """A pad of degree 2 with named walls tilts as it is dragged: its corners keep their points.

    Formerly corners lost and regained them in turn, with 40 iterations per step.
    """
    case = Boxes("quadrilateral", ((17, 6), (7, 5)), ((3.0, 1.0), (0.8, 0.6)), 0.7, degree=2)
    moved = case.clamp_far()
    sides = [plane(case.upper.mesh, 0, value) for value in (0.7, 1.5)]
    named = np.unique(np.concatenate([plane(case.upper.mesh, 1, 0.0), *sides]))
    contact = qs.Contact(
        qs.Surface(case.upper.V, facets=named), case.below, friction=qs.Coulomb(0.3)
    )
    problem = case.problem(contact)
    for step in range(4):
        moved.value[:] = 0.05 * step, -0.04
        with warnings.catch_warnings():
            warnings.simplefilter("error", qs.ContactWarning)
            problem.solve()
        assert problem.num_iterations <= 20


def test_hook_over_a_catch():
    """A corner on a face that becomes parallel to its own face keeps its contact force."""
    arm = box(WORLD, (30, 3), "quadrilateral", (0.0, 0.0), (3.0, 1.0))
    catch = box(WORLD, (24, 4), "triangle", (3.0, -0.9), (4.6, 0.0))
    x, y = arm.geometry.x, catch.geometry.x
    below = np.interp(x[:, 0], [0, 2.3, 2.5, 2.6, 3.0], [0, 0, -0.3, -0.3, 0])
    above = np.interp(y[:, 0], [3, 3.1, 3.4, 3.5, 3.7, 4.6], [-0.4, -0.4, -0.1, -0.1, -0.4, -0.4])
    faces = [plane(msh, 1, 0.0) for msh in (arm, catch)]
    x[:, 0] += 0.5  # to the position of first contact
    x[:, 1] = below + (0.2 - below) * x[:, 1]
    y[:, 1] = -0.9 + (above + 0.9) * (y[:, 1] + 0.9) / 0.9
    bodies = [Body(arm, stiffness=2e3), Body(catch, stiffness=5e3)]
    moved = bodies[0].clamp(plane(arm, 0, 0.5))
    bodies[1].clamp(plane(catch, 1, -0.9))
    hook = mesh.compute_midpoints(arm, 1, faces[0])[:, 0] > 2.5
    contact = qs.Contact(bodies[0].surface(faces[0][hook]), bodies[1].surface(faces[1]))

    def drive(t, dt):
        moved.value[0] = 0.03 + 0.01 * t

    stepper = qs.TimeStepper(problem_of(bodies, [contact]), 1.0, drive)
    force = []
    for _ in stepper.run(27.0):
        force.append(contact.force("slave"))
    assert stepper.num_cutbacks == 0
    assert stepper.total_iterations <= 130
    lean = np.arctan2(-np.array(force)[2:, 0], np.array(force)[2:, 1])
    assert lean[0] > 0.6 and abs(lean[-1]) < 0.15  # first up the slope, then flat on the catch


class Rough:
    """Block of n cells whose bottom or top (at y = 0) is rough.

    Attributes:
        body: The body.
        surface: Its rough side; for a rough bottom also the walls.
        held: Constant of the displacement of the opposite side.
    """

    def __init__(self, n, x, y, seed):
        msh = box(WORLD, n, "quadrilateral", [0.0, 0.0], [1.0, 1.0])
        sides = {(axis, at): plane(msh, axis, at) for axis in (0, 1) for at in (0.0, 1.0)}
        s, t = msh.geometry.x[:, 0].copy(), msh.geometry.x[:, 1].copy()
        heights = 0.03 * np.random.default_rng(seed).uniform(-1, 1, n[0] + 1)
        bumps = np.interp(s, np.linspace(0, 1, n[0] + 1), heights)
        is_lower = y[1] == 0.0
        msh.geometry.x[:, 0] = x[0] + (x[1] - x[0]) * s
        msh.geometry.x[:, 1] = y[0] + (y[1] - y[0]) * t + bumps * (t if is_lower else 1 - t)
        self.body = Body(msh)
        self.held = self.body.clamp(sides[1, 0.0 if is_lower else 1.0])
        rough = [sides[1, 1.0]] if is_lower else [sides[1, 0.0], sides[0, 0.0], sides[0, 1.0]]
        self.surface = self.body.surface(np.concatenate(rough))


def rough_run(**options):
    """Return contact and stepper of two rough blocks that slide on each other every other step."""
    upper = Rough((10, 5), (0.3, 1.3), (0.045, 0.8), 101)
    lower = Rough((33, 5), (0.0, 3.0), (-1.0, 0.0), 1)
    contact = qs.Contact(upper.surface, lower.surface, **options)

    def drive(t, dt):
        way = 0.1 * ((round(t) + 1) // 2)
        upper.held.value[:] = max(way - 0.5, 0.0), -0.06 * min(2 * way, 1.0)

    return contact, qs.TimeStepper(problem_of([upper.body, lower.body], [contact]), 1.0, drive)


@pytest.mark.parallel
def test_vertices_that_bear_keep_their_points():
    """Vertices with force keep their points; otherwise a step at rest would lose equilibrium.

    Facets next to some vertices rotate under pressure, so that new contact detection would find no
    points for these vertices.
    """
    contact, stepper = rough_run()
    force = np.zeros(2)
    for t in stepper.run(12.0):
        if round(t) % 2 == 0:
            assert stepper.num_iterations == 0
            np.testing.assert_allclose(contact.force("slave"), force, rtol=1e-7)
        force = contact.force("slave")


@pytest.mark.parallel
@pytest.mark.parametrize("mu", (0.0, 0.3))
def test_restart(mu, tmp_path_factory):
    """A run goes on from a checkpoint exactly: vertices and smooth patches are those of the run.

    Those that would be chosen for the surfaces as they are at the end of the run are others.
    """
    folder = pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0)) / "state"
    options = {"friction": qs.Coulomb(mu) if mu else None}
    contact, stepper = rough_run(**options)
    for _ in stepper.run(10.0):
        pass
    qs.save_run(stepper, folder)
    again, resumed = rough_run(**options)
    qs.load_run(resumed, folder)
    for _ in range(2):
        force = contact.force("slave")
        assert largest(again.force("slave") - force) < 1e-10 * largest(force)
        stepper.step()
        resumed.step()
