"""What a figure was measured on and with."""

import datetime
import importlib.metadata
import os
import pathlib
import platform
import re
import shlex
import sys

from petsc4py import PETSc

import dolfinx

ROOT = pathlib.Path(__file__).resolve().parent.parent


def cpu_model():
    """As Linux has it."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def version_of_this():
    """Of the installed package, or else of the source tree."""
    try:
        return importlib.metadata.version("qsdolfinx")
    except importlib.metadata.PackageNotFoundError:
        text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        return re.search(r'^version = "(.*)"$', text, re.MULTILINE)[1]


def circumstances(ranks):
    """Machine, versions, date, ranks and command."""
    return {
        "machine": {
            "cpu": cpu_model(),
            "cores": len(os.sched_getaffinity(0)),
            "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
        },
        "versions": {
            "dolfinx": dolfinx.__version__,
            "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
            "qsdolfinx": version_of_this(),
            "python": platform.python_version(),
        },
        "date": datetime.date.today().isoformat(),
        "ranks": ranks,
        "command": shlex.join(
            ["python3", f"bench/{pathlib.Path(sys.argv[0]).name}", *sys.argv[1:]]
        ),
    }
