"""The benchmark of speed against error: its errors, and that the page shows the results."""

from mpi4py import MPI

import hertz
import numpy as np
import pytest
import speed_vs_error
from scenes import WORLD
from speed_scenes import SIDES, Forging, Kind

OVERLAY = Kind("quasi-symmetric", "overlay", "penalty")
KINDS = [
    OVERLAY,
    OVERLAY._replace(quadrature="nodal"),
    OVERLAY._replace(enforcement="augmented-lagrangian"),
    OVERLAY._replace(formulation="master-slave"),
]


def test_errors():
    """Errors are those of the demo on one rank.

    With the overlay they are smaller and decrease faster.
    """
    result = speed_vs_error.measure("hertz2d", [0, 1], 1, KINDS)
    assert [speed_vs_error.kind_of(row) for row in result["rows"]] == KINDS
    for level, row in ((level, row) for row in result["rows"] for level in (0, 1)):
        assert row["seconds"][level] > 0 and 0 < row["contact"][level] <= 1
        choice = speed_vs_error.kind_of(row)._asdict()
        p = hertz.Parameters(h=0.1 / 2**level, ratio=1.5, **choice)
        expected, _ = hertz.run(p, MPI.COMM_SELF)
        for side in SIDES:
            assert np.isclose(row[side][level], expected[f"l2_error_{side}"], rtol=1e-6)
        assert result["unknowns"][level] == expected["dofs"]
    overlay, nodal, augmented, _ = (speed_vs_error.worst(row, "traction") for row in result["rows"])
    for coarse, fine in (overlay, augmented):
        assert coarse < nodal[0] and fine < 0.6 * coarse
    assert nodal[1] > 0.5 * nodal[0]


def test_scene_starts_anew():
    """Forging moves its meshes, but a second run on the same bodies has the same errors."""
    shared = Forging.prepare(WORLD, [-2])
    scene = Forging(WORLD, -2, shared)
    first, again = (speed_vs_error.run_once(scene, OVERLAY) for _ in range(2))
    for side in SIDES:
        assert np.isclose(first[side], again[side], rtol=1e-6)
        assert first[side] < 0.05
    # The dies are nearly rigid, so the reference is the closed form.
    assert abs(shared.numbers["mean pressure over that between rigid dies"] - 1) < 0.01


def test_page():
    """The page has the tables of the stored results."""
    results = speed_vs_error.load(speed_vs_error.RESULTS)
    assert [r["case"] for r in results] == list(speed_vs_error.CASES)
    page = (speed_vs_error.DOCS / "speed-vs-error.md").read_text(encoding="utf-8")
    assert speed_vs_error.rewritten(page, results) == page


def test_figure(tmp_path):
    """A failed solve leaves a gap in the line, and the table says so."""
    pytest.importorskip("matplotlib")
    if WORLD.rank == 0:
        result = speed_vs_error.load(speed_vs_error.RESULTS)[0]
        for side in SIDES:
            result["rows"][0][side][1] = None
        speed_vs_error.plot(result, tmp_path / "speed.png")
        assert (tmp_path / "speed.png").stat().st_size > 10000
        assert "| no solution; " in speed_vs_error.case_table(result)
    WORLD.barrier()
