"""Gaps between the curved surfaces that facets approximate."""

import numpy as np
import pytest
from curved_scenes import Shell, ShrinkFit, exact_pressure
from hertz import Parameters, build
from hertz_bodies import R
from scenes import WORLD, Pair, largest, raises_everywhere

import qsdolfinx as qs

SMOOTH = {"smoothing": "shared-curvature"}
RINGS = (16, 5), (22, 7)
SHELLS = (12, 3, 4), (17, 4, 5)


@pytest.mark.parametrize("swap", (False, True))
@pytest.mark.parametrize(
    ("n", "cell", "uneven", "within"),
    [
        (RINGS, "quadrilateral", 0.0, 0.01),
        (RINGS[::-1], "triangle", 0.3, 0.03),
        (SHELLS, "hexahedron", 0.0, 0.03),
        (SHELLS, "tetrahedron", 0.0, 0.15),
    ],
)
def test_gap_of_concentric_surfaces(n, cell, uneven, within, swap):
    """The gap is the misfit at every point; chord gaps are wrong by more than half of it."""
    chords = ShrinkFit(n, swap, cell=cell, uneven=uneven).contact.pairing.gap
    smooth = ShrinkFit(n, swap, cell=cell, uneven=uneven, **SMOOTH).contact.pairing.gap
    assert largest(chords / 0.01 + 1) > 0.5
    assert largest(smooth / 0.01 + 1) < within


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric", "double-pass"))
@pytest.mark.parametrize("n", (RINGS, RINGS[::-1]), ids=("coarse inside", "coarse outside"))
def test_shrink_fit(n, formulation):
    """Lamé's pressure within 1 % in each formulation; without smoothing it is wrong by a third."""
    exact = exact_pressure()
    penalty = 1e3 * exact / 0.01 if formulation == "double-pass" else "auto"
    enforcement = "penalty" if formulation == "double-pass" else "augmented-lagrangian"
    options = {"formulation": formulation, "enforcement": enforcement, "penalty": penalty}
    for swap in (False, True):
        scene = ShrinkFit(n, swap, **options, **SMOOTH)
        scene.problem().solve()
        for side in ("slave", "master"):
            mean, scatter = scene.pressure(side)
            assert abs(mean / exact - 1) < 0.01 and scatter / exact < 0.015
    if formulation == "quasi-symmetric":
        scene = ShrinkFit(n, **options)
        scene.problem().solve()
        mean, scatter = scene.pressure("slave")
        assert abs(mean / exact - 1) > 0.3 and scatter / exact > 0.2


@pytest.mark.parametrize(
    ("n", "misfit", "is_smooth"),
    ((RINGS, 0.01, True), (((64, 4), (90, 4)), 0.01, True), (((64, 4), (90, 4)), 0.2, False)),
)
def test_by_itself(n, misfit, is_smooth):
    """With the default ``smoothing`` surfaces are smoothed where chord errors matter."""
    ways = "auto", "shared-curvature", "none"
    given = (ShrinkFit(n, misfit=misfit, smoothing=way).contact for way in ways)
    gaps = [contact.pairing.gap for contact in given]
    np.testing.assert_array_equal(gaps[0], gaps[1 if is_smooth else 2])
    assert ShrinkFit(n, misfit=misfit, smoothing="auto").contact.smoothing == (
        "shared-curvature" if is_smooth else "none"
    )


def test_hertz_is_as_before():
    """Hertz contact does not change: equal cylinders share no curvature, a block shares half."""
    for case, change in (("cylinders", 0.05), ("block", 0.5)):
        _, slave, master, contact, _ = build(WORLD, Parameters(case=case, h=0.05, ratio=1.3))
        h = contact.settings.search_radius
        options = {"quadrature": "overlay", "search_radius": h}
        smooth = qs.Contact(slave.surface, master.surface, **options, **SMOOTH)
        plain = qs.Contact(slave.surface, master.surface, **options)
        near = np.abs(plain.pairing.slave.x[:, 0]) < 0.8
        sagitta = (1.3 * 0.05) ** 2 / 8 / R
        difference = (smooth.pairing.gap - plain.pairing.gap)[near]
        assert largest(difference) < change * sagitta
        assert case == "cylinders" or largest(difference) > 0.1 * sagitta


def test_flat_and_tied_contact_are_as_before():
    for law in (qs.Unilateral(), qs.Tied()):
        found = []
        for options in ({}, SMOOTH):
            pair = Pair("triangle", law=law, contact_options={"quadrature": "overlay"} | options)
            pair.problem().solve()
            found.append([u.x.array.copy() for u in pair.u])
        np.testing.assert_allclose(*map(np.concatenate, found), atol=1e-12)


def test_rigid_facets():
    """The gap of a ring on a rigid core of segments is the misfit, too."""
    p = np.linspace(-0.1, np.pi / 2 + 0.1, 30)
    x = 10.005 * np.column_stack([np.cos(p), np.sin(p)])
    segments = np.column_stack([np.arange(29), np.arange(1, 30)])
    core = qs.RigidSurface.triangulated(WORLD, x, segments)
    outer = Shell((22, 7), (9.995, 15.0))
    slave = outer.surface(outer.inner)
    gap = qs.Contact(slave, core, quadrature="overlay", **SMOOTH).pairing.gap
    assert WORLD.allreduce(len(gap)) > 20 and largest(gap / 0.01 + 1) < 0.02


def test_refused():
    def contact(**options):
        return lambda: Pair("triangle", contact_options=options)

    raises_everywhere(
        WORLD, ValueError, 'use quadrature="overlay"', contact(**SMOOTH | {"quadrature": "nodal"})
    )
    raises_everywhere(
        WORLD, ValueError, "smoothing: must be one of none", contact(smoothing="nagata")
    )
