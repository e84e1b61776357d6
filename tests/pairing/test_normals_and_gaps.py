"""Normals are outward of the slave and gaps positive when open, on both integration sides.

A flat slave above a master whose face is inclined: the normals of the two differ.
"""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, plane, vector_space

import qsdolfinx as qs

SLOPE = 0.2


def contact_of(cell, height, **options):
    """Make the contact of a slave at a mean height above a master with z = SLOPE (x - 0.5)."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    axis, surfaces = gdim - 1, []
    for count, low, partition in ((3, 0.0, "forward"), (4, -1.0, "backward")):
        corner = np.append(np.zeros(axis), low)
        msh = box(WORLD, [count] * axis + [1], cell, corner, corner + 1, partition)
        face = plane(msh, axis, 0.0)
        x = msh.geometry.x
        if low < 0:
            x[:, axis] += SLOPE * (x[:, 0] - 0.5) * (1 + x[:, axis])
        else:
            x[:, axis] += height
        surfaces.append(qs.Surface(vector_space(msh), facets=face))
    options |= {"search_radius": 0.5, "initial_overclosure": "ignore"}
    return qs.Contact(*surfaces, formulation="quasi-symmetric", penalty=1.0, **options)


def outward(gdim):
    """Return the slave normal and the reversed master normal: both are outward of the slave."""
    of_slave, of_master = np.zeros(3), np.zeros(3)
    of_slave[gdim - 1] = -1.0
    of_master[0], of_master[gdim - 1] = SLOPE, -1.0
    return of_slave, of_master / np.hypot(1, SLOPE)


@pytest.mark.parametrize("height", (0.3, -0.3))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", CELLS)
def test_along_the_normals_of_facets(cell, quadrature, height):
    """The normal is that of the facet found for a node, or of the facet that is segmented."""
    contact = contact_of(cell, height, quadrature=quadrature, normals="facet")
    points, gdim = contact.pairing, contact.slave.gdim
    of_slave, of_master = outward(gdim)
    on_slave = np.linalg.norm(points.normal - of_slave, axis=1) < 1e-12
    on_master = np.linalg.norm(points.normal - of_master, axis=1) < 1e-12
    weights = [WORLD.allreduce(points.weight[found].sum()) for found in (on_slave, on_master)]
    assert np.all(on_slave | on_master)
    assert min(weights) > 0.4  # half of the surface, except the part at the edge
    assert np.all(np.sign(points.gap) == np.sign(height))
    distance = np.sum((points.master.x - points.slave.x) * points.normal, axis=1)
    np.testing.assert_allclose(points.gap, distance, atol=1e-13)
    # Both points lie on their surfaces.
    vertical = points.slave.x[:, gdim - 1] - SLOPE * (points.slave.x[:, 0] - 0.5)
    upon = points.master.x[:, gdim - 1] - SLOPE * (points.master.x[:, 0] - 0.5)
    np.testing.assert_allclose(points.slave.x[:, gdim - 1], height, atol=1e-13)
    np.testing.assert_allclose(upon, 0, atol=1e-13)
    if quadrature == "nodal":  # the closest point of the other surface
        expected = vertical[on_master] / np.hypot(1, SLOPE)
        np.testing.assert_allclose(points.gap[on_master], expected, atol=1e-13)
        expected = height - points.master.x[on_slave, gdim - 1]
        np.testing.assert_allclose(points.gap[on_slave], expected, atol=1e-13)


@pytest.mark.parametrize("height", (0.3, -0.3))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", CELLS)
def test_along_the_bisector(cell, quadrature, height):
    """The bisector normal is the same on both integration sides."""
    contact = contact_of(cell, height, quadrature=quadrature, normals="bisector")
    points, gdim = contact.pairing, contact.slave.gdim
    expected = sum(outward(gdim))
    expected /= np.linalg.norm(expected)
    # At the rim the normal of a node may be that of its own side.
    x = np.hstack([side.x[:, : gdim - 1] for side in (points.slave, points.master)])
    inner = np.all((x > 0.01) & (x < 0.99), axis=1)
    assert WORLD.allreduce(np.count_nonzero(inner)) > 0
    np.testing.assert_allclose(points.normal[inner] - expected, 0, atol=1e-12)
    assert np.all(np.sign(points.gap) == np.sign(height))
    distance = np.sum((points.master.x - points.slave.x) * points.normal, axis=1)
    np.testing.assert_allclose(points.gap, distance, atol=1e-13)
