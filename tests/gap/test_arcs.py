"""Arc length of a slip along surfaces that turn, over its projection."""

import numpy as np
import pytest

from qsdolfinx.gap.shape_points import arc_of_turn


def arc(angle):
    """Arc length over the projection after a rotation by this angle (radians)."""
    first, last = np.array([[1.0, 0.0]]), np.array([[np.cos(angle), np.sin(angle)]])
    return arc_of_turn(first, last)[0]


@pytest.mark.parametrize("angle", (0.0, 0.5, 2.0, 2.5))
def test_arcs(angle):
    np.testing.assert_allclose(arc(angle), angle / np.sin(angle) if angle else 1.0, rtol=1e-6)


def test_half_a_turn():
    """The projection vanishes, and the direction of the rotation is not known: it is bounded."""
    assert 3 < arc(np.pi) == arc(3.0) < 10
