"""Run the same contact job in qsdolfinx, asimov-contact, CalculiX, Kratos and NGSolve.

Two unit cubes of non-matching hexahedra are pressed together by a displacement, or with --job hertz
a sphere is pressed on a block; bench/peers/README.md describes the comparison. Printed for each
program: CPU seconds (user and system, of the process and its children), wall seconds, peak memory,
Newton and Krylov iterations, and the total force; with --job hertz also the Hertz radius of the
force, the error of the pressure on both bodies against Hertz's solution, and the unbalanced forces
inside them. The programs run one after the other, each in a separate process on one core; of
several repeats, the one with the fewest CPU seconds counts. Missing programs are reported.

    scripts/with-dolfinx python3 bench/peers.py --install FOLDER --sizes 22,18 35,28 --json FILE
    scripts/with-dolfinx python3 bench/peers.py --peers ours calculix --factor 1000
    scripts/with-dolfinx python3 bench/peers.py --job hertz --install FOLDER --json FILE
"""

import argparse
import datetime
import functools
import json
import os
import pathlib
import platform
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "peers"))

import hertz_error
import install
import jobs
from machine import cpu_model, write

#: Folder of the drivers.
HERE = pathlib.Path(__file__).resolve().parent / "peers"

#: Cells along an edge, LOWER,UPPER, of each job, and of a trial run.
SIZES = {"cubes": ["22,18", "35,28"], "hertz": ["13,10", "20,16", "27,21"]}
TRIAL = {"cubes": (3, 2), "hertz": (7, 5)}
#: Runs of each program: name, arguments of its driver, and whether it takes the penalty.
RUNS = {
    "ours": [
        ("overlay, augmented", ["--quadrature", "overlay"], False),
        (
            "overlay, augmented, points",
            ["--quadrature", "overlay", "--constraints", "points"],
            False,
        ),
        ("nodal, augmented", ["--quadrature", "nodal"], False),
        ("overlay, penalty", ["--quadrature", "overlay", "--enforcement", "penalty"], True),
        (
            "overlay, penalty, points",
            ["--quadrature", "overlay", "--enforcement", "penalty", "--constraints", "points"],
            True,
        ),
        ("nodal, penalty", ["--quadrature", "nodal", "--enforcement", "penalty"], True),
    ],
    "asimov": [
        ("CG, GAMG", ["--linear", "gamg"], False),
        ("CG, BoomerAMG", ["--linear", "boomeramg"], False),
        ("CG, incomplete Cholesky", ["--linear", "icc"], False),
        ("MUMPS", ["--linear", "mumps"], False),
    ],
    "calculix": [
        ("CG, incomplete Cholesky", ["--linear", "ITERATIVE CHOLESKY"], True),
        ("SPOOLES", ["--linear", "SPOOLES"], True),
        ("PaStiX", ["--linear", "PASTIX"], True),
    ],
    "kratos": [
        ("penalty, AMGCL", [], True),
        ("ALM, sparse LU", ["--contact", "alm", "--linear", "sparse_lu"], False),
    ],
    "ngsolve": [
        ("CG, Jacobi", ["--linear", "cg"], True),
        ("sparse Cholesky", ["--linear", "sparsecholesky"], True),
    ],
}
#: Runs with direct solvers, only with --direct.
DIRECT = "MUMPS", "SPOOLES", "PaStiX", "ALM, sparse LU", "sparse Cholesky"
#: The run without a remaining gap, the reference for forces.
REFERENCE = "overlay, augmented"


def command(name, how):
    """Return the command that starts a program's driver."""
    if name == "ours":
        return [sys.executable, HERE / "ours.py"]
    if name == "calculix":
        return [sys.executable, HERE / "calculix.py", "--ccx", how]
    if name == "asimov":
        return [sys.executable, HERE / "asimov.py"]
    return [how, HERE / ("ngsolve_.py" if name == "ngsolve" else "kratos.py")]


def environment(name, how):
    """Return a driver's environment: ours if it needs our DOLFINx; one thread."""
    if name in ("ours", "asimov"):
        return install.with_path(how)
    return install.environment()


def measure(arguments, environ, limit):
    """Run a driver; return its row, or the reason why there is none."""
    start = time.perf_counter()
    with subprocess.Popen(
        [str(a) for a in ("timeout", limit, *arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env=environ,
    ) as process:
        text = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    row = {
        "cpu": usage.ru_utime + usage.ru_stime,
        "wall": time.perf_counter() - start,
        "peak": usage.ru_maxrss / 1024,
    }
    lines = text.strip().split("\n")
    results = [line.removeprefix("RESULT ") for line in lines if line.startswith("RESULT ")]
    if process.returncode == 124:
        return {"error": f"not finished after {limit} s"}
    if process.returncode != 0 or not results:
        told = [line for line in lines if "error" in line.lower()] or lines
        return {"error": told[0].strip()[:100] or f"ended with {process.returncode}"}
    return row | json.loads(results[-1])


def machine():
    """Return the machine and versions of the measurement."""
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "load": os.getloadavg()[0],
    }


def solve(call, environ, sizes, p):
    """Return the row of one program and one pair of meshes; errors if the solution is known."""
    call = [*call, "--job", p.job, "--sizes", ",".join(map(str, sizes))]
    if p.job == "cubes":
        return measure(call, environ, p.timeout)
    with tempfile.TemporaryDirectory() as folder:
        output = pathlib.Path(folder, "u.npz")
        row = measure([*call, "--output", output], environ, p.timeout)
        if "error" in row:
            return row
        try:
            return row | hertz_error.measure(sizes, **np.load(output))
        except ValueError as reason:
            return {"error": str(reason)}


def columns(row, exact):
    """Format force and error; of the job "cubes" the force relative to the run without a gap."""
    if "l2_lower" in row:
        errors = (f"{100 * row[f'l2_{name}']:9.2f}" for name in ("lower", "upper"))
        balance = max(row["unbalanced_lower"], row["unbalanced_upper"])
        return f"{row['total']:10.3f}{row['radius']:8.4f}{''.join(errors)}{balance:9.0e}"
    off = f"{100 * (row['force'] / exact[0] - 1):8.3f}" if exact else ""
    return f"{row['force']:10.3f}{off}"


def show(rows, sizes, job):
    """Print the table of one pair of meshes."""
    exact = [r["force"] for r in rows if r["run"] == REFERENCE and "force" in r]
    print(f"\n{sizes[0]}³ and {sizes[1]}³ hexahedra, {jobs.unknowns(sizes):,} unknowns")
    titles = {"force": 10, "off %": 8}
    if job == "hertz":
        titles = {"force": 10, "a": 8, "lower %": 9, "upper %": 9, "balance": 9}
    print(
        f"{'':36}{'CPU s':>8}{'wall s':>8}{'MiB':>7}{'Newton':>8}{'Krylov':>8}"
        + "".join(f"{title:>{width}}" for title, width in titles.items())
    )
    for r in rows:
        title = f"{r['program']}: {r['run']}"
        if "error" in r:
            print(f"{title:36}  {r['error']}")
            continue
        print(
            f"{title:36}{r['cpu']:8.2f}{r['wall']:8.2f}{r['peak']:7.0f}{r['newton']:8}"
            f"{r.get('krylov') or '–':>8}{columns(r, exact)}"
        )
    for r in rows:
        if "stages" in r:
            stages = ", ".join(f"{name} {s:.2f}" for name, s in r["stages"].items())
            print(f"  {r['run']}, wall s: {stages}")


def best(runs):
    """Return the run with the fewest CPU seconds; a failure only if all failed."""
    return min(runs, key=lambda row: row.get("cpu", float("inf")))


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--job", choices=tuple(SIZES), default="cubes")
    add("--sizes", nargs="+", help="cells along an edge, LOWER,UPPER")
    add("--peers", nargs="+", choices=tuple(RUNS), default=tuple(RUNS))
    add("--install", metavar="FOLDER", help="folder of the programs; missing ones are installed")
    add("--python", help="interpreter for Kratos and NGSolve; default: this one")
    add("--asimov-source", metavar="FOLDER", help="source of asimov-contact; default: clone it")
    add("--factor", type=float, default=10.0, help="penalty over E/h, for penalty contact")
    add("--rtol", type=float, default=1e-6, help="Newton tolerance, with a penalty")
    add("--direct", action="store_true", help="also with direct solvers")
    add("--repeats", type=int, default=1)
    add("--timeout", type=int, default=3600, help="time limit of one run, s")
    add("--json", metavar="FILE")
    p = parser.parse_args()
    p.sizes = [tuple(int(n) for n in sizes.split(",")) for sizes in p.sizes or SIZES[p.job]]
    return p


def main():
    p = parse()
    others = [name for name in p.peers if name != "ours"]
    say = functools.partial(print, flush=True)
    how = install.prepare(others, p.install, p.python, say, p.asimov_source)
    runners, versions = [], {}
    for name in p.peers:
        for run, arguments, takes_penalty in RUNS[name]:
            if run in DIRECT and not p.direct:
                continue
            if isinstance(how.get(name), install.Missing):
                runners.append((name, run, None, None, {"error": f"missing: {how[name]}"}))
                continue
            call = [*command(name, how.get(name)), *arguments]
            environ = environment(name, how.get(name))
            if takes_penalty:
                call += ["--factor", p.factor]
            if (takes_penalty and name != "calculix") or name == "asimov":
                call += ["--rtol", p.rtol]  # CalculiX has its own stopping criterion
            # A tiny job first: it compiles forms, and finds programs that cannot run at all.
            trial = solve(call, environ, TRIAL[p.job], p)
            versions[name] = trial.get("version", versions.get(name))
            runners.append((name, run, call, environ, trial))
    results = []
    for sizes in p.sizes:
        runs = {i: [] for i in range(len(runners))}
        for _ in range(p.repeats):
            for i, (_, _, call, environ, trial) in enumerate(runners):
                failed = "error" in trial
                row = trial if failed else solve(call, environ, sizes, p)
                runs[i].append(row)
        rows = [
            {"sizes": sizes, "program": name, "run": run} | best(runs[i])
            for i, (name, run, *_) in enumerate(runners)
        ]
        show(rows, sizes, p.job)
        results += rows
    if p.json:
        result = {
            "job": p.job,
            "date": datetime.date.today().isoformat(),
            "machine": machine(),
            "versions": versions,
            "factor": p.factor,
            "rtol": p.rtol,
            "repeats": p.repeats,
            "rows": results,
        }
        write(p.json, result)


if __name__ == "__main__":
    main()
