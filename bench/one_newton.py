"""Newton iterations: multipliers updated around a penalty, and all unknowns in one Newton's method.

Each demo is run twice: as it is, by one Newton's method, and without it. Printed are the iterations
of each step in the median, at 90 % and at worst, their sum, all attempts included, the steps that
were cut back, the solves that one Newton's method gave up, and by how much the last contact force
differs.

    python3 bench/one_newton.py [--scenes block roller …]
"""

import argparse
import contextlib
import io
import pathlib
import runpy
import sys
import time
import warnings

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs
from qsdolfinx.solve.at_once import AtOnce

DEMOS = pathlib.Path(__file__).resolve().parents[1] / "demos"
SCENES = {
    "block": ("block_on_block.py",),
    "roller": ("rubber.py", "--scene", "roller"),
    "roller, augmented": tuple(
        "rubber.py --scene roller --enforcement augmented-lagrangian --steps 12".split()
    ),
    "o-ring": ("rubber.py", "--scene", "oring"),
    "beams": ("curved_beams.py", "--friction", "0.3"),
    "ironing": ("ironing.py",),
}


class Counted:
    """Counts the iterations of all solves of problems that are made meanwhile.

    Args:
        at_once: Whether one Newton's method solves.
    """

    def __init__(self, at_once):
        self.at_once = at_once
        #: Iterations of each step or solve, of attempts that failed, and the last force.
        self.steps, self.cutbacks, self.given_up, self.force = [], 0, 0, np.zeros(2)
        self._within = None

    @contextlib.contextmanager
    def counting(self):
        """All solves inside the block are counted."""
        solve, step, fits = qs.ContactProblem.solve, qs.TimeStepper.step, AtOnce.fits
        try_at_once = AtOnce.solve

        def counted(problem, *args):
            before = 0 if self._within is None else self._within
            try:
                found = solve(problem, *args)
            finally:
                count = before + problem.num_iterations
                self._within, count = (count, 0) if self._within is not None else (None, count)
            if self._within is None:
                self.steps.append(count)
            self._note(problem)
            return found

        def stepped(stepper, *args, **kwargs):
            cutbacks, self._within = stepper.num_cutbacks, 0
            out = step(stepper, *args, **kwargs)
            self.steps.append(self._within)
            self._within = None
            self.cutbacks += stepper.num_cutbacks - cutbacks
            return out

        def tried(solver):
            done = try_at_once(solver)
            self.given_up += not done
            return done

        qs.ContactProblem.solve, qs.TimeStepper.step, AtOnce.solve = counted, stepped, tried
        if not self.at_once:
            AtOnce.fits = False
        try:
            yield self
        finally:
            qs.ContactProblem.solve, qs.TimeStepper.step = solve, step
            AtOnce.fits, AtOnce.solve = fits, try_at_once

    def _note(self, problem):
        force = np.asarray(problem.contacts[0].force("slave"))
        if np.any(force):
            self.force = force


def run(arguments, at_once):
    """A demo; what was counted, how it ended, and seconds."""
    script, began = DEMOS / arguments[0], time.perf_counter()
    kept, sys.argv = sys.argv, [str(script), *arguments[1:]]
    sys.path.insert(0, str(DEMOS))
    end = ""
    with Counted(at_once).counting() as counted, contextlib.redirect_stdout(io.StringIO()):
        try:
            runpy.run_path(str(script), run_name="__main__")
        except SystemExit:
            pass
        except qs.StepError as error:
            end = type(error).__name__
        finally:
            sys.argv = kept
    return counted, end, time.perf_counter() - began


def line(name, who, counted, end, seconds):
    """A line of the table."""
    steps = counted.steps or [0]
    found = f"{np.median(steps):.0f} | {np.percentile(steps, 90):.0f} | {max(steps)} | {sum(steps)}"
    return (
        f"| {name} | {who} | {len(steps)} | {found} | {counted.cutbacks} | {counted.given_up} "
        f"| {seconds:.1f} | {end or 'ended'} |"
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    names = parser.parse_args().scenes
    show = print if MPI.COMM_WORLD.rank == 0 else lambda *_: None
    show("| scene | solver | steps | median | 90 % | worst | all | cut back | given up | s | |")
    show("|---|---|---|---|---|---|---|---|---|---|---|")
    warnings.simplefilter("ignore")
    for name in names:
        both = [run(SCENES[name], at_once) for at_once in (False, True)]
        for who, found in zip(("updates", "one Newton"), both, strict=True):
            show(line(name, who, *found))
        forces = [counted.force for counted, *_ in both]
        apart = np.linalg.norm(forces[1] - forces[0]) / max(np.linalg.norm(forces[0]), 1e-300)
        show(f"| {name} | last force apart by {apart:.1e} | | | | | | | | |")


if __name__ == "__main__":
    main()
