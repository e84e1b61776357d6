"""The benchmark of linear solvers: its measurements, and that the page shows them."""

import numpy as np
import pytest
import solvers

from qsdolfinx.linear import presets


def test_page_is_up_to_date():
    text = solvers.PAGE.read_text(encoding="utf-8")
    assert solvers.rewritten(text) == text


@pytest.mark.parametrize(
    "scene",
    (
        "linear",
        pytest.param("Newtonian", marks=pytest.mark.long),
        pytest.param("Norton-Hoff", marks=pytest.mark.long),
    ),
)
def test_row(scene, monkeypatch):
    """A row has a time for each solver, the choice of "auto", and its time over the best."""
    monkeypatch.setitem(presets.LARGE, 3, 10)
    (row,) = solvers.rows_of(solvers.Case(scene, 3, 1, 0.0), 40.0, [3])
    named = solvers.SOLVERS[scene]
    assert row["picked"] == ("amg" if scene == "linear" else "direct")
    assert all(row[name] > 0 for name in (*named, "auto"))
    assert np.isclose(row["ratio"], row["auto"] / min(row[name] for name in named))


def test_slow_solvers_are_left_out():
    """A solver is omitted after a size that took too long.

    Without any solver left, later sizes are omitted, too.
    """
    case = solvers.Case("linear", 2, 1, 0.0)
    rows = list(solvers.rows_of(case, 0.0, [2, 3, 4]))
    assert [row["cells"] for row in rows] == [2]
    assert len(list(solvers.rows_of(case, 1e9, [2, 3]))) == 2
