"""Scenes that need the whole derivative: of contact points, areas and vertices."""

import numpy as np
import pytest
from following import Body, E, create, problem_of
from scenes import WORLD, box, plane

import qsdolfinx as qs


def tip(n, half):
    """A slender wedge of n × n cells, its tip at y = 1.01."""
    s = np.linspace(0, 1, n + 1)
    width = 0.016 + (half - 0.016) * s
    x = [[w * (2 * t - 1), 1.01 + y] for y, w in zip(s, width, strict=True) for t in s]
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([first, first + 1, first + n + 1, first + n + 2], axis=1)
    return create("quadrilateral", np.array(x), cells)


@pytest.mark.one_rank
def test_corners_on_a_tip_that_bends():
    """The derivative includes the curvature of facets near corners when the tip bends.

    Without the derivative of the nodal normals, 100 iterations were not enough.
    """
    sides = (-1.02, -0.02), (0.02, 1.02)
    blocks = [
        Body(box(WORLD, (10, 10), "triangle", (low, 0.0), (high, 1.0))) for low, high in sides
    ]
    wedge = Body(tip(8, 0.5))
    for block, far in zip(blocks, (-1.02, 1.02), strict=True):
        block.clamp(block.boundary(lambda x, far=far: np.isclose(x[0], far)))
    top = wedge.clamp(wedge.boundary(lambda x: np.isclose(x[1], 2.01)))
    flanks = wedge.surface(wedge.boundary(lambda x: x[1] < 2.005))
    contacts = []
    for block, near in zip(blocks, (-0.02, 0.02), strict=True):
        walls = block.boundary(lambda x, near=near: np.isclose(x[0], near) | np.isclose(x[1], 1.0))
        contacts.append(qs.Contact(block.surface(walls), flanks))
    problem = problem_of([*blocks, wedge], contacts)

    def drive(t, dt):
        top.value[:] = 0.0, -t

    stepper = qs.TimeStepper(problem, 0.05, drive, min_quality=0.003)
    steps = [stepper.num_iterations for _ in stepper.run(0.15)]
    assert stepper.num_cutbacks == 0
    assert max(steps) <= 30 and steps[-1] <= 10
    force = sum(contact.force("slave") for contact in contacts)
    assert force[1] == pytest.approx(-1.126, rel=0.02)


def test_round_punch_on_a_line_of_the_mesh():
    """The derivative includes partly active segments, areas, and a corner that carries load.

    With the terms of the rims alone, and fixed areas, 100 iterations were not enough, for
    any step size.
    """
    forces = [pressed_by_a_punch(swapped) for swapped in (False, True)]
    assert forces[0] == pytest.approx(forces[1], rel=5e-3)


def pressed_by_a_punch(swapped):
    """Force of a round punch on a block, its lowest node on a line of the block's mesh."""
    msh = box(WORLD, (8, 3), "quadrilateral", (0.0, 0.0), (1.0, 1.0))
    sides = {(axis, at): plane(msh, axis, at) for axis in (0, 1) for at in (0.0, 1.0)}
    s, t = 2 * msh.geometry.x[:, 0] - 1, msh.geometry.x[:, 1].copy()
    bottom = 0.25 - np.sqrt(0.0625 - (0.245 * s) ** 2)
    msh.geometry.x[:, 0], msh.geometry.x[:, 1] = 0.25 * s, bottom + (1 - bottom) * t
    punch = Body(msh, stiffness=10 * E)
    block = Body(box(WORLD, (16, 8), "quadrilateral", (-1.0, -1.0), (1.0, 0.0)))
    block.clamp(plane(block.mesh, 1, -1.0))
    top = punch.clamp(sides.pop((1, 1.0)))
    surfaces = punch.surface(np.concatenate(list(sides.values()))), block.side(1, 0.0)
    contact = qs.Contact(*surfaces[:: -1 if swapped else 1])
    problem = problem_of([punch, block], [contact])

    def drive(t, dt):
        top.value[:] = 0.0, -0.5 * t

    stepper = qs.TimeStepper(problem, 0.05, drive)
    steps = [stepper.num_iterations for _ in stepper.run(0.6)]
    assert stepper.num_cutbacks == 0 and max(steps) <= 12
    return contact.force("master" if swapped else "slave")[1]
