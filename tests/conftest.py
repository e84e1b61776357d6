"""Run tests with any number of MPI ranks; each test counts once, whichever rank it fails on."""

import collections
import functools
import gc
import io
import itertools
import os
import pathlib
import sys

# Tests make a mesh twice and compare values rank by rank. With threads Scotch, DOLFINx's
# partitioner, may partition the same mesh differently each time (7.0.16 does, on 3 ranks).
os.environ["SCOTCH_PTHREAD_NUMBER"] = "1"

from mpi4py import MPI

import pytest

# Tests import modules next to this file (scenes) and in test folders (hard.scenes), the demos and
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

# Two processes may need the same form: one waits until the other has compiled it.
jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, "seconds to wait for another process")


def keep_loaded(load):
    """Keep loaded forms in memory: FFCx lists the whole folder of forms at each load."""
    modules = {}

    def get_cached_module(name, objects, folder, timeout):
        key = name, str(folder)
        module = modules.get(key) or load(name, objects, folder, timeout)
        if module[0] is not None:
            modules[key] = module
        return module

    return get_cached_module


ffcx_jit.get_cached_module = keep_loaded(ffcx_jit.get_cached_module)

# A cell creates all of its facets, edges and vertices again each time that UFL asks an element for
# it.
ufl.cell.Cell = functools.cache(ufl.cell.Cell)

#: Number of tests between garbage collections, and the counter of finished tests.
GARBAGE, finished = 10, itertools.count(1)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """Freeze all objects of pytest, so that later garbage collections are fast."""
    gc.collect()
    gc.freeze()
    if comm.size > 1:
        gc.disable()  # see pytest_runtest_teardown


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    """Collect garbage on all ranks at the same time.

    Otherwise each rank frees communicators at different times. The numbers of the remaining
    communicators then differ between ranks, and Open MPI takes ever longer to find a number that is
    free on all ranks: at the end of the tests everything took four times as long on 3 ranks.
    """
    if next(finished) % GARBAGE == 0 and comm.size > 1:
        gc.collect()


@pytest.fixture(autouse=True)
def destroy_problems(monkeypatch):
    """Destroy the problems of each test: in parallel PETSc would keep them to the end."""
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
        help="run every case, not only a selection with each value or pair of parameter values",
    )
    parser.addoption(
        "--share",
        action="store_true",
        help="run only the share of `make test` for this number of MPI ranks (see CONTRIBUTING.md)",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark cases not needed after each change as long; divide the rest among 1, 2 and 3 ranks."""
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
    """Skip tests that need another number of ranks."""
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
