"""Wall time by stage: exclusive, over contacts and bodies, with the same stages in PETSc's log."""

import time

from petsc4py import PETSc

import pytest
from scenes import WORLD, Pair

from qsdolfinx.timing import STAGES, Stopwatch, spans


def test_stages_are_exclusive():
    """A stage inside another one, of another stopwatch too, stops its time."""
    first, second = Stopwatch(), Stopwatch()
    start = time.perf_counter()
    with first.stage("solve"):
        time.sleep(0.02)
        with second.stage("gap"):
            time.sleep(0.03)
            with first.stage("solve"):
                time.sleep(0.01)
        with pytest.raises(KeyError), second.stage("insertion"):
            raise KeyError
    total = time.perf_counter() - start
    assert first.seconds["solve"] >= 0.03 and second.seconds["gap"] >= 0.03
    counted = sum(first.seconds.values()) + sum(second.seconds.values())
    assert 0 <= total - counted < 0.01
    assert not Stopwatch._running
    both = spans(WORLD, [first, second])
    assert both["solve"].max >= both["solve"].min > 0 == both["pairing"].max


def test_timings_of_a_problem():
    pair = Pair("quadrilateral", n=(12, 9), wave=0.02)
    problem = pair.problem()
    problem.solve()
    timings = problem.timings
    assert tuple(timings) == STAGES
    for name, span in timings.items():
        assert span.max >= span.min >= 0 and span.max > 0, name
    in_contact = sum(timings[name].max for name in ("pairing", "gap", "insertion"))
    assert pair.contact.seconds <= in_contact * (1 + 1e-12)
    before = timings["bulk assembly"]
    problem.solve()  # linear bodies: the matrix is not assembled again
    assert problem.timings["bulk assembly"].max >= before.max


def test_stages_of_petsc():
    """Each stage is one of PETSc's, made once."""
    watch = Stopwatch()
    for _ in range(2):
        with watch.stage("gap"):
            pass
    names = {PETSc.Log.Stage(f"contact: {name}").name for name in STAGES}
    ids = {PETSc.Log.Stage(f"contact: {name}").id for name in ("gap", "gap")}
    assert names == {f"contact: {name}" for name in STAGES} and len(ids) == 1
