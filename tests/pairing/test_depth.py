"""Points that penetrate deeper than the search radius are not paired."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, plane, vector_space

import qsdolfinx as qs
from qsdolfinx.pairing.distance import of_points, on_facets

RADIUS, SLOPE = 0.2, 0.8
MASTERS = ("body", "facets", "analytic")


def block(cell, low, partition, slope=0.0):
    """Make the lower face of a unit block at low + slope (x - 0.5), or the upper if low is -1."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    axis = gdim - 1
    corner = np.append(np.zeros(axis), low)
    msh = box(WORLD, [4 if low else 5] * axis + [1], cell, corner, corner + 1, partition)
    facets = plane(msh, axis, 0.0)
    x = msh.geometry.x
    x[:, axis] += slope * (x[:, 0] - 0.5)
    return qs.Surface(vector_space(msh), facets=facets)


def contact_of(cell, kind, quadrature, formulation="quasi-symmetric"):
    """Make the contact of a slave with an inclined face from 0.4 above the master to 0.4 below."""
    slave = block(cell, 0.0, "forward", SLOPE)
    gdim = slave.gdim
    if kind == "body":
        master = block(cell, -1.0, "backward")
    elif kind == "analytic":
        normal = np.eye(gdim)[-1]
        master = qs.RigidSurface.plane(WORLD, np.zeros(gdim), normal)
    elif gdim == 2:
        master = qs.RigidSurface.triangulated(WORLD, [[2.0, 0.0], [-1.0, 0.0]], [[0, 1]])
    else:
        x = [[-1.0, -1.0, 0.0], [2.0, -1.0, 0.0], [2.0, 2.0, 0.0], [-1.0, 2.0, 0.0]]
        master = qs.RigidSurface.triangulated(WORLD, x, [[0, 1, 2], [0, 2, 3]])
    options = {"search_radius": RADIUS, "normals": "facet", "initial_overclosure": "ignore"}
    return qs.Contact(
        slave, master, formulation=formulation, quadrature=quadrature, penalty=1.0, **options
    )


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("kind", MASTERS)
@pytest.mark.parametrize("cell", CELLS)
def test_as_deep_as_high(cell, kind, quadrature):
    """Points within the search radius are paired, outside and inside of the other body."""
    contact = contact_of(cell, kind, quadrature)
    gap = contact.pairing.gap
    lowest = WORLD.allreduce(gap.min(initial=0.0), op=MPI.MIN)
    highest = WORLD.allreduce(gap.max(initial=0.0), op=MPI.MAX)
    assert np.isclose(-lowest, highest, rtol=0.3) and 0.3 * RADIUS < highest <= RADIUS
    assert -RADIUS <= lowest


@pytest.mark.parametrize("kind", MASTERS)
@pytest.mark.parametrize("cell", CELLS)
def test_nodes(cell, kind):
    """Slave nodes are paired if their distance from the master is within the search radius."""
    contact = contact_of(cell, kind, "nodal", "master-slave")
    surface = contact.slave
    height = surface.node_x[:, surface.gdim - 1]
    paired = np.isfinite(contact.weighted_gap())
    inside, outside, unpaired = (
        WORLD.allreduce(int(np.count_nonzero(rows)))
        for rows in (paired & (height < 0), paired & (height > 0), ~paired)
    )
    counted = contact.num_unpaired
    np.testing.assert_array_equal(paired, np.abs(height) <= RADIUS)
    assert inside == outside > 0
    assert counted == unpaired > 0


@pytest.mark.parametrize("distance", (0.01, 0.1))
def test_points_beside_a_corner(distance):
    """A point that only a corner faces is as far away as the corner, not as a plane through it."""
    msh = box(WORLD, (2, 2), "quadrilateral", [-1.0, -1.0], [0.0, 0.0])
    facets = np.concatenate([plane(msh, axis, 0.0) for axis in (0, 1)])
    corner = qs.Surface(vector_space(msh), facets=facets)
    angle = np.linspace(0.1, 1.4, 9)
    away = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(9)])
    own = qs.Surface(vector_space(msh), facets=plane(msh, 1, -1.0)).cpp_object
    found = of_points(distance * away, -away, own, corner.cpp_object, 0.5)
    np.testing.assert_allclose(found.depth, -distance, rtol=1e-12)
    assert not found.beside.any()


def test_several_points_of_a_facet():
    """A facet is deepest beside its middle if an edge cuts into it: it has a few points."""
    msh = box(WORLD, (2, 2), "quadrilateral", [-1.0, -1.0], [0.0, 0.0])
    surface = qs.Surface(vector_space(msh), facets=plane(msh, 1, 0.0))
    points = on_facets(surface.cpp_object, 2)
    assert 2 * len(surface.facets) <= points.size <= 4 * len(surface.facets)
