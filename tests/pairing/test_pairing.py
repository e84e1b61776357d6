"""Contact quadrature points agree with brute force on any partition."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.spatial
from fuzz.brute import dot, on_segment, on_triangle, unit
from scenes import WORLD, all_facets, box, gathered, plane, random_values, vector_space

import qsdolfinx as qs

RADIUS = 0.15


def curved(comm, cell, n, low, high, base, seed, amplitude, partition):
    """Make a block one cell thick with a curved face at height 0 and the other face at base."""
    gdim = len(low) + 1
    bottom, top = min(base, 0.0), max(base, 0.0)
    msh = box(comm, [*n, 1], cell, [*low, bottom], [*high, top], partition)
    facets = plane(msh, gdim - 1, 0.0)
    x = msh.geometry.x
    face = np.isclose(x[:, gdim - 1], 0)
    shape = x.copy()
    shape[:, gdim - 1] = 0
    msh.geometry.x[face, gdim - 1] += random_values(msh, amplitude, seed, 1)[face, 0]
    return qs.Surface(vector_space(msh), facets=facets)


def brute_force(nodes, facets, outline, step=200):
    """Return the result of :func:`closest` in batches of nodes, because there are many pairs."""
    parts = [
        closest(nodes[i : i + step], facets, outline) for i in range(0, max(len(nodes), 1), step)
    ]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def closest(nodes, facets, outline):
    """Return closest points, and whether they are in the radius and not beside the surface.

    Only such points are admissible. Facets are tried in the order of the distances of their
    centroids. An assertion checks that the facets left out are further away.
    """
    centroid = facets.mean(axis=1)
    reach = np.linalg.norm(facets - centroid[:, None], axis=2).max()
    count = 400 if facets.shape[1] == 3 else 1500
    far, index = scipy.spatial.cKDTree(centroid).query(nodes, count)
    p = np.repeat(nodes, count, axis=0)
    corners = np.moveaxis(facets[index.ravel()], 1, 0)
    if len(corners) == 3:
        x = on_triangle(*corners, p)
        normal = unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
    else:
        x, tangent = on_segment(*corners, p), corners[1] - corners[0]
        normal = tangent[:, [1, 0, 2]] * [-1, 1, 0] / np.linalg.norm(tangent, axis=1)[:, None]
    distance = np.linalg.norm(x - p, axis=1).reshape(-1, count)
    pick = np.arange(len(nodes)) * count + np.argmin(distance, axis=1)
    distance, x, normal, corners = distance.min(axis=1), x[pick], normal[pick], corners[:, pick]
    assert np.all(far[:, -1] - reach > distance)

    low, high = outline
    on_outline = np.any((x[:, : len(low)] <= low) | (x[:, : len(low)] >= high), axis=1)
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=2).max(axis=0)
    height = dot(nodes - x, normal)
    offset = np.linalg.norm(nodes - x - height[:, None] * normal, axis=1)
    beside = (offset > 0.1 * size) & (on_outline | (offset > 2 * np.abs(height)))
    return (distance <= RADIUS) & ~beside, x, distance


@pytest.mark.parametrize("partitions", (("forward", "backward"), ("scattered", "last")))
@pytest.mark.parametrize("cell", ("tetrahedron", "triangle"))
def test_brute_force(cell, partitions):
    """Thousands of nodes on random curved surfaces have the expected pairs, in both directions."""
    d = 2 if cell == "tetrahedron" else 1
    counts = ([70, 71], [75, 64]) if d == 2 else ([2000], [1500])
    low, high = np.zeros(d), np.ones(d)
    slave = curved(WORLD, cell, counts[0], low, high, 0.3, 1, 0.1, partitions[0])
    master = curved(WORLD, cell, counts[1], low - 0.2, high + 0.1, -0.3, 2, 0.1, partitions[1])
    contact = qs.Contact(slave, master, quadrature="nodal", search_radius=RADIUS, penalty=1.0)
    pairing = contact.pairing
    from_slave = pairing.slave.dofs[:, 1, 0] < 0

    # Each rank checks the nodes it owns; only the brute force needs all facets everywhere.
    expected = [
        brute_force(slave.node_x, all_facets(master), (low - 0.2, high + 0.1)),
        brute_force(master.node_x, all_facets(slave), (low, high)),
    ]
    nodes = WORLD.allreduce(len(slave.node_x) + len(master.node_x))
    unpaired = contact.num_unpaired
    missed = WORLD.allreduce(sum(int(np.count_nonzero(~found)) for found, _, _ in expected))
    assert nodes >= 3 * 10**3
    assert unpaired == missed > 0
    for (found, x, distance), own, rows in (
        (expected[0], (pairing.slave.x, pairing.master.x), from_slave),
        (expected[1], (pairing.master.x, pairing.slave.x), ~from_slave),
    ):
        surface = slave if rows is from_slave else master
        node, point = own[0][rows], own[1][rows]
        np.testing.assert_array_equal(node, surface.node_x[found])
        np.testing.assert_allclose(
            np.linalg.norm(node - point, axis=1), distance[found], rtol=0, atol=1e-13
        )
        far = np.linalg.norm(point - x[found], axis=1) > 1e-7  # equally close facets
        assert np.count_nonzero(far) == 0


def test_bilinear_facets():
    """On warped quadrilaterals no sample of any facet is closer than the point that was found."""
    slave = curved(WORLD, "hexahedron", [12, 9], [0, 0], [1, 1], 0.3, 1, 0.3, "scattered")
    master = curved(WORLD, "hexahedron", [7, 8], [-0.2] * 2, [1.1] * 2, -0.3, 2, 0.3, "backward")
    contact = qs.Contact(
        slave,
        master,
        formulation="master-slave",
        quadrature="nodal",
        search_radius=RADIUS,
        penalty=1.0,
    )
    pairing = contact.pairing
    facets = all_facets(master)
    s, t = (a.ravel()[:, None] for a in np.meshgrid(*[np.linspace(0, 1, 31)] * 2))
    N = np.hstack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
    samples = np.einsum("si,fij->fsj", N, facets).reshape(-1, 3)
    distance = np.linalg.norm(pairing.master.x - pairing.slave.x, axis=1)
    paired = WORLD.allreduce(len(pairing))
    expected = WORLD.allreduce(len(slave.node_x)) - contact.num_unpaired
    assert paired == expected > 50
    if len(pairing):
        by_sampling, _ = scipy.spatial.cKDTree(samples).query(pairing.slave.x)
        assert np.all(distance <= by_sampling + 1e-14)
        # Samples are a thirtieth of a facet apart: the closest point cannot be much closer either.
        assert np.all(by_sampling - distance <= 0.01)


def table(comm, partitions, formulation, cell):
    """Return all contact quadrature points, in an order that no partition changes."""
    n = ([5, 4], [6, 8]) if cell in ("tetrahedron", "hexahedron") else ([9], [13])
    d = len(n[0])
    slave = curved(comm, cell, n[0], [0] * d, [1] * d, 0.3, 1, 0.0, partitions[0])
    master = curved(comm, cell, n[1], [0] * d, [1] * d, -0.3, 2, 0.0, partitions[1])
    contact = qs.Contact(
        slave, master, formulation=formulation, law=qs.Tied(), penalty=1.0, quadrature="nodal"
    )
    rows = [
        np.column_stack([p.slave.x, p.master.x, p.normal, p.gap, p.weight])
        for p in contact.model.pairings
    ]
    rows = gathered(comm, np.concatenate(rows))
    return rows[np.lexsort(np.round(rows, 9).T)]


@pytest.mark.parametrize("formulation", ("master-slave", "double-pass", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron", "triangle", "quadrilateral"))
def test_partition_does_not_matter(cell, formulation):
    """Structured flat meshes have many equally close facets; all partitions choose the same."""
    reference = table(MPI.COMM_SELF, (None, None), formulation, cell)
    others = [
        table(WORLD, p, formulation, cell)
        for p in (("forward", "forward"), ("backward", "scattered"), ("first", "last"))
    ]
    for other in others:
        np.testing.assert_allclose(other, reference, atol=1e-14)
    # Flat touching surfaces: all nodes are paired at their place, with the whole area.
    area = {"master-slave": 1, "double-pass": 2, "quasi-symmetric": 1}[formulation]
    assert np.isclose(reference[:, -1].sum(), area)
    np.testing.assert_allclose(reference[:, :3], reference[:, 3:6], atol=1e-14)


def test_ties_take_the_same_facet():
    """Equally close facets: the chosen facet has the same vertices on every partition."""

    def vertices(comm, partition):
        slave = curved(comm, "tetrahedron", [4, 4], [0, 0], [1, 1], 0.3, 1, 0.0, partition)
        master = curved(comm, "tetrahedron", [2, 4], [0, 0], [1, 1], -0.3, 1, 0.0, partition)
        contact = qs.Contact(
            slave,
            master,
            formulation="master-slave",
            law=qs.Tied(),
            penalty=1.0,
            quadrature="nodal",
        )
        x_of = dict(
            zip(
                gathered(comm, master.node_dofs[:, 0]),
                gathered(comm, np.round(master.node_x, 9)),
                strict=True,
            )
        )
        points = contact.pairing
        corners = [
            np.sort([tuple(x_of[d]) for d in row], axis=0) for row in points.master.dofs[..., 0]
        ]
        flat = np.column_stack([points.slave.x, np.reshape(corners, (len(points), -1))])
        flat = gathered(comm, flat)
        return flat[np.lexsort(np.round(flat[:, :3], 9).T)]

    reference = vertices(MPI.COMM_SELF, None)
    others = [vertices(WORLD, p) for p in ("forward", "scattered")]
    for other in others:
        np.testing.assert_allclose(other, reference, atol=1e-12)


def test_never_the_back_of_a_body():
    """The far face of a thin plate in between is never paired, although it is in reach."""
    slave = curved(WORLD, "hexahedron", [4, 4], [0, 0], [1, 1], 0.3, 1, 0.0, None)
    plate = box(WORLD, [5, 5, 1], "hexahedron", [0, 0, -0.05], [1, 1, 0.0])
    back = qs.Surface(vector_space(plate), facets=plane(plate, 2, -0.05))
    front = qs.Surface(vector_space(plate), facets=plane(plate, 2, 0.0))
    num = [
        WORLD.allreduce(
            len(
                qs.Contact(
                    slave, s, formulation="master-slave", quadrature="nodal", search_radius=0.5
                ).pairing
            )
        )
        for s in (back, front)
    ]
    assert num == [0, 25]


def test_beyond_the_radius():
    slave = curved(WORLD, "triangle", [10], [0], [1], 0.3, 1, 0.0, None)
    msh = box(WORLD, [7, 1], "triangle", [0, -1.2], [1, -0.2])
    master = qs.Surface(vector_space(msh), facets=plane(msh, 1, -0.2))
    near = qs.Contact(slave, master, quadrature="nodal", search_radius=0.21)
    far = qs.Contact(slave, master, quadrature="nodal", search_radius=0.19)
    counts = [WORLD.allreduce(len(c.pairing)) for c in (near, far)]
    unpaired = [c.num_unpaired for c in (near, far)]
    radius = qs.Contact(slave, master).search_radius
    assert counts == [19, 0] and unpaired == [0, 19]
    assert np.isclose(radius, 1 / 7)  # the largest facet


def test_punch_on_a_wider_block():
    """Nodes of the wider surface beside the punch have no pairs."""
    punch = curved(WORLD, "quadrilateral", [4], [0.0], [1.0], 0.3, 1, 0.0, None)
    wide = curved(WORLD, "quadrilateral", [33], [-1.0], [2.0], -0.3, 1, 0.0, None)
    contact = qs.Contact(punch, wide, quadrature="nodal", search_radius=1.0)
    x = gathered(WORLD, contact.pairing.slave.x)
    weight = gathered(WORLD, contact.pairing.weight)
    assert np.all((x[:, 0] > -1e-12) & (x[:, 0] < 1 + 1e-12))
    assert len(x) == 5 + 12  # 11 cells along the punch
    assert np.isclose(weight.sum(), 0.5 * 1 + 0.5 * 12 / 11)


def test_update_after_motion():
    """Contact updates use the moved meshes, and gaps are those of the new positions."""
    slave = curved(WORLD, "quadrilateral", [4], [0.0], [1.0], 0.3, 1, 0.0, None)
    master = curved(WORLD, "quadrilateral", [5], [0.0], [1.0], -0.3, 1, 0.0, None)
    contact = qs.Contact(slave, master, quadrature="nodal", search_radius=0.5)
    slave.mesh.geometry.x[:, 1] += 0.125
    before = contact.pairing.gap
    contact.update()
    after = contact.pairing.gap
    np.testing.assert_allclose(before, 0, atol=1e-15)
    np.testing.assert_allclose(after, 0.125, rtol=1e-12)


def test_unknowns_and_owners():
    """The dofs and owner of a point are those of the surface's unknowns at these positions."""
    slave = curved(WORLD, "tetrahedron", [3, 4], [0, 0], [1, 1], 0.3, 1, 0.1, "scattered")
    master = curved(WORLD, "tetrahedron", [5, 3], [0, 0], [1, 1], -0.3, 2, 0.1, "backward")
    pairing = qs.Contact(slave, master, quadrature="nodal", search_radius=1.0).pairing
    checks = []
    for side, surface in ((pairing.slave, slave), (pairing.master, master)):
        numbers = gathered(WORLD, surface.node_dofs)
        ranks = gathered(WORLD, np.full(len(surface.node_dofs), WORLD.rank))
        position = dict(zip(numbers[:, 0], gathered(WORLD, surface.node_x), strict=True))
        owner = dict(zip(numbers[:, 0], ranks, strict=True))
        checks.append((side, position, owner))
    for side, position, owner in checks:
        for p in range(len(pairing)):
            used = side.owner[p] >= 0
            first = side.dofs[p, used, 0]
            np.testing.assert_array_equal(side.owner[p, used], [owner[d] for d in first])
            np.testing.assert_array_equal(side.dofs[p, used, 2], first + 2)
            x = side.shape_values[p, used] @ np.array([position[d] for d in first])
            np.testing.assert_allclose(x, side.x[p], atol=1e-13)
            assert np.isclose(side.shape_values[p].sum(), 1)
