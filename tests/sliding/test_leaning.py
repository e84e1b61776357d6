"""Tools of facets whose walls face the body more and more as its facets lean on them."""

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box

import qsdolfinx as qs

DOWN, ALONG = 0.02, 0.05


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("steep", (2.0, 3.0, 20.0))
def test_pressed_and_dragged(steep, friction):
    """A tool with a flat bottom and inclined walls is pressed down and dragged in whole steps.

    Facets at its corners lean by 10° to 20°. Where walls of 72° had no weight or all of it, there
    was no equilibrium, and no step of any size succeeded.
    """
    body = Body(box(WORLD, (60, 12), "quadrilateral", [0.0, 0.0], [1.5, 0.4], "scattered"))
    body.clamp(body.boundary(lambda x: np.isclose(x[1], 0.0)))
    out = 0.15 / steep
    x = np.array([[0.35, 0.0], [0.65, 0.0], [0.65 + out, 0.15], [0.35 - out, 0.15]])
    sides = [[0, 1], [1, 2], [2, 3], [3, 0]]
    tool = qs.RigidSurface.triangulated(WORLD, x + np.array([0.0, 0.401]), sides)
    contact = qs.Contact(body.side(1, 0.4), tool, sliding="finite", friction=friction)

    def drive(t, dt):
        way = np.array([[max(s - 1, 0) * ALONG, -min(s, 1) * DOWN] for s in (t - dt, t)])
        tool.displacement = way[1] - way[0]

    stepper = qs.TimeStepper(problem_of([body], [contact]), 1.0, drive, dt_max=1.0)
    for _ in stepper.run(4.0):
        pass
    assert stepper.num_cutbacks == 0
    assert max(attempt.iterations for attempt in stepper.log) <= 25
    assert contact.force("slave")[1] < -1
