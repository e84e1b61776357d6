"""Anderson mixing of Newton steps whose derivative is incomplete."""

import numpy as np
import pytest
from scenes import WORLD

from qsdolfinx.solve.mixing import Mixing


def iterations(left_out, mixes, most=200):
    """Iterations until |A z − b| < 1e-10, with a derivative that omits a part of A."""
    rng = np.random.default_rng((3, WORLD.rank))
    n = 20
    diagonal, b, z = rng.uniform(1, 2, n), rng.uniform(-1, 1, n), np.zeros(n)
    mixing = Mixing(WORLD)
    for k in range(most):
        residual = diagonal * z - b
        if np.sqrt(WORLD.allreduce(residual @ residual)) < 1e-10:
            return k
        step = -residual / (diagonal * (1 + left_out))
        mixed = mixing.step(z, residual, step, True) if mixes else None
        z = z + (step if mixed is None else mixed)
    return most


@pytest.mark.parametrize("slow", (0.8, -0.5))
def test_what_is_left_out(slow):
    """Mixing removes as many convergence factors at once as it mixes steps, on all ranks."""
    n = 20
    few = np.zeros(n)
    if WORLD.rank == 0:
        few[:3] = slow / (1 - slow), 0.5 * slow, 0.2 * slow
    assert iterations(few, False) > 25
    assert iterations(few, True) < 15
    assert iterations(np.zeros(n), True) == 1


def test_nothing_alike():
    """After a change of the constraints, earlier steps are not mixed."""
    mixing, z = Mixing(WORLD), np.ones(3)
    assert mixing.step(z, z, -0.2 * z, True) is None
    assert mixing.step(0.8 * z, 0.8 * z, -0.16 * z, False) is None
    np.testing.assert_allclose(mixing.step(0.64 * z, 0.64 * z, -0.128 * z, True), -0.64 * z)


def test_residuals_that_say_nothing():
    """Steps are not mixed if the residual does not change, falls fast, or would stay large."""
    z = np.ones(5)
    same = Mixing(WORLD)
    assert [same.step(z, z, -z, True) for _ in range(6)] == [None] * 6
    fast = Mixing(WORLD)
    assert [fast.step(z, 0.01**k * z, -z, True) for k in range(4)] == [None] * 4
    wild = Mixing(WORLD)  # parts 1/√2 and 1/√3 would remain
    assert [wild.step(z, r, -z, True) for r in np.eye(5)[:3]] == [None] * 3
    half = Mixing(WORLD)  # a part of 0.27 remains
    residuals = np.array([[1.0, 0.2], [0.7, 0.2]])
    assert [half.step(z[:2], r, -z[:2], True) is None for r in residuals] == [True, False]
