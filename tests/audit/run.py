"""Random scenes through full solves, and the auditor's faults.

    python3 tests/audit/run.py --scenes 0:200 --verbose
    mpirun -n 2 python3 tests/audit/run.py --scenes 0:200 --units

A scene is refused if the library raises an error of its own; one that has faults but was warned
about by the library is counted as such. Ends with 1 if there are faults that nothing has explained.
"""

import argparse
import dataclasses
import gc
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))

from audit.scenes import Stage, random_scene

import qsdolfinx as qs

COMM = MPI.COMM_WORLD

#: Errors that say what to do.
REFUSALS = (qs.ConvergenceError, ValueError)


@dataclasses.dataclass
class Outcome:
    """What became of a scene.

    Attributes:
        faults: What the auditor found, each with its step.
        refused: The library's error.
        warned: The library's warnings.
        seconds: Wall time.
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
    """Solve and audit a scene. Collective."""
    out, start, step, stage = Outcome(), time.perf_counter(), 0, None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", qs.ContactWarning)
        try:
            stage = Stage(scene)
            for step, faults in enumerate(stage.steps(), 1):
                out.faults += [f"step {step}: {fault}" for fault in faults]
        except REFUSALS as error:
            out.refused = f"step {step + 1}: {error}"
        except Exception as error:
            out.faults.append(f"step {step + 1}: {type(error).__name__}: {error}")
        finally:
            if stage is not None:
                stage.problem.destroy()
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    out.warned = sorted({text for part in COMM.allgather(texts) for text in part})
    out.faults = sorted({fault for part in COMM.allgather(out.faults) for fault in part})
    out.seconds = time.perf_counter() - start
    return out


def run(numbers, units=False, report=None, verbose=False):
    """Scenes one after another; counts by word. Collective."""
    counts = {"good": 0, "refused": 0, "warned": 0, "FAULT": 0}
    for i, number in enumerate(numbers):
        if i % 10 == 0:  # on all ranks at once: see tests/conftest.py
            gc.collect()
        scene = random_scene(number, units)
        outcome = run_scene(scene)
        counts[outcome.word] += 1
        if report and COMM.rank == 0 and (verbose or outcome.word == "FAULT"):
            lines = [f"{number} {outcome.word} {outcome.seconds:.2f} s: {scene}"]
            lines += outcome.faults
            lines += [f"refused at {outcome.refused[:300]}"] * bool(outcome.refused)
            lines += [f"warned: {text[:120]}" for text in outcome.warned]
            report("\n    ".join(lines))
    return counts


def numbers_of(text):
    """``first:last`` or numbers with commas."""
    if ":" in text:
        first, last = map(int, text.split(":"))
        return range(first, last)
    return [int(number) for number in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=numbers_of, default=range(100), help="first:last, or 3,7")
    parser.add_argument("--units", action="store_true", help="odd units of force and length")
    parser.add_argument("--verbose", action="store_true", help="those without faults as well")
    args = parser.parse_args()
    start = time.perf_counter()
    counts = run(args.scenes, args.units, lambda text: print(text, flush=True), args.verbose)
    seconds = time.perf_counter() - start
    if COMM.rank == 0:
        words = ", ".join(f"{count} {word}" for word, count in counts.items())
        print(f"{len(args.scenes)} scenes on {COMM.size} rank(s): {words}; {seconds:.1f} s")
    sys.exit(min(counts["FAULT"], 1))


if __name__ == "__main__":
    main()
