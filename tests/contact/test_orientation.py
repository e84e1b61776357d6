"""A warning is given for tools with reversed facets, and for no similar but correct scene."""

from mpi4py import MPI

import numpy as np
import pytest
from contact.test_warnings import warned
from scenes import WORLD, box, plane, vector_space

from dolfinx import mesh

import qsdolfinx as qs

CASES = [(gdim, quadrature) for gdim in (2, 3) for quadrature in ("nodal", "overlay")]


def closed_box(low, high, cavity=False, divisions=1):
    """Make a tool that is a box, or the whole space outside of a box."""
    return qs.RigidSurface.triangulated(WORLD, *box_facets(low, high, cavity, divisions))


def box_facets(low, high, cavity=False, divisions=1):
    """Return vertices and facets of such a tool."""
    cell = "quadrilateral" if len(low) == 2 else "tetrahedron"
    solid = box(MPI.COMM_SELF, [divisions] * len(low), cell, low, high)
    tdim = len(low) - 1
    solid.topology.create_connectivity(tdim, tdim + 1)
    facets = mesh.exterior_facet_indices(solid.topology)
    nodes = mesh.entities_to_geometry(solid, tdim, facets).reshape(-1, tdim + 1)
    x = solid.geometry.x[nodes].reshape(-1, 3)[:, : len(low)]
    x, index = np.unique(np.round(x, 12), axis=0, return_inverse=True)
    cells = index.reshape(-1, tdim + 1)
    out = x[cells].mean(axis=1) - np.mean([low, high], axis=0)
    edge = x[cells[:, 1]] - x[cells[:, 0]]
    if tdim == 1:
        normal = edge[:, ::-1] * [1, -1]  # the tool is on the left side
    else:
        normal = np.cross(edge, x[cells[:, 2]] - x[cells[:, 0]])
    turned = (np.sum(out * normal, axis=1) < 0) != cavity
    cells[turned] = cells[turned][:, ::-1]
    return x, cells


def slave(high, faces="top", n=4):
    """Make the faces of a box at the origin: its top, bottom, or all."""
    gdim = len(high)
    cell = "triangle" if gdim == 2 else "hexahedron"
    V = vector_space(box(WORLD, [n] * gdim, cell, [0.0] * gdim, high))
    if faces == "all":
        found = mesh.locate_entities_boundary(V.mesh, gdim - 1, lambda x: x[0] > -1)
    else:
        found = plane(V.mesh, gdim - 1, high[-1] if faces == "top" else 0.0)
    return qs.Surface(V, facets=found)


def texts_of(surface, tool, quadrature, **options):
    texts = warned(lambda: qs.Contact(surface, tool, quadrature=quadrature, **options))
    return [text for text in texts if "orientation" in text]


@pytest.mark.parametrize(("gdim", "quadrature"), CASES)
def test_tool_on_a_body(gdim, quadrature):
    """Only a reversed tool warns: open, touching or overlapping; coarse, fine, quadratic body."""
    for offset, divisions in ((0.04, 1), (0.0, 1), (-0.01, 1), (-0.04, 4)):
        low = [-0.3] * (gdim - 1) + [1 + offset]
        high = [1.4] * (gdim - 1) + [1.5 + offset]
        for turned in (False, True):
            tool = closed_box(low, high, turned, divisions)
            texts = texts_of(slave([1.0] * gdim), tool, quadrature, search_radius=0.7)
            assert len(texts) == turned, (offset, turned, texts)
            assert not turned or texts[0].startswith("normals: ")


@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("gdim", (2, 3))
def test_smaller_tool(gdim, sliding):
    """A reversed tool smaller than the body's face is detected where it touches the body."""
    low, high = [0.2] * (gdim - 1) + [1.0], [0.8] * (gdim - 1) + [1.25]
    for cavity in (False, True):
        tool = closed_box(low, high, cavity)
        texts = texts_of(slave([1.0] * gdim), tool, "overlay", sliding=sliding)
        assert len(texts) == int(cavity)


@pytest.mark.parametrize(("gdim", "quadrature"), CASES)
def test_body_in_a_cavity(gdim, quadrature):
    """No warning for a body in a cavity, with clearance, at zero gap or with interference."""
    for clearance in (0.02, 0.0, -0.01):
        for faces in ("all", "bottom"):
            for turned in (False, True):
                tool = closed_box([-clearance] * gdim, [1 + clearance] * gdim, not turned)
                texts = texts_of(slave([1.0] * gdim, faces), tool, quadrature)
                assert len(texts) == turned, (clearance, faces, turned, texts)


@pytest.mark.parametrize(("gdim", "quadrature"), CASES)
def test_no_false_alarm(gdim, quadrature):
    """No warning for a sheet in a cavity, a block deep in a plate, or a block on another."""
    across = [1.0] * (gdim - 1)
    cavity = closed_box([0.0] * gdim, [*across, 0.5], True)
    for n in (1, 3):
        for faces in ("all", "top", "bottom"):
            sheet = slave([*across, 0.05], faces, n)
            assert texts_of(sheet, cavity, quadrature, search_radius=1.0) == []
    for depth in (0.02, 0.06, 0.09):
        low = [-0.3] * (gdim - 1) + [1 - depth]
        plate = closed_box(low, [1.4] * (gdim - 1) + [1.1 - depth])
        for faces in ("all", "top"):
            assert texts_of(slave([1.0] * gdim, faces), plate, quadrature) == []
    below = closed_box([-1.0] * gdim, [2.0] * (gdim - 1) + [0.0])
    for faces in ("all", "bottom"):
        assert texts_of(slave([1.0] * gdim, faces), below, quadrature) == []


def sheets(gdim, turned, between=0.01):
    """Make two flat sheets side by side on top of the unit box, some of them reversed."""
    ends = ((-0.2, 0.6 - between), (0.6, 1.2))
    if gdim == 2:
        x = [[[a, 1.0], [b, 1.0]] for a, b in ends]
        cells = [[[0, 1]], [[0, 1]]]
    else:
        x = [[[s, t, 1.0] for t in (-0.2, 1.2) for s in pair] for pair in ends]
        cells = [[[0, 2, 1], [1, 2, 3]]] * 2
    cells = [np.array(c) + gdim**2 // 2 * i for i, c in enumerate(cells)]
    cells = [c[:, ::-1] if t else c for c, t in zip(cells, turned, strict=True)]
    return qs.RigidSurface.triangulated(WORLD, np.concatenate(x), np.concatenate(cells))


@pytest.mark.parametrize(("gdim", "quadrature"), CASES)
def test_each_shell_is_oriented_by_itself(gdim, quadrature):
    """Of two sheets side by side the warning names the reversed one, also if it is the smaller."""
    for turned in ((False, False), (False, True), (True, False), (True, True)):
        texts = texts_of(slave([1.0] * gdim, n=6), sheets(gdim, turned), quadrature)
        assert len(texts) == any(turned), (turned, texts)
        if turned == (False, True):
            assert "from (0.6, " in texts[0] and f"({2 if gdim == 3 else 1} facets" in texts[0]


@pytest.mark.parametrize("gdim", (2, 3))
def test_shells_within_each_other(gdim):
    """A hollow tool on a body: its cavity is correctly oriented inwards and gives no warning."""
    across = gdim - 1
    outer = [-0.3] * across + [1.0], [1.3] * across + [1.6]
    inner = [-0.1] * across + [1.1], [1.1] * across + [1.5]
    for outer_turned in (False, True):
        (x, first), (y, second) = box_facets(*outer, outer_turned), box_facets(*inner, True)
        cells = np.concatenate([first, second + len(x)])
        tool = qs.RigidSurface.triangulated(WORLD, np.concatenate([x, y]), cells)
        texts = texts_of(slave([1.0] * gdim), tool, "overlay", search_radius=0.7)
        assert len(texts) == outer_turned
