"""Jump of ties: the gap vector between the surfaces rotates with the facets of the opponent."""

import numpy as np
from audit.distance import Meshed
from fuzz.brute import dot, unit


def jump(side):
    """Return u_s - u_m - (R - 1) d at a side's points; R is the rotation of the opposite facets."""
    out = side.jump
    if not isinstance(side.opponent, Meshed) or side.opponent.rigid:
        return out  # a tool carries with it what is tied to it
    d = side.points - faced(side.opponent, side.rest)
    R = rotations(side.opponent, side.rest)
    return out - (np.einsum("pij,pj->pi", R, d) - d)


def faced(opponent, found, deformed=False):
    """Return the positions of the points opposite to the given points."""
    x = opponent.body.x + (opponent.body.u if deformed else 0.0)
    return np.einsum("pi,pij->pj", found.weights, x[found.nodes])


def rotations(opponent, found):
    """Return the rotations of an opponent's facets at the opposite points, shape (points, 3, 3).

    The normal stays normal; orthonormal directions of the facet rotate by their mean angle.
    """
    body = opponent.body
    rest, now = (tangents(c[found.nodes], found.weights) for c in (body.x, body.x + body.u))
    n, m = (unit(np.cross(*t)) for t in (rest, now))
    first = unit(rest[0])
    second = np.cross(n, first)
    # Images of the two directions; both are combinations of the undeformed tangents.
    made = []
    for direction in (first, second):
        gram = np.array([[dot(a, b) for b in rest] for a in rest]).transpose(2, 0, 1)
        right = np.stack([dot(a, direction) for a in rest], axis=1)
        share = np.linalg.solve(gram, right[..., None])[..., 0]
        made.append(share[:, :1] * now[0] + share[:, 1:] * now[1])
    turned = unit(made[0] - np.cross(m, made[1]))
    before = np.stack([first, second, n], axis=2)
    after = np.stack([turned, np.cross(m, turned), m], axis=2)
    return after @ before.transpose(0, 2, 1)


def tangents(corners, weights):
    """Return two tangents of segments, triangles or quadrilaterals at points by shape functions."""
    if corners.shape[1] == 2:
        z = np.zeros((len(corners), 3))
        z[:, 2] = 1.0
        return corners[:, 1] - corners[:, 0], z
    if corners.shape[1] == 3:
        return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    s, t = (weights[:, i] + weights[:, 3] for i in (1, 2))
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    c = corners[:, 3] - corners[:, 0] - a - b
    return a + t[:, None] * c, b + s[:, None] * c


def second_order(side, before=None):
    """Return the error of small rotations of the gap vector, (R - R_0 - θ × R_0) d (length).

    Args:
        side: The side.
        before: The side with R = R_0; None for no rotation.
    """
    if not isinstance(side.opponent, Meshed) or side.opponent.rigid:
        return 0.0
    R = rotations(side.opponent, side.rest)[side.rest.facing]
    R_0 = np.eye(3) if before is None else rotations(before.opponent, side.rest)[side.rest.facing]
    wide = np.abs(side.rest.distance[side.rest.facing]).max(initial=0.0)
    return wide * np.linalg.norm(R - R_0, axis=(-2, -1)).max(initial=0.0) ** 2


def arm(sides):
    """Return the largest jump of points: the distance between opposite forces (length)."""
    jumps = [np.linalg.norm(jump(s), axis=1).max(initial=0.0) for s in sides]
    return max(jumps)
