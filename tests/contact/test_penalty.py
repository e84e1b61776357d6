"""How stiff the automatic penalties are, compared with the bodies."""

import types

import numpy as np
import pytest

from qsdolfinx.contact.model import ContactModel, radius_of
from qsdolfinx.contact.penalty import Penalty, points_factor
from qsdolfinx.gap.laws import Unilateral
from qsdolfinx.system.normal_rows import Scales

K, E = 7.0, 3.5  # stiffness of a side, stress per length; its modulus: facets of half a length


def penalty(quadrature, augmented=False, at_points=0.0, together=False, stiffer=(1.0, 4.0)):
    """Return an automatic penalty of two sides with the same facets, of which one is stiffer."""
    made = Penalty("auto", quadrature, augmented, False, at_points)
    made.follow(tuple(K * s for s in stiffer), tuple(E * s for s in stiffer), together)
    return made


@pytest.mark.parametrize("stiffer", ((1.0, 4.0), (4.0, 1.0)))
def test_ratios(stiffer):
    """The layer of cells at the softer surface deforms as gaps do, or more."""
    nodal, overlay = (penalty(name, stiffer=stiffer).ratio for name in ("nodal", "overlay"))
    assert 30 < nodal < 300  # gaps of a per cent of the layer's deformation
    assert 2 < overlay < 15  # stiffer penalties oscillate
    assert 4 < penalty("overlay", True, stiffer=stiffer).ratio < 30
    assert 1.2 < penalty("overlay", True, together=True, stiffer=stiffer).ratio < 9


def test_points():
    """Multipliers at points are softer, and softer still where bodies slide."""
    of_points, follows = points_factor("points", False), points_factor("points", True)
    made = penalty("overlay", at_points=of_points)
    assert 1.5 < made.ratio < 12 and np.isclose(made.of_points, made.value)
    assert 0.6 < made.of_slips / K < 4
    made = penalty("overlay", True, follows)
    assert 0.1 < made.ratio < 0.9  # 1 makes bodies lose contact
    made.let_follow()
    assert made.of_points is None and points_factor("nodes", True) == 0.0


def scales(ratio, augmented):
    """Scaling factors of one constraint with this penalty over the stiffness of the bodies."""
    of = types.SimpleNamespace(stiffness=(K, 2 * K))
    model = types.SimpleNamespace(augmented=augmented, stiffness_ratio=ratio, penalty=of)
    return Scales.of(model, np.array([ratio * K]))


def test_factors_of_constraints():
    """They are those of bodies and not of penalties that are much stiffer, or softer."""
    assert scales(20.0, True).usual == scales(20.0, False).usual == 1.0
    assert 30 < 1e6 * scales(1e6, True).usual < 300
    assert 2 < 0.01 * scales(0.01, True).usual < 15 and scales(0.01, False).usual == 1.0
    assert 1e-11 < 2 * K * scales(1.0, True).proximal[0] < 1e-9 and not scales(1.0, False).proximal


@pytest.mark.parametrize("ratio, expected", ((1.01, True), (1.0001, False), (0.5, False)))
def test_penalties_that_are_as_soft_as_multipliers(ratio, expected):
    """They need no multipliers: these would carry differences of nearly equal compliances."""
    settings = types.SimpleNamespace(constraints="points", formulation="master-slave")
    of = types.SimpleNamespace(of_points=K, eps=ratio * K)
    model = types.SimpleNamespace(
        settings=settings, augmented=False, penalty=of, follows=False, law=Unilateral()
    )
    assert ContactModel.has_multipliers_at_points.fget(model) == expected


def test_search_distance():
    """With finite sliding it is some facets: Newton's iterates must not lose their partners."""
    master = types.SimpleNamespace(is_analytic=True)
    for sliding, least, most in (("small", 1.0, 1.0), ("finite", 2.0, 10.0)):
        of = {"search_radius": "auto", "largest_facet": 0.5, "sliding": sliding, "master": master}
        assert least <= radius_of(types.SimpleNamespace(**of)).largest / 0.5 <= most
