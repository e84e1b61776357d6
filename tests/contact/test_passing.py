"""Points that have passed through a thin part of the other surface, and left it again."""

import warnings

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, problem_of, ring, rotation
from scenes import WORLD, box, vector_space

from dolfinx import fem, mesh

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.passed import find_passed

THICK, GAP, RADIUS = 0.04, 0.05, 0.06


def boundary_of(msh):
    """Return all facets on the boundary of a mesh."""
    msh.topology.create_connectivity(msh.topology.dim - 1, msh.topology.dim)
    return mesh.exterior_facet_indices(msh.topology)


def boundary(gdim, cell):
    """Make the surface of a box that is [-0.5, 0.5] along each axis, thinner along the last one."""
    low, high = np.full(gdim, -0.5), np.full(gdim, 0.5)
    low[-1], high[-1] = -THICK / 2, THICK / 2
    msh = box(WORLD, (3,) * (gdim - 1) + (2,), cell, low, high, "scattered")
    return qs.Surface(vector_space(msh), facets=boundary_of(msh)), low, high


def clip(start, end, low, high):
    """Return where a straight path enters and leaves a box, and the axes along which it does."""
    way = end - start
    with np.errstate(divide="ignore"):
        a, b = (low - start) / way, (high - start) / way
    first, last = np.minimum(a, b), np.maximum(a, b)
    return first.max(), last.min(), int(np.argmax(first)), int(np.argmin(last))


@pytest.mark.parametrize(
    "gdim, cell",
    ((2, "triangle"), (3, "tetrahedron"), (3, "hexahedron")),
)
@pytest.mark.parametrize("moves", (False, True))
def test_depths_within_a_box(gdim, cell, moves):
    """Depths of random paths through a box, which may move itself, are those of a clipped line.

    They count if the point looks the way that the face does through which it comes out, and if the
    path grazes neither this face nor that through which it goes in.
    """
    surface, low, high = boundary(gdim, cell)
    rng = np.random.default_rng(3)
    shift = rng.uniform(-1, 1, gdim) if moves else np.zeros(gdim)
    start, end = rng.uniform(-0.6, 0.6, (2, 400, gdim))
    normal = rng.normal(size=(400, gdim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    mine = np.arange(400) % WORLD.size == WORLD.rank
    expected = np.zeros(400)
    for i in range(400):
        first, last, *axes = clip(start[i], end[i], low, high)
        way = end[i] - start[i]
        alike = np.sign(way[axes[1]]) * normal[i, axes[1]]
        across = np.abs(way[axes] if first > 0 else way[axes[1:]]).min()
        if first < last and 0 < last < 1 and alike > 0.5 and across > 0.1 * np.linalg.norm(way):
            expected[i] = (last - max(first, 0)) * across
    assert np.count_nonzero(expected) > 50

    def padded(x):
        return np.pad(x, ((0, 0), (0, 3 - gdim)))[mine]

    facets, was = surface.cpp_object, np.pad(shift, (0, 3 - gdim))
    for times in ((0.0, 1.0), (0.0, 0.5, 1.0)):  # two pieces of a straight path change nothing
        facet_x = np.stack([facets.facet_x - (1 - t) * was for t in times])
        x = np.stack([(1 - t) * padded(start - shift) + t * padded(end) for t in times])
        normals = np.stack([padded(normal)] * len(times))
        depths = _cpp.passed_depths(facets, len(times) - 1, facet_x, x, normals)
        assert np.allclose(depths, expected[mine], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("gdim, cell", ((2, "triangle"), (3, "tetrahedron"), (3, "hexahedron")))
def test_pieces_of_straight_paths(gdim, cell):
    """Depths do not depend on the number of pieces of straight paths, also if the box deforms."""
    facets, rng = boundary(gdim, cell)[0].cpp_object, np.random.default_rng(3)
    shear, ends, normal = np.zeros((3, 3)), np.zeros((2, 400, 3)), np.zeros((400, 3))
    shear[:gdim, :gdim] = rng.uniform(-0.7, 0.7, (gdim, gdim))
    ends[..., :gdim] = rng.uniform(-0.6, 0.6, (2, 400, gdim))
    normal[:, :gdim] = rng.normal(size=(400, gdim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    found = []
    for num in (1, 3):
        times = np.linspace(0, 1, num + 1)
        facet_x = np.stack([facets.facet_x + (1 - t) * facets.facet_x @ shear for t in times])
        x = np.stack([(1 - t) * ends[0] + t * ends[1] for t in times])
        found.append(_cpp.passed_depths(facets, num, facet_x, x, np.stack([normal] * (num + 1))))
    assert np.count_nonzero(found[0]) > 10
    np.testing.assert_allclose(*found, rtol=1e-8, atol=1e-10)


class OntoASheet:
    """A block that is pushed down by 0.2 on a thin part, through a small gap.

    Args:
        kind: ``"facets"`` of a closed rigid sheet, a deformable ``"body"`` that is held at its
            ends, two thin analytic ``"bars"``, or a ``"round"`` tool whose centre reaches the
            surface.
        thick: Thickness of the sheet.
    """

    DOWN = 0.2

    def __init__(self, kind, thick=THICK):
        n = (30, 5) if kind == "bars" else (10, 5)
        block = Body(box(WORLD, n, "quadrilateral", [0.0, 0.0], [1.0, 0.5]))
        top = block.clamp(block.boundary(lambda x: np.isclose(x[1], 0.5)))
        slave, bodies = block.side(1, 0.0), [block]
        if kind == "body":
            low, high = [-0.5, -GAP - thick], [1.5, -GAP]
            sheet = Body(box(WORLD, (20, 2), "quadrilateral", low, high), stiffness=1e4)
            sheet.clamp(sheet.boundary(lambda x: np.isclose(abs(x[0] - 0.5), 1.0)))
            masters = [sheet.surface(boundary_of(sheet.mesh))]
            bodies.append(sheet)
        elif kind == "facets":
            x = np.linspace(-0.5, 1.5, 21)
            upper = np.column_stack([x[::-1], np.full(21, -GAP)])
            lower = np.column_stack([x, np.full(21, -GAP - thick)])
            k = np.arange(42)
            sides = np.column_stack([k, (k + 1) % 42])
            masters = [qs.RigidSurface.triangulated(WORLD, np.concatenate([upper, lower]), sides)]
        elif kind == "round":
            masters = [qs.RigidSurface.cylinder(WORLD, [0.53, -0.2], None, 0.2 - GAP)]
        else:
            middles = ([x, -GAP - RADIUS] for x in (0.25, 0.75))
            masters = [qs.RigidSurface.cylinder(WORLD, middle, None, RADIUS) for middle in middles]
        self.contacts = [qs.Contact(slave, master) for master in masters]
        self.problem = problem_of(bodies, self.contacts)

        def push(t, dt=None):
            top.value[1] = -self.DOWN * t

        self.push = push

    def stepped(self, dt, **options):
        """Make steps to the end; return the stepper and the force on the block."""
        stepper = qs.TimeStepper(self.problem, dt, self.push, **options)
        for _ in stepper.run(1.0):
            pass
        return stepper, sum(contact.force("slave")[1] for contact in self.contacts)


@pytest.mark.parametrize("kind", ("facets", "body", "bars", "round"))
def test_large_steps_do_not_pass_through_a_thin_part(kind):
    """Steps by many thicknesses are cut back; the force is that of small steps."""
    stepper, force = OntoASheet(kind).stepped(1.0)
    small, expected = OntoASheet(kind).stepped(0.125)
    assert stepper.num_cutbacks > 0 and small.num_cutbacks == 0
    assert expected > 0.5 and np.isclose(force, expected, rtol=1e-5)
    assert any("passed through a part" in attempt.reason for attempt in stepper.log)


def test_sheet_of_a_twohundredth_of_a_facet():
    """Neither a large step nor small ones pass through a very thin part."""
    stepper, force = OntoASheet("facets", 5e-4).stepped(1.0)
    small, expected = OntoASheet("facets", 5e-4).stepped(0.125)
    assert stepper.num_cutbacks > 0 and small.num_cutbacks > 0
    assert expected > 0.5 and np.isclose(force, expected, rtol=1e-5)


@pytest.mark.parametrize("kind", ("facets", "body", "bars", "round"))
def test_a_solve_says_so(kind):
    """A solve in which the block passes through gives a warning on all ranks."""
    case = OntoASheet(kind)
    case.push(1.0)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        case.problem.solve()
    told = any("through a part of the other surface" in str(w.message) for w in found)
    assert WORLD.allgather(told) == [True] * WORLD.size


@pytest.mark.parametrize("steep", (False, True))
def test_paths_that_start_on_a_face(steep):
    """A path from a face into a box and out beside it counts unless it grazes the face."""
    surface, low, high = boundary(2, "triangle")
    facets = surface.cpp_object
    start = np.array([[0.48, low[1], 0.0]])
    end = np.array([[0.56, low[1] + (0.02 if steep else 0.005), 0.0]])
    normal = np.array([[1.0, 0.0, 0.0]])
    ends, still = np.stack([start, end]), np.stack([facets.facet_x] * 2)
    found = _cpp.passed_depths(facets, 1, still, ends, np.stack([normal] * 2))
    depth = 0.02 * (high[0] - 0.48) / 0.08 if steep else 0.0
    np.testing.assert_allclose(WORLD.allreduce(found, op=MPI.MAX), depth, rtol=1e-9)


def test_depth_in_a_bar():
    """The deepest path through a bar goes through its middle."""
    case = OntoASheet("bars")
    model = case.contacts[0].model
    before = model.placement
    case.push(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has passed through
        case.problem.solve()
    found = find_passed(model, before)
    assert found is not None and found.side == "slave"
    assert found.depth == pytest.approx(RADIUS - abs(found.x[0] - 0.25), rel=0.03)


def test_going_around_an_edge_is_no_passing():
    """A block that slides off the sheet's end by many thicknesses in a step is not cut back."""
    case = OntoASheet("facets")
    tool = case.contacts[0].master
    stepper = qs.TimeStepper(case.problem, 1.0)
    for way in ([-0.8, GAP + 0.01], [-0.9, 0.02]):
        stepper.drive = lambda t, dt, way=way: setattr(tool, "displacement", way)
        stepper.step()
    assert stepper.num_cutbacks == 0


class Paddle:
    """A round bar on an arm turns about the origin into a thin post, which it pushes aside.

    The chord of a large rotation passes between the bar and the origin.

    Args:
        kind: ``"facets"`` of a rigid tool, or a ``"body"`` whose motion is prescribed.
        angle: Angle of the whole rotation (radians); negative clockwise.
    """

    ARM, RADIUS, BEYOND = 0.95, 0.15, 0.25

    def __init__(self, kind, angle):
        post = Body(box(WORLD, (2, 20), "quadrilateral", [-0.05, 0.75], [0.05, 2.0]))
        post.clamp(post.boundary(lambda x: np.isclose(x[1], 2.0)))
        slave, bodies = post.surface(post.boundary(lambda x: x[1] < 1.99)), [post]
        start = np.pi / 2 + np.sign(angle) * self.BEYOND - angle
        self.angle, middle = angle, self.ARM * np.array([np.cos(start), np.sin(start)])
        if kind == "facets":
            i = np.arange(32)
            around = 2 * np.pi * i / 32
            x = middle + self.RADIUS * np.stack([np.cos(around), np.sin(around)], axis=1)
            sides = np.stack([i, (i + 1) % 32], axis=1)
            self.tool = qs.RigidSurface.triangulated(WORLD, x, sides, [0.0, 0.0])
            master, self.move = self.tool, self.turn_tool
        else:
            msh = ring((32, 1), (0.5 * self.RADIUS, self.RADIUS))
            msh.geometry.x[:, :2] += middle
            bar = Body(msh, stiffness=1e4)
            self.held = fem.Function(bar.V)
            dofs = np.arange(bar.V.dofmap.index_map.size_local, dtype=np.int32)
            bar.bcs.append(fem.dirichletbc(self.held, dofs))
            bodies.append(bar)
            master, self.move = bar.surface(boundary_of(msh)), self.turn_body
        self.contact = qs.Contact(slave, master, formulation="master-slave", sliding="finite")
        self.problem = problem_of(bodies, [self.contact])

    def turn_tool(self, t, dt):
        self.tool.rotation = self.angle * dt

    def turn_body(self, t, dt):
        R = rotation(self.angle * t)
        self.held.interpolate(lambda x: (R - np.eye(2)) @ x[:2])

    def stepped(self, dt):
        """Make steps to the end; return the stepper and the force on the post."""
        stepper = qs.TimeStepper(self.problem, dt, self.move)
        for _ in stepper.run(1.0):
            pass
        return stepper, self.contact.force("slave")


@pytest.mark.parametrize(
    "kind, degrees", (("facets", 60), ("facets", 120), ("facets", -180), ("body", 120))
)
def test_paths_of_a_large_rotation_are_arcs(kind, degrees):
    """A bar that would pass through a post in one rotation pushes it aside in smaller steps."""
    angle = np.radians(degrees)
    stepper, force = Paddle(kind, angle).stepped(1.0)
    _, expected = Paddle(kind, angle).stepped(1 / 16)
    assert stepper.num_cutbacks > 0
    assert np.sign(angle) * expected[0] < -0.005 and np.allclose(force, expected, rtol=1e-4)


@pytest.mark.parametrize("turn", (2.0, np.pi, 5.0))
def test_arcs_in_space(turn):
    """In 3D, a tool that has turned through a block by any angle gives a warning, else none."""
    found = []
    for height in (0.0, 0.5):
        msh = box(WORLD, (2, 4, 2), "hexahedron", [-0.1, 0.7, -0.1], [0.1, 1.3, 0.1])
        block = Body(msh)
        block.clamp(block.boundary(lambda x: np.isclose(x[1], 1.3)))
        n, s = 6, np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        rows = [[x, 0.05 * a, 0.1 * b + height] for x in np.linspace(0.75, 1.0, n) for a, b in s]
        start = rotation(np.pi / 2 - turn / 2)
        corners = np.array(rows)
        corners[:, :2] = corners[:, :2] @ start.T
        sides = [[4 * i + j, 4 * i + k, 4 * i + 4 + j, 4 * i + 4 + k] for i in range(n - 1)
                 for j, k in ((0, 1), (1, 2), (2, 3), (3, 0))]  # fmt: skip
        triangles = [t for a, b, c, d in sides for t in ([a, c, b], [b, c, d])]
        m = 4 * (n - 1)
        triangles += [[0, 1, 2], [0, 2, 3], [m, m + 2, m + 1], [m, m + 3, m + 2]]
        tool = qs.RigidSurface.triangulated(WORLD, corners, triangles, [0.0, 0.0, height])
        contact = qs.Contact(block.surface(boundary_of(msh)), tool, formulation="master-slave")
        problem = problem_of([block], [contact])
        tool.rotation = [0.0, 0.0, turn]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            problem.solve()
        told = any("through a part of the other surface" in str(w.message) for w in caught)
        found.append(WORLD.allreduce(told, op=MPI.LOR))
    assert found == [True, False]
