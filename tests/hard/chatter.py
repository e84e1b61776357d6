"""Case 5: active sets that Newton's method could change for ever."""

import numpy as np
from hard.bodies import (
    Column,
    Punch,
    Wrong,
    balance,
    difference,
    problem,
    rectangle,
    solve,
)
from hard.cases import SHORT, Case, Variant
from scenes import largest

import qsdolfinx as qs


def touching(variant):
    """Two blocks that just touch, without load: displacements and forces must vanish.

    In a second run the end of the upper block is moved until the blocks just touch, up to rounding.
    """
    found = []
    for gap in (0.0, 0.1):
        scene = Column(variant, gap=gap)
        scene.push(-gap)
        solve(scene.problem())
        rigid = scene.upper.u.x.array[1::2] + gap
        found += [
            largest(rigid),
            largest(scene.contact.force("slave")),
            scene.contact.stored_energy(),
        ]
    return max(found)


def bumpy(variant, n, depth):
    """The column with the upper block's interface nodes moved up by a function of x."""
    scene = Column(variant, n=n)
    scene.upper.move(lambda x, y: np.stack([0 * x, np.where(np.abs(y) < 1e-9, depth(x), 0)], 1))
    scene.contact.update()
    return scene, scene.press(0.0)


def grazing(variant):
    """Nodes within rounding of contact: gaps of ±1e-16 to 1e-9, alternating along the surface."""
    errors = []
    for depth in (1e-16, 1e-13, 1e-11, 1e-9):
        scene, load = bumpy(variant, (12, 9), lambda x, d=depth: d * np.cos(9 * np.pi * x))
        p = scene.problem()
        for pressure in (0.0, 1e-12, 1e-3):
            load.value[1] = -pressure
            solve(p)
        errors.append(abs(scene.contact.force("slave")[1] / pressure - 1))
    return max(errors)


def wavy(variant):
    """Wavy surfaces with as many bumps as facets, from light to heavy load."""
    bumps = np.random.default_rng(5).uniform(0.0, 0.02, 64)
    scene, load = bumpy(variant, (16, 13), lambda x: bumps[np.round(13 * x).astype(int) % 64])
    p, errors = scene.problem(), []
    for pressure in (1e-7, 1e-5, 1e-3, 1e-2, 1e-4, 1e-6):
        load.value[1] = -pressure
        solve(p)
        errors.append(abs(scene.contact.force("slave")[1] / pressure - 1))
    return max(errors)


def sharp(variant):
    """A flat punch with sharp edges, fine and stiff, or coarse and soft, under a force."""
    errors = []
    for n, E in ((4, 0.1), (11, 1e4), (23, 1.0)):
        block = rectangle((24, 8), [-3.0, -2.0], [3.0, 0.0])
        punch = rectangle((n, 4), [-1.0, 0.0], [1.0, 1.0], E)
        block.hold(block.facets(1, -2.0))
        top = punch.facets(1, 1.0)
        punch.hold(top, axis=0)
        punch.load(top, [0.0, -1e-2])
        surfaces = punch.surface(1, 0.0), block.surface(1, 0.0)
        contact = qs.Contact(*surfaces, **variant.options)
        solve(problem((block, punch), [contact]))
        errors += [abs(contact.force("slave")[1] / 2e-2 - 1), balance(contact, 2.0)]
    return max(errors)


def checkerboard(variant):
    """Initial guesses in which every other node is active must give the same result."""
    scene = Punch(variant, n=((24, 8), (17, 5)), depth=0.15)
    p = scene.problem()
    solve(p)
    state = [u.x.array.copy() for u in p.u]
    errors, force = [], scene.contact.force("slave")[1]
    for amplitude in (1e-3, -1e-3, 1e-1, -1e-1, 10.0, -10.0):
        for body, n in zip(scene.bodies, (24, 17), strict=True):
            x = body.V.tabulate_dof_coordinates()[:, 0]
            h = (body.high[0] - body.low[0]) / n
            body.u.x.array[1::2] += amplitude * np.cos(np.pi * np.round((x - body.low[0]) / h))
        if variant.augmented:
            scene.contact.reset()
        solve(p)
        errors.append(difference(p.u, state))
    if not force > 0:
        raise Wrong("nothing is in contact")
    return max(errors)


def cases(variant):
    for label, what, allowed, run, short, most in (
        ("just touching, no load", "motion, force", 1e-12, touching, True, 10),
        ("gaps of ±1e-16 to 1e-9 in turn", "force", 1e-8, grazing, True, 20),
        ("punch with sharp edges", "force, balance", 1e-8, sharp, variant == Variant(), 1000),
        ("every other node closed at first", "displacements", 1e-6, checkerboard, None, 1000),
        ("rough surface, load up and down", "force", 1e-6, wavy, variant == Variant(), 1000),
    ):
        short = variant in SHORT if short is None else short
        yield Case(
            "5 chattering", label, what, allowed, lambda run=run: run(variant), short, most=most
        )
