"""Case 8: contact at edges and corners; forces and moments of both sides balance there as well."""

import numpy as np
from hard.scenes import Body, Check, Wrong, balance, problem, solve

from dolfinx import fem

import qsdolfinx as qs


def overhang(variant, swap, gap):
    """A block that overhangs another one by half of its length, pressed down on it."""
    lower = Body((7, 4), [-1.0, -1.0], [1.0, 0.0])
    upper = Body((9, 4), [0.0, 0.0], [2.0, 1.0], 2.0)
    near, top = upper.facets(1, 0.0), upper.facets(1, 1.0)
    lower.clamp(lower.facets(1, -1.0))
    upper.slide(0, top)
    upper.slide(1, top, -gap - 0.02)
    upper.move(lambda x, y: np.stack([0 * x, gap + 0 * y], axis=1))
    surfaces = [qs.Surface(upper.V, facets=near), lower.surface(1, 0.0)]
    contact = qs.Contact(*(surfaces[::-1] if swap else surfaces), **variant.options)
    iterations = solve(problem((lower, upper), [contact]))
    if not abs(contact.force("slave")[1]) > 1e-3:
        raise Wrong("nothing is in contact")
    return balance(contact, 1.0), iterations


class Driven:
    """A body whose far end follows a finite rigid motion, over a plate that ends at x = 1.

    Args:
        variant: What it is solved with.
        body: The body, the slave.
        near: Its facets that may touch.
        far: Its facets that are driven.
        motion: Angle, centre and displacement at a time.
        options: For the contact.
    """

    def __init__(self, variant, body, near, far, motion, **options):
        self.plate = Body((10, 5), [-1.0, -1.0], [1.0, 0.0])
        self.plate.clamp(self.plate.facets(1, -1.0))
        facets = [self.plate.facets(0, 1.0), self.plate.facets(1, 0.0)]
        master = qs.Surface(self.plate.V, facets=np.unique(np.concatenate(facets)))
        self.body, self.motion = body, motion
        self.given = fem.Function(body.V)
        dofs = fem.locate_dofs_topological(body.V, 1, far)
        body.bcs.append(fem.dirichletbc(self.given, dofs))
        slave = qs.Surface(body.V, facets=near)
        self.contact = qs.Contact(slave, master, **(variant.options | options))
        made = problem((self.plate, body), [self.contact])
        self.stepper = qs.TimeStepper(made, 0.05, self.drive)

    def drive(self, t, dt):
        angle, centre, shift = self.motion(t)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        def displacement(x):
            r = x[:2] - np.array(centre)[:, None]
            return turn @ r - r + np.array(shift)[:, None]

        self.given.interpolate(displacement)

    def run(self):
        """Worst balance of the steps in contact; at the end it has to be lost."""
        worst, largest, iterations = 0.0, 0.0, 0
        for _ in self.stepper.run(1.0):
            force = np.linalg.norm(self.contact.force("slave"))
            largest = max(largest, force)
            if force > 1e-6 * largest:
                worst = max(worst, balance(self.contact, 1.0))
            iterations = max(iterations, self.stepper.num_iterations)
        if not largest > 1e-4 or force > 1e-12 * largest:
            raise Wrong(f"a force of {force:.3g} at the end, of {largest:.3g} at most")
        return worst, iterations


def corner(variant, **options):
    """The corner of a tilted block is pressed on the plate and dragged off its end."""
    body = Body((5, 5), [0.0, 0.0], [0.8, 0.8], 2.0, large=True)
    near = np.unique(np.concatenate([body.facets(0, 0.0), body.facets(1, 0.0)]))
    far = np.unique(np.concatenate([body.facets(0, 0.8), body.facets(1, 0.8)]))
    angle, at = np.pi / 6, np.array([0.65, 0.02])

    def tilt(x, y):
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([c * x - s * y - x + at[0], s * x + c * y - y + at[1]], axis=1)

    body.move(tilt)

    def motion(t):
        return 0.0, (0.0, 0.0), (0.5 * max(t - 0.2, 0.0), -0.06 * min(t / 0.2, 1.0))

    return Driven(variant, body, near, far, motion, **options).run()


def rolling(variant, **options):
    """A stiffer rocker, a part of a ring with the radius 1, rolls off the end of the plate."""
    low, high = np.radians(-115), np.radians(-25)
    body = Body((20, 3), [low, 0.6], [high, 1.0], 10.0, large=True)
    near, far = body.facets(1, 1.0), body.facets(1, 0.6)
    start = np.array([0.6, 1.0])

    def bend(angle, r):
        place = start + (r * np.array([np.cos(angle), np.sin(angle)])).T
        return place - np.stack([angle, r], axis=1)

    body.move(bend)

    def motion(t):
        down, on = 0.03 * min(t / 0.2, 1.0), 0.875 * max(t - 0.2, 0.0)
        return -on, start, (on, -down)

    return Driven(variant, body, near, far, motion, **options).run()


def checks(variant):
    case, what = "8 edges", "force, moment"
    for swap in (False, True):
        for gap in (0.0, 0.1):
            label = f"overhang, {'plate' if swap else 'block'} is the slave, gap of {gap:g}"
            yield Check(
                case,
                label,
                what,
                1e-10,
                lambda s=swap, g=gap: overhang(variant, s, g),
            )
    # Along bisectors forces have a lever, the penetration times the sine of half the angle between
    # the normals; at nodes it may be a tenth of a facet, as far as nodes may be beside a surface.
    nodal = variant.quadrature == "nodal"
    facet = {"normals": "facet"}
    lever = 3e-3 if nodal else 1e-10
    moves = (("corner dragged off an edge", corner, 0.05), ("rolling off an edge", rolling, 5e-3))
    for label, move, bisector in moves:
        text = f"{label}, facet normals"
        yield Check(case, text, what, lever, lambda m=move: m(variant, **facet))
        if not nodal:
            text = f"{label}, bisectors"
            yield Check(case, text, what, bisector, lambda m=move: m(variant))
    rough = {"friction": qs.Coulomb(0.3)}
    text = "rolling off an edge with friction, bisectors"
    yield Check(case, text, what, 1e-2, lambda: rolling(variant, **rough))
