"""Moments of contact forces about any point, on either side, agree with those of nodal forces."""

import numpy as np
import pytest
from rigid_scenes import TOOLS, Pressed
from scenes import WORLD, Pair, drag_top

import qsdolfinx as qs


def moment_of(contact, surface, side, about):
    """Return Σ (x − a) × f of the tractions times nodal areas; the z component alone in 2D."""
    traction = surface.node_values(contact.traction(side)) * surface.node_area[:, None]
    arm, force = np.zeros((len(traction), 3)), np.zeros((len(traction), 3))
    arm[:, : surface.gdim] = surface.node_x[:, : surface.gdim] - about
    force[:, : surface.gdim] = traction
    moment = WORLD.allreduce(np.cross(arm, force).sum(axis=0))
    return moment[2:] if surface.gdim == 2 else moment


@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_about_any_point(cell):
    """Moments agree with a direct sum; between two points they differ by arm times force."""
    pair = Pair(cell, law=qs.Tied(), n=(4, 3), wave=0.05)
    drag_top(pair, 0.05)
    pair.problem().solve()
    contact, points = pair.contact, np.array([[0.0, 0.0, 0.0], [0.3, -0.7, 1.1]])[:, : pair.gdim]
    for side, surface in (("slave", pair.slave), ("master", pair.master)):
        found = [contact.moment(side, point) for point in points]
        for moment, point in zip(found, points, strict=True):
            expected = moment_of(contact, surface, side, point)
            np.testing.assert_allclose(moment, expected, atol=1e-12)
        np.testing.assert_array_equal(contact.moment(side), found[0])  # about the origin
        assert np.abs(found[1] - found[0]).min() > 1e-3


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_on_a_tool(cell, tool):
    """The default point is the tool's current centre; the moments of both sides are opposite."""
    scene = Pressed(cell, TOOLS[tool], law=qs.Tied(), penalty=50.0)
    scene.tool.displacement[0] = 0.02
    scene.problem.solve()
    contact, center = scene.contact, scene.tool.center
    for about, point in ((None, center), (center + 0.4, center + 0.4)):
        moment = contact.moment("slave", about)
        expected = moment_of(contact, scene.surface, "slave", point)
        np.testing.assert_allclose(moment, expected, atol=1e-12)
        np.testing.assert_array_equal(contact.moment("master", about), -moment)
        assert np.abs(moment).max() > 1e-4
