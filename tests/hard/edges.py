"""Case 8: contact at edges and corners; forces and moments of both sides balance there as well."""

import numpy as np
from hard.bodies import Wrong, balance, iterations, problem, rectangle, solve
from hard.cases import Case, Variant

from dolfinx import fem

import qsdolfinx as qs


def overhang(variant, swap, gap):
    """A block that overhangs another block by half of its length, pressed down on it."""
    lower = rectangle((7, 4), [-1.0, -1.0], [1.0, 0.0])
    upper = rectangle((9, 4), [0.0, 0.0], [2.0, 1.0], 2.0)
    near, top = upper.facets(1, 0.0), upper.facets(1, 1.0)
    lower.hold(lower.facets(1, -1.0))
    upper.hold(top, [0.0, -gap - 0.02])
    upper.move(lambda x, y: np.stack([0 * x, gap + 0 * y], axis=1))
    surfaces = [qs.Surface(upper.V, facets=near), lower.surface(1, 0.0)]
    contact = qs.Contact(*(surfaces[::-1] if swap else surfaces), **variant.options)
    solve(problem((lower, upper), [contact]))
    if not abs(contact.force("slave")[1]) > 1e-3:
        raise Wrong("nothing is in contact")
    return balance(contact, 1.0)


def driven(variant, body, near, far, motion, **options):
    """A body whose far end follows a finite rigid motion, over a plate that ends at x = 1.

    Args:
        variant: Variant of contact.
        body: The body, the slave.
        near: Its facets that can come into contact.
        far: Its facets that are moved.
        motion: Function of time: angle, centre and displacement.
        options: Options of the contact.

    Returns:
        The largest imbalance of the steps in contact; contact must be lost at the end.
    """
    plate = rectangle((10, 5), [-1.0, -1.0], [1.0, 0.0])
    plate.hold(plate.facets(1, -1.0))
    facets = np.concatenate([plate.facets(0, 1.0), plate.facets(1, 0.0)])
    surfaces = qs.Surface(body.V, facets=near), qs.Surface(plate.V, facets=np.unique(facets))
    contact = qs.Contact(*surfaces, **(variant.options | options))
    given = body.hold(far, fem.Function(body.V))

    def drive(t, dt):
        angle, centre, shift = motion(t)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        def displacement(x):
            r = x[:2] - np.array(centre)[:, None]
            return turn @ r - r + np.array(shift)[:, None]

        given.interpolate(displacement)

    stepper = qs.TimeStepper(problem((plate, body), [contact]), 0.05, drive)
    worst, most = 0.0, 0.0
    for _ in stepper.run(1.0):
        iterations.append(stepper.num_iterations)
        force = np.linalg.norm(contact.force("slave"))
        most = max(most, force)
        if force > 1e-6 * most:
            worst = max(worst, balance(contact, 1.0))
    if not most > 1e-4 or force > 1e-12 * most:
        raise Wrong(f"a force of {force:.3g} at the end, of {most:.3g} at most")
    return worst


def corner(variant, **options):
    """Press the corner of a tilted block on the plate and drag it off the plate's end."""
    body = rectangle((5, 5), [0.0, 0.0], [0.8, 0.8], 2.0, large=True)
    near, far = (
        np.unique(np.concatenate([body.facets(axis, at) for axis in (0, 1)])) for at in (0.0, 0.8)
    )
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    body.move(lambda x, y: np.stack([c * x - s * y - x + 0.65, s * x + c * y - y + 0.02], axis=1))

    def motion(t):
        return 0.0, (0.0, 0.0), (0.5 * max(t - 0.2, 0.0), -0.06 * min(t / 0.2, 1.0))

    return driven(variant, body, near, far, motion, **options)


def rolling(variant, **options):
    """Roll a stiffer rocker, a part of a ring with the radius 1, off the end of the plate."""
    low, high = np.radians(-115), np.radians(-25)
    body = rectangle((20, 3), [low, 0.6], [high, 1.0], 10.0, large=True)
    near, far = body.facets(1, 1.0), body.facets(1, 0.6)
    start = np.array([0.6, 1.0])

    def bend(angle, r):
        place = start + (r * np.array([np.cos(angle), np.sin(angle)])).T
        return place - np.stack([angle, r], axis=1)

    body.move(bend)

    def motion(t):
        down, on = 0.03 * min(t / 0.2, 1.0), 0.875 * max(t - 0.2, 0.0)
        return -on, start, (on, -down)

    return driven(variant, body, near, far, motion, **options)


def cases(variant):
    name, what, nodal = "8 edges", "force, moment", variant.quadrature == "nodal"
    for swap in (False, True):
        for gap in (0.0, 0.1):
            label = f"overhang, {'plate' if swap else 'block'} is the slave, gap of {gap:g}"
            run = lambda s=swap, g=gap: overhang(variant, s, g)  # noqa: E731
            yield Case(name, label, what, 1e-10, run, short=True)
    # With bisector normals forces have a lever: the penetration times the sine of half the angle
    # between the normals. With nodal quadrature the lever may be a tenth of a facet, the distance
    # by which nodes may be beside a surface.
    facet, rough = {"normals": "facet"}, {"friction": qs.Coulomb(0.3)}
    short = variant in (Variant(), Variant(quadrature="nodal"))
    moves = [
        ("corner dragged off an edge, facet normals", corner, 1e-10, facet),
        ("corner dragged off an edge, bisectors", corner, 0.05, {}),
        ("rolling off an edge, facet normals", rolling, 3e-3 if nodal else 1e-10, facet),
        ("rolling off an edge, bisectors", rolling, 5e-3, {}),
        ("rolling off an edge with friction, bisectors", rolling, 1e-2, rough),
    ]
    stuck = Variant("master-slave", "overlay", "augmented-lagrangian")
    for label, move, allowed, options in moves:
        if options or not nodal:
            run = lambda move=move, given=options: move(variant, **given)  # noqa: E731
            off_edge = move is corner and options is facet and variant == stuck
            known = "It is right with bisectors, the overlay's default normals." * off_edge
            yield Case(name, label, what, allowed, run, short and options is not rough, known=known)
