"""Hard cases of several bodies: stacks, edges, three that meet; balance and energy."""

import pytest
from hard import edges, energy, free_bodies, meeting
from hard.scenes import VARIANTS, Variant
from scenes import spread_cells

import qsdolfinx as qs

SYMMETRIC = [v for v in VARIANTS if v.balances]
SOME = [Variant(), Variant("quasi-symmetric", "nodal"), Variant(enforcement="augmented-lagrangian")]


@pytest.fixture(autouse=True)
def scattered(monkeypatch):
    """Both sides of a pair are on all ranks, in small pieces."""
    with spread_cells(monkeypatch, "scattered"):
        yield


@pytest.mark.parametrize("gap", (0.0, 0.1))
@pytest.mark.parametrize("variant", SOME, ids=str)
def test_stack(variant, gap):
    """Forces and moments on bodies that only contact holds are in equilibrium."""
    assert free_bodies.pushed(variant, gap)[0] < 1e-7
    assert free_bodies.pressed(variant, gap, -0.75, 0.75)[0] < 1e-7
    assert free_bodies.pressed(variant, gap, 0.15, 0.75)[0] < 1e-7


@pytest.mark.parametrize("kind", ("sideways", "upwards", "toppling"))
def test_what_nothing_balances(kind):
    with pytest.raises(qs.ConvergenceError):
        free_bodies.unbalanced(Variant(), kind)


@pytest.mark.parametrize("swap", (False, True))
@pytest.mark.parametrize("variant", SYMMETRIC, ids=str)
def test_overhang(variant, swap):
    """Force and moment balance where one body ends on the other."""
    for gap in (0.0, 0.1):
        assert edges.overhang(variant, swap, gap)[0] < 1e-10


def test_off_the_edge():
    """Moments too; with bisectors but for the penetration times the sine between normals."""
    for quadrature in ("overlay", "nodal"):
        variant = Variant(quadrature=quadrature)
        assert edges.rolling(variant, normals="facet")[0] < (
            1e-10 if quadrature == "overlay" else 3e-3
        )
        assert edges.corner(variant, normals="facet")[0] < 1e-10
    assert edges.rolling(Variant())[0] < 5e-3
    assert edges.corner(Variant())[0] < 5e-2


@pytest.mark.parametrize("swap", (False, True))
@pytest.mark.parametrize("variant", SYMMETRIC, ids=str)
def test_three_bodies(variant, swap):
    """A surface in two contacts, and nodes that are slaves twice, under uniform pressure."""
    for cells in (7, 8):
        assert meeting.three(variant, swap, cells)[0] < 1e-6


def test_multipliers_of_one_side_alone():
    """In two-half-pass contact they can close all gaps: forces differ, and a warning says so."""
    with pytest.warns(qs.BalanceWarning, match="the forces on slave and master differ"):
        free_bodies.pushed(Variant("two-half-pass", "nodal", "augmented-lagrangian"), 0.1)


def test_two_contacts_of_one_pair():
    for variant in SOME:
        assert meeting.twice(variant)[0] < 1e-8


def test_work_comes_back():
    for variant in SOME:
        assert energy.returned(variant)[0] < 1e-8
    assert energy.stored(Variant())[0] < 1e-2
