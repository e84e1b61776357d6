"""Two blocks with rough surfaces, one of which slides on the other."""

import numpy as np
from following import Body, problem_of
from scenes import WORLD, box, plane

import qsdolfinx as qs


class Rough:
    """Block of n cells whose bottom or top (at y = 0) is rough.

    Attributes:
        body: The body.
        surface: Its rough side; for a rough bottom also the walls.
        held: Constant of the displacement of the opposite side.
    """

    def __init__(self, n, x, y, seed):
        msh = box(WORLD, n, "quadrilateral", [0.0, 0.0], [1.0, 1.0])
        sides = {(axis, at): plane(msh, axis, at) for axis in (0, 1) for at in (0.0, 1.0)}
        s, t = msh.geometry.x[:, 0].copy(), msh.geometry.x[:, 1].copy()
        heights = 0.03 * np.random.default_rng(seed).uniform(-1, 1, n[0] + 1)
        bumps = np.interp(s, np.linspace(0, 1, n[0] + 1), heights)
        is_lower = y[1] == 0.0
        msh.geometry.x[:, 0] = x[0] + (x[1] - x[0]) * s
        msh.geometry.x[:, 1] = y[0] + (y[1] - y[0]) * t + bumps * (t if is_lower else 1 - t)
        self.body = Body(msh)
        self.held = self.body.clamp(sides[1, 0.0 if is_lower else 1.0])
        rough = [sides[1, 1.0]] if is_lower else [sides[1, 0.0], sides[0, 0.0], sides[0, 1.0]]
        self.surface = self.body.surface(np.concatenate(rough))


def rough_run(**options):
    """Return contact and stepper of two rough blocks that slide on each other every other step."""
    upper = Rough((10, 5), (0.3, 1.3), (0.045, 0.8), 101)
    lower = Rough((33, 5), (0.0, 3.0), (-1.0, 0.0), 1)
    contact = qs.Contact(upper.surface, lower.surface, **options)

    def drive(t, dt):
        way = 0.1 * ((round(t) + 1) // 2)
        upper.held.value[:] = max(way - 0.5, 0.0), -0.06 * min(2 * way, 1.0)

    return contact, qs.TimeStepper(problem_of([upper.body, lower.body], [contact]), 1.0, drive)
