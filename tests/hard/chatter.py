"""Case 5: sets of closed nodes that Newton's method could change for ever."""

import numpy as np
from hard.scenes import Body, Check, Column, Wrong, balance, difference, largest, problem, solve
from hard.stiffness import Punch

import qsdolfinx as qs


def touching(variant):
    """Two blocks that just touch, without load: nothing moves, and nothing presses.

    Once with the upper block's end moved to where it touches exactly, but for rounding.
    """
    found, iterations = [], 0
    for gap in (0.0, 0.1):
        scene = Column(variant, gap=gap)
        scene.push(-gap)
        iterations = max(iterations, solve(scene.problem()))
        rigid = scene.upper.u.x.array[1::2] + gap
        found += [largest(rigid), largest(scene.contact.force("slave")), scene.contact.energy]
    return max(found), iterations


def grazing(variant):
    """Nodes within rounding of contact: gaps of ±1e-16 to 1e-9, in turn along the surface."""
    worst, iterations = 0.0, 0
    for depth in (1e-16, 1e-13, 1e-11, 1e-9):
        scene = Column(variant, n=(12, 9))
        upper = scene.upper
        upper.move(
            lambda x, y, d=depth: np.stack(
                [0 * x, np.where(np.abs(y) < 1e-9, d * np.cos(9 * np.pi * x), 0)], axis=1
            )
        )
        scene.contact.update()
        pressure = scene.press(0.0)
        for p in (0.0, 1e-12, 1e-3):
            pressure.value[1] = -p
            if p == 0.0:
                iterations = max(iterations, solve(scene.problem()))
            else:
                iterations = max(iterations, solve(scene.made))
        worst = max(worst, abs(scene.contact.force("slave")[1] / p - 1))
    return worst, iterations


def sharp(variant):
    """A flat punch with sharp edges, fine and stiff, or coarse and soft, under a force."""
    worst, iterations = 0.0, 0
    for n, E in ((4, 0.1), (11, 1e4), (23, 1.0)):
        block = Body((24, 8), [-3.0, -2.0], [3.0, 0.0])
        punch = Body((n, 4), [-1.0, 0.0], [1.0, 1.0], E)
        block.clamp(block.facets(1, -2.0))
        top = punch.facets(1, 1.0)
        punch.slide(0, top)
        punch.load(top, [0.0, -1e-2])
        surfaces = punch.surface(1, 0.0), block.surface(1, 0.0)
        contact = qs.Contact(*surfaces, **variant.options)
        iterations = max(iterations, solve(problem((block, punch), [contact])))
        worst = max(worst, abs(contact.force("slave")[1] / 2e-2 - 1))
        if variant.balances:
            worst = max(worst, balance(contact, 2.0))
    return worst, iterations


def checkerboard(variant):
    """First guesses in which every other node is closed, however they started."""
    scene = Punch(variant, n=((24, 8), (17, 5)), depth=0.15)
    p = scene.problem()
    iterations = solve(p)
    state = [u.x.array.copy() for u in p.u]
    change, force = 0.0, scene.contact.force("slave")[1]
    for amplitude in (1e-3, 1e-1, 10.0):
        for sign in (1, -1):
            for body in scene.bodies:
                x = body.V.tabulate_dof_coordinates()
                h = (body.high[0] - body.low[0]) / (24 if body is scene.block else 17)
                turn = np.cos(np.pi * np.round((x[:, 0] - body.low[0]) / h))
                body.u.x.array[1::2] += sign * amplitude * turn
            if variant.augmented:
                scene.contact.reset()
            iterations = max(iterations, solve(p))
            change = max(change, difference(p.u, state))
    if not force > 0:
        raise Wrong("nothing is in contact")
    return change, iterations


def wavy(variant):
    """Wavy surfaces with as many bumps as there are facets, from light to heavy load."""
    scene = Column(variant, n=(16, 13))
    rng = np.random.default_rng(5)
    bumps = rng.uniform(0.0, 0.02, 64)

    def rough(x, y):
        down = np.where(np.abs(y) < 1e-9, bumps[np.round(13 * x).astype(int) % 64], 0.0)
        return np.stack([0 * x, down], axis=1)

    scene.upper.move(rough)
    scene.contact.update()
    pressure = scene.press(0.0)
    p, worst, iterations = scene.problem(), 0.0, 0
    for load in (1e-7, 1e-5, 1e-3, 1e-2, 1e-4, 1e-6):
        pressure.value[1] = -load
        iterations = max(iterations, solve(p))
        worst = max(worst, abs(scene.contact.force("slave")[1] / load - 1))
    return worst, iterations


def checks(variant):
    case = "5 chattering"
    yield Check(case, "just touching, no load", "motion, force", 1e-12, lambda: touching(variant))
    yield Check(case, "gaps of ±1e-16 to 1e-9 in turn", "force", 1e-7, lambda: grazing(variant))
    yield Check(case, "punch with sharp edges", "force, balance", 1e-8, lambda: sharp(variant))
    yield Check(
        case,
        "every other node closed at first",
        "displacements",
        1e-6,
        lambda: checkerboard(variant),
    )
    yield Check(case, "rough surface, load up and down", "force", 1e-6, lambda: wavy(variant))
