"""Default search distance of points: the size of the larger of the local facets."""

import numpy as np
import pytest
from scenes import WORLD, box, plane, vector_space

import qsdolfinx as qs

#: Facet sizes of the master on the left and on the right half, and of the slave.
SIZES = 0.05, 0.5
FINE, COARSE = 40, 2


def graded(gap, slave_cells):
    """Make a slave block at a height over a master that is fine for x < 1 and coarse for x > 1."""
    cells = round(1 / SIZES[0]), round(1 / SIZES[1])
    msh = box(WORLD, [sum(cells), 1], "quadrilateral", [0, -1], [sum(cells), 0])
    x = msh.geometry.x
    x[:, 0] = (
        np.minimum(x[:, 0], cells[0]) * SIZES[0] + np.maximum(x[:, 0] - cells[0], 0) * SIZES[1]
    )
    over = box(WORLD, [slave_cells, 1], "quadrilateral", [0, gap], [2, gap + 1])
    slave = qs.Surface(vector_space(over), facets=plane(over, 1, gap))
    return slave, qs.Surface(vector_space(msh), facets=plane(msh, 1, 0.0))


def places(contact, side="slave"):
    """Return the sorted abscissae of the points of all ranks, and their weights."""
    p = contact.pairing
    x, weight = getattr(p, side).x[:, 0], p.weight
    x, weight = (np.concatenate(WORLD.allgather(values)) for values in (x, weight))
    return x[np.argsort(x)], weight[np.argsort(x)]


@pytest.mark.parametrize("formulation", ("master-slave", "double-pass"))
def test_nodes_of_a_fine_body(formulation):
    """Nodes over fine facets are unpaired beyond the facet size; those over coarse are paired."""
    slave, master = graded(0.3, FINE)
    contact = qs.Contact(
        slave,
        master,
        formulation=formulation,
        penalty=1.0,
        quadrature="nodal",
        search_radius="local",
    )
    assert np.isclose(contact.settings.search_radius, SIZES[1])
    x, _ = places(contact)
    if formulation == "master-slave":
        np.testing.assert_allclose(x, np.linspace(1, 2, FINE // 2 + 1), atol=1e-12)
    given = qs.Contact(
        slave,
        master,
        formulation="master-slave",
        penalty=1.0,
        quadrature="nodal",
        search_radius=0.31,
    )
    np.testing.assert_allclose(places(given)[0], np.linspace(0, 2, FINE + 1), atol=1e-12)


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
def test_overlay_of_a_fine_body(formulation):
    slave, master = graded(0.3, FINE)
    options = {"quadrature": "overlay", "penalty": 1.0, "search_radius": "local"}
    contact = qs.Contact(slave, master, formulation=formulation, **options)
    x, weight = places(contact)
    assert np.isclose(weight.sum(), 1.0) and x.min() > 1


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("swapped", (False, True))
def test_coarse_and_fine(quadrature, swapped):
    """A gap just below the coarse facet size is in reach from the fine and from the coarse body."""
    surfaces = graded(0.95, COARSE)
    options = {"quadrature": quadrature, "penalty": 1.0, "search_radius": "local"}
    contact = qs.Contact(*surfaces[:: -1 if swapped else 1], **options)
    assert np.isclose(contact.settings.search_radius, 1.0)
    assert np.isclose(places(contact)[1].sum(), 2.0)
    contact = qs.Contact(*graded(1.05, COARSE)[:: -1 if swapped else 1], **options)
    assert len(places(contact)[0]) == 0


#: Radius of the fillet of the die, and its length along y.
FILLET, LENGTH = 2.0, 4.0


def die(comm):
    """Make a floor of two huge triangles, a fillet of small ones, and a wall of two huge ones."""
    angles, y = np.linspace(0, np.pi / 2, 13), np.linspace(0, LENGTH, 25)
    arc = np.stack([FILLET * np.sin(angles), FILLET * (1 - np.cos(angles))], axis=1)
    strips = [np.array([[-300.0, 0.0], [0.0, 0.0]]), arc]
    strips.append(np.array([[FILLET, FILLET], [FILLET, 300.0]]))
    rows = [np.array([-150.0, 150.0]), y, np.array([-150.0, 150.0])]
    x, triangles, first = [], [], 0
    for strip, ticks in zip(strips, rows, strict=True):
        grid = np.array([[[a, t, b] for t in ticks] for a, b in strip])
        n, m = grid.shape[:2]
        k = first + np.arange(n * m).reshape(n, m)
        corners = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
        triangles += [
            np.stack([corners[i] for i in part], axis=1) for part in ((0, 1, 2), (0, 2, 3))
        ]
        x.append(grid.reshape(-1, 3))
        first += n * m
    return qs.RigidSurface.triangulated(comm, np.concatenate(x), np.concatenate(triangles))


def billet(low, high, n):
    """Make a block; return its underside."""
    msh = box(WORLD, n, "hexahedron", low, high)
    return qs.Surface(vector_space(msh), facets=plane(msh, 2, low[2]))


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("height, paired", ((6.6, False), (0.9, True)))
def test_huge_triangles(quadrature, height, paired):
    """Huge triangles of a flat do not enlarge the search distance of a finely meshed billet."""
    surface = billet([-9, 0, height], [-5, 4, height + 4], [4, 4, 4])
    options = {"quadrature": quadrature, "penalty": 1.0}
    contact = qs.Contact(surface, die(WORLD), **options)
    assert np.isclose(contact.settings.search_radius, np.sqrt(2.0))
    area = 16.0 if paired else 0.0
    if quadrature == "nodal" and paired:
        assert np.isclose(
            places(qs.Contact(surface, die(WORLD), formulation="master-slave", **options))[1].sum(),
            area,
        )
    if quadrature == "overlay":
        assert np.isclose(places(contact)[1].sum(), area)
    assert paired == bool(WORLD.allreduce(len(contact.pairing)))


def test_fillet():
    """Nodes over fillet and flat are paired if the die is within the billet's facet size."""
    n, height = 12, 0.35
    surface = billet([-4, 0.5, height], [2 - 0.3, 3.5, height + 2], [n, 6, 1])
    contact = qs.Contact(
        surface, die(WORLD), formulation="master-slave", quadrature="nodal", penalty=1.0
    )
    x = np.linspace(-4, 1.7, n + 1)
    # The chord error of the fillet is at most 1/200 of its radius.
    distance = np.where(x < 0, height, FILLET - np.hypot(np.maximum(x, 0), FILLET - height))
    size = np.hypot(5.7 / n, 0.5)
    assert not np.any(np.abs(np.abs(distance) - size) < 0.02)
    near = np.abs(distance) <= size
    found, _ = places(contact)
    np.testing.assert_allclose(found, np.repeat(x[near], 7), atol=1e-12)
    assert np.isclose(contact.settings.search_radius, size)
