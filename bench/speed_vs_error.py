"""Speed against error: every formulation, quadrature and enforcement on four mesh levels.

Five cases: patch, hertz2d, hertz3d, upsetting, forging, see speed_cases.py and speed_forging.py.
Measured are CPU seconds of all ranks, from the bodies in hand to the solution: contact and problem
are made, and the problem is solved, or all steps are made. Meshes and errors are not in it. The
least of up to --repeats runs counts; runs are repeated as long as they took less than two seconds
in all. A kind of contact that has no solution on two levels, or takes 20 times as long as the
fastest, is not tried on finer ones.

Writes speed_vs_error_CASE.json to --json-dir. Then bench/speed_report.py makes
docs/speed-vs-error.md and its figures of them.

    python3 bench/speed_vs_error.py
    mpirun -n 2 python3 bench/speed_vs_error.py --cases patch hertz2d --levels 0 1 2 --repeats 1
"""

import argparse
import gc
import itertools
import json
import pathlib
import sys
import time

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances
from speed_cases import Hertz2D, Hertz3D, Kind, Patch, Upsetting
from speed_forging import Forging

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
ROOT = pathlib.Path(__file__).resolve().parent.parent
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
ENFORCEMENTS = ("penalty", "augmented-lagrangian")
KINDS = [Kind(*k) for k in itertools.product(FORMULATIONS, ("nodal", "overlay"), ENFORCEMENTS)]
CASES = {
    "patch": Patch,
    "hertz2d": Hertz2D,
    "hertz3d": Hertz3D,
    "upsetting": Upsetting,
    "forging": Forging,
}
#: CPU seconds after which a run is not repeated.
LONG = 2.0
#: Levels without a solution after which finer ones are not tried.
PATIENCE = 2
#: Times as slow as the fastest on its level is what is not tried on finer ones.
SLOW = 20


def run_once(scene, kind):
    """One timed run: seconds, iterations and errors."""
    gc.collect()
    COMM.barrier()
    cpu, wall = time.process_time(), time.perf_counter()
    contacts, problem, solve = scene.assemble(kind)
    try:
        newton, reason = solve(), ""
    except (qs.ConvergenceError, qs.StepError) as error:
        newton, reason = None, str(error).split("; residuals")[0]
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    row = {
        "status": "no solution" if reason else "ok",
        "reason": reason,
        "cpu_seconds": COMM.allreduce(cpu),
        "wall_seconds": COMM.allreduce(wall, op=MPI.MAX),
        "contact_wall_seconds": COMM.allreduce(sum(c.seconds for c in contacts), op=MPI.MAX),
        "newton": newton,
    }
    # The library's stopwatch tells wall time.
    row["contact_share"] = min(row["contact_wall_seconds"] / row["wall_seconds"], 1.0)
    row["errors"] = {} if reason else scene.errors(contacts)
    problem.destroy()
    return row


def run(scene, kind, repeats):
    """The fastest of some runs."""
    best, spent = None, 0.0
    for count in range(1, repeats + 1):
        row = run_once(scene, kind)
        spent += row["cpu_seconds"]
        if best is None or row["cpu_seconds"] < best["cpu_seconds"]:
            best = row
        best["runs"] = count
        if spent > LONG or best["status"] != "ok":
            break
    return best


def measure(case, levels, repeats, kinds=tuple(KINDS), say=lambda row: None):
    """All rows of a case, and numbers on its reference."""
    cls = CASES[case]
    shared = cls.prepare(COMM, levels)
    compiled = cls(COMM, min(levels), shared)
    for kind in kinds[:2]:  # forms are compiled before anything is timed
        run_once(compiled, kind)
    rows, given_up = [], {}
    for level in sorted(levels):
        scene = cls(COMM, level, shared)
        for kind in kinds:
            row = {"level": level, "h": scene.h, "dofs": scene.dofs, **kind._asdict()}
            if kind in given_up:
                row |= {"status": "not tried", "reason": given_up[kind]}
            else:
                row |= run(scene, kind, repeats)
            rows.append(row)
            say(row)
        given_up |= hopeless(rows, level)
    return rows, cls.describe(shared)


def hopeless(rows, level):
    """Kinds not to be tried on levels finer than this one, and why."""
    out = {}
    here = [r for r in rows if r["level"] == level and r["status"] != "not tried"]
    fastest = min((r["cpu_seconds"] for r in here if r["status"] == "ok"), default=np.inf)
    for row in here:
        kind = Kind(*(row[name] for name in Kind._fields))
        mine = [r for r in rows if all(r[name] == row[name] for name in Kind._fields)]
        if sum(r["status"] == "no solution" for r in mine) >= PATIENCE:
            out[kind] = "no solution on coarser levels"
        elif row["cpu_seconds"] > SLOW * fastest:
            ratio = row["cpu_seconds"] / fastest
            out[kind] = f"{ratio:.0f} times as slow as the fastest on the level before"
    return out


def line(row):
    """Of the terminal."""
    start = (
        f"{row['level']:2}{row['dofs']:8}  {row['formulation']:16}{row['quadrature']:9}"
        f"{row['enforcement']:21}"
    )
    if row["status"] != "ok":
        spent = f" after {row['cpu_seconds']:.1f} s" if "cpu_seconds" in row else ""
        return f"{start}{row['status']}{spent}: {row['reason']}"
    errors = "".join(f" {name} {value:.2e}" for name, value in row["errors"].items())
    seconds = f"{row['cpu_seconds']:8.3f} s, contact {100 * row['contact_share']:4.1f} %"
    return f"{start}{seconds}, Newton {row['newton']:3},{errors}"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=list(CASES))
    parser.add_argument(
        "--levels", nargs="+", type=int, help="mesh levels, 0 is the coarsest; 0 1 2 3 by default"
    )
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json-dir", type=pathlib.Path, default=ROOT / "bench" / "results")
    a = parser.parse_args()
    if a.levels is not None and min(a.levels) < 0:
        parser.error("--levels must not be negative")
    if a.repeats < 1:
        parser.error("--repeats must be at least 1")
    say = print if COMM.rank == 0 else lambda *args, **kwargs: None
    for case in a.cases:
        start = time.perf_counter()
        levels = sorted(set(a.levels or CASES[case].levels))
        say(f"\n{CASES[case].title}: level, unknowns, CPU seconds, errors", flush=True)
        rows, reference = measure(case, levels, a.repeats, say=lambda r: say(line(r), flush=True))
        result = {
            "case": case,
            "title": CASES[case].title,
            "text": CASES[case].text,
            "measures": CASES[case].measures,
            "reference": reference,
            "levels": levels,
            "measured_in_seconds": time.perf_counter() - start,
            **circumstances(COMM.size),
            "rows": rows,
        }
        say(f"{case}: {result['measured_in_seconds']:.0f} s")
        if COMM.rank == 0:
            a.json_dir.mkdir(parents=True, exist_ok=True)
            text = json.dumps(result, indent=1, ensure_ascii=False)
            filename = a.json_dir / f"speed_vs_error_{case}.json"
            filename.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
