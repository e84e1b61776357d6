"""Choice of the facet for a point, if several facets of the other surface qualify."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, blocks, box, create_mesh, gathered, plane, vector_space

import basix.ufl
import ufl
from dolfinx import mesh

import qsdolfinx as qs

QUADRATURES = ("nodal", "overlay")


def facing(msh, axis, values):
    """Return the boundary facets in any of several planes across an axis."""
    return np.unique(np.concatenate([plane(msh, axis, value) for value in values]))


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
def test_plate_in_a_slot(gdim, quadrature):
    """Each side of a thin plate is paired with the wall it faces, although the other is near."""
    n, low, high = [5] * gdim, np.zeros(gdim), np.ones(gdim)
    low[0], high[0], n[0] = 0.1, 0.12, 1
    plate = box(WORLD, n, "quadrilateral" if gdim == 2 else "hexahedron", low, high, "scattered")
    walls = blocks(
        ([-1.0] + [-0.1] * (gdim - 1), [0.0] + [1.1] * (gdim - 1)),
        ([0.4] + [-0.1] * (gdim - 1), [1.4] + [1.1] * (gdim - 1)),
    )
    slave = qs.Surface(vector_space(plate), facets=facing(plate, 0, (0.1, 0.12)))
    master = qs.Surface(vector_space(walls), facets=facing(walls, 0, (0.0, 0.4)))
    options = {"quadrature": quadrature, "search_radius": 0.5, "penalty": 1.0, "normals": "facet"}
    contact = qs.Contact(slave, master, formulation="master-slave", **options)
    points = contact.pairing
    left = points.slave.x[:, 0] < 0.11
    areas = [WORLD.allreduce(points.weight[side].sum()) for side in (left, ~left)]
    unpaired = contact.num_unpaired
    np.testing.assert_allclose(points.gap, np.where(left, 0.1, 0.28), atol=1e-14)
    np.testing.assert_allclose(points.normal[:, 0], np.where(left, -1, 1), atol=1e-14)
    np.testing.assert_allclose(points.master.x[:, 0], np.where(left, 0, 0.4), atol=1e-14)
    np.testing.assert_allclose(areas, 1.0)
    assert unpaired == 0


@pytest.mark.filterwarnings("ignore:normals")  # the back of the plate gives no pairs
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
def test_what_is_behind_is_hidden(gdim, quadrature):
    """In front of part of a wall a plate counts, because it is nearer; its back never counts."""
    cell = "quadrilateral" if gdim == 2 else "hexahedron"
    msh = box(WORLD, [4] * (gdim - 1) + [1], cell, [0.0] * gdim, [1.0] * gdim)
    axis, middle = gdim - 1, [1.0] * (gdim - 2)
    below = blocks(
        ([0.0] * axis + [-0.03], [0.5, *middle, -0.02]),
        ([0.0] * axis + [-1.0], [1.0, *middle, -0.06]),
    )
    slave = qs.Surface(vector_space(msh), facets=plane(msh, axis, 0.0))
    faces = facing(below, axis, (-0.02, -0.03, -0.06))
    master = qs.Surface(vector_space(below), facets=faces)
    options = {"quadrature": quadrature, "search_radius": 0.1, "penalty": 1.0, "normals": "facet"}
    points = qs.Contact(slave, master, formulation="master-slave", **options).pairing
    x = points.slave.x[:, 0]
    inner = np.abs(x - 0.5) > 1e-9  # without the edge of the plate
    expected = np.where(x < 0.5, 0.02, 0.06)
    area = WORLD.allreduce(points.weight.sum())
    back = qs.Surface(vector_space(below), facets=facing(below, axis, (-0.03,)))
    contact = qs.Contact(slave, back, formulation="master-slave", **options)
    behind = WORLD.allreduce(len(contact.pairing))
    np.testing.assert_allclose(points.gap[inner], expected[inner], atol=1e-14)
    assert np.isclose(area, 1.0) and behind == 0


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("axis, sign", [(i, s) for i in range(3) for s in (1, -1)])
def test_open_gap_along_any_axis(axis, sign, quadrature, formulation):
    """For bodies apart along x, y or z, in either order, the pairs are the same."""
    surfaces = []
    for n, low in ((3, 0.3), (4, -1.0)):
        msh = box(WORLD, [n, n, 1], "hexahedron", [0.0, 0.0, low], [1.0, 1.0, low + 1.0])
        V, face = vector_space(msh), plane(msh, 2, max(low, 0.0))
        x = msh.geometry.x
        x[:, 2] *= sign
        x[:] = np.roll(x, axis - 2, axis=1)
        surfaces.append(qs.Surface(V, facets=face))
    options = {"quadrature": quadrature, "search_radius": 0.4, "penalty": 1.0}
    contact = qs.Contact(*surfaces, formulation=formulation, **options)
    points, unpaired = contact.pairing, contact.num_unpaired
    area = WORLD.allreduce(points.weight.sum())
    np.testing.assert_allclose(points.gap, 0.3, rtol=1e-13)
    np.testing.assert_allclose(points.normal[:, axis], -sign, rtol=1e-13)
    np.testing.assert_allclose(points.slave.x[:, axis], 0.3 * sign, rtol=1e-13)
    np.testing.assert_allclose(points.master.x[:, axis], 0.0, atol=1e-14)
    assert np.isclose(area, 1.0) and unpaired == 0


@pytest.mark.parametrize("gdim", (2, 3))
def test_beyond_an_edge_round_which_the_surface_goes_on(gdim):
    """Points beyond a corner's edge are unpaired: the adjacent face has another orientation."""
    cell, axis = "quadrilateral" if gdim == 2 else "hexahedron", gdim - 1
    wide = box(WORLD, [8] + [2] * (axis - 1) + [1], cell, [0.0] * gdim, [2.0] + [1.0] * axis)
    wide.geometry.x[:, axis] += 0.01
    low = [0.0] * axis + [-1.0]
    corner = box(WORLD, [3] * axis + [4], cell, low, [1.0] * axis + [0.0], "backward")
    faces = np.concatenate([plane(corner, axis, 0.0), plane(corner, 0, 1.0)])
    slave = qs.Surface(vector_space(wide), facets=plane(wide, axis, 0.01))
    master = qs.Surface(vector_space(corner), facets=faces)
    contact = qs.Contact(
        slave,
        master,
        formulation="master-slave",
        quadrature="nodal",
        search_radius=0.8,
        penalty=1.0,
    )
    paired, x = np.isfinite(contact.weighted_gap()), slave.node_x[:, 0]
    alone, unpaired = WORLD.allreduce(np.count_nonzero(~paired)), contact.num_unpaired
    np.testing.assert_array_equal(paired, x < 1 + 1e-9)
    np.testing.assert_allclose(contact.weighted_gap()[paired], -0.01, rtol=1e-10)
    assert alone == unpaired > 0


@pytest.mark.parametrize("turns", range(4))
def test_ridge_of_cells_numbered_anyhow(turns):
    """A node above a ridge is paired with its edge, however the cells are numbered."""
    columns = [(i, j) for i in range(3) for j in (0, 1)]
    x = np.array([[i, j, z] for i, j in columns for z in (-1.0, -0.5 * abs(i - 1))])
    cells = []
    for i in (0, 1):
        square = [(i, 0), (i + 1, 0), (i, 1), (i + 1, 1)]
        for _ in range(turns if i else 0):  # about the vertical axis
            square = [square[k] for k in (1, 3, 0, 2)]
        cells.append([2 * columns.index(p) + k for k in (0, 1) for p in square])
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,)))
    mine = slice(None) if WORLD.rank == 0 else slice(0)
    roof = create_mesh(np.array(cells)[mine], x[mine], domain)
    top = mesh.locate_entities_boundary(roof, 2, lambda y: y[2] > -0.6)
    msh = box(WORLD, [4, 2, 1], "hexahedron", [0.5, 0.2, 0.6], [1.5, 0.8, 1.0])
    slave = qs.Surface(vector_space(msh), facets=plane(msh, 2, 0.6))
    master = qs.Surface(vector_space(roof), facets=top)
    contact = qs.Contact(
        slave,
        master,
        formulation="master-slave",
        quadrature="nodal",
        search_radius=1.0,
        penalty=1.0,
    )
    points = contact.pairing
    above = np.isclose(points.slave.x[:, 0], 1.0)
    counts = WORLD.allreduce(np.array([len(points), np.count_nonzero(above)]))
    unpaired = contact.num_unpaired
    step = points.master.x[above] - points.slave.x[above]
    np.testing.assert_allclose(step - [0.0, 0.0, -0.6], 0, atol=1e-12)
    assert counts.tolist() == [15, 3] and unpaired == 0


def tied_corners(comm, partition, angle):
    """Return the paired points of surfaces with equally close facets disturbed by rounding."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    surfaces = []
    for n, low in ((4, 0.1), (2, -1.0)):
        corner = np.array([0.0, 0.0, low])
        msh = box(comm, [n, 4, 1], "tetrahedron", corner, corner + 1, partition)
        V, face = vector_space(msh), plane(msh, 2, max(low, 0.0))
        msh.geometry.x[:] = msh.geometry.x @ R.T
        surfaces.append(qs.Surface(V, facets=face))
    slave, master = surfaces
    options = {"search_radius": 0.3, "penalty": 1.0, "quadrature": "nodal"}
    points = qs.Contact(slave, master, formulation="master-slave", law=qs.Tied(), **options).pairing
    numbers, places = gathered(comm, master.node_dofs[:, 0]), gathered(comm, master.node_x)
    x_of = dict(zip(numbers, np.round(places @ R, 9), strict=True))
    corners = [np.sort([tuple(x_of[d]) for d in row], axis=0) for row in points.master.dofs[..., 0]]
    flat = [np.round(points.slave.x @ R, 9), np.reshape(corners, (len(points), -1))]
    flat = gathered(comm, np.column_stack(flat))
    return flat[np.lexsort(flat[:, :3].T)]


@pytest.mark.parallel
def test_ties_but_for_rounding():
    """Nodes above edges of rotated surfaces have the same facet on any partition."""
    for angle in (0.0, 0.3, 1.1):
        reference = tied_corners(MPI.COMM_SELF, None, angle)
        others = [tied_corners(WORLD, p, angle) for p in ("forward", "scattered", "backward")]
        assert len(reference) == 25
        for found in others:
            np.testing.assert_allclose(found, reference, atol=1e-9)


def test_beside_a_corner():
    """Nodes beside a flat patch have no partner, also where a corner is closest to them.

    Most triangles at the corner have no edge at the boundary.
    """
    rim = np.deg2rad(np.linspace(20.0, 160.0, 6))
    fan = np.vstack([np.zeros(3), np.column_stack([np.cos(rim), np.sin(rim), 0 * rim])])
    cells = np.column_stack([np.zeros(5, dtype=np.int64), np.arange(1, 6), np.arange(2, 7)])
    msh = box(WORLD, (1, 1, 1), "hexahedron", [-0.02, -0.3, 0.3], [0.02, -0.26, 0.4])
    slave = qs.Surface(vector_space(msh), facets=plane(msh, 2, 0.3))
    options = {"formulation": "master-slave", "quadrature": "nodal", "search_radius": 1.0}
    tool = qs.RigidSurface.triangulated(WORLD, *((fan, cells) if WORLD.rank == 0 else (None, None)))
    assert qs.Contact(slave, tool, **options).num_unpaired == 4
