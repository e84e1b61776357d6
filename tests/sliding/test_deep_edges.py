"""Sharp edges and corners of tools that go into facets with finite sliding, in 3D."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, box, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs


def roof(place):
    """A roof with its edge, downwards, along y."""
    x = [[place + a, b, abs(a)] for a in (0.0, -0.6, 0.6) for b in (-0.5, 1.5)]
    return np.array(x), [[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4]]


def tip(place):
    """A pyramid with its tip downwards."""
    corners = [[place + a, 0.47 + b, 0.6] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.array([[place, 0.47, 0.0], *corners]), [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]]


def pressed(tool, depth, sliding, steps=2):
    """Press a tool that starts above an elastic block; returns the contact."""
    msh = box(WORLD, (6, 6, 3), "tetrahedron", [0.0, 0.0, -0.5], [1.0, 1.0, 0.0])
    V = vector_space(msh)
    u = fem.Function(V)
    stress = qs.materials.linear_elastic(u, 1e3, 0.3)
    F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
    bc = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, plane(msh, 2, -0.5)), V)
    surface = qs.Surface(V, facets=plane(msh, 2, 0.0))
    tool = qs.RigidSurface.triangulated(WORLD, *tool)
    contact = qs.Contact(surface, tool, sliding=sliding)
    problem = qs.ContactProblem(F, u, contact, [bc])

    def drive(t, dt):
        tool.displacement = np.array([0.0, 0.0, -depth * dt])

    for _ in qs.TimeStepper(problem, 1 / steps, drive).run(1.0):
        pass
    return contact


@pytest.mark.parallel
@pytest.mark.parametrize("tool", (roof, tip))
def test_between_nodes(tool):
    """The warning comes where the force is too small; with small sliding there is no such depth."""
    with pytest.warns(qs.ContactWarning, match="a sharp edge or corner of the master") as caught:
        contact = pressed(tool(0.52), 0.02, "finite")
    assert sum("sharp edge or corner" in str(w.message) for w in caught) == 1
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*sharp edge or corner")
        other = pressed(tool(0.52), 0.02, "small")
    assert abs(contact.force("slave")[2]) < 0.3 * abs(other.force("slave")[2])


@pytest.mark.parametrize("half", (0.3, 1 / 3))
def test_flat_punch(half):
    """There is no warning if the face beside the edges lies on the other surface.

    Forces are 5 %, 0.01 % below those with small sliding.
    """
    x = [[0.5 + a * half, 0.5 + b * half, c] for c in (0, 1) for b in (-1, 1) for a in (-1, 1)]
    triangles = [[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7]]
    triangles += [[0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*sharp edge or corner")
        contact = pressed((np.array(x), triangles), 0.02, "finite")
    assert abs(contact.force("slave")[2]) > 10.0
