"""Contact forces on a rigid tool act along the tool's own normals, of facets or of a shape."""

import numpy as np
import pytest
from rigid_scenes import flat_facets
from scenes import WORLD, box, clamp, elastic, plane

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.surface.affine import rotation_matrix

ANGLE = {2: np.array([0.4]), 3: np.array([0.3, -0.5, 0.2])}


def pressed_tip(gdim, degree, kind, **options):
    """A curved, tilted face pressed without friction on a flat tool; the scene is rotated.

    Returns:
        Force on the body along the tool's normal, and the magnitude of its tangential part.
    """
    shape = (7, 3) if gdim == 2 else (4, 3, 2)
    cell = "triangle" if gdim == 2 else "tetrahedron"
    msh = box(WORLD, shape, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
    top = plane(msh, gdim - 1, 1.0)
    bottom = plane(msh, gdim - 1, 0.0)
    x, R = msh.geometry.x, rotation_matrix(ANGLE[gdim])
    tip = 0.4 * (x[:, 0] - 0.35) ** 2 + (0.3 * (x[:, 1] - 0.6) ** 2 if gdim == 3 else 0.0)
    x[:, gdim - 1] -= tip * x[:, gdim - 1]
    x[:, :gdim] = x[:, :gdim] @ R.T
    V = fem.functionspace(msh, ("Lagrange", degree, (gdim,)))
    u = fem.Function(V)
    if kind == "facets":
        tool = flat_facets(WORLD, gdim)
        tool.position = np.column_stack([R, np.zeros(gdim)])
    else:
        tool = qs.RigidSurface.plane(WORLD, R @ np.ones(gdim), -R[:, -1])
    if "dt" in options:
        options["unknown"] = "velocity"
    contact = qs.Contact(qs.Surface(V, facets=top), tool, search_radius=0.5, **options)
    tool.displacement = -0.03 * R[:, -1]
    bcs = [clamp(V, bottom)]
    qs.ContactProblem([elastic(u, 10.0)], [u], [contact], [bcs]).solve()
    along = R.T @ contact.force("slave")
    return along[-1], np.linalg.norm(along[:-1])


@pytest.mark.parametrize(
    "gdim, degree, options",
    (
        (2, 1, {}),
        (2, 1, {"constraints": "nodes"}),
        (2, 1, {"formulation": "master-slave", "normals": "bisector"}),
        (2, 1, {"sliding": "finite"}),
        (2, 1, {"quadrature": "nodal", "friction": qs.Coulomb(0.0)}),
        (2, 2, {"normals": "facet"}),
        (2, 1, {"dt": 0.5}),
        (3, 1, {}),
        (3, 1, {"quadrature": "nodal"}),
    ),
)
def test_a_flat_tool_does_not_push_sideways(gdim, degree, options):
    """Force is normal to a flat tool, whatever the facets of the body.

    It is that of a plane, except for the areas of tilted facets.
    """
    force, sideways = pressed_tip(gdim, degree, "facets", **options)
    assert force < -0.01 and sideways < 1e-10 * -force
    if "quadrature" not in options:
        assert np.isclose(force, pressed_tip(gdim, degree, "plane", **options)[0], rtol=2e-2)
