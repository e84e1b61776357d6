"""What a figure was measured on and with."""

import datetime
import os
import pathlib
import platform
import shlex
import sys

from petsc4py import PETSc

import dolfinx

import qsdolfinx


def cpu_model():
    """As Linux has it."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


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
            "qsdolfinx": qsdolfinx.__version__,
            "python": platform.python_version(),
        },
        "date": datetime.date.today().isoformat(),
        "ranks": ranks,
        "command": shlex.join(
            ["python3", f"bench/{pathlib.Path(sys.argv[0]).name}", *sys.argv[1:]]
        ),
    }
