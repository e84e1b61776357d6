"""Record the machine and software of a measurement, and write files of results."""

import datetime
import json
import os
import pathlib
import platform
import shlex
import sys


def cpu_model():
    """Return the processor name from Linux."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def circumstances(ranks):
    """Return machine, versions, date, ranks and command."""
    from petsc4py import PETSc  # starts MPI, which must not happen in scripts that start mpirun

    import dolfinx

    import qsdolfinx

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


def write(filename, result, digits=6):
    """Write readable JSON: a line for each entry and each row of a table, with rounded numbers."""

    def text(value):
        if isinstance(value, list) and value and isinstance(value[0], dict):
            return "[\n  " + ",\n  ".join(map(text, value)) + "\n ]"
        return json.dumps(rounded(value, digits), ensure_ascii=False)

    entries = ",\n ".join(f"{json.dumps(key)}: {text(value)}" for key, value in result.items())
    path = pathlib.Path(filename)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{{\n {entries}\n}}\n", encoding="utf-8")


def rounded(value, digits):
    """Round numbers to some digits, also inside lists and dictionaries."""
    if isinstance(value, dict):
        return {key: rounded(inner, digits) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(inner, digits) for inner in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value
