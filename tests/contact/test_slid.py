"""Sliding distance since contact detection, for which contact pairs are updated."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact.slid import slid
from qsdolfinx.surface.affine import Affine

N = 4

#: Distance in facets, at the ends of the surface as elsewhere.
SLID = 0.1 * N


def below_a_plane(gap):
    """A contact of a block with a plane at a distance, evaluated."""
    msh = box(WORLD, (N, N), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "scattered")
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0 + gap], [0.0, -1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 1.0)), tool)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
    problem.solve()
    return contact.model, u


def test_relative_to_the_tool():
    """A tool and a body that move together do not slide on each other."""
    model, u = below_a_plane(0.0)
    u.interpolate(lambda x: np.stack([0.1 + 0 * x[0], 0 * x[0]]))
    rests, way = np.zeros_like(u.x.array), Affine(np.zeros((2, 2)), np.array([0.1, 0.0]))
    assert slid(model, u.x.array, None, way) == pytest.approx(0.0, abs=1e-12)
    assert slid(model, rests, None, way) == pytest.approx(SLID)
    assert slid(model, u.x.array, None, None) == pytest.approx(SLID)


def test_rotation_may_have_opened_a_gap():
    """Nodes with a gap of 0.01 count if they slide by s on a tool that rotates by more than 0.01/s.

    The others are not in contact.
    """
    model, u = below_a_plane(0.01)
    u.interpolate(lambda x: np.stack([0.1 + 0 * x[0], 0 * x[0]]))
    for angle, counts in ((0.0, False), (0.05, False), (0.2, True)):
        c, s = np.cos(angle), np.sin(angle)
        A = np.array([[c - 1, -s], [s, c - 1]])
        tool = Affine(A, -A @ [0.5, 1.0])
        assert slid(model, u.x.array, None, tool) == pytest.approx(SLID if counts else 0, abs=0.1)
