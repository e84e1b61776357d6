"""Weights of contact quadrature points add up to nodal areas; the points lie on the surfaces."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, gathered, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.ahead import linear
from qsdolfinx.pairing.edges import edges_of


def lower_face(cell, n, partition, wave=0.0, low=0.0, axisymmetric=False):
    """Make the face of a unit block at z = low; if low is 0, the lower face, warped and uneven."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    corner = np.zeros(gdim)
    corner[-1] = low
    msh = box(WORLD, [n] * (gdim - 1) + [1], cell, corner, corner + 1, partition)
    facets = plane(msh, gdim - 1, 0.0)
    x = msh.geometry.x
    inner = np.sin(np.pi * x[:, 0]) * (np.sin(np.pi * x[:, 1]) if gdim == 3 else 1.0)
    up = wave * np.cos(5 * x[:, 0] + 3 * x[:, 1] * (gdim - 2))
    x[:, 0] += 0.1 * inner
    x[:, gdim - 1] += up
    return qs.Surface(vector_space(msh), facets=facets, axisymmetric=axisymmetric)


def sums_at_nodes(points, surface):
    """Return Σ w N at the nodes owned by this rank, with the multiplier functions."""
    number = points.slave.dofs[:, : points.multiplier_values.shape[1], 0]
    number = gathered(WORLD, number)
    values = gathered(WORLD, points.weight[:, None] * points.multiplier_values)
    out = {dof: 0.0 for dof in number.ravel()}
    for dof, value in zip(number.ravel(), values.ravel(), strict=True):
        out[dof] += value
    return np.array([out[dof] for dof in surface.node_dofs[:, 0]])


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize(
    "cell, axisymmetric", [*((cell, False) for cell in CELLS), ("quadrilateral", True)]
)
def test_areas_of_warped_facets(cell, axisymmetric, formulation):
    """A facet on its copy: overlay weights are areas of the facets, not of their projections."""
    slave = lower_face(cell, 3, "forward", 0.3, 0.0, axisymmetric)
    master = lower_face(cell, 3, "backward", 0.3, -1.0, axisymmetric)
    options = {"quadrature": "overlay", "quadrature_degree": 8, "penalty": 1.0}
    contact = qs.Contact(slave, master, formulation=formulation, **options)
    # Areas of warped quadrilaterals are not polynomial.
    accuracy = 1e-3 if cell == "hexahedron" else 1e-12
    found = sums_at_nodes(contact.pairing, slave)
    flat = lower_face(cell, 3, "forward", 0.0, 0.0, axisymmetric)
    areas = slave.area, flat.area
    assert areas[0] > 1.1 * areas[1]
    np.testing.assert_allclose(found, slave.node_area, rtol=accuracy)
    np.testing.assert_allclose(contact.pairing.gap, 0, atol=1e-12)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("inside", (False, True))
@pytest.mark.parametrize(
    "cell, axisymmetric", (("triangle", False), ("quadrilateral", True), ("hexahedron", False))
)
def test_points_upon_a_tool(cell, axisymmetric, inside, quadrature):
    """Master points are a tool's closest points along its normal; slaves inside and outside."""
    slave = lower_face(cell, 5, "scattered", axisymmetric=axisymmetric)
    gdim = slave.gdim
    center = np.full(gdim, 0.5)
    center[-1] = 0.9 if inside else -0.9
    tool = qs.RigidSurface.sphere(WORLD, center, 1.0, inside)
    options = {"quadrature": quadrature, "search_radius": 0.6, "initial_overclosure": "ignore"}
    contact = qs.Contact(slave, tool, formulation="master-slave", penalty=1.0, **options)
    points = contact.pairing
    sums = sums_at_nodes(points, slave)
    outside, within = (WORLD.allreduce(np.count_nonzero(s * points.gap > 0)) for s in (1, -1))
    distance, normal = tool.distance(points.slave.x)
    np.testing.assert_allclose(points.gap, distance, atol=1e-14)
    np.testing.assert_allclose(points.normal, -normal, atol=1e-14)
    np.testing.assert_allclose(tool.distance(points.master.x)[0], 0, atol=1e-14)
    moved = np.linalg.norm(points.master.x - points.slave.x, axis=1)
    np.testing.assert_allclose(moved, np.abs(distance), atol=1e-14)
    inward = np.append(center, np.zeros(3 - gdim)) - points.slave.x
    assert np.all(np.sum(points.normal * inward, axis=1) * (-1 if inside else 1) > 0)
    np.testing.assert_allclose(sums, slave.node_area, rtol=1e-12)
    assert min(outside, within) > 0


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron", "hexahedron"))
def test_linear_functions_from_quadratic_ones(cell):
    """The linear functions of the vertices at any points follow from the functions of degree 2."""
    gdim = 2 if cell == "triangle" else 3
    msh = box(WORLD, [2] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
    V = fem.functionspace(msh, ("Lagrange", 2, (gdim,)))
    surface = qs.Surface(V, facets=plane(msh, gdim - 1, 0.0))
    x = np.random.default_rng(1).random((5, 2)) / 2
    values = [_cpp.trace_values(surface.num_facet_vertices, degree, x) for degree in (2, 1)]
    np.testing.assert_allclose(linear(surface, values[0]), values[1], atol=1e-14)


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_edges_share_the_area(cell):
    """The areas of all edges of a surface, with those at its boundary, add up to its area."""
    msh = box(WORLD, (3, 2, 2), cell, [0.0] * 3, [3.0, 1.0, 1.0], "scattered")
    surface = qs.Surface(vector_space(msh), facets=plane(msh, 2, 1.0))
    np.testing.assert_allclose(WORLD.allreduce(edges_of(surface).area.sum()), 3.0, rtol=1e-12)
