"""Hard cases for Newton's method: stiffness ratios, units, light loads, contact lost and found."""

import numpy as np
import pytest
from hard import chatter, lost_and_found, stiffness
from hard.scenes import VARIANTS, Column, Variant, difference, solve
from scenes import spread_cells

SYMMETRIC = [v for v in VARIANTS if v.balances]
SOME = [Variant(), Variant("quasi-symmetric", "nodal"), Variant(enforcement="augmented-lagrangian")]


@pytest.fixture(autouse=True)
def scattered(monkeypatch):
    """Both sides of a pair are on all ranks, in small pieces."""
    with spread_cells(monkeypatch, "scattered"):
        yield


@pytest.mark.parametrize("ratio", (1e-8, 1e8))
@pytest.mark.parametrize("variant", SOME, ids=str)
def test_stiffness_ratio(variant, ratio):
    """The residual cannot fall below rounding, and Newton's method has to end there."""
    error, iterations = stiffness.column(variant, ratio=ratio)
    assert error < 1e-14 * max(ratio, 1e6)
    assert iterations < 10


def test_rounding_does_not_end_other_solves():
    """What rounding leaves is a small part of what a solve is asked for."""
    scene = stiffness.Punch(Variant(), n=((16, 6), (7, 3)))
    problem = scene.problem()
    solve(problem)
    problem.system.assemble()
    assert problem.system.rounding() < 1e-3 * 1e-9 * problem.residual_history[0]
    assert problem.snes.getTolerances()[1] < 1e-40  # it is put back


@pytest.mark.parametrize("factor", (1e-2, 1e8))
@pytest.mark.parametrize("variant", SOME, ids=str)
def test_penalty_factor(variant, factor):
    assert stiffness.column(variant, penalty=5 * factor)[0] < 1e-7


@pytest.mark.parametrize("name", stiffness.UNITS)
def test_units(name):
    """The same relative answers, in the same number of iterations."""
    for variant in SOME:
        assert stiffness.in_units(variant, name)[0] < 1e-8


def test_nearly_incompressible():
    for variant in SOME:
        assert stiffness.column(variant, nu=0.4999)[0] < 1e-8


@pytest.mark.parametrize("variant", SYMMETRIC, ids=str)
def test_gaps_of_the_size_of_rounding(variant):
    """Nodes that are open by rounding alone bear no force: the tangent must not say they do."""
    error, iterations = chatter.grazing(variant)
    assert error < 1e-8
    assert iterations < 20


def test_just_touching():
    for variant in VARIANTS:
        assert chatter.touching(variant)[0] < 1e-12


@pytest.mark.parametrize("variant", SOME, ids=str)
def test_every_other_node_closed_at_first(variant):
    assert chatter.checkerboard(variant)[0] < 1e-6


def test_sharp_edges_and_rough_surfaces():
    assert chatter.sharp(Variant())[0] < 1e-8
    assert chatter.wavy(Variant())[0] < 1e-6


@pytest.mark.parametrize("variant", SOME, ids=str)
def test_lost_and_found(variant, monkeypatch):
    monkeypatch.setattr(lost_and_found, "CYCLES", 5)
    assert lost_and_found.cycles(variant)[0] < 1e-8
    assert lost_and_found.reversal(variant)[0] < 1e-7
    assert lost_and_found.thrown(variant)[0] < 1e-8
    assert lost_and_found.receding(variant)[0] < 1e-8


def test_refused_solves_leave_the_state():
    """A load that nothing balances; the problem can be used afterwards."""
    scene = Column(Variant())
    load = scene.press(1e-3)
    problem = scene.problem()
    solve(problem)
    before = [u.x.array.copy() for u in problem.u]
    load.value[1] = 1e-3
    with pytest.raises(RuntimeError, match="did not converge"):
        solve(problem)  # which compares the unknowns
    load.value[1] = -1e-3
    solve(problem)
    assert difference(problem.u, before) < 1e-10
    assert np.isclose(scene.contact.force("slave")[1], 1e-3)
