"""Areas of the smooth patches of nodes."""

import numpy as np
import pytest
from following import Body
from scenes import WORLD, box, largest, plane

from qsdolfinx.surface.patches import patch_areas, patches_of_nodes, share_gradients


def side_of_box(cell, axisymmetric=False):
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    low, high = [1.0] + [0.0] * (gdim - 1), [3.0] + [1.0] * (gdim - 1)
    msh = box(WORLD, [4] + [3] * (gdim - 1), cell, low, high, "scattered")
    surface = Body(msh, axisymmetric=axisymmetric).surface(
        np.concatenate([plane(msh, gdim - 1, 1.0), plane(msh, 0, 3.0)])
    )
    return surface, surface.coordinates[0][:, : surface.num_facet_vertices].copy()


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("cell", "axisymmetric", "area"),
    (("triangle", False, 3.0), ("quadrilateral", True, 14 * np.pi), ("tetrahedron", False, 3.0)),
)
def test_areas(cell, axisymmetric, area):
    """Areas of patches are those of their nodes together, and exist at patches only."""
    surface, x = side_of_box(cell, axisymmetric)
    found = patch_areas(surface, x)
    assert WORLD.allreduce(found.sum()) == pytest.approx(area, rel=1e-12)
    np.testing.assert_array_equal(found > 0, patches_of_nodes(surface))
    if not axisymmetric:
        assert largest(found.sum(axis=1) - surface.node_area) < 1e-12


@pytest.mark.parametrize(
    ("cell", "axisymmetric"),
    (("triangle", False), ("quadrilateral", True), ("tetrahedron", False), ("hexahedron", False)),
)
def test_derivative(cell, axisymmetric):
    """Derivatives of the areas agree with differences, also of warped facets."""
    surface, x = side_of_box(cell, axisymmetric)
    rng = np.random.default_rng(3)
    x[..., : surface.gdim] += 0.05 * rng.uniform(-1, 1, (*x.shape[:2], surface.gdim))
    way = np.zeros(x.shape)
    way[..., : surface.gdim] = rng.uniform(-1, 1, (*x.shape[:2], surface.gdim))
    ahead, behind = (
        WORLD.allreduce(patch_areas(surface, x + s * way).sum()) for s in (1e-5, -1e-5)
    )
    n = surface.num_facet_vertices
    by = WORLD.allreduce(n * np.sum(share_gradients(surface, x) * way))
    assert by == pytest.approx((ahead - behind) / 2e-5, rel=1e-8)
