"""Edges and tips of rigid tools: none penetrates a body without a contact force."""

import warnings

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, slide, vector_space
from scipy.optimize import nnls

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix

import qsdolfinx as qs

E, SIZE = 1e3, 0.25


def roof(at, slope, yaw):
    """Make an inverted roof through a place, its edge along y and rotated about z (degrees)."""
    x = [[s * 1.2, y, abs(s) * 1.2 * slope] for y in (-1.0, 1.0) for s in (-1, 0, 1)]
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.array(x) @ R.T + at, [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]]


def tip(at, slope):
    """Make an inverted pyramid with its tip at the given place."""
    base = [[-1.0, -1.0, slope], [1.0, -1.0, slope], [1.0, 1.0, slope], [-1.0, 1.0, slope]]
    return np.array([[0.0, 0.0, 0.0], *base]) + at, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]]


def facing(x, facets, up):
    """Make a rigid tool of these facets, with normals upwards or downwards."""
    across = [np.cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]])[2] for f in facets]
    turned = [f if (z > 0) == up else f[::-1] for f, z in zip(facets, across, strict=True)]
    return qs.RigidSurface.triangulated(WORLD, x, turned)


def made(kind, at, slope=1.0, yaw=0.0):
    """Make a tool of a kind: an edge in 2D, a roof or a pyramid in 3D."""
    if kind == "edge":
        x = np.array([[1.2, 1.2 * slope], [0.0, 0.0], [-1.2, 1.2 * slope]]) + at
        return qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 1]])
    return facing(*(tip(at, slope) if kind == "tip" else roof(at, slope, yaw)), up=False)


def compliance(body, loads):
    """Return the work of each load on the displacements of each load, without contact."""
    A = assemble_matrix(fem.form(ufl.derivative(body.F, body.u)), bcs=body.bcs)
    A.assemble()
    ksp = PETSc.KSP().create(WORLD)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setOperators(A)
    x = A.createVecRight()
    b, out = [load(x) for load in loads], []
    for load in b:
        ksp.solve(load, x)
        out.append([x.dot(other) for other in b])
    return np.array(out)


class Block:
    """Block below the last coordinate 0, clamped at its bottom.

    Args:
        cell: Type of its cells.
        tool: The tool in contact with the block.
        options: Options of the contact.
    """

    def __init__(self, cell, tool, **options):
        d = self.d = tool.gdim
        mid = [2] * (d - 2)
        self.low = [-1.0, *[-SIZE] * len(mid), -0.75]
        self.msh = box(
            WORLD, [8, *mid, 3], cell, self.low, [1.0, *[SIZE] * len(mid), 0.0], "scattered"
        )
        self.V = vector_space(self.msh)
        self.u, self.tool = fem.Function(self.V), tool
        self.F = elastic(self.u, E, 0.3)
        self.bcs = [clamp(self.V, plane(self.msh, d - 1, -0.75))]
        self.contact = qs.Contact(
            qs.Surface(self.V, facets=plane(self.msh, d - 1, 0.0)), tool, **options
        )
        self.problem = qs.ContactProblem([self.F], [self.u], [self.contact], [self.bcs])

    def press(self, depth, *along):
        """Move the tool down by the depth and, if given, along the first axes."""
        self.tool.displacement[-1] = -depth
        self.tool.displacement[: len(along)] = along
        self.problem.solve()
        return self.contact.force("slave")

    def load(self, like, place):
        """Return a force of 1 along the last axis at a place of the top: on a line or a square."""
        out, owned = like.duplicate(), self.V.dofmap.index_map.size_local
        x = self.V.tabulate_dof_coordinates()[:owned, : self.d]
        hats = np.maximum(1 - np.abs(x[:, :-1] - place[: self.d - 1]) / SIZE, 0.0).prod(axis=1)
        out.array[self.d - 1 :: self.d] = hats * np.isclose(x[:, -1], 0.0)
        return out

    def compliance(self, places):
        """Return displacements along the last axis at places by forces there, without contact."""
        return compliance(self, [lambda like, at=place: self.load(like, at) for place in places])


#: Kinds of tools, places of their edges or tips, places where they press, and cell types.
ON_LINES = (-SIZE, 0.0, SIZE)
CASES = {
    "between nodes": ("edge", [0.1, 0.0], [[0.1, 0.0]], "triangle"),
    "at a node": ("edge", [0.25, 0.0], [[0.25, 0.0]], "quadrilateral"),
    "on a square": ("tip", [0.1, 0.06, 0.0], [[0.1, 0.06]], "hexahedron"),
    "on a line": ("tip", [0.1, 0.0, 0.0], [[0.1, 0.0]], "tetrahedron"),
    "across lines": ("roof", [0.1, 0.0, 0.0], [[0.1, y] for y in ON_LINES], "hexahedron"),
    "along a line": (
        "roof",
        [0.25, 0.0, 0.0],
        [[0.25, y] for y in ON_LINES],
        "tetrahedron",
    ),
}


@pytest.mark.parametrize("depth", (0.01, 0.1))
@pytest.mark.parametrize("case", CASES)
def test_pressed(case, depth):
    """From first contact on, the force is the force at the contact points."""
    kind, at, places, cell = CASES[case]
    depth *= SIZE
    for formulation in ("quasi-symmetric", "master-slave"):
        block = Block(cell, made(kind, at, slope=1.5), formulation=formulation)
        force = block.press(depth)
        C = block.compliance(np.array(places))
        expected = np.linalg.solve(C, np.full(len(places), depth)).sum()
        np.testing.assert_allclose(force[-1], -expected, rtol=1e-8)
        np.testing.assert_allclose(block.contact.force("master"), -force, atol=1e-9)
        assert largest(force[:-1]) < 1e-9 * expected  # the block is level
        assert block.problem.num_iterations <= 4
        assert block.contact.penetration() < 0.01 * depth  # because the top also moves sideways


def places_below(at, yaw):
    """Return places below a roof's edge: mesh lines of a block's top and midpoints between them."""
    along = np.array([-np.sin(np.radians(yaw)), np.cos(np.radians(yaw))])
    lines = [np.arange(-4, 5) * SIZE, np.arange(-1, 2) * SIZE]
    t = np.concatenate([(x - at[i]) / along[i] for i, x in enumerate(lines) if along[i]])
    places = np.array(at[:2]) + np.sort(t)[:, None] * along
    places = places[np.all(np.abs(places) < [1 + 1e-9, SIZE + 1e-9], axis=1)]
    places = places[np.linalg.norm(np.diff(places, axis=0, prepend=9.0), axis=1) > 1e-9]
    return np.concatenate([places, (places[1:] + places[:-1]) / 2])


@pytest.mark.parametrize(
    ("cell", "at", "yaw"),
    [
        ("hexahedron", [0.0, 0.0, 0.0], 45.0),  # through nodes only
        ("hexahedron", [0.1, 0.03, 0.0], 45.0),
        ("hexahedron", [0.1, 0.03, 0.0], 63.0),
        ("tetrahedron", [0.1, 0.03, 0.0], 10.0),
        ("tetrahedron", [0.1, 0.03, 0.0], 37.0),
    ],
)
def test_turned_edge(cell, at, yaw):
    """No penetration across facets; the force acts at mesh lines and halfway between them."""
    block = Block(cell, made("roof", at, 6.0, yaw))
    depth = 0.1 * SIZE
    force = block.press(depth)
    assert block.contact.penetration() < 1e-6 * depth
    assert block.problem.num_iterations <= 15  # with soft penalties first, where it starts far off
    if cell == "hexahedron":
        C = block.compliance(places_below(at, yaw))
        root = np.linalg.cholesky(C)  # forces without tension: least squares of the same energy
        forces, _ = nnls(root.T, np.linalg.solve(root, np.full(len(C), depth)))
        # Away from nodes the top rises beside the edge, and the faces of the roof press a little.
        rtol = 1e-8 if not any(at) else 2e-2
        np.testing.assert_allclose(force[2], -forces.sum(), rtol=rtol)


def test_tip_that_goes_in():
    """With contact updates in each step the tip keeps its constraint as the top bends around it."""
    msh = box(WORLD, (8, 8, 6), "hexahedron", [-0.5, -0.5, -0.75], [0.5, 0.5, 0.0], "scattered")
    V, tool = vector_space(msh), made("tip", [0.03, 0.02, 0.0], 0.3)
    u, bcs = fem.Function(V), [clamp(V, plane(msh, 2, -0.75))]
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 2, 0.0)), tool)
    problem = qs.ContactProblem([elastic(u, E, 0.3)], [u], [contact], [bcs])

    def drive(t, dt):
        tool.displacement[2] = -0.12 * dt

    stepper = qs.TimeStepper(problem, 1 / 8, drive)
    for _ in stepper.run(1.0):
        assert WORLD.allreduce(contact.model.of_vertices[0].points.size) == 1
    assert sum(row.iterations for row in stepper.log.rows) <= 60  # 88 if it comes and goes


def pressed(tool, cell, n, depth, degree=1, comm=WORLD, **options):
    """Press a tool into a block [−.5, .5]² below 0 that is clamped at its bottom."""
    msh = box(comm, (n, n, 2), cell, [-0.5, -0.5, -0.5], [0.5, 0.5, 0.0])
    V = fem.functionspace(msh, ("Lagrange", degree, (3,)))
    u, bcs = fem.Function(V), [clamp(V, plane(msh, 2, -0.5))]
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 2, 0.0)), tool, **options)
    problem = qs.ContactProblem([elastic(u, E, 0.3)], [u], [contact], [bcs])
    tool.displacement[2] = -depth
    problem.solve()
    return contact, problem


@pytest.mark.parametrize("enforcement", ("augmented-lagrangian", "penalty"))
@pytest.mark.parametrize("kind", ("roof", "tip"))
def test_beside_the_rim(kind, enforcement):
    """A tool that passes beside the body without touching it has no contact force."""
    for cell in ("hexahedron", "tetrahedron"):
        tool = made(kind, [-0.515, 0.07, 0.0], 1.5)
        contact, _ = pressed(tool, cell, 5, 0.01, enforcement=enforcement)
        assert largest(contact.force("slave")) == 0.0


def test_tip_beside_an_edge_of_the_block():
    """The force at the tip of a pyramid is normal to the face that it presses, up to its edge."""
    msh = box(WORLD, (3, 3, 3), "hexahedron", [0.0] * 3, [1.0] * 3, "scattered")
    V = vector_space(msh)
    facets = np.unique(np.concatenate([plane(msh, 2, 1.0), plane(msh, 0, 1.0)]))
    rim = [[0.5, 0.1, 1.8], [1.3, 0.1, 1.8], [1.3, 0.9, 1.8], [0.5, 0.9, 1.8]]
    x, cells = np.array([[0.9, 0.5, 1.0], *rim]), [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]]
    tool = qs.RigidSurface.triangulated(WORLD, *((x, cells) if WORLD.rank == 0 else (None, None)))
    tool.displacement = [0.0, 0.0, -0.004]
    u, contact = fem.Function(V), qs.Contact(qs.Surface(V, facets=facets), tool)
    bcs = [clamp(V, plane(msh, 2, 0.0))]
    qs.ContactProblem([elastic(u)], [u], [contact], [bcs]).solve()
    force = contact.force("slave")
    assert force[2] < -1e-4
    np.testing.assert_allclose(force[:2], 0.0, atol=1e-9 * -force[2])


def test_degree_2_along_diagonals():
    """An edge above corner nodes only penetrates no deeper than an edge next to these nodes."""
    forces = []
    for yaw in (45.0, 47.0):
        contact, problem = pressed(
            made("roof", [0.0, 0.0, 0.0], 4.0, yaw), "hexahedron", 2, 0.02, 2
        )
        forces.append(contact.force("slave")[2])
        assert problem.num_iterations <= 10
    np.testing.assert_allclose(*forces, rtol=0.03)  # .26 apart with a point in the middle only


@pytest.mark.parametrize("law", (None, qs.Coulomb(0.2)))
def test_merged_alike(law):
    """Crossings close to mesh lines are merged, in the same way on any number of ranks."""
    forces = []
    for comm in (WORLD, MPI.COMM_SELF):
        x, facets = roof([0.0, -0.02, 0.0], 1.5, 90.0)
        turned = [f[::-1] for f in facets]
        down = [f if np.cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]])[2] < 0 else t
                for f, t in zip(facets, turned, strict=True)]  # fmt: skip
        tool = qs.RigidSurface.triangulated(comm, x, down)
        contact, _ = pressed(tool, "tetrahedron", 4, 0.01, comm=comm, friction=law)
        forces.append(contact.force("slave"))
    np.testing.assert_allclose(*forces, rtol=1e-7, atol=1e-7 * largest(forces[0]))


@pytest.mark.parametrize("angle", (0.254, 0.2541, 0.264))
def test_many_tips(angle):
    """More tips than unknowns below them: few iterations suffice, also with friction."""
    pitch, m, slope = 0.15, 1, 0.5
    places = pitch * np.array([[i, j] for i in range(-m, m + 1) for j in range(-m, m + 1)])
    x, facets = [], []
    for place in places:
        start, half = len(x), pitch / 2
        around = [place + half * np.array(d) for d in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        x += [[*place, 0.0], *([*a, slope * half] for a in around)]
        facets += [[start, start + 1 + k, start + 1 + (k + 1) % 4] for k in range(4)]
    c, s = np.cos(angle), np.sin(angle)
    x = np.array(x) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [0.0316, -0.033, 0.0]
    for law in (None, qs.Coulomb(0.3)):
        contact, problem = pressed(facing(x, facets, up=False), "hexahedron", 3, 0.01, friction=law)
        assert problem.num_iterations <= (15 if law is None else 30)  # 67, and no convergence
        assert contact.force("slave")[2] < -9.0


def test_held_in_rubber():
    """A sharp corner pressed into rubber and held there: its force stays constant."""
    msh = box(WORLD, (12, 8), "quadrilateral", [0.0, -2.0], [3.0, 0.0], "scattered")
    V = vector_space(msh)
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.neo_hookean(u, 1.0, 5.0), ufl.grad(v)) * ufl.dx(degree=4)
    x = np.array([[-1.0, 3.0], [-1.0, 0.0], [1.0, 0.0], [1.0, 3.0]])
    tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2], [2, 3]])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool)
    bcs = [clamp(V, plane(msh, 1, -2.0)), slide(V, 0, plane(msh, 0, 0.0))]
    problem = qs.ContactProblem([F], [u], [contact], [bcs])

    def drive(t, dt):
        tool.displacement[1] = -0.2 * (min(t, 1.0) - min(t - dt, 1.0))

    stepper = qs.TimeStepper(problem, 0.25, drive)
    forces = [contact.force("master")[1] for _ in stepper.run(2.0)]
    np.testing.assert_allclose(forces[4:], forces[3], rtol=5e-3)  # 2.6e-2 along the facet normals
    assert max(row.iterations for row in stepper.log.rows) <= 10


def test_ring():
    """A circular edge between the nodes of a disc does not penetrate from first contact on."""
    msh = box(WORLD, (8, 3), "quadrilateral", [0.0, -0.75], [2.0, 0.0], "scattered")
    V = vector_space(msh)
    u, v = fem.Function(V), ufl.TestFunction(V)
    r = ufl.SpatialCoordinate(msh)[0]

    def strain(w):
        around = w[0] / r
        d = ufl.grad(w)
        return ufl.as_tensor(
            [[d[0, 0], (d[0, 1] + d[1, 0]) / 2, 0], [(d[0, 1] + d[1, 0]) / 2, d[1, 1], 0],
             [0, 0, around]]
        )  # fmt: skip

    F = E * ufl.inner(strain(u), strain(v)) * 2 * np.pi * r * ufl.dx(degree=4)
    x = np.array([[1.7, 0.9], [1.1, 0.0], [0.2, 1.35]])
    tool = qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 1]])
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0), axisymmetric=True)
    contact = qs.Contact(surface, tool)
    bcs = [clamp(V, plane(msh, 1, -0.75)), slide(V, 0, plane(msh, 0, 0.0))]
    problem = qs.ContactProblem([F], [u], [contact], [bcs])
    forces = []
    for depth in (1e-3, 2e-3):
        tool.displacement[1] = -depth * SIZE
        problem.solve()
        forces.append(contact.force("slave")[1])
        assert contact.penetration() < 0.01 * depth * SIZE
    np.testing.assert_allclose(forces[1], 2 * forces[0], rtol=1e-8)
    assert forces[0] < 0


@pytest.mark.parametrize("reach", (1.0, 40.0))
def test_long_edge(reach):
    """An edge hundreds of facets long, mostly outside the block, gives the same force."""
    x, facets = roof([0.25, 0.0, 0.0], 1.5, 0.0)
    x[:, 1] *= reach
    block = Block("hexahedron", facing(x, facets, up=False))
    C = block.compliance(np.array([[0.25, y] for y in ON_LINES]))
    depth = 0.05 * SIZE
    expected = np.linalg.solve(C, np.full(3, depth)).sum()
    np.testing.assert_allclose(block.press(depth)[2], -expected, rtol=1e-8)


@pytest.mark.parametrize("slope", (0.03, 0.08, 0.3))
@pytest.mark.parametrize("kind", ("edge", "tip"))
def test_faces_that_hardly_lean(kind, slope):
    """The sharp end of a face inclined by 2° or more carries the force before the face does."""
    at, cell = ([0.1, 0.0], "triangle") if kind == "edge" else ([0.1, 0.06, 0.0], "hexahedron")
    steep = 2.0
    if kind == "edge":
        x = np.array([[1.2, 1.2 * steep], [0.0, 0.0], [-1.2, 1.2 * slope]]) + at
        tool = qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 1]])
    else:  # two slightly inclined faces and two large steep faces
        low = [[-1.0, -0.6, slope], [0.0, -1.0, slope], [1.0, -0.6, slope]]
        x = np.array([[0.0, 0.0, 0.0], *low, [0.0, 0.1, 1.0]]) + at
        tool = facing(x, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], up=False)
    block = Block(cell, tool)
    depth = 2e-3 * SIZE * slope
    C = block.compliance(np.array([at]))
    np.testing.assert_allclose(block.press(depth)[-1], -depth / C[0, 0], rtol=1e-8)


def test_penalties_on_coarse_facets():
    """Forces grow with the penalty, without a jump where multipliers replace the pure penalty."""
    forces, has_multipliers = [], []
    block = Block("triangle", made("edge", [0.1, 0.0], slope=0.05), enforcement="penalty")
    block.problem.set_up()
    model = block.contact.model
    switch = model.penalty.of_points
    for factor in (0.1, 0.5, 0.99, 1.01, 2.0, 10.0, 1e3, 1e6):
        block = Block("triangle", made("edge", [0.1, 0.0], slope=0.05), enforcement="penalty")
        block.contact.set_penalty(factor * switch)
        forces.append(-block.press(0.05 * SIZE)[-1])
        has_multipliers.append(block.contact.model.has_multipliers_at_points)
    assert has_multipliers == [False] * 3 + [True] * 5
    assert np.all(np.diff(forces) > -1e-9 * forces[-1])
    np.testing.assert_allclose(forces[3], forces[2], rtol=5e-3)


def test_moved_tool():
    """A tool that was moved and rotated to a place acts like a tool that was made there."""
    forces = []
    for moves in (False, True):
        at, yaw = ([0.1, 0.03, 0.0], 37.0) if not moves else ([-0.2, 0.1, 0.3], 10.0)
        block = Block("hexahedron", made("roof", at, 1.5, yaw), search_radius=SIZE)
        if moves:
            tool = block.tool
            for part in (0.4, 0.6):
                turn = np.radians(27.0 * part)
                tool.rotation = [0.0, 0.0, turn]
                tool.displacement = np.zeros(3)
                tool.advance()
            x = tool.position[:, :3] @ np.array(at) + tool.position[:, 3]
            tool.displacement = np.array([0.1, 0.03, 0.0]) - x
            tool.advance()
            block.contact.update()
        forces.append(block.press(0.1 * SIZE))
        sizes = [gap.points.size for gap in block.contact.model.of_vertices]
        forces[-1] = np.append(forces[-1], WORLD.allreduce(np.array(sizes)))
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("law", (qs.Coulomb(0.3), qs.Sticking()))
@pytest.mark.parametrize("case", ("between nodes", "on a square", "across lines"))
def test_friction(case, law):
    """Drawn sideways, the force is Coulomb's limit, or all contacts stick."""
    kind, at, _, cell = CASES[case]
    block = Block(cell, made(kind, at, slope=1.5), friction=law)
    pressed = block.press(0.02 * SIZE)
    force = block.press(0.02 * SIZE, 0.03 * SIZE)
    T, N = np.linalg.norm(force[:-1]), -force[-1]
    if isinstance(law, qs.Coulomb):
        rtol = 1e-2 if kind == "roof" else 1e-8  # each point slips in its own direction
        np.testing.assert_allclose(T, 0.3 * N, rtol=rtol)
        assert block.contact.step_dissipation() > 0
    else:
        assert T > 0.3 * N and block.contact.step_dissipation() < 1e-9 * N * SIZE
    assert largest(pressed) > 0 and block.problem.num_iterations <= 10


@pytest.mark.parametrize("kind", ("edge", "tip", "roof"))
def test_driven(kind):
    """Under force control the tool stops where the edge balances the force."""
    at, cell = ([0.1, 0.0], "triangle") if kind == "edge" else ([0.1, 0.0, 0.0], "hexahedron")
    block = Block(cell, made(kind, at))
    down = -np.eye(block.d)[-1]
    block.tool.drive(3.0, down)
    block.problem.solve()
    np.testing.assert_allclose(block.contact.force("slave")[-1], -3.0, rtol=1e-8)
    depth = -block.tool.displacement[-1]
    block.tool.release()
    np.testing.assert_allclose(block.press(depth)[-1], -3.0, rtol=1e-7)


class Wedge:
    """Cube that stands on an edge along y, held by the faces away from this edge."""

    def __init__(self):
        n, s = 4, np.sqrt(0.5)
        self.msh = box(WORLD, (n,) * 3, "hexahedron", [0, -0.5, 0], [1, 0.5, 1], "scattered")
        self.R = np.array([[s, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, s]])
        self.msh.geometry.x[:] = self.msh.geometry.x @ self.R.T
        self.V = vector_space(self.msh)
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E, 0.3)
        far = self.facets(lambda x: np.isclose(x[0], 1) | np.isclose(x[2], 1))
        self.bcs = [clamp(self.V, far)]

    def facets(self, found):
        return mesh.locate_entities_boundary(self.msh, 2, lambda x: found(self.R.T @ x))

    def compliance(self, y):
        """Return the displacement of the edge there under a force of 1 along z."""

        def load(like):
            owned = self.V.dofmap.index_map.size_local
            x = self.V.tabulate_dof_coordinates()[:owned] @ self.R
            on_edge = np.isclose(x[:, 0], 0) & np.isclose(x[:, 2], 0)
            out = like.duplicate()
            out.array[2::3] = np.maximum(1 - np.abs(x[:, 1] - y) * 4, 0) * on_edge
            return out

        return float(compliance(self, [load])[0, 0])

    def on(self, tool):
        """Return the force of a tool that is lifted against the edge."""
        near = self.facets(lambda x: np.isclose(x[0], 0) | np.isclose(x[2], 0))
        self.contact = qs.Contact(qs.Surface(self.V, facets=near), tool)
        problem = qs.ContactProblem([self.F], [self.u], [self.contact], [self.bcs])
        tool.displacement[2] = 0.05
        problem.solve()
        return self.contact.force("slave")


def test_on_triangles():
    """An edge of a body on a flat tool: the triangulation of the tool does not matter."""
    exact = Wedge().on(qs.RigidSurface.plane(WORLD, np.zeros(3), [0.0, 0.0, 1.0]))
    x = np.array([[-1.2, -1.3, 0], [1.3, -1.1, 0], [1.2, 1.3, 0], [-1.1, 1.2, 0], [0.1, 0.07, 0]])
    up = facing(x, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], up=True)
    np.testing.assert_allclose(Wedge().on(up), exact, rtol=1e-8, atol=1e-9)


def test_edges_that_cross():
    """An edge of a body across an edge of a tool: the force at the crossing, far from nodes."""
    for yaw in (90.0, 50.0):
        wedge = Wedge()
        x, facets = roof([0.0, 0.08, 0.0], 0.5, yaw)
        force = wedge.on(facing(x * [1, 1, -1], facets, up=True))
        np.testing.assert_allclose(force[2], 0.05 / wedge.compliance(0.08), rtol=1e-8)


@pytest.mark.parametrize(("cell", "yaw"), (("tetrahedron", 0.6), ("hexahedron", 0.0)))
def test_steep_wall(cell, yaw):
    """A roof with a steep wall, in a block initially, is not pushed out through a far side."""
    forces = []
    for start in (-1e-3, 1e-3, 0.02):
        msh = box(WORLD, (3, 2, 2), cell, [-2.0, -2.0, -0.8], [2.0, 2.0, 0.0], "scattered")
        V = vector_space(msh)
        u = fem.Function(V)
        F = elastic(u, 1e3)
        sides = [plane(msh, i, end) for i in range(2) for end in (-2.0, 2.0)]
        bcs = [clamp(V, plane(msh, 2, -0.8))]
        profile = ((-0.7, 0.6), (0.0, 0.0), (0.005, 0.5))
        x = np.array([[a, y, z - start] for y in (-1.5, 1.5) for a, z in profile])
        facets = [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]]
        c, s = np.cos(yaw), np.sin(yaw)
        x = x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        tool = facing(x, facets, up=False)
        surface = qs.Surface(V, facets=np.concatenate([plane(msh, 2, 0.0), *sides]))
        contact = qs.Contact(surface, tool)
        tool.displacement = [0.0, 0.0, start - 0.03]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", qs.ContactWarning)
            qs.ContactProblem([F], [u], [contact], [bcs]).solve()
        forces.append(contact.force("slave"))
        assert WORLD.allreduce(largest(u.x.array), op=MPI.MAX) < 0.06
    for force in forces:
        assert -600.0 < force[2] < -300.0 and largest(force[:2]) < 1.0
