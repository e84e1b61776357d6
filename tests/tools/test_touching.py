"""Solids that touch at an edge become surfaces of their own."""

import numpy as np
import pytest

from qsdolfinx.tools.touching import separate


def wedges(*angles):
    """Return tetrahedra around an edge, each between two angles (radians)."""
    x, triangles = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], []
    for k, both in enumerate(angles):
        x += [[(1 + k) * np.cos(a), (1 + k) * np.sin(a), 0.5] for a in both]
        a, b = len(x) - 2, len(x) - 1
        triangles += [[0, a, 1], [1, b, 0], [0, b, a], [a, b, 1]]
    return np.array(x), np.array(triangles)


RIGHT = np.pi / 2


@pytest.mark.parametrize("error", (-1e-6, 0.0, 1e-6))
@pytest.mark.parametrize("angles", (((0.0, RIGHT), (RIGHT, 3.0)), ((0.0, 0.3), (0.4, 0.7))))
def test_walls(angles, error):
    """Walls that coincide up to single precision, and thin solids, are those of two solids."""
    second = angles[1][0] + error, angles[1][1]
    x, triangles = separate(*wedges(angles[0], second))
    assert len(x) == 8 and not set(triangles[:4].ravel()) & set(triangles[4:].ravel())
