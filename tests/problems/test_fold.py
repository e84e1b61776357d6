"""The fold demo: force, symmetry, balances, friction, and its parameters."""

import functools

import numpy as np
import pytest
from fold import CLOSED, FLAT, Parameters, fold
from fold_bodies import OPEN
from fold_output import energy_error, summary, symmetry_error
from scenes import WORLD

KEYS = (
    "force",
    "force_change",
    "symmetry_error",
    "energy_error",
    "max_penetration",
    "facet_size",
    "snes_iterations",
)


@functools.cache
def folded(**options):
    """Rows of one mesh."""
    return fold(Parameters(cells=3, steps=16, **options), WORLD)


def test_flat():
    """The ends of the legs touch first, at the end about half of the legs; energies balance."""
    rows = folded()
    assert rows[-1].stroke == pytest.approx(OPEN - FLAT)
    touching = [row.touching for row in rows if row.stroke < OPEN - CLOSED]
    assert touching[0] == 0 and 0 < max(touching[:-4]) < 1.6 and rows[-1].touching > 4.8
    assert max(row.penetration for row in rows) < 0.1 * rows[-1].facet_size
    assert energy_error(rows) < 1e-2 and symmetry_error(rows) < 1e-4
    assert max(row.net_force for row in rows) < 1e-7 * rows[-1].force
    assert sum(row.cutbacks for row in rows) == 0


def test_pressed_legs():
    """Further stroke compresses the legs, where they touch, like a flat specimen."""
    a, b = folded()[-3], folded()[-1]
    modulus = 1 / (1 - 0.3**2)  # free along the legs; plane strain
    stiffness = (b.force - a.force) / (b.stroke - a.stroke)
    assert stiffness == pytest.approx(modulus * (a.touching + b.touching) / 2, rel=0.15)


@pytest.mark.long
def test_inside():
    """Additional facets in the surfaces that do not touch make no difference."""
    both = [[row.force for row in folded(touching=name)] for name in ("boundary", "inside")]
    np.testing.assert_allclose(*both, rtol=1e-5, atol=1e-8)


@pytest.mark.long
def test_friction():
    """Legs that are mirror images do not slip on each other."""
    rows = folded(friction=0.2)
    assert abs(rows[-1].dissipated) < 1e-9 * rows[-1].elastic
    assert rows[-1].force == pytest.approx(folded()[-1].force, rel=1e-6)


@pytest.mark.long
def test_friction_of_legs_of_two_lengths():
    """Legs of two lengths slip on each other."""
    rows = folded(friction=0.2, longer=1.0)
    assert rows[-1].dissipated > 1e-5 * rows[-1].elastic and energy_error(rows) < 1e-2


def test_results():
    rows = folded()
    result = summary(rows, rows)
    assert tuple(result) == KEYS and result["force_change"] == 0
    assert result["force"] == rows[-1].force
    assert result["snes_iterations"] == 2 * sum(row.iterations for row in rows)


def test_refused():
    with pytest.raises(ValueError, match="--friction"):
        Parameters(friction=-0.1)
    with pytest.raises(ValueError, match="--steps: must be a multiple of 4"):
        Parameters(steps=10)
    with pytest.raises(ValueError, match="--longer"):
        Parameters(longer=3.0)
