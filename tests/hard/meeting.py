"""Case 10: three bodies that meet along a line, surfaces in two contacts, nodes slave twice."""

import numpy as np
from hard.bodies import Column, problem, rectangle, solve
from hard.cases import SHORT, Case
from scenes import largest

import ufl

import qsdolfinx as qs

NAME, PRESSURE = "10 meeting", 1e-3


def three(variant, swap, cells):
    """Two blocks side by side on a third, under the same pressure from all sides.

    All contacts carry this pressure, exactly on the overlay. The upper face of the lower block is
    in two contacts; with ``swap`` it is the slave of both. The nodes at the corner where all three
    meet are then slave nodes twice: each contact has its own multiplier there, along its own
    normal.
    """
    left = rectangle((4, 4), [0.0, 0.0], [1.0, 1.0])
    right = rectangle((5, 3), [1.0, 0.0], [2.0, 1.0])
    lower = rectangle((cells, 3), [0.0, -1.0], [2.0, 0.0])
    lower.hold(lower.facets(1, -1.0), axis=1)
    for body in (left, lower):
        body.hold(body.facets(0, 0.0), axis=0)
    sides = {
        left: left.facets(1, 1.0),
        right: np.concatenate([right.facets(1, 1.0), right.facets(0, 2.0)]),
        lower: lower.facets(0, 2.0),
    }
    for body, facets in sides.items():
        body.load(facets, -PRESSURE * ufl.FacetNormal(body.mesh))
    floor = lower.surface(1, 0.0)
    pairs = [(left.surface(1, 0.0), floor), (right.surface(1, 0.0), floor)]
    pairs = [pair[::-1] if swap else pair for pair in pairs]
    pairs.append((right.surface(0, 1.0), left.surface(0, 1.0)))
    # A gap of 1e-8 of a facet would be 1e-6 of these small displacements.
    contacts = [qs.Contact(*pair, gap_tolerance=1e-11, **variant.options) for pair in pairs]
    solve(problem((left, right, lower), contacts))
    of_blocks, of_floor = ("master", "slave") if swap else ("slave", "master")
    sides = of_blocks, of_blocks, "slave"
    forces = [contact.force(side) for contact, side in zip(contacts, sides, strict=True)]
    expected = PRESSURE * np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    error = np.abs(forces - expected).max() / PRESSURE
    if variant.quadrature == "nodal":  # where the patch test fails on meshes that do not match
        return error
    found = []
    for contact in contacts[:2]:
        blocks = getattr(contact, of_blocks).node_values(contact.traction(of_blocks))
        found.append(blocks[:, 1] / PRESSURE - 1)
    total, other = (c.traction(of_floor) for c in contacts[:2])
    total.x.array[:] += other.x.array
    found.append(floor.node_values(total)[:, 1] / PRESSURE + 1)
    return max(error, largest(*found))


def twice(variant):
    """The same two surfaces in two contacts carry the load together."""
    scene = Column(variant)
    pair = scene.contact.slave, scene.contact.master
    contacts = [scene.contact, qs.Contact(*pair, **variant.options)]
    scene.press(PRESSURE)
    solve(problem(scene.bodies, contacts))
    force = sum(contact.force("slave") for contact in contacts)
    return np.abs(force / PRESSURE - [0.0, 1.0]).max()


def cases(variant):
    what = "tractions, forces" if variant.quadrature == "overlay" else "forces"
    for swap in (False, True):
        for cells in (7, 8):
            at = "a node" if cells == 8 else "no node"
            yield Case(
                NAME,
                f"three bodies, floor {'slave' if swap else 'master'} of two, {at} at the line",
                what,
                1e-6 if variant.augmented else 1e-8,
                lambda s=swap, n=cells: three(variant, s, n),
                short=True,
            )
    short = variant in SHORT
    yield Case(NAME, "one pair in two contacts", "force", 1e-8, lambda: twice(variant), short)
