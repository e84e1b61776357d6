"""Tests run with any number of MPI ranks; each test counts as one, whichever rank it fails on."""

import collections
import functools
import gc
import io
import itertools
import os
import pathlib
import sys

# Tests make a mesh twice and compare values rank by rank. With its threads Scotch, DOLFINx's
# partitioner, may cut the same mesh differently each time (7.0.16 does, on 3 ranks).
os.environ["SCOTCH_PTHREAD_NUMBER"] = "1"

from mpi4py import MPI

import pytest

# Tests import what is beside this file (scenes), in a folder of tests (hard.scenes), the demos and
# the benchmarks.
here = pathlib.Path(__file__).resolve().parent
programs = [here.parent / folder for folder in ("demos", "demos/engineering", "bench")]
sys.path[:0] = [str(here), *map(str, programs)]

from choice import chosen, indices, is_slow, ranks_of  # noqa: E402

import ffcx.codegeneration.jit as ffcx_jit  # noqa: E402
import ufl.cell  # noqa: E402
from dolfinx import jit  # noqa: E402

import qsdolfinx as qs  # noqa: E402

comm = MPI.COMM_WORLD.Dup()

# Two processes may want the same form: the one waits until the other has compiled it.
jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, "seconds to wait for another process")


def keep_loaded(load):
    """FFCx lists the whole folder of forms each time that it loads one: remember those loaded."""
    modules = {}

    def get_cached_module(name, objects, folder, timeout):
        key = name, str(folder)
        module = modules.get(key) or load(name, objects, folder, timeout)
        if module[0] is not None:
            modules[key] = module
        return module

    return get_cached_module


ffcx_jit.get_cached_module = keep_loaded(ffcx_jit.get_cached_module)

# A cell makes all of its facets, edges and vertices anew each time that UFL asks an element for it.
ufl.cell.Cell = functools.cache(ufl.cell.Cell)

#: Tests after which garbage is collected, and the count of them.
GARBAGE, finished = 10, itertools.count(1)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """From here on, collecting garbage takes a moment: all that pytest knows is left out."""
    gc.collect()
    gc.freeze()
    if comm.size > 1:
        gc.disable()  # see pytest_runtest_teardown


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
        help="every case of every test, not each value of its parameters or pairs of these",
    )
    parser.addoption(
        "--share",
        action="store_true",
        help="only what `make test` runs with this number of MPI ranks (see CONTRIBUTING.md)",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark as long what no run after each change needs; deal the rest to 1, 2 and 3 ranks."""
    for item in filter(is_slow, items):
        item.add_marker(pytest.mark.long)
    if not config.getoption("all_cases", False):
        groups = collections.defaultdict(list)
        for item in (item for item in items if not item.get_closest_marker("long")):
            groups[item.nodeid.partition("[")[0]].append(item)
        for group in groups.values():
            kept = set(chosen([indices(item) for item in group]))
            for item in (item for i, item in enumerate(group) if i not in kept):
                item.add_marker(pytest.mark.long)
    if config.getoption("share", False):
        mine = {id(item) for item in items if comm.size == ranks_of(item)}
        config.hook.pytest_deselected(items=[item for item in items if id(item) not in mine])
        items[:] = [item for item in items if id(item) in mine]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Skip what another number of ranks is needed for."""
    if item.get_closest_marker("several_ranks") and comm.size == 1:
        pytest.skip("needs two ranks")
    if item.get_closest_marker("one_rank") and comm.size > 1:
        pytest.skip("needs a single rank")


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    if comm.rank > 0:  # only rank 0 writes to the terminal
        reporter = config.pluginmanager.unregister(name="terminalreporter")
        silent = type(reporter)(config, io.StringIO())
        config.pluginmanager.register(silent, "terminalreporter")


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
