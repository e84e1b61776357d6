"""The job "cubes": two unit cubes of hexahedra, one pressed on the other.

The lower cube is [0, 1]³, the upper [0, 1]² × [1, 2]; their meshes do not match. The bottom face is
clamped, and so is the top face, at u_z = PRESS. Contact is unilateral, without friction.
"""

import numpy as np
from blocks import block

E = 3e4, 1.3e4  # of the lower and the upper cube
NU = 0.3
PRESS = -0.02


def cube(n, bottom):
    """Make the unit cube that stands at the height `bottom`."""
    s = np.linspace(0, 1, n + 1)
    return block(s, s + bottom)


def bodies(sizes):
    """Make both cubes, the lower one first."""
    return [cube(n, float(i)) for i, n in enumerate(sizes)]


def cell_size(n):
    """Return the cell size at the contact for n cells along an edge."""
    return 1 / n
