"""Curvature of surfaces from the angles between neighbouring facets."""

import numpy as np
import pytest
from curved_scenes import Shell
from scenes import CELLS, WORLD, box, largest, plane, vector_space

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.unknowns import EDGES

R = 10.0
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def tensors(surface):
    """Return K of the facets of this rank, shape (facets, 3, 3). Collective."""
    K = np.asarray(_cpp.facet_curvature(surface.cpp_object))
    out = np.zeros((len(K), 3, 3))
    for value, (i, j) in zip(K.T, PLACES, strict=True):
        out[:, i, j] = out[:, j, i] = value
    return out


def in_all_directions(surface, K):
    """Return e·K e over |e|² for lines e between facet vertices, shape (lines, facets)."""
    x = surface.coordinates[0]
    pairs = [(i, j) for i in range(x.shape[1]) for j in range(i)]
    lines = [x[:, i] - x[:, j] for i, j in pairs]
    return np.array([np.einsum("fi,fij,fj->f", e, K, e) / np.sum(e**2, axis=1) for e in lines])


def body(n, cell="quadrilateral", **options):
    return Shell(n, (5.0, R), cell, partition="scattered", **options)


@pytest.mark.parametrize("cell", CELLS)
def test_nodes_of_flat_facets(cell):
    """Heights are measured over vertices, middles of edges and the middle of quadrilaterals."""
    is_plane = cell in ("triangle", "quadrilateral")
    n, options = ((8, 2), {}) if is_plane else ((4, 4, 1), {"sphere": True})
    part = body(n, cell, uneven=0.3, **options)
    surface = part.surface(part.outer)
    x = surface.coordinates[0]
    expected = [x, x[:, EDGES[x.shape[1]]].mean(axis=2)]
    if x.shape[1] == 4:
        expected.append(x.mean(axis=1, keepdims=True))
    found = np.asarray(_cpp.flat_nodes(surface.cpp_object))
    assert largest(found - np.concatenate(expected, axis=1)) < 1e-14 * R


@pytest.mark.parametrize("uneven", (0.0, 0.4))
def test_circle(uneven):
    """A circle has its curvature for facets of any length: convex inside, concave outside."""
    inside = body((16, 2), uneven=uneven)
    for facets, expected in ((inside.outer, 1 / R), (inside.inner, -1 / 5.0)):
        surface = inside.surface(facets)
        found = in_all_directions(surface, tensors(surface))
        assert largest(found / expected - 1) < 0.01


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
@pytest.mark.parametrize("uneven", (0.0, 0.3))
def test_sphere(cell, uneven):
    """A sphere has the same curvature in all directions, to O(h), also at the surface's end."""
    errors = []
    for n in (6, 12):
        surface = (part := body((n, n, 1), cell, sphere=True, uneven=uneven)).surface(part.outer)
        values = in_all_directions(surface, tensors(surface)) * R - 1
        total, count = WORLD.allreduce(np.array([np.abs(values).sum(), values.size]))
        errors.append(total / count)
    assert errors[1] < 0.06 and errors[1] < 0.7 * errors[0]


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
@pytest.mark.parametrize("along", (1, 5))
def test_cylinder(cell, along):
    """A cylinder is curved around its axis only, also with a single facet along the axis."""
    surface = (part := body((12, along, 1), cell)).surface(part.outer)
    x = surface.coordinates[0].mean(axis=1)
    around = np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]])
    around /= np.linalg.norm(around, axis=1)[:, None]
    exact = around[:, :, None] * around[:, None, :] / R
    assert largest(tensors(surface) - exact) < 0.05 / R


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
def test_oblique_facets(cell):
    """The same holds for facets whose edges are neither parallel to the axis nor around it.

    This is checked away from the ends of the surface.
    """
    part = body((12, 8, 1), cell)
    x = part.mesh.geometry.x
    angle, r, z = np.arctan2(x[:, 1], x[:, 0]), np.linalg.norm(x[:, :2], axis=1), x[:, 2].copy()
    turned = angle + 0.02 * z
    x[:] = np.column_stack([r * np.cos(turned), r * np.sin(turned), z + 3 * angle])
    surface = part.surface(part.outer)
    middle = surface.coordinates[0].mean(axis=1)
    turned = np.arctan2(middle[:, 1], middle[:, 0])
    angle = (turned - 0.02 * middle[:, 2]) / (1 - 0.06)
    inside = (abs(angle - np.pi / 4) < 0.5) & (abs(middle[:, 2] - 3 * angle - 5) < 3)
    around = np.column_stack([-np.sin(turned), np.cos(turned), 0 * turned])
    exact = around[:, :, None] * around[:, None, :] / R
    assert WORLD.allreduce(int(inside.sum()))
    assert largest((tensors(surface) - exact)[inside]) < 0.05 / R


@pytest.mark.parametrize("cell", CELLS)
def test_creases_and_planes_are_not_curved(cell):
    """Sharp edges and planes have no curvature: all sides of a block as one surface."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    V = vector_space(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    sides = [plane(V.mesh, axis, value) for axis in range(gdim) for value in (0.0, 1.0)]
    surface = qs.Surface(V, facets=np.unique(np.concatenate(sides)))
    assert largest(tensors(surface)) < 1e-13


@pytest.mark.parametrize("cell", CELLS)
def test_flat_beside_a_fillet(cell):
    """Flat facets next to a fillet stay flat; all fillet facets but the outermost are curved."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    n, radius = 24, 2.0
    V = vector_space(box(WORLD, [n] + [4] * (gdim - 1), cell, [0.0] * gdim, [1.0] * gdim))
    top = plane(V.mesh, gdim - 1, 1.0)
    x = V.mesh.geometry.x
    length = 3.0 * x[:, 0]  # flat up to 1.5, then along the fillet
    angle = np.maximum(length - 1.5, 0.0) / radius
    depth = 1 - x[:, gdim - 1]
    at = np.minimum(length, 1.5) + (radius - depth) * np.sin(angle)
    x[:, gdim - 1] = -depth * np.cos(angle) - radius * (1 - np.cos(angle))
    x[:, 0] = at
    surface = qs.Surface(V, facets=top)
    K, corners = tensors(surface), surface.coordinates[0]
    flat = corners[:, :, 0].max(axis=1) < 1.5 + 1e-9
    if gdim == 3:  # at the end of the surface a facet has neighbours on one side only
        y = corners[:, :, 1]
        flat &= (y.min(axis=1) > 1e-9) & (y.max(axis=1) < 1 - 1e-9)
    beyond = corners[:, :, 0].min(axis=1) > 1.5 + 1e-9
    assert largest(K[flat]) < 1e-12
    found = np.trace(K[beyond], axis1=1, axis2=2) * radius
    assert largest(found - 1) < 0.1
    assert WORLD.allreduce(int(flat.sum())) and WORLD.allreduce(int(beyond.sum()))


@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_any_partition(cell):
    """Every partition gives the same tensors at the same places."""
    n = (12, 3) if cell == "quadrilateral" else (8, 3, 2)
    found = []
    for partition in ("first", "scattered", "backward"):
        part = Shell(n, (5.0, R), cell, uneven=0.3, partition=partition)
        surface = part.surface(part.outer)
        x, K = surface.coordinates[0].mean(axis=1), tensors(surface)
        rows = np.column_stack([np.round(x, 9), K.reshape(-1, 9)])
        rows = np.concatenate(WORLD.allgather(rows))
        found.append(rows[np.lexsort(rows[:, :3].T)])
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-9)
