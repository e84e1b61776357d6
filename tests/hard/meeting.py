"""Case 10: three bodies that meet along a line, surfaces in two contacts, nodes slave twice."""

import numpy as np
from hard.scenes import Body, Check, Column, largest, problem, solve

import qsdolfinx as qs

PRESSURE = 1e-3


def three(variant, swap, cells):
    """Two blocks side by side on a third, under the same pressure from all sides.

    All contacts carry this pressure, exactly on the overlay. The lower block's upper face is in two
    contacts, of which it is the slave with ``swap``. The corner where all three meet belongs to
    nodes that are slaves twice: each contact has a multiplier of its own there, normal to itself.
    """
    left = Body((4, 4), [0.0, 0.0], [1.0, 1.0])
    right = Body((5, 3), [1.0, 0.0], [2.0, 1.0])
    lower = Body((cells, 3), [0.0, -1.0], [2.0, 0.0])
    lower.slide(1, lower.facets(1, -1.0))
    for body in (left, lower):
        body.slide(0, body.facets(0, 0.0))
    for body in (left, right):
        body.load(body.facets(1, 1.0), [0.0, -PRESSURE])
    for body in (right, lower):
        body.load(body.facets(0, 2.0), [-PRESSURE, 0.0])
    floor = lower.surface(1, 0.0)
    pairs = [(left.surface(1, 0.0), floor), (right.surface(1, 0.0), floor)]
    pairs = [pair[::-1] if swap else pair for pair in pairs]
    pairs.append((right.surface(0, 1.0), left.surface(0, 1.0)))
    # A gap of a facet's 1e-8 would be 1e-6 of these small displacements.
    contacts = [qs.Contact(*pair, gap_tolerance=1e-11, **variant.options) for pair in pairs]
    iterations = solve(problem((left, right, lower), contacts))
    side = "master" if swap else "slave"
    forces = [contacts[0].force(side), contacts[1].force(side), contacts[2].force("slave")]
    expected = PRESSURE * np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    error = np.abs(forces - expected).max() / PRESSURE
    if variant.quadrature == "nodal":  # where the patch test fails on meshes that do not match
        return error, iterations
    found = []
    for contact in contacts[:2]:
        blocks = getattr(contact, side).linear.node_values(contact.traction(side))
        found.append(blocks[:, 1] / PRESSURE - 1)
    on_floor = sum(c.traction("slave" if swap else "master").x.array for c in contacts[:2])
    total = contacts[0].traction("slave" if swap else "master")
    total.x.array[:] = on_floor
    found.append(floor.linear.node_values(total)[:, 1] / PRESSURE + 1)
    return max(error, largest(*found)), iterations


def twice(variant):
    """The same two surfaces in two contacts: together they carry the load."""
    scene = Column(variant)
    pair = scene.contact.slave, scene.contact.master
    contacts = [scene.contact, qs.Contact(*pair, **variant.options)]
    scene.press(PRESSURE)
    iterations = solve(problem(scene.bodies, contacts))
    force = sum(contact.force("slave") for contact in contacts)
    return np.abs(force / PRESSURE - [0.0, 1.0]).max(), iterations


def checks(variant):
    case, what = "10 meeting", "tractions, forces"
    what = what if variant.quadrature == "overlay" else "forces"
    for swap in (False, True):
        for cells in (7, 8):
            at = "a node" if cells == 8 else "no node"
            yield Check(
                case,
                f"three bodies, floor {'slave' if swap else 'master'} of two, {at} at the line",
                what,
                1e-6 if variant.augmented else 1e-8,
                lambda s=swap, n=cells: three(variant, s, n),
            )
    yield Check(case, "one pair in two contacts", "force", 1e-8, lambda: twice(variant))
