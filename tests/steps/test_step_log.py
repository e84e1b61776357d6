"""The log of attempts has a row for each, with result and reason; a restart keeps it."""

import csv
import logging

import numpy as np
import pytest
from scenes import WORLD
from step_scenes import Upset, refuse

import qsdolfinx as qs

DT = 0.05


def run(caplog):
    """Run two steps; the second step succeeds at the second attempt."""
    caplog.set_level(logging.INFO, logger="qsdolfinx")
    case = Upset(growth=1.0)
    calls = []

    def solve(step):
        case.problem.solve()
        calls.append(step)
        if calls.count(1) == 1 and step == 1:
            refuse(1.0, 2.0)

    stepper = qs.TimeStepper(case.problem, DT, case.move, solve=solve, growth=1.0)
    for _ in range(2):
        stepper.step()
    return stepper


def test_rows(caplog, tmp_path_factory):
    stepper = run(caplog)
    rows = stepper.log.rows
    assert [(row.step, row.attempt, row.result) for row in rows] == [
        (1, 1, "accepted"),
        (2, 1, "cut back"),
        (2, 2, "accepted"),
    ]
    np.testing.assert_allclose([row.t for row in rows], [DT, 2 * DT, 1.5 * DT])
    np.testing.assert_allclose([row.dt for row in rows], [DT, DT, DT / 2])
    assert sum(row.iterations for row in rows) == stepper.total_iterations
    assert rows[1].reason.startswith("DIVERGED_MAX_IT") and rows[0].reason == ""
    closed = [c.report().active for c in stepper.problem.contacts]
    assert list(rows[-1].closed) == closed and min(closed) > 0
    assert len(set(WORLD.allgather(str(stepper.log)))) == 1
    assert str(stepper.log).count("\n") == 3 and "cut back: DIVERGED_MAX_IT" in str(stepper.log)
    told = [r.getMessage() for r in caplog.records if "cut back" in r.getMessage()]
    assert len(told) == (1 if WORLD.rank == 0 else 0)
    for part in ("step 2", "t = 0.05", "Δt = 0.05", "Δt = 0.025", "DIVERGED_MAX_IT"):
        assert all(part in text for text in told)
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("log")) if WORLD.rank == 0 else None)
    stepper.log.write(f"{folder}/log.csv")
    WORLD.Barrier()
    with open(f"{folder}/log.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [line["result"] for line in table] == [row.result for row in rows]
    qs.save_run(stepper, f"{folder}/run")
    other = Upset().stepper
    qs.load_run(other, f"{folder}/run")
    assert other.log.rows == rows
    other.step()
    assert other.log[-1].step == 3 and len(other.log) == 4


def test_faults():
    """The reason is what is wrong with the solution; the last attempt has failed."""
    case = Upset(dt_min=0.02, max_rotation=0.1)

    def turn(t, dt):
        case.tool.rotation = 0.5

    case.stepper.drive = turn
    with pytest.raises(qs.StepError, match="max_rotation"):
        case.stepper.step()
    assert [row.result for row in case.stepper.log] == ["cut back", "failed"]
    assert all("above max_rotation = 0.1" in row.reason for row in case.stepper.log)


def test_active_sets_that_change_are_named():
    error = qs.ConvergenceError(-5, [1.0, 1.0], [[4, 7], [4, 9]])
    case = Upset(solve=lambda step: (_ for _ in ()).throw(error), dt_min=0.05)
    with pytest.raises(qs.StepError):
        case.stepper.step()
    assert "contact 1 (7 to 9 closed)" in case.stepper.log[0].reason
    assert "contact 0" not in case.stepper.log[0].reason
    assert case.stepper.log[0].closed == (4, 9)
