"""Detection of steps whose deviation from the prediction alternates in sign."""

import numpy as np
import orders
import pytest
from scenes import WORLD, box, vector_space

from dolfinx import fem

from qsdolfinx.steps import swinging
from qsdolfinx.steps.mesh_motion import MeshMotion


def test_no_force_swings_up():
    """A dome slides under a block without friction; oscillations grew to 0.3 % in these steps."""
    (sideways, down), _ = orders.Run(orders.SCENES["two elastic"], 64).result
    assert abs(sideways) < 5e-4 * abs(down)


@pytest.mark.parametrize(
    "now, before, expected",
    [
        ((0.1, 0.2), (-0.1, -0.3), True),
        ((0.1, 0.2), (0.1, 0.3), False),  # still accelerating
        ((0.1, 0.2), (0.2, -0.1), False),  # another direction, not the opposite
        ((1e-5, 2e-5), (-0.1, -0.3), False),  # next to zero
        ((0.1, 0.2), (-1e-15, -3e-15), False),  # rounding
        ((0.0, 0.0), (0.0, 0.0), False),
    ],
)
def test_what_swings(now, before, expected):
    """The result is the same on all ranks, also on ranks that own little of the mesh."""
    V = vector_space(box(WORLD, (2, 1), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "scattered"))
    motion = MeshMotion(fem.Function(V))
    n = len(motion.u.x.array) // 2
    arrays = [np.tile(x, n) for x in (now, before, (1.0, 0.0))]
    assert swinging.swings([motion], *[[a] for a in arrays]) is expected
