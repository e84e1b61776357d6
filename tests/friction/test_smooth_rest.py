"""Friction between two facets as a function of the position: what is kept as points move."""

import numpy as np
import pytest

from qsdolfinx.friction.of_points import OfPoints, SmoothRest


def smooth(x, values):
    """Return the function with these values at positions from 0 to 1 on a line facet."""
    keys = np.zeros((len(x), 2), dtype=np.int64)
    rest = np.column_stack([values, 0 * values])
    old = OfPoints(keys, np.column_stack([1 - x, x]), rest, np.tile([0.0, 1.0], (len(x), 1)))
    made = SmoothRest(old)

    def at(x):
        x = np.atleast_1d(x)
        keys = np.zeros((len(x), 2), dtype=np.int64)
        return made.at(keys, np.column_stack([1 - x, x]))[:, 0]

    return at


MANY = np.linspace(0, 1, 41)


@pytest.mark.parametrize("degree, is_exact", ((0, True), (1, True), (3, True), (4, False)))
def test_polynomials(degree, is_exact):
    """Cubic functions are exact. Higher ones are smoothed: they would oscillate between points."""
    found = smooth(MANY, MANY**degree)(MANY)
    assert (np.abs(found - MANY**degree).max() < 1e-9) == is_exact


def test_far_away():
    """Beyond the old points the function is constant: a cubic one would grow."""
    x = np.linspace(0.4, 0.6, 21)
    at = smooth(x, x - 0.5)
    np.testing.assert_allclose(at([0.6, 0.9, 1.0]), [0.1, 0.12, 0.12], atol=0.01)
    np.testing.assert_allclose(at(1.0), at(0.0) * -1)


def test_points_that_hardly_differ():
    """Their positions determine no slope, and two points no cubic function."""
    x = 0.5 + 1e-3 * np.linspace(-1, 1, 5)
    np.testing.assert_allclose(smooth(x, x - 0.5)([0.49, 0.5, 0.51]), 0.0, atol=1e-12)
    x = 0.5 + 0.03 * np.linspace(-1, 1, 5)
    assert smooth(x, x - 0.5)(0.53) > 0.02


def test_few_points():
    """Errors of the values are not magnified between points that determine less than a cubic."""
    x = np.array([0.1, 0.102, 0.5, 0.9])
    at = smooth(x, np.array([1.0, -1.0, 1.0, 1.0]))
    assert np.abs(at(MANY)).max() < 5
