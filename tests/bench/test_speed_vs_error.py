"""The benchmark of speed against error: its errors, its fronts, and that the document has them."""

import json

from mpi4py import MPI

import hertz
import numpy as np
import pytest
from machine import circumstances
from scenes import WORLD
from speed_cases import Kind
from speed_forging import Forging
from speed_front import curves as curves_of
from speed_front import factors, faults, front, points, standings
from speed_vs_error import hopeless, measure, run_once

NODAL, OVERLAY, AUGMENTED, TWO = (
    Kind("quasi-symmetric", "nodal", "penalty"),
    Kind("quasi-symmetric", "overlay", "penalty"),
    Kind("quasi-symmetric", "overlay", "augmented-lagrangian"),
    Kind("two-half-pass", "overlay", "augmented-lagrangian"),
)


def made_up(**lines):
    """A result with (seconds, error) of NODAL, … on each level; None: no solution."""
    rows = []
    for name, values in lines.items():
        for level, value in enumerate(values):
            row = {"level": level, "h": 0.5**level, "dofs": 10, **globals()[name]._asdict()}
            row |= {"status": "no solution", "cpu_seconds": 9.0, "errors": {}}
            if value:
                seconds, error = value
                errors = {"slave": error / 2, "master": error}
                row |= {"status": "ok", "cpu_seconds": seconds, "errors": errors}
            rows.append(row)
    measures = {"traction": ["slave", "master"]}
    levels = list(range(len(values)))
    return {"case": "made up", "title": "A", "measures": measures, "levels": levels, "rows": rows}


def test_factors():
    """Errors 1/t and 2/t: twice the time and twice the error, also between the levels."""
    result = made_up(
        NODAL=[(1, 1), (4, 0.25), (16, 1 / 16)],
        OVERLAY=[(1.5, 2 / 1.5), (6, 1 / 3), (20, 0.1)],
        AUGMENTED=[(1, 2e-9), None, (3, 1e-9)],
    )
    everything = points(result, "traction")
    two = [p for p in everything if p.kind != AUGMENTED]
    assert [p.kind for p in front(two)] == [NODAL] * 3
    lines = curves_of(two)
    # No kind has an error as large as the first one in less than 1 s, where the first line begins.
    time, error = zip(*(factors(lines, p) for p in two if p.kind == OVERLAY), strict=True)
    np.testing.assert_allclose(time, (1.5, 2, 2))
    np.testing.assert_allclose(error, (2, 2, 1.6))  # the first line ends at 16 s
    found = standings(result, "traction", (NODAL, OVERLAY))
    assert found[NODAL].distance == 1 and found[NODAL].on_front == 3
    assert np.isclose(found[OVERLAY].distance, 2) and found[OVERLAY].on_front == 0
    # What is exact takes all: the first level counts, the third is no better than that.
    exact = standings(result, "traction")
    assert exact[AUGMENTED].distance == 1 and exact[AUGMENTED].missing == 1
    assert np.isclose(exact[NODAL].time_factor, 16)


def test_faults_and_giving_up():
    result = made_up(NODAL=[(1, 0.9), (2, 0.8)], OVERLAY=[(1, 0.4), (30, 0.2)], TWO=[None, None])
    said = faults([result])
    assert said == {
        NODAL: ["A: traction wrong by 80 %"],
        OVERLAY: [],
        TWO: ["A: no solution on 2 of 2 levels"],
    }
    assert np.isinf(standings(result, "traction")[TWO].distance)
    result["rows"][3]["cpu_seconds"] = 41.0  # over 2 s
    for row in result["rows"]:
        row.setdefault("reason", "")
    assert hopeless([row for row in result["rows"] if row["level"] == 0], 0) == {}
    assert set(hopeless(result["rows"], 1)) == {OVERLAY, TWO}


@pytest.fixture(scope="module")
def result():
    kinds = (NODAL, OVERLAY, AUGMENTED, Kind("master-slave", "overlay", "penalty"))
    rows, reference = measure("hertz2d", [0, 1], 1, kinds)
    return (
        made_up(NODAL=[None])
        | circumstances(1)
        | {
            "title": "Hertz 2D",
            "case": "hertz2d",
            "text": "a cylinder",
            "levels": [0, 1],
            "rows": rows,
            "reference": reference,
            "measured_in_seconds": 1.0,
        }
    )


def test_rows(result):
    """Errors are those of the demo on one rank; the overlay's are smaller and fall faster."""
    errors = {}
    for row in result["rows"]:
        assert row["status"] == "ok" and row["cpu_seconds"] > 0
        assert 0 < row["contact_share"] <= 1
        names = "formulation", "quadrature", "enforcement"
        p = hertz.Parameters(h=0.1 / 2 ** row["level"], ratio=1.5, **{n: row[n] for n in names})
        expected, _ = hertz.run(p, MPI.COMM_SELF)
        for side in ("slave", "master"):
            assert np.isclose(row["errors"][side], expected[f"l2_error_{side}"], rtol=1e-6)
        assert row["dofs"] == expected["dofs"]
        errors[row["quadrature"], row["enforcement"], row["level"]] = max(row["errors"].values())
    for enforcement in ("penalty", "augmented-lagrangian"):
        coarse, fine = (errors["overlay", enforcement, level] for level in (0, 1))
        assert coarse < errors["nodal", "penalty", 0] and fine < 0.5 * coarse
    assert errors["nodal", "penalty", 1] > 0.5 * errors["nodal", "penalty", 0]


def test_scene_starts_anew():
    """Forging moves its meshes: the next run on the same bodies has the same errors."""
    shared = Forging.prepare(WORLD, [-2])
    scene = Forging(WORLD, -2, shared)
    first, again = (run_once(scene, OVERLAY) for _ in range(2))
    assert first["status"] == "ok"
    for side in ("slave", "master"):
        assert np.isclose(first["errors"][side], again["errors"][side], rtol=1e-6)
        assert first["errors"][side] < 0.05
    # The dies are nearly rigid: the reference is the closed form.
    assert abs(shared.numbers["its mean pressure over that between rigid dies"] - 1) < 0.01


def test_report(result, tmp_path):
    """What was measured is in the document, and each figure is there."""
    pytest.importorskip("matplotlib")
    from speed_report import load, report
    from speed_tables import number, seconds

    if WORLD.rank == 0:
        file = tmp_path / "speed_vs_error_hertz2d.json"
        file.write_text(json.dumps(result), encoding="utf-8")
        results = load(tmp_path)
        report(results, tmp_path / "docs" / "speed.md", tmp_path / "docs" / "figures")
        text = (tmp_path / "docs" / "speed.md").read_text(encoding="utf-8")
        assert (tmp_path / "docs" / "figures" / "speed_hertz2d.png").stat().st_size > 10000
        assert "](figures/speed_hertz2d.png)" in text
        for row in result["rows"]:
            errors = f"{number(row['errors']['slave'])} / {number(row['errors']['master'])}"
            assert f"{errors}, {seconds(row['cpu_seconds'])} s" in text
        at = standings(result, "traction")[AUGMENTED]
        assert f"quasi-symmetric overlay AL: {'yes' if at.distance <= 1.1 else 'no'}" in text
    WORLD.barrier()
