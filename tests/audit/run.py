"""Run and audit random scenes with full solves, and random histories with time steps.

    python3 tests/audit/run.py --scenes 0:200 --verbose
    python3 tests/audit/run.py --histories 0:500
    mpirun -n 2 python3 tests/audit/run.py --scenes 0:200 --units

A scene counts as refused if the library raises an error of its own. A scene with faults about which
the library has warned is counted as such. Ends with 1 if there are unexplained faults.
"""

import argparse
import contextlib
import dataclasses
import gc
import pathlib
import sys
import tempfile
import time
import traceback
import warnings

from mpi4py import MPI

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))

from audit.auditor import compare
from audit.histories import random_history
from audit.play import Play
from audit.scenes import Scene, Stage, random_scene
from audit.steps import StepAuditor

import qsdolfinx as qs

COMM = MPI.COMM_WORLD

#: Errors whose messages say what to do; those of NumPy's functions are no refusals.
REFUSALS = (qs.ConvergenceError, qs.StepError, ValueError)

#: Allowed difference between an uninterrupted and a restarted history, relative to its length.
RESTART = 1e-6


class Historian:
    """A history with its auditor and, from the middle on, a second one restarted from a file."""

    def __init__(self, history):
        self.plays = [Play(history)]
        self.auditor = StepAuditor(self.plays[0])
        self.restarted = history.restarted

    def steps(self):
        """Make all steps; yield the faults after each step."""
        first = self.plays[0]
        for unit in range(1, len(first.history.path) + 1):
            for _ in first.stepper.run(unit):
                faults = self.auditor.audit()
                if len(self.plays) > 1:
                    faults += self.compare(unit)
                if first.stepper.t > len(first.history.path) - 1e-9:
                    faults += self.auditor.audit_update()
                yield faults
            if unit == self.restarted:
                self.restart()

    def restart(self):
        """Save the history and continue it in new bodies. Collective."""
        with shared_folder() as folder:
            qs.save_run(self.plays[0].stepper, f"{folder}/run")
            again = Play(self.plays[0].history)
            self.plays.append(again)
            again.refused = self.plays[0].refused
            qs.load_run(again.stepper, f"{folder}/run")

    def compare(self, unit):
        """Make the step in the restarted history as well; return the differences."""
        first, again = self.plays
        again.stepper.step(unit)
        faults = compare("restart", abs(again.stepper.t - first.stepper.t), 1e-9, "time")
        length = first.L
        for i, (a, b) in enumerate(zip(first.actors, again.actors, strict=True)):
            difference = a.nodes.values(a.u.x.array) - b.nodes.values(b.u.x.array)
            error = np.abs(a.nodes.gather(difference)).max()
            faults += compare("restart", error, RESTART * length, f"unknowns of body {i}")
        force = first.contact.force("slave") - again.contact.force("slave")
        # Areas in updated geometry converge to a thousandth: more than where pairs of nodes are
        # kept.
        part = 1e-5 if self.auditor.joint.finite else 1e-6
        slack = 1e-5 * np.abs(first.contact.force("slave")).max() + part * self.auditor.force
        return faults + compare("restart", np.abs(force), slack, "contact force")

    def destroy(self):
        for play in self.plays:
            play.problem.destroy()


def is_of_the_library(error):
    """Whether the library has raised an error, rather than a function that it calls."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return "qsdolfinx" in last.filename and (last.line or "").startswith("raise ")


@contextlib.contextmanager
def shared_folder():
    """Provide a temporary folder that all ranks write to. Collective."""
    with contextlib.ExitStack() as stack:
        name = None
        if COMM.rank == 0:
            name = stack.enter_context(tempfile.TemporaryDirectory())
        yield COMM.bcast(name)
        COMM.barrier()


@dataclasses.dataclass
class Outcome:
    """Outcome of a scene.

    Attributes:
        faults: Faults found by the auditor, each with its step.
        refused: Error raised by the library.
        warned: Warnings of the library.
        seconds: Wall-clock time.
    """

    faults: list[str] = dataclasses.field(default_factory=list)
    refused: str = ""
    warned: list[str] = dataclasses.field(default_factory=list)
    seconds: float = 0.0

    @property
    def word(self):
        if self.faults:
            return "warned" if self.warned else "FAULT"
        return "refused" if self.refused else "good"


def run_scene(scene):
    """Solve and audit a scene, or a history. Collective."""
    out, start, step, stage = Outcome(), time.perf_counter(), 0, None
    begin = Stage if isinstance(scene, Scene) else Historian
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", qs.ContactWarning)
        try:
            stage = begin(scene)
            for step, faults in enumerate(stage.steps(), 1):
                out.faults += [f"step {step}: {fault}" for fault in faults]
        except Exception as error:
            if isinstance(error, REFUSALS) and is_of_the_library(error):
                out.refused = f"step {step + 1}: {error}"
            else:
                out.faults.append(f"step {step + 1}: {type(error).__name__}: {error}")
        finally:
            if stage is not None:
                stage.destroy()
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    out.warned = sorted({text for part in COMM.allgather(texts) for text in part})
    out.faults = sorted({fault for part in COMM.allgather(out.faults) for fault in part})
    out.seconds = time.perf_counter() - start
    return out


def run(numbers, units=False, report=None, verbose=False, draw=random_scene):
    """Run scenes or histories one after another; count their outcomes. Collective."""
    counts = {"good": 0, "refused": 0, "warned": 0, "FAULT": 0}
    for i, number in enumerate(numbers):
        if i % 10 == 0:  # on all ranks at the same time: see tests/conftest.py
            gc.collect()
        scene = draw(number, units)
        outcome = run_scene(scene)
        counts[outcome.word] += 1
        if report and COMM.rank == 0 and (verbose or outcome.word == "FAULT"):
            lines = [f"{number} {outcome.word} {outcome.seconds:.2f} s: {scene}"]
            lines += outcome.faults
            lines += [f"refused at {outcome.refused[:300]}"] * bool(outcome.refused)
            lines += [f"warned: {text[:120]}" for text in outcome.warned]
            report("\n    ".join(lines))
    return counts


def following(draw):
    """Make the same scenes or histories with updated contact geometry."""

    def drawn(number, units):
        scene = draw(number, units)
        left_out = ("constraints", "normals", "quadrature", "quadrature_degree")
        options = {k: v for k, v in scene.options.items() if k not in left_out}
        options |= {"quadrature": "overlay", "sliding": "finite"}
        if options.get("search_radius") == "local":
            del options["search_radius"]
        return dataclasses.replace(scene, options=options)

    return drawn


def numbers_of(text):
    """Parse ``first:last`` or numbers with commas."""
    if ":" in text:
        first, last = map(int, text.split(":"))
        return range(first, last)
    return [int(number) for number in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=numbers_of, default=range(100), help="first:last, or 3,7")
    parser.add_argument("--histories", type=numbers_of, help="numbers of histories")
    parser.add_argument("--units", action="store_true", help="unusual units of force and length")
    parser.add_argument("--finite", action="store_true", help="updated contact geometry")
    parser.add_argument("--verbose", action="store_true", help="print those without faults, too")
    args = parser.parse_args()
    start = time.perf_counter()
    numbers, draw, what = args.scenes, random_scene, "scenes"
    if args.histories is not None:
        numbers, draw, what = args.histories, random_history, "histories"
    if args.finite:
        draw = following(draw)
    counts = run(numbers, args.units, lambda text: print(text, flush=True), args.verbose, draw)
    seconds = time.perf_counter() - start
    if COMM.rank == 0:
        words = ", ".join(f"{count} {word}" for word, count in counts.items())
        print(f"{len(numbers)} {what} on {COMM.size} rank(s): {words}; {seconds:.1f} s")
    sys.exit(min(counts["FAULT"], 1))


if __name__ == "__main__":
    main()
