"""Tests run with any number of MPI ranks; each test counts as one, whichever rank it fails on."""

import collections
import gc
import io
import itertools
import os
import pathlib
import sys
import zlib

# Tests make a mesh twice and compare values rank by rank. With its threads Scotch, DOLFINx's
# partitioner, may cut the same mesh differently each time (7.0.16 does, on 3 ranks).
os.environ["SCOTCH_PTHREAD_NUMBER"] = "1"

from mpi4py import MPI

import pytest

# Tests import scenes.py beside them, the demos and the benchmarks.
here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here), *(str(here.parent / folder) for folder in ("demos", "bench"))]

import qsdolfinx as qs  # noqa: E402

comm = MPI.COMM_WORLD.Dup()

#: Cases of a test from which on they are shared between the runs with several ranks.
MANY_CASES = 4

#: Tests after which garbage is collected, and the count of them.
GARBAGE, finished = 10, itertools.count(1)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """From here on, collecting garbage takes a moment: all that pytest knows is left out."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    """All ranks collect garbage at the same time.

    Else each frees communicators when it likes, the numbers of those that are left become
    different ones on each rank, and Open MPI searches ever longer for one that is free on all: at
    the end of the tests everything took four times as long on 3 ranks.
    """
    if next(finished) % GARBAGE == 0 and comm.size > 1:
        gc.collect()


@pytest.fixture(autouse=True)
def destroy_problems(monkeypatch):
    """Free what each test solved: in parallel PETSc would keep it to the end."""
    problems = []
    create = qs.ContactProblem.__init__

    def init(self, *args, **kwargs):
        create(self, *args, **kwargs)
        problems.append(self)

    monkeypatch.setattr(qs.ContactProblem, "__init__", init)
    yield problems
    for problem in problems:
        problem.destroy()


def pytest_addoption(parser):
    parser.addoption(
        "--all-cases",
        action="store_true",
        help="every case of every test, whatever the number of ranks (see CONTRIBUTING.md)",
    )


def pytest_collection_modifyitems(config, items):
    """With several ranks, of a test with many cases a half: with 2 the one, with 3 the other.

    Which half a case is in follows from its name. One rank runs them all.
    """
    if comm.size == 1 or config.getoption("all_cases"):
        return
    counts = collections.Counter(item.nodeid.partition("[")[0] for item in items)
    kept, left = [], []
    for item in items:
        many = counts[item.nodeid.partition("[")[0]] >= MANY_CASES
        other_half = zlib.crc32(item.nodeid.encode()) % 2 != comm.size % 2
        (left if many and other_half else kept).append(item)
    config.hook.pytest_deselected(items=left)
    items[:] = kept


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    if comm.rank > 0:  # only rank 0 writes to the terminal
        config.pluginmanager.get_plugin("terminalreporter")._tw._file = io.StringIO()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if comm.size > 1:
        texts = comm.allgather(report.longreprtext if report.failed else None)
        failed = [rank for rank, text in enumerate(texts) if text is not None]
        if failed and comm.rank == 0:
            report.outcome = "failed"
            report.longrepr = "\n".join(f"--- rank {rank}\n{texts[rank]}" for rank in failed)
        elif failed:
            report.outcome = "failed"
            report.longrepr = report.longrepr or "failed on another rank"
    return report
