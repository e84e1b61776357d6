"""Wall time by stage: exclusive, summed over contacts and bodies, with the same stages in PETSc."""

import time

from petsc4py import PETSc

import pytest
from scenes import WORLD, Pair

from qsdolfinx.base.timing import STAGES, Stopwatch, spans


def test_stages_are_exclusive(monkeypatch):
    """A stage pauses while an inner stage runs, also one of another stopwatch."""
    clock = 100.0
    monkeypatch.setattr(time, "perf_counter", lambda: clock)
    first, second = Stopwatch(), Stopwatch()
    with first.stage("solve"):
        clock += 2
        with second.stage("gap"):
            clock += 4
            with first.stage("solve"):
                clock += 8
            clock += 16
        with pytest.raises(KeyError), second.stage("insertion"):
            clock += 32
            raise KeyError
        clock += 64
    clock += 128
    with first.stage("pairing"):  # nothing else is running
        clock += 256
    assert {k: t for k, t in first.seconds.items() if t} == {"solve": 2 + 8 + 64, "pairing": 256}
    assert {k: t for k, t in second.seconds.items() if t} == {"gap": 4 + 16, "insertion": 32}
    monkeypatch.undo()
    both = spans(WORLD, [first, second])
    assert both["solve"] == (74, 74) and both["gap"] == (20, 20) and both["bulk assembly"] == (0, 0)


def test_timings_of_a_problem():
    pair = Pair("quadrilateral", n=(12, 9), wave=0.02)
    problem = pair.problem()
    problem.solve()
    timings = problem.timings
    assert tuple(timings) == STAGES
    for name, span in timings.items():
        assert span.max >= span.min >= 0 and span.max > 0, name
    in_contact = sum(timings[name].max for name in ("pairing", "gap", "insertion"))
    assert pair.contact.model.watch.total <= in_contact * (1 + 1e-12)
    before = timings["bulk assembly"]
    problem.solve()  # linear bodies: the matrix is not assembled again
    assert problem.timings["bulk assembly"].max >= before.max


def test_stages_of_petsc():
    """Each stage is a stage of PETSc's log, created once."""
    watch = Stopwatch()
    for _ in range(2):
        with watch.stage("gap"):
            pass
    names = {PETSc.Log.Stage(f"contact: {name}").name for name in STAGES}
    ids = {PETSc.Log.Stage(f"contact: {name}").id for name in ("gap", "gap")}
    assert names == {f"contact: {name}" for name in STAGES} and len(ids) == 1
