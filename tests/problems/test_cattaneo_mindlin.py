"""Partial slip of two cylinders against the closed form, and the demo's own results."""

import dataclasses
import json
import pathlib
import sys
import tempfile

import cattaneo_mindlin as demo
import numpy as np
import pytest
from cattaneo_mindlin import MU, SHEAR, Parameters, build, run, tractions
from hertz_bodies import CattaneoMindlin
from scenes import WORLD, largest

SIDES = ("slave", "master")
NODAL = {"quadrature": "nodal"}
STICK = "stick radius error, facets"


def solve(comm=WORLD, **parameters):
    """Results that the terminal shows, with those of --json."""
    result, more, _ = run(dataclasses.replace(Parameters(), **parameters), comm)
    return result | more


def test_closed_form():
    """The closed form has the published numbers; tractions carry loads and obey Coulomb's law."""
    exact = CattaneoMindlin(MU, SHEAR)
    expected = [0.680778, 9.35135, 0.496511, 0.506229, 1.279571]
    values = [exact.a, exact.p0, exact.c, exact.tangential(0.0), exact.tangential(exact.c)]
    np.testing.assert_allclose(values, expected, rtol=2e-6)
    x = np.linspace(-exact.a, exact.a, 400001)
    p, t = exact.normal(x), exact.tangential(x)
    assert np.isclose(p.sum() * (x[1] - x[0]), 0.625 * 16, rtol=1e-5)
    assert np.isclose(t.sum() * (x[1] - x[0]), 0.05851 * 16, rtol=1e-5)
    slips = np.abs(x) >= exact.c
    np.testing.assert_allclose(t[slips], 0.2 * p[slips], atol=1e-12)
    assert np.all(t[~slips] < 0.2 * p[~slips])


@pytest.mark.parametrize("swap", (False, True))
@pytest.mark.parametrize("ratio", (1.3, 0.6, 2.0))
def test_overlay(ratio, swap):
    """Tractions are right on both sides, with either body as slave; loads arrive without tilt."""
    result = solve(h=0.05, ratio=ratio, swap=swap)
    assert abs(result["peak_error"]) < 0.01
    assert result["l2_error_normal"] < 0.03 * max(1, ratio)
    assert result["l2_error_tangential"] < 0.10 * max(1, ratio)
    assert abs(result[STICK]) < 1
    assert abs(result["centre of the stick zone"]) < 1.01 * result["facet of the slave"]
    for side in SIDES:
        assert abs(result[f"P error, {side}"]) < 1e-6
        assert abs(result[f"Q error, {side}"]) < 1e-6
        assert abs(result[f"moment / (Q R), {side}"]) < 0.005


def test_convergence():
    """Both tractions converge with first order on both sides; the stick zone is within a facet."""
    h = (0.1, 0.05, 0.025)
    results = [solve(h=size) for size in h]
    for side in SIDES:
        for name in ("normal", "tangential"):
            error = [result[f"l2_error_{name}, {side}"] for result in results]
            assert np.polyfit(np.log(h), np.log(error), 1)[0] > 0.75, (side, name, error)
    assert results[-1]["l2_error_tangential"] < 0.04
    assert results[-1]["l2_error_normal"] < 0.015
    assert all(abs(result[STICK]) < 1 for result in results)


def test_finer_master():
    """With nodal quadrature the load of a finer master is uneven.

    Quasi-symmetric contact halves the peaks.
    """
    options = {"h": 0.08, "ratio": 0.5}
    one_sided = solve(**options, **NODAL, formulation="master-slave")
    nodal, overlay = solve(**options, **NODAL), solve(**options)
    for key in ("l2_error_normal, master", "l2_error_tangential, master"):
        assert one_sided[key] > 0.6
        assert 0.4 < nodal[key] / one_sided[key] < 0.6
        assert overlay[key] < 0.4 * nodal[key]


def test_rigid_stick():
    """An augmented Lagrangian is the limit of a large ε, and no better than the default."""
    h = 0.05
    nodes = {"h": h, "constraints": "nodes"}
    elastic, stiff = solve(**nodes), solve(**nodes, penalty=1e4 * 200 / h)
    rigid = solve(**nodes, enforcement="augmented-lagrangian")
    for key in demo.KEYS:
        assert abs(stiff[key] - rigid[key]) < 1e-3
    assert elastic["l2_error_tangential"] < rigid["l2_error_tangential"] < 0.10
    assert abs(rigid[STICK]) < 1


def test_tilting():
    """If bodies may tilt, loads are right, but the moment of Q moves pressure and stick zone.

    The shift of the pressure is Q R / P.
    """
    result = solve(h=0.064, tilting=True)
    for side in SIDES:
        assert abs(result[f"P error, {side}"]) < 1e-6
        assert abs(result[f"Q error, {side}"]) < 1e-6
        assert abs(abs(result[f"moment / (Q R), {side}"]) - 1) < 0.05
        assert result[f"l2_error_tangential, {side}"] > 1
    assert result["centre of the stick zone"] > 0.3


def test_normals():
    """Pressing along the tilted facet normals produces friction where there should be none."""
    shear = {}
    for normals in ("facet", "bisector"):
        options = {"h": 0.08, "normals": normals, "formulation": "master-slave", **NODAL}
        scene = build(WORLD, Parameters(**options))
        scene.problem.solve()
        shear[normals] = largest(tractions(scene, "slave")[1]) / scene.exact.tangential(0.0)
    assert shear["facet"] > 1.5
    assert shear["bisector"] < 0.5 * shear["facet"]


def test_steps():
    """Q in one step gives the same result as in four, as the slip has one direction."""
    one, four = solve(h=0.08), solve(h=0.08, steps=4)
    for key in demo.KEYS:
        assert abs(one[key] - four[key]) < 1e-6


def test_json(monkeypatch):
    """The file has only its documented keys."""
    folder = WORLD.bcast(tempfile.mkdtemp() if WORLD.rank == 0 else None)
    file = pathlib.Path(folder) / "result.json"
    monkeypatch.setattr(sys, "argv", ["demo", "--h", "0.1", "--json", str(file)])
    demo.main()
    WORLD.barrier()
    keys = set(json.loads(file.read_text()))
    assert keys == set(demo.KEYS)
