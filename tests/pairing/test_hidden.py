"""Facets hidden behind others do not count: plates, boxes and sheets, against brute force."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    FORMULATIONS,
    WORLD,
    blocks,
    box,
    clamp,
    elastic,
    gathered,
    plane,
    slide,
    vector_space,
)

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

pytestmark = pytest.mark.filterwarnings("ignore::qsdolfinx.ContactWarning")
QUADRATURES = ("nodal", "overlay")
SQUARES = (0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)


def exterior(msh):
    fdim = msh.topology.dim - 1
    return mesh.locate_entities_boundary(msh, fdim, lambda x: np.full(x.shape[1], True))


def plates(gdim, depths, size=1.0):
    """Make thin plates at these depths; return the surface of upper faces, and all facets."""
    axis, thin = gdim - 1, 1e-3
    boxes = [([0.0] * axis + [-t - thin], [size] * axis + [-t]) for t in depths]
    msh = blocks(*boxes)
    V = vector_space(msh)
    faces = np.unique(np.concatenate([plane(msh, axis, -t) for t in depths]))
    return V, faces, clamp(V, exterior(msh))


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("gdim", (2, 3))
def test_second_sheet_changes_nothing(gdim, formulation, quadrature):
    """A block pressed on plates has the same depth if there are other plates below them."""
    axis, deepest = gdim - 1, []
    for depths in ((0.0,), (0.0, 0.005), (0.0, 0.02), (0.0, 0.1, 0.15)):
        cell = "quadrilateral" if gdim == 2 else "hexahedron"
        msh = box(WORLD, [2] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
        V = vector_space(msh)
        u = fem.Function(V)
        top = np.sort(plane(msh, axis, 1.0))
        tags = mesh.meshtags(msh, axis, top, np.ones(len(top), dtype=np.int32))
        ds = ufl.Measure("ds", msh, subdomain_data=tags)
        F = elastic(u, 1e4) + 20.0 * ufl.TestFunction(V)[axis] * ds(1)
        V_m, faces, held = plates(gdim, depths)
        u_m = fem.Function(V_m)
        contact = qs.Contact(
            qs.Surface(V, facets=plane(msh, axis, 0.0)),
            qs.Surface(V_m, facets=faces),
            formulation=formulation,
            quadrature=quadrature,
            penalty=1e6,
            search_radius=0.5,
        )
        bcs = [[slide(V, i, plane(msh, i, 0.0)) for i in range(axis)], [held]]
        qs.ContactProblem([F, elastic(u_m, 1e4)], [u, u_m], [contact], bcs).solve()
        deepest.append(WORLD.allreduce(u.x.array[axis::gdim].min(initial=0.0), op=MPI.MIN))
    np.testing.assert_allclose(deepest[1:], deepest[0], rtol=1e-6)


def test_a_wall_in_between():
    """No node sees a face through the back of a plate, wherever it looks through its facet."""
    msh = box(WORLD, (4, 4, 1), "hexahedron", [0.0] * 3, [1.0, 1.0, 0.2], "scattered")
    slave = qs.Surface(vector_space(msh), facets=plane(msh, 2, 0.2))
    lid = blocks(([-0.1, -0.1, 0.35], [1.1, 1.1, 0.4]), ([-0.1, -0.1, 0.5], [1.1, 1.1, 0.6]))
    far, back = plane(lid, 2, 0.5), plane(lid, 2, 0.4)
    hidden = []
    for faces in ([far], [far, back]):
        master = qs.Surface(vector_space(lid), facets=np.unique(np.concatenate(faces)))
        options = {"formulation": "master-slave", "quadrature": "nodal", "search_radius": 0.5}
        hidden.append(qs.Contact(slave, master, **options).num_unpaired)
    assert hidden == [0, 25]


def hollow(low, high, wall):
    """Make triangles of a box with a cavity: outer walls and walls that face into the cavity."""
    x, triangles = [], []
    for sign, grow in ((1, 0.0), (-1, -wall)):
        first = len(x)
        corner = np.array([low, high]) + grow * np.array([[-1.0], [1.0]])
        x += [[corner[i >> k & 1, k] for k in range(3)] for i in range(8)]
        for square in SQUARES:
            for corners in (square[:3], (square[0], *square[2:])):
                triangles.append([first + i for i in corners[::sign]])
    return x, triangles


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
def test_hollow_tool(formulation, quadrature):
    """A box with a cavity, named by all its facets, has the same contact as a solid box."""
    forces = []
    for wall in (None, 0.2, 0.05):
        x, triangles = hollow([-0.5, -0.5, 0.0], [1.5, 1.5, 1.0], wall or 0.2)
        tool = qs.RigidSurface.triangulated(WORLD, x, triangles[: None if wall else 12])
        msh = box(WORLD, [3, 3, 1], "hexahedron", [0.0, 0.0, -1.0], [1.0, 1.0, 0.0])
        V = vector_space(msh)
        u = fem.Function(V)
        surface = qs.Surface(V, facets=plane(msh, 2, 0.0))
        options = {"quadrature": quadrature, "penalty": 1e5, "search_radius": 1.5}
        contact = qs.Contact(surface, tool, formulation=formulation, **options)
        bcs = [[clamp(V, plane(msh, 2, -1.0))]]
        problem = qs.ContactProblem([elastic(u, 100.0)], [u], [contact], bcs)
        tool.displacement[-1] = -0.02
        problem.solve()
        forces.append(contact.force("slave")[-1])
    assert forces[0] < -1
    np.testing.assert_allclose(forces[1:], forces[0], rtol=1e-9)


def pick(heights, looks_up, on_master, i):
    """Return the nearest of the first sheets on both sides of sheet i that is opposed to it."""
    found = []
    for way in (1, -1):
        ahead = [
            j
            for j in range(len(heights))
            if on_master[j] != on_master[i] and way * (heights[j] - heights[i]) > 0
        ]
        first = min(ahead, key=lambda j: abs(heights[j] - heights[i]), default=i)
        if looks_up[first] != looks_up[i]:
            found.append(first)
    return min(found, key=lambda j: abs(heights[j] - heights[i]), default=None)


def sheets(gdim, heights, looks_up):
    """Make unit sheets at these heights: faces of thin blocks above or below them."""
    axis, thick = gdim - 1, 1e-4
    ends = np.sort(np.column_stack([heights, heights - np.where(looks_up, thick, -thick)]))
    msh = blocks(*([[0.0] * axis + [a], [1.0] * axis + [b]] for a, b in ends))
    faces = np.unique(np.concatenate([plane(msh, axis, z) for z in heights]))
    return qs.Surface(vector_space(msh), facets=faces)


@pytest.mark.parallel
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
def test_stacks_of_sheets(gdim, quadrature):
    """Of sheets with random orientation, exactly those that face each other are paired."""
    axis, radius, count = gdim - 1, 0.45, 0
    for seed in range(20):
        rng = np.random.default_rng([seed, gdim])
        heights = rng.permutation(np.linspace(-0.3, 0.3, 7)) + rng.uniform(-0.04, 0.04, 7)
        looks_up, on_master = rng.random(7) < 0.5, np.arange(7) < 4
        picks = [pick(heights, looks_up, on_master, i) for i in range(7)]
        expected = {
            (round(heights[i], 9), round(heights[j], 9))
            for i, j in enumerate(picks)
            if not on_master[i] and j is not None and picks[j] == i
            if abs(heights[i] - heights[j]) <= radius
        }
        count += len(expected)
        slave, master = (sheets(gdim, heights[m], looks_up[m]) for m in (~on_master, on_master))
        options = {"search_radius": radius, "penalty": 1.0, "initial_overclosure": "ignore"}
        p = qs.Contact(slave, master, quadrature=quadrature, **options).pairing
        rows = np.column_stack([p.slave.x[:, axis], p.master.x[:, axis], p.weight])
        rows = gathered(WORLD, rows)
        assert {tuple(pair) for pair in np.round(rows[:, :2], 9)} == expected, seed
        assert np.isclose(rows[:, 2].sum(), len(expected)), seed  # half of the areas of both sheets
    assert count > 15


@pytest.mark.parametrize("gdim", (2, 3))
def test_beside_a_near_plate_and_before_a_far_one(gdim):
    """Nodes beside a plate, although it is nearer, are paired with the face opposite them."""
    axis, middle = gdim - 1, [1.0] * (gdim - 2)
    below = blocks(
        ([0.0] * axis + [-0.03], [0.55, *middle, -0.02]),
        ([0.0] * axis + [-1.0], [1.0, *middle, -0.3]),
    )
    cell = "quadrilateral" if gdim == 2 else "hexahedron"
    msh = box(WORLD, [4] * axis + [1], cell, [0.0] * gdim, [1.0] * gdim, "scattered")
    faces = np.concatenate([plane(below, axis, -0.02), plane(below, axis, -0.3)])
    contact = qs.Contact(
        qs.Surface(vector_space(msh), facets=plane(msh, axis, 0.0)),
        qs.Surface(vector_space(below), facets=np.unique(faces)),
        formulation="master-slave",
        penalty=1.0,
        search_radius=0.5,
        quadrature="nodal",
    )
    points, unpaired = contact.pairing, contact.num_unpaired
    x = points.slave.x[:, 0]
    np.testing.assert_allclose(points.gap, np.where(x < 0.6, 0.02, 0.3), atol=1e-14)
    assert unpaired == 0


def turn(rng):
    """Make a map of points to a random scale, micrometres to kilometres, and orientation."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q[:, 0] *= np.linalg.det(q)
    scale = 10 ** rng.uniform(-6, 3)
    return scale, lambda x: scale * np.asarray(x) @ q.T


def shells(place, behind):
    """Make a tool of two triangles per side, with a smaller one of equal orientation inside."""
    x, triangles = hollow([-0.5, -0.5, 0.01], [1.5, 1.5, 0.6], 0.2)
    triangles = np.array(triangles)
    triangles[12:] = triangles[12:, ::-1]  # a body within the body
    return qs.RigidSurface.triangulated(WORLD, place(x), triangles[: 24 if behind else 12])


def layers(place, behind, cell, n):
    """Make the lower faces of a plate, or of two plates above each other."""
    msh = box(WORLD, [n, n, 3], cell, [-0.2, -0.2, 0.01], [1.2, 1.2, 0.31])
    ends = [
        mesh.locate_entities(msh, 3, lambda x: x[2] < 0.11 + 1e-9),
        mesh.locate_entities(msh, 3, lambda x: x[2] > 0.21 - 1e-9),
    ]
    plates = mesh.create_submesh(msh, 3, np.sort(np.concatenate(ends)))[0]
    faces = [plane(plates, 2, z) for z in ((0.01, 0.21) if behind else (0.01,))]
    plates.geometry.x[:] = place(plates.geometry.x)
    return qs.Surface(vector_space(plates), facets=np.sort(np.concatenate(faces)))


def covered(seed, behind):
    """Return the covered part of a square before a plate, and the gaps, of a random scene.

    Behind the front of two triangles, or of a grid, there may be a second front with the same
    orientation. Many of the points are on the edges of the front, except for rounding.
    """
    rng = np.random.default_rng(seed)
    scale, place = turn(rng)
    n, m, kind = rng.choice([3, 4, 5, 6]), rng.choice([2, 3, 4, 5, 7]), rng.integers(3)
    msh = box(WORLD, [n, n, 1], "hexahedron", [0.0, 0.0, -0.3], [1.0, 1.0, 0.0])
    bottom = plane(msh, 2, 0.0)
    msh.geometry.x[:] = place(msh.geometry.x)
    cell = ("tetrahedron", "hexahedron")[kind % 2]
    master = shells(place, behind) if kind == 2 else layers(place, behind, cell, m)
    slave = qs.Surface(vector_space(msh), facets=bottom)
    options = {"search_radius": 0.4 * scale, "quadrature": "overlay", "penalty": 1.0}
    points = qs.Contact(slave, master, formulation="master-slave", **options).pairing
    return points.weight.sum() / scale**2, points.gap / scale


@pytest.mark.one_rank
def test_nothing_is_seen_through_edges():
    """A square of any scale and orientation is covered exactly once, by the front face only."""
    for seed in range(60):
        for behind in (False, True):
            share, gap = covered(seed, behind)
            np.testing.assert_allclose(share, 1, rtol=1e-9, err_msg=f"{seed} {behind}")
            np.testing.assert_allclose(gap, 0.01, rtol=1e-6, err_msg=f"{seed} {behind}")


@pytest.mark.one_rank
def test_force_of_the_front_alone():
    """Facets behind the front of a tool add nothing to its force, at any scale."""
    for seed in (1, 30, 41, 55):
        forces = []
        for behind in (False, True):
            rng = np.random.default_rng(seed)
            scale, place = turn(rng)
            n = rng.choice([4, 5, 6])
            msh = box(WORLD, [n, n, 2], "hexahedron", [0.0, 0.0, -0.6], [1.0, 1.0, 0.0])
            top, bottom = plane(msh, 2, 0.0), plane(msh, 2, -0.6)
            msh.geometry.x[:] = place(msh.geometry.x)
            V, tool = vector_space(msh), shells(place, behind)
            u, surface = fem.Function(V), qs.Surface(V, facets=top)
            contact = qs.Contact(surface, tool, search_radius=0.4 * scale)
            problem = qs.ContactProblem([elastic(u, 1e3)], [u], [contact], [[clamp(V, bottom)]])
            tool.displacement = place([[0.0, 0.0, -0.04]])[0]
            problem.solve()
            forces.append(contact.force("slave") / scale**2)
        assert np.linalg.norm(forces[0]) > 10
        np.testing.assert_allclose(forces[1], forces[0], atol=1e-7 * np.abs(forces[0]).max())
