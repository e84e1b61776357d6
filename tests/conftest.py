"""Tests run with any number of MPI ranks; each test counts as one, whichever rank it fails on."""

import io
import pathlib
import sys

from mpi4py import MPI

import pytest

# Tests import scenes.py beside them and the demos.
here = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(here), str(here.parent / "demos")]

import qsdolfinx as qs  # noqa: E402

comm = MPI.COMM_WORLD.Dup()


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
