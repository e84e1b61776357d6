"""Remeshing: volumes, planes, lines, tags, sizes, and bodies that cannot be meshed."""

from mpi4py import MPI

import numpy as np
import pytest
from forming_bodies import quarter_cylinder
from remeshing_scenes import all_nodes, area, bump, nodes_on, num_cells, tagged, volume
from scenes import WORLD, box

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.remeshing.outline import Outline
from qsdolfinx.remeshing.remesh import SIZES
from qsdolfinx.remeshing.sizes import limit_growth
from qsdolfinx.steps.mesh_motion import MeshMotion

pytest.importorskip("gmsh")


def barrel(comm=WORLD, n=8):
    """A meridian section (r, z) with a curved side, and tags of axis, bottom and top."""
    msh = mesh.create_rectangle(comm, [[0, 0], [10, 15]], [n, 12])
    tags = tagged(msh, [(0, 0.0), (1, 0.0), (1, 15.0)])
    x = msh.geometry.x
    x[:, 0] *= 1 + 0.1 * np.sin(np.pi * x[:, 1] / 15)
    return msh, tags


def quality(msh):
    return MeshMotion(
        fem.Function(fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,))))
    ).quality()


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_section_keeps_volume_lines_and_tags(axisymmetric):
    msh, tags = barrel()
    made = qs.remesh(msh, 0.9, tags, axisymmetric=axisymmetric)
    assert abs(made.report.volume_change) < 1e-10 < abs(made.report.unrestored) < 1e-2
    if not axisymmetric:
        assert np.isclose(volume(made.mesh), volume(msh), rtol=1e-10)
    for tag, axis, value in ((1, 0, 0.0), (2, 1, 0.0), (3, 1, 15.0)):
        assert np.all(nodes_on(made, tag)[:, axis] == value)
    assert np.allclose([area(made, tag) for tag in (1, 2, 3)], [15, 10, 10], rtol=1e-12)
    assert made.report.num_cells == num_cells(made.mesh)
    assert np.isclose(made.report.quality, quality(made.mesh)) and made.report.quality > 0.3


def test_box_keeps_its_planes_edges_and_corners():
    msh = mesh.create_box(WORLD, [[0, 0, 0], [1, 2, 3]], [3, 6, 8])
    planes = [(axis, value) for axis in range(3) for value in (0.0, (1.0, 2.0, 3.0)[axis])]
    made = qs.remesh(msh, 0.4, tagged(msh, planes))
    areas = [area(made, tag) for tag in range(1, 7)]
    assert np.allclose(areas, [6, 6, 3, 3, 2, 2], rtol=1e-12)
    for tag, (axis, value) in enumerate(planes, 1):
        assert np.all(nodes_on(made, tag)[:, axis] == value)
    assert np.isclose(volume(made.mesh), 6, rtol=1e-12)
    x = all_nodes(made.mesh)
    ends = np.isin(x, [0.0, 1.0, 2.0, 3.0]) & np.isclose(np.minimum(x, [1, 2, 3] - x), 0)
    assert np.sum(ends.all(axis=1)) == 8


def test_the_worst_cell_is_as_wanted():
    """The first mesh that is good enough is used, or else the best mesh of all sizes tried."""
    msh = mesh.create_box(WORLD, [[0.0] * 3, [1.0, 1.1, 1.2]], [4, 4, 4])
    made = [qs.remesh(msh, factor * 0.22).report for factor in SIZES]
    first, best = made[0].quality, max(report.quality for report in made)
    assert best > first
    for wanted in (0.9 * first, 0.5 * (first + best), 0.99):
        found = qs.remesh(msh, 0.22, min_quality=wanted).report
        enough = (r for r in made if r.quality >= wanted)
        expected = next(enough, max(made, key=lambda r: r.quality))
        assert (found.num_cells, found.quality) == (expected.num_cells, expected.quality)


def test_ten_times_in_a_row():
    height, size = 6.0, 1.2
    msh = quarter_cylinder(WORLD, 10.0, 0.0, height, size)
    tags = tagged(msh, [(0, 0.0), (1, 0.0), (2, 0.0)])
    counts = []
    for i in range(10):
        bump(msh, i, height)
        before = volume(msh)
        msh, tags, report = qs.remesh(msh, size, tags)
        assert np.isclose(volume(msh), before, rtol=1e-10)
        assert report.quality > 0.05
        for axis in range(3):
            made = qs.Remeshed(msh, tags, report)
            assert np.all(nodes_on(made, axis + 1)[:, axis] == 0.0)
        counts.append(report.num_cells)
    assert max(counts) < 1.3 * min(counts)


@pytest.mark.parametrize("dim", [2, 3])
def test_same_mesh_on_any_partition(dim):
    def make(comm):
        if dim == 2:
            return qs.remesh(barrel(comm)[0], 1.1, axisymmetric=True)
        msh = mesh.create_box(comm, [[0, 0, 0], [1, 1, 1]], [4, 4, 4])
        msh.geometry.x[:, 0] *= 1 + 0.2 * np.sin(2 * msh.geometry.x[:, 2])
        return qs.remesh(msh, 0.25)

    alone, together = make(WORLD.Split(WORLD.rank)), make(WORLD)
    assert alone.report == together.report
    assert np.array_equal(all_nodes(alone.mesh), all_nodes(together.mesh))


def test_displaced_body_is_the_moved_one():
    msh = barrel()[0]
    u = fem.Function(fem.functionspace(msh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.stack([0.1 * x[0] * np.sin(x[1] / 5), 0.02 * x[0]]))
    x = msh.geometry.x.copy()
    displaced = qs.remesh(u, 1.1)
    assert np.array_equal(msh.geometry.x, x)
    x[:, :2] += all_values(u)
    msh.geometry.x[:] = x
    moved = qs.remesh(msh, 1.1)
    assert np.allclose(all_nodes(moved.mesh), all_nodes(displaced.mesh), atol=1e-9)


def all_values(u):
    """Values of a function of degree 1 at the nodes of its mesh."""
    out = np.zeros((len(u.function_space.mesh.geometry.x), 2))
    out[qs.compat.cell_nodes(u.function_space.mesh)] = u.x.array.reshape(-1, 2)[
        u.function_space.dofmap.list
    ]
    return out


def test_the_end_of_the_axis_is_kept():
    """The tip of a steep conical recess is a corner, although the boundary turns by only 27°."""
    msh = box(WORLD, (6, 8), "triangle", [0.0, 0.0], [3.0, 4.0])
    x = msh.geometry.x
    bottom = np.maximum(2 - 2 * x[:, 0], 0.0)
    x[:, 1] = bottom + (1 - bottom / 4) * x[:, 1]
    made = qs.remesh(msh, 0.43, axisymmetric=True)
    away = np.linalg.norm(all_nodes(made.mesh) - [0.0, 2.0, 0.0], axis=1)
    assert away.min() < 1e-6


def test_line_between_tags_is_kept():
    """The line where tags change within a plane is kept, although there is no sharp edge."""
    msh = mesh.create_unit_cube(WORLD, 4, 4, 4)
    msh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(msh.topology)
    middle = mesh.compute_midpoints(msh, 2, facets)
    values = np.where((middle[:, 2] > 1 - 1e-9) & (middle[:, 0] < 0.5), 7, 1).astype(np.int32)
    made = qs.remesh(msh, 0.17, mesh.meshtags(msh, 2, facets, values))
    assert np.allclose([area(made, 7), area(made, 1)], [0.5, 5.5], rtol=1e-12)
    assert np.all(nodes_on(made, 7)[:, 0] <= 0.5)


def test_a_hole_in_a_section():
    import gmsh
    from common.bodies import gmsh_mesh

    def draw(_):
        plate = gmsh.model.occ.addRectangle(0, 0, 0, 3, 2)
        hole = gmsh.model.occ.addDisk(1, 1, 0, 0.5, 0.5)
        gmsh.model.occ.cut([(2, plate)], [(2, hole)])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)

    msh = gmsh_mesh(WORLD, 2, draw)
    made = qs.remesh(msh, 0.15)
    assert np.isclose(volume(made.mesh), volume(msh), rtol=1e-10)


# --- Sizes


def test_sizes_are_followed():
    msh = mesh.create_rectangle(WORLD, [[0, 0], [4, 1]], [16, 4])
    coarse, fine = qs.remesh(msh, 0.2).report, qs.remesh(msh, 0.1).report
    assert 3.2 < fine.num_cells / coarse.num_cells < 4.8
    V = fem.functionspace(msh, ("Lagrange", 1))
    size = fem.Function(V)
    size.interpolate(lambda x: 0.1 + 0.05 * x[0])
    by_field = qs.remesh(msh, size).report.num_cells
    by_points = qs.remesh(msh, lambda x: 0.1 + 0.05 * x[0]).report.num_cells
    assert by_field == pytest.approx(by_points, rel=0.02)  # except for rounding
    assert coarse.num_cells < by_field < fine.num_cells
    assert qs.remesh(msh, [size, 0.1]).report.num_cells == fine.num_cells


def test_growth_of_sizes():
    """Sizes are the largest ones that grow from node to node by no more than a part of the way."""
    rng, n, part = np.random.default_rng(0), 12, 0.3
    x = np.column_stack([np.sort(rng.random(n)), rng.random(n), np.zeros(n)])
    cells = np.arange(n - 2)[:, None] + np.arange(3)
    sizes = rng.permutation(np.geomspace(0.01, 10.0, n))
    outline = Outline(x, cells[:, :2], np.zeros(n - 2, dtype=np.int64), cells, sizes)
    i = np.arange(n)
    way = np.linalg.norm(x[:, None] - x, axis=2)
    way[np.abs(i[:, None] - i) > 2] = np.inf  # not in one cell
    for k in range(n):
        way = np.minimum(way, way[:, k : k + 1] + way[k])
    found = limit_growth(outline, part).sizes
    np.testing.assert_allclose(found, np.min(sizes + part * way, axis=1), rtol=1e-12)


def test_size_from_curvature_is_radius_times_angle():
    msh = mesh.create_rectangle(WORLD, [[0, 0], [1, 1]], [40, 40])
    x = msh.geometry.x
    r, angle = 1 + x[:, 0], np.pi / 2 * x[:, 1]
    x[:, 0], x[:, 1] = r * np.cos(angle), r * np.sin(angle)
    size = qs.size_from_curvature(msh, 0.1, 0.01, 10.0)
    at = WORLD.allreduce(size.x.array.min(initial=np.inf), op=MPI.MIN)
    assert np.isclose(at, 0.1, rtol=1e-2)
    radius = np.linalg.norm(all_nodes(qs.remesh(msh, size).mesh), axis=1)
    assert 15 <= np.sum(radius < 1.01) <= 19


def test_size_from_distance_of_shapes_and_facets():
    x = np.random.default_rng(1).uniform(-1, 1, (3, 20))
    x[2] *= 0.3  # on both sides
    shape = qs.RigidSurface.plane(WORLD, [0, 0, 0], [0, 0, 1])
    corners = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]
    facets = qs.RigidSurface.triangulated(WORLD, corners, [[0, 1, 2], [0, 2, 3]])
    expected = 0.1 + 0.4 * np.clip(np.abs(x[2]) / 0.2, 0, 1)
    for tool in (shape, facets):
        assert np.allclose(qs.size_from_distance(tool, 0.1, 0.5, 0.2)(x), expected)


def test_size_from_field():
    msh = mesh.create_unit_square(WORLD, 8, 8)
    strain = fem.Function(fem.functionspace(msh, ("DG", 0)))
    strain.interpolate(lambda x: np.where(x[0] < 0.5, 0.0, 2.0))
    size = qs.size_from_field(strain, [0.0, 1.0], [0.2, 0.05], msh)
    x = size.function_space.tabulate_dof_coordinates()
    assert np.allclose(size.x.array[x[:, 0] < 0.45], 0.2)
    assert np.allclose(size.x.array[x[:, 0] > 0.55], 0.05)


# --- Bodies that cannot be meshed


def test_boundary_through_itself_is_refused_with_the_place():
    """A tongue of a body that goes through its neighbour is refused, with the place."""
    msh = mesh.create_rectangle(WORLD, [[0, 0], [3, 3]], [12, 12])
    keep = mesh.locate_entities(
        msh, 2, lambda x: (x[0] < 1.01) | (x[1] < 1.01) | ((x[0] > 1.99) & (x[1] < 2.6))
    )
    msh = mesh.create_submesh(msh, 2, keep)[0]
    x = msh.geometry.x
    above = x[:, 1] > 1.01
    right = above & (x[:, 0] > 1.5)
    x[right, 0] -= 1.5 * (x[right, 1] - 1.0)
    before = x.copy()
    with pytest.raises(qs.RemeshError, match="passes through itself at") as caught:
        qs.remesh(msh, 0.3)
    assert caught.value.where.shape[1] == 3 and len(caught.value.where) > 0
    x, y, _ = caught.value.where.T
    assert np.all(np.isclose(x, 0) | np.isclose(x, 1)) and np.all((y > 1.5) & (y < 2.5))
    assert np.array_equal(msh.geometry.x, before)


@pytest.mark.parametrize("part", (2e-5, 5e-4))
def test_volume_that_cannot_be_restored(part):
    """A slightly curved side of one new segment: only the corners are left, which stay."""
    msh = mesh.create_rectangle(WORLD, [[0, 0], [1, 1]], [4, 4])
    x = msh.geometry.x
    x[:, 1] *= 1 + part * 8 / 5 * 4 * x[:, 0] * (1 - x[:, 0])  # by the trapezoidal rule
    if part > 1e-4:
        with pytest.raises(qs.RemeshError, match="since no boundary node is free"):
            qs.remesh(msh, 2.0)
    else:
        report = qs.remesh(msh, 2.0).report
        np.testing.assert_allclose(report.volume_change, -part, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"size": -1.0}, "size: must be a positive"),
        ({"size": lambda x: -x[0]}, "size: must be positive and finite everywhere"),
        ({"size": []}, "size: must not be an empty list"),
        ({"feature_angle": 200.0}, "feature_angle: must be an angle"),
        ({"gradation": 0.0}, "gradation: must be"),
        ({"body": mesh.create_unit_square(WORLD, 2, 2, mesh.CellType.quadrilateral)}, "body: must"),
    ],
)
def test_bad_arguments_are_named(arguments, text):
    given = {"body": mesh.create_unit_square(WORLD, 3, 3), "size": 0.3} | arguments
    with pytest.raises(ValueError, match=text):
        qs.remesh(**given)


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    "sizes",
    [([0.3, 0.2], [0.3]), (0.3, 0.2), ([0.3], 0.3), (lambda x: 0.3 + 0 * x[0], 0.3)],
    ids=("lists", "numbers", "list-number", "function-number"),
)
def test_sizes_differ_between_ranks(sizes):
    """Sizes that differ between ranks raise an error on all ranks, and no rank waits."""
    msh = mesh.create_unit_square(WORLD, 4, 4)
    with pytest.raises(ValueError, match="size"):
        qs.remesh(msh, sizes[min(WORLD.rank, 1)])


def test_a_complex_size():
    msh = mesh.create_unit_square(WORLD, 4, 4)
    with pytest.raises(ValueError, match="size: must return a real number"):
        qs.remesh(msh, lambda x: 0.3 + 0j * x[0])


@pytest.mark.several_ranks
def test_tags_of_one_rank_alone():
    msh = mesh.create_unit_square(WORLD, 4, 4)
    tags = tagged(msh, [(0, 0.0)])
    with pytest.raises(ValueError, match="facet_tags"):
        qs.remesh(msh, 0.3, tags if WORLD.rank == 0 else None)
