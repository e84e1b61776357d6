"""At overlapping corners the paired faces are those with the smaller penetration."""

import numpy as np
import pytest
from overlapping_corners import CELL, Corners
from scenes import FORMULATIONS, WORLD, blocks, box, create_mesh, gathered, largest, vector_space

import basix.ufl
import ufl
from dolfinx import mesh

import qsdolfinx as qs

pytestmark = pytest.mark.filterwarnings("ignore::qsdolfinx.ContactWarning")
QUADRATURES = ("nodal", "overlay")
QUIET = {"penalty": 1.0, "initial_overclosure": "ignore"}


def pairs(contact):
    """Return the normals, gaps and weights of all ranks."""
    p = contact.pairing
    return gathered(WORLD, p.normal), gathered(WORLD, p.gap), gathered(WORLD, p.weight)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
def test_the_less_deep_faces(gdim, quadrature, formulation):
    """For an overlap of width w and depth d only faces with penetration min(w, d) are paired."""
    rng = np.random.default_rng([gdim, len(formulation)])
    for deeper in (False, True):
        for angle in (0.0, rng.uniform(0, 2 * np.pi)):
            short, long = np.sort(10 ** rng.uniform(-2.2, -0.9, 2)) * (0.9, 1.1)
            width, depth = (short, long) if deeper else (long, short)
            options = {"quadrature": quadrature, "normals": "facet"} | QUIET
            scene = Corners(width, depth, gdim, True, (6, 7), angle, **options)
            normal, gap, weight = pairs(scene.contact)
            across = np.array([np.sin(angle), np.cos(angle)])  # seen along the middle axis
            expected = (-np.cos(angle), -np.sin(angle)) if deeper else (across[0], -across[1])
            np.testing.assert_allclose(
                normal[:, [0, gdim - 1]], [expected] * len(normal), atol=1e-9
            )
            np.testing.assert_allclose(gap, -short, rtol=1e-9)
            if quadrature == "overlay":  # no part of the faces is lost
                np.testing.assert_allclose(weight.sum(), long, rtol=1e-9)
            np.testing.assert_allclose(scene.contact.penetration(), short, rtol=1e-9)
            for side in ("slave", "master"):
                found = scene.contact.gap(side)
                assert np.isclose(largest(np.maximum(np.nan_to_num(found), 0)), short)


@pytest.mark.parametrize("quadrature", QUADRATURES)
@pytest.mark.parametrize("gdim", (2, 3))
@pytest.mark.parametrize("inset", (0.0, 0.002, 0.004, 0.02))
def test_flush_ends(inset, gdim, quadrature):
    """A block with interference between walls: flush ends with equal normals are not paired."""
    width, mid, one = 0.01, [0.0] * (gdim - 2), [1.0] * (gdim - 2)
    n = [3, *[2] * (gdim - 2), 4]
    low, high = [0.0, *mid, -1.0], [1.0, *one, -inset]
    block = box(WORLD, n, CELL[gdim], low, high, "scattered")
    walls = blocks(
        ([-1.0, *mid, -1.0], [width, *one, 0.0]), ([1.0 - width, *mid, -1.0], [2.0, *one, 0.0])
    )
    faces = [
        mesh.locate_entities_boundary(
            msh, gdim - 1, lambda x: (x[gdim - 1] > -0.03) | np.isclose(x[0] * (1 - x[0]), product)
        )
        for msh, product in ((block, 0.0), (walls, width * (1 - width)))
    ]
    spaces = vector_space(block), vector_space(walls)
    surfaces = [qs.Surface(V, facets=f) for V, f in zip(spaces, faces, strict=True)]
    contact = qs.Contact(*surfaces, quadrature=quadrature, search_radius=0.2, **QUIET)
    normal, gap, weight = pairs(contact)
    along = np.abs(normal[:, 0]) > 0.8
    deep = along & (gap < 0)
    if quadrature == "overlay":
        assert np.all(along)
        np.testing.assert_allclose(gap, -width, rtol=1e-9)
        np.testing.assert_allclose(weight.sum(), 2 * (1 - inset), rtol=1e-9)
    else:  # constraints on both sides, except top nodes, which also face the rims
        assert np.count_nonzero(np.isclose(gap[deep], -width)) >= 2 * 3 ** (gdim - 2) * 4
    np.testing.assert_allclose(contact.penetration(), width, rtol=1e-9)


def polygon(points, cells):
    """Make a mesh of triangles in the plane on rank 0."""
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,)))
    mine = slice(None) if WORLD.rank == 0 else slice(0)
    return create_mesh(np.array(cells)[mine], np.array(points, dtype=float)[mine], domain)


def wedge(slope, depth):
    """Make a tip that points down, at -depth, and its sides, which rise with the slope."""
    msh = polygon([[0, -depth], [1, slope - depth], [-1, slope - depth]], [[0, 1, 2]])
    sides = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], slope * np.abs(x[0]) - depth)
    )
    return qs.Surface(vector_space(msh), facets=sides)


@pytest.mark.parametrize("slope", (0.3, 0.7, 1.0))
def test_all_of_a_wedge(slope):
    """Both sides of a wedge in a plane have pairs down to the tip."""
    depth, msh = 0.1, box(WORLD, [9, 2], "quadrilateral", [-2.0, -1.0], [2.0, 0.0], "scattered")
    faces = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0.0))
    flat = qs.Surface(vector_space(msh), facets=faces)
    options = {"quadrature": "overlay", "normals": "facet", "search_radius": 0.4} | QUIET
    options["quadrature_degree"] = 30
    contact = qs.Contact(wedge(slope, depth), flat, formulation="master-slave", **options)
    _, gap, weight = pairs(contact)
    inside, long = gap < 0, np.hypot(1, slope)
    # The distance to the plane along the side's normal is `long` times the vertical distance.
    assert np.isclose(gap.min(), -depth * long, rtol=0.15)
    assert np.isclose(weight[inside].sum(), 2 * depth / slope * long, rtol=0.1)


@pytest.mark.parametrize("slope", (0.7, 1.0))
def test_tip_deep_in_a_notch(slope):
    """A node behind both sides of a notch, but beside each of them, is inside the notch."""
    points = [[0, 0], [1, slope], [-1, slope], [-1, -1], [1, -1]]
    msh = polygon(points, [[0, 1, 4], [0, 4, 3], [0, 3, 2]])
    faces = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], slope * np.abs(x[0])))
    notch = qs.Surface(vector_space(msh), facets=faces)
    tip = wedge(slope, 0.3)
    contact = qs.Contact(tip, notch, formulation="master-slave", search_radius=0.5, **QUIET)
    gap = gathered(WORLD, contact.pairing.gap)
    depth = contact.penetration()
    assert len(gap) >= 2 or np.isclose(gap.min(), -0.3)
    assert WORLD.allreduce(contact.num_unpaired) <= 2 * WORLD.size
    assert 0.2 < depth <= 0.3 + 1e-9
