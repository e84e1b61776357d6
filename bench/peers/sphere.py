"""The job "hertz": a sphere on a block, a quarter of both, against Hertz's solution.

The lower body is a block, the upper one a block whose lower side is the paraboloid r² / 2R, by
which Hertz's theory replaces the sphere; x = 0 and y = 0 are symmetry planes. The bottom is
clamped, and so is the top, at u_z = PRESS, which gives a contact of radius a = 1, nearly. Contact
is unilateral, without friction. Meshes do not match; cells grow away from the contact.
"""

import numpy as np
from blocks import block

E = 3e4, 1.3e4  # of the lower and the upper body
NU = 0.3
E_STAR = 1 / sum((1 - NU**2) / modulus for modulus in E)
R = 100.0
SIDE = 8.0  # of each body, in all directions
PRESS = -0.0093
#: Cells have the same size up to these lengths, across and upwards, with these fractions of their
#: number.
EVEN = ((1.2, 0.5), (0.48, 0.2))


def grade(n, even):
    """Return coordinates from 0 to SIDE: steps are even at first, then grow smoothly.

    Args:
        n: Number of steps.
        even: Length with even steps, and the fraction of the steps in it.
    """
    length, share = even
    rest, slope = 1 - share, length / share

    def reach(rate):
        return length + slope * np.expm1(rate * rest) / rate

    low, high = 1e-6, 50.0
    while high - low > 1e-13 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if reach(middle) < SIDE else (low, middle)
    s = np.linspace(0, 1, n + 1)
    out = np.where(s <= share, slope * s, length + slope * np.expm1(low * (s - share)) / low)
    out[-1] = SIDE
    return out


def bodies(sizes):
    """Make the block below z = 0, and the upper body."""
    lower, upper = (
        block(grade(n, EVEN[0]), sign * grade(n, EVEN[1])[::sign], symmetric=True)
        for n, sign in zip(sizes, (-1, 1), strict=True)
    )
    x, y, z = upper.x.T
    upper.x[:, 2] = z + (1 - z / SIDE) * (x**2 + y**2) / (2 * R)
    return [lower, upper]


def cell_size(n):
    """Return the cell size at the contact for n cells along an edge."""
    return EVEN[0][0] / EVEN[0][1] / n
