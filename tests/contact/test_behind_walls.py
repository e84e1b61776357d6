"""Named walls of bodies: a point behind the plane of a wall may be outside of the body."""

import numpy as np
import pytest
from following import Body, problem_of, rotation
from scenes import WORLD, box, largest, plane

import qsdolfinx as qs


def column(n, cell, low, high, bottom=None, top=None, yaw=0.0):
    """Make a box whose bottom and top have heights over (x, y), rotated about its middle."""
    body = Body(box(WORLD, n, cell, low, high))
    msh = body.mesh
    sides = {
        "xyz"[i] + str(end): plane(msh, i, value[i])
        for i in range(3)
        for end, value in enumerate((low, high))
    }
    x = msh.geometry.x
    part = (x[:, 2] - low[2]) / (high[2] - low[2])
    first = low[2] + (0.0 if bottom is None else bottom(*x[:, :2].T))
    last = high[2] + (0.0 if top is None else top(*x[:, :2].T))
    x[:, 2] = first + (last - first) * part
    middle = (np.array(low) + np.array(high)) / 2 * [1, 1, 0]
    x[:] = (x - middle) @ rotation(yaw, [0, 0, 1]).T + middle
    return body, sides


def pair(lower, upper, walls):
    """Make the contact of the first body's top and the second body's bottom, with some walls."""
    surfaces = [
        body.surface(np.concatenate([sides[name] for name in names]))
        for (body, sides), names in zip((lower, upper), walls, strict=True)
    ]
    lower[0].clamp(lower[1]["z0"])
    moved = upper[0].clamp(upper[1]["z1"])
    contact = qs.Contact(*surfaces)
    return contact, problem_of([lower[0], upper[0]], [contact]), moved


@pytest.mark.parametrize("yaw", (1.32, 1.34, 1.38))
def test_an_edge_behind_a_wall_and_above_the_body(yaw):
    """Bodies that do not touch have no contact force, whatever mesh lines the edges cross."""
    slope = 0.66
    lower = column((7, 6, 2), "tetrahedron", (0, 0, -1), (2, 2, 0), top=lambda x, y: slope * x)
    upper = column((2, 5, 3), "tetrahedron", (0.77, 0.08, 0), (1.62, 1.12, 0.6), yaw=yaw)
    mine = np.max(upper[0].mesh.geometry.x[:, 0], initial=-np.inf)
    upper[0].mesh.geometry.x[:, 2] += slope * max(WORLD.allgather(mine)) + 0.01
    contact, problem, _ = pair(lower, upper, (("z1", "x1"), ("z0", "x1")))
    problem.solve()
    assert contact.penetration() == 0
    assert largest(contact.force("slave"), contact.force("master")) < 1e-12


def test_a_vertex_below_a_rising_bottom():
    """Behind a far wall another face is nearer: the distance to the wall is not the depth."""
    roof = -2.0
    lower = column(
        (4, 4, 4), "hexahedron", (0, 0, -2.5), (2, 2, 0), top=lambda x, y: roof * np.abs(y - 1)
    )
    upper = column(
        (2, 2, 2), "tetrahedron", (0.67, 0.4, 0), (1.27, 1.5, 0.8),
        bottom=lambda x, y: 0.1 * (x - 0.67),
    )  # fmt: skip
    names = "x0", "x1", "y0", "y1"
    contact, problem, moved = pair(lower, upper, (("z1", *names), ("z0", *names)))
    moved.value[:] = 0.0, 0.0, -0.01
    problem.solve()
    assert contact.force("master")[2] != 0
    assert contact.penetration() < 0.01
