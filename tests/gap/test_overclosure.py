"""Initial penetration and gaps: initial_overclosure, and bodies beyond the search distance."""

import warnings

import numpy as np
import pytest
from hard import overclosure
from hard.bodies import Column, modulus, problem, solve
from hard.cases import Variant
from scenes import WORLD, Pair, largest, raises_everywhere, spread_cells

import qsdolfinx as qs

H = overclosure.H


@pytest.fixture(autouse=True)
def scattered(monkeypatch, request):
    """Both sides of a pair are on all ranks, in small parts; Pair distributes its own meshes."""
    if "tie" in request.node.name:
        yield
        return
    with spread_cells(monkeypatch, "scattered"):
        yield


def test_resolve_is_the_default():
    found = []
    for options in ({}, {"initial_overclosure": "resolve"}):
        scene = Column(Variant(), gap=-0.5 * H, **options)
        scene.push(0.0)
        solve(scene.problem())
        found.append(scene.contact.force("slave"))
    # not bit for bit: with three ranks the order of sums over other ranks varies
    np.testing.assert_allclose(*found, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("formulation", ("quasi-symmetric", "double-pass"))
def test_error(formulation):
    """Every rank refuses the overclosure and names its depth and place."""
    variant = Variant(formulation)

    def make():
        overclosure.overclosed(variant, 0.5, initial_overclosure="error")

    raises_everywhere(WORLD, ValueError, "penetrate each other by 0.1 (0.5 of the smallest", make)
    overclosure.overclosed(variant, 1e-7, initial_overclosure="error")  # rounding level
    overclosure.overclosed(variant, -0.5, initial_overclosure="error")
    assert Column(variant, gap=-0.03).contact.overclosure.depth == pytest.approx(0.03)
    assert Column(variant, gap=0.03).contact.overclosure.depth == 0


def test_uneven_depths_stay_with_their_nodes():
    """With uneven depths each node has its own allowed depth, and pressure only beyond it."""
    found = []
    for treatment in ("ignore", "resolve"):
        scene = Column(Variant(quadrature="nodal"), n=(5, 5))
        scene.upper.move(lambda x, y: np.stack([0 * x, -0.02 * x * (1 - y)], axis=1))
        scene.contact.slave.update()
        contact = qs.Contact(
            scene.contact.slave,
            scene.contact.master,
            quadrature="nodal",
            initial_overclosure=treatment,
        )
        scene.contact = contact
        scene.push(0.0)
        p = scene.problem()
        solve(p)
        found.append((largest(*(u.x.array for u in p.u)), contact.force("slave")[1]))
        deepest = contact.model.overclosure.depth
        assert deepest == pytest.approx(0.02, rel=1e-3)
    assert found[0][0] < 1e-15 and abs(found[0][1]) < 1e-15
    assert found[1][0] > 1e-3 and found[1][1] > 1e-3


def test_part_is_checked():
    contact = Column(Variant(), gap=-0.01).contact
    for part in (-0.1, 1.5, float("nan"), "all"):
        raises_everywhere(
            WORLD, ValueError, "part: must be", lambda p=part: contact.allow_overclosure(p)
        )
    raises_everywhere(
        WORLD,
        ValueError,
        "initial_overclosure: must be one of resolve",
        lambda: Column(Variant(), initial_overclosure="adjust"),
    )


def test_tie_keeps_its_gap():
    for treatment in ("resolve", "ignore"):
        options = {"contact_options": {"initial_overclosure": treatment}}
        pair = Pair("triangle", law=qs.Tied(), gap=-0.05, load=0.0, **options)
        pair.problem().solve()
        assert max(largest(u.x.array) for u in pair.u) < 1e-14


def test_rigid_tool():
    """The same holds for a rigid plane that is too high."""
    for treatment, expected in (("resolve", 0.02), ("ignore", 0.0)):
        scene = Column(Variant())
        tool = qs.RigidSurface.plane(WORLD, [0.0, 0.02], [0.0, 1.0])
        contact = qs.Contact(
            scene.contact.slave,
            tool,
            penalty=100.0,
            initial_overclosure=treatment,
            enforcement="penalty",
        )
        scene.push(0.0)
        solve(problem([scene.upper], [contact]))
        pressure = expected / (1 / modulus() + 1 / 100)
        assert contact.force("slave")[1] == pytest.approx(pressure, abs=1e-12)
        assert contact.model.overclosure.depth == pytest.approx(0.02)


def test_what_is_in_reach_or_not_approached():
    """No warning if bodies are in reach or do not approach each other."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ReachWarning)
        assert overclosure.closed(Variant(), 3.0) < 1e-6
        assert overclosure.stepped(Variant()) < 1e-6
        away = overclosure.overclosed(Variant(), -3.0)
        away.push(0.5)
        solve(away.problem())


def test_traction_after_ignoring():
    """After overclosure is ignored, the traction of a loaded body is the load."""
    scene = Column(Variant(), gap=-0.3 * H, initial_overclosure="ignore")
    scene.press(1e-2)
    solve(scene.problem())
    assert scene.error(1e-2) < 1e-9
