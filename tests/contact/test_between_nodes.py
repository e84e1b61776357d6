"""A warning is given for an edge that penetrates between two nodes with almost no force."""

import warnings

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

SIZE = 0.2


class Edge:
    """Roof or flat tool pressed into a block, with its edge in the middle of a facet.

    Args:
        gdim: Dimension of space.
        slope: Slope of both sides of the edge.
        options: Options of the contact.
    """

    def __init__(self, gdim=2, slope=1.0, **options):
        mid = [2] * (gdim - 2)
        cell = "triangle" if gdim == 2 else "hexahedron"
        low, high = [-0.8, *[-0.2] * len(mid), -0.6], [0.8, *[0.2] * len(mid), 0.0]
        msh = box(WORLD, [8, *mid, 3], cell, low, high, "scattered")
        V = vector_space(msh)
        self.u = fem.Function(V)
        rise = 1.2 * slope
        roof = [[1.3, rise], [0.1, 0.0], [-1.1, rise]]
        if gdim == 2:
            facets = [[0, 1], [1, 2]]
        else:
            roof = [[x, y, z] for y in (-1.0, 1.0) for x, z in roof]
            facets = [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]]
        self.tool = qs.RigidSurface.triangulated(WORLD, roof, self.looking_down(roof, facets))
        surface = qs.Surface(V, facets=plane(msh, gdim - 1, 0.0))
        self.contact = qs.Contact(surface, self.tool, **{"constraints": "nodes"} | options)
        bcs = [[clamp(V, plane(msh, gdim - 1, -0.6))]]
        F = [elastic(self.u, 100.0)]
        self.problem = qs.ContactProblem(F, [self.u], [self.contact], bcs)

    @staticmethod
    def looking_down(x, facets):
        """Return the facets with downward normals."""
        x, out = np.array(x), []
        for f in facets:
            if len(f) == 2:
                d = x[f[1]] - x[f[0]]
                up = -d[0]
            else:
                up = np.cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]])[2]
            out.append(f[::-1] if up > 0 else f)
        return out

    def pressed(self, depth):
        """Return the upward force on the tool and the edge warnings, which all ranks share."""
        self.tool.displacement[-1] = -depth
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            self.problem.solve()
        texts = [str(w.message) for w in found if "goes in between nodes" in str(w.message)]
        assert len(set(map(tuple, WORLD.allgather(texts)))) == 1
        return -self.contact.force("slave")[-1], texts


@pytest.mark.parametrize("options", ({}, {"enforcement": "augmented-lagrangian"}))
@pytest.mark.parametrize("gdim", (2, 3))
def test_edge_without_a_force(gdim, options):
    """With constraints at nodes the force is zero; one warning names depth, place and remedy."""
    scene, depth = Edge(gdim, **options), 0.3 * SIZE
    force, texts = scene.pressed(depth)
    penetration = scene.contact.penetration()
    assert 0.7 * depth < penetration < 1.001 * depth and force == 0.0
    (text,) = texts
    assert 'constraints="points"' in text
    x, said = (
        float(text.split(after)[1].split(to)[0]) for after, to in ((" (", ","), (") is ", " "))
    )
    deepest = depth / np.sqrt(2)  # along the normals of the roof
    assert 0.6 * deepest < said <= deepest and abs(x - 0.1) < 0.2 * SIZE
    assert scene.pressed(1.01 * depth)[1] == []


@pytest.mark.parametrize("gdim", (2, 3))
def test_points_resist(gdim):
    """With constraints at points there is a force, no warning, and the edge does not penetrate."""
    scene = Edge(gdim, constraints="points")
    force, texts = scene.pressed(0.3 * SIZE)
    assert force > 1.0 and texts == []
    assert scene.contact.penetration() < 1e-9 * SIZE
    assert scene.contact.report().advice == ""


@pytest.mark.parametrize("penalty", (20.0, 1e4))
@pytest.mark.parametrize("slope, depth", ((0.0, 0.04), (0.05, 0.02), (1.0, 0.005)))
def test_nothing_to_warn_of(slope, depth, penalty):
    """No warning for flat tools with a soft penalty, for blunt edges and for shallow edges."""
    scene = Edge(2, slope, penalty=penalty, enforcement="penalty")
    assert scene.pressed(depth)[1] == []


def test_time_steps_warn_as_well():
    """One warning at the end of the step whose penetration is too deep; correct steps give none."""
    scene = Edge()

    def drive(t, dt):
        scene.tool.displacement[-1] = -0.02 * dt

    found = []
    stepper = qs.TimeStepper(scene.problem, 1.0, drive)
    for _ in range(4):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            stepper.step()
        found.append(sum("goes in between nodes" in str(w.message) for w in caught))
    assert sum(found) == 1 and found[0] == 0


@pytest.mark.parametrize("options", ({"constraints": "nodes"}, {"sliding": "finite"}))
@pytest.mark.parametrize("tool", ("ball", "needle"))
def test_round_and_graded(tool, options):
    """Local facets count, not distant ones: the ball is round for them, and the needle is sharp.

    With constraints at points the needle does not penetrate.
    """
    msh = box(WORLD, (16, 4), "triangle", [-1.0, -0.5], [1.0, 0.0], "scattered")
    x = msh.geometry.x
    x[:, 0] = np.where(x[:, 0] > 0.3, 0.3 + (x[:, 0] - 0.3) ** 3 / 0.49, x[:, 0])
    V = vector_space(msh)
    u = fem.Function(V)
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    assert surface.facet_size_range[0] < 0.1 * surface.facet_size_range[1]
    radius = 0.5 if tool == "ball" else 0.06
    circle = qs.RigidSurface.cylinder(WORLD, [-0.3125, radius], None, radius)
    contact = qs.Contact(surface, circle, **options)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, -0.5))]])
    circle.displacement = [0.0, -0.04 if tool == "ball" else -0.045]
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        problem.solve()
    texts = [str(w.message) for w in found if "goes in between nodes" in str(w.message)]
    assert len(texts) == (tool == "needle" and "constraints" in options), texts
    assert not texts or "of the slave's facet there" in texts[0]
