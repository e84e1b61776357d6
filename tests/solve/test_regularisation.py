"""How soft springs and compliances are, and when they vanish."""

import types

import numpy as np
import pytest

import qsdolfinx as qs
from qsdolfinx.solve.balance import Balance, Iterate
from qsdolfinx.solve.stabilisation import vanishing


def iterate(left, residual=None):
    """Return an iteration with this part of the forces unbalanced."""
    return Iterate(left if residual is None else residual, left, 0.0, 0.0, 1, 1, 1.0)


def balance(parts, is_held=True, stiffness=None, cut_after=0, unheld=1e-3):
    """Return what is known after iterations with these parts of the forces unbalanced."""
    left = min(1.0, parts[-1]) if len(parts) > 1 else 0.0
    return types.SimpleNamespace(
        history=[iterate(part) for part in parts],
        keeps_its_set=False,
        **{
            "_left": left,
            "_stiffness": stiffness,
            "_is_held": is_held,
            "_unheld": unheld,
            "_seen": np.array([1.0, 1.0]),
            "_cut_after": cut_after,
        },
    )


def test_springs_of_unsupported_bodies():
    """They are much softer than the body, and vanish with the residual."""
    first, later = (Balance.shift.fget(balance(parts)) for parts in ((1.0, 1.0), (1.0, 1e-9)))
    assert first[0] < 1e-9 and 1e-6 < first[1] < 1e-2
    assert 1e-13 < later[0] == later[1] < 1e-9  # above rounding: the matrix stays regular
    assert Balance.shift.fget(balance((1.0, 0.5), stiffness=0.1)) == (0.05, 0.05)


def test_points_are_compliant_far_from_a_solution():
    """A little, and less with the residual, but never by less than rounding needs."""
    first, near, last = (
        Balance.proximal.fget(balance(parts)) for parts in ((1.0,), (1.0, 1e-4), (1.0, 1e-12))
    )
    assert 1e-7 < first < 1e-3 and 1e-9 < near < 0.1 * first and 1e-12 < last < 1e-8
    assert last < near


@pytest.mark.parametrize("left, expected", ((0.5, True), (0.1, True), (1e-4, False)))
def test_far_from_a_solution(left, expected):
    """A per cent of the forces decides: the active set is then nearly right."""
    assert Balance.is_far.fget(balance((1.0, left))) == expected


def test_residuals_that_fall_slowly():
    """What some full steps have not halved is no longer far: compliance is in the way."""
    slow, fast = 0.96 ** np.arange(12), 0.8 ** np.arange(9)
    assert Balance.is_far.fget(balance(slow[:4])) and not Balance.is_far.fget(balance(slow))
    assert Balance.is_far.fget(balance(slow, cut_after=10)) and Balance.is_far.fget(balance(fast))


def test_stabilisation_by_default():
    """Its springs are much softer than the body, and stiff enough to hold it."""
    assert vanishing(None) is None and vanishing(qs.Stabilisation(stiffness=0.1)) == 0.1
    assert 1e-5 < vanishing(qs.Stabilisation()) < 0.05
