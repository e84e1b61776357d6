"""Count the Newton iterations of demos.

Printed are the iterations of each step in the median, at 90 % and at worst, and their sum, all
attempts and repeated contact detections included, and the number of steps that were cut back; the
last line has the totals of all scenes.

    python3 bench/one_newton.py [--scenes block roller …] [--constraints points]
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
    "fold": ("fold.py",),
    "cattaneo-mindlin": ("cattaneo_mindlin.py",),
    "wedge": ("sliding_wedge.py",),
    "ring": ("ring_compression.py",),
    "upset cylinder": ("upset_cylinder.py",),
    "shaft": ("shaft.py",),
    "closed die": ("closed_die.py",),
    "forging": ("forging.py",),
    "press fit": ("engineering/press_fit.py",),
    "gear pair": ("engineering/gear_pair.py",),
    "o-ring, engineering": ("engineering/oring.py",),
    "STL forging": ("engineering/stl_forging.py",),
}


class Counted:
    """Counts the iterations of all solves of problems that are made inside the block.

    Args:
        constraints: Constraints of overlay contacts in small sliding that do not name any; or None.
    """

    def __init__(self, constraints):
        self.constraints = constraints
        #: Iterations of each step or solve, including those of failed attempts.
        self.steps, self.cutbacks, self._within = [], 0, None

    @contextlib.contextmanager
    def counting(self):
        """Count all solves inside the block."""
        solve, step, make = qs.ContactProblem.solve, qs.TimeStepper.step, qs.Contact.__init__

        def counted(problem, *args):
            before = 0 if self._within is None else self._within
            try:
                found = solve(problem, *args)
            finally:
                count = before + problem.num_iterations
                self._within, count = (count, 0) if self._within is not None else (None, count)
            if self._within is None:
                self.steps.append(count)
            return found

        def stepped(stepper, *args, **kwargs):
            cutbacks, self._within = stepper.num_cutbacks, 0
            out = step(stepper, *args, **kwargs)
            self.steps.append(self._within)
            self._within = None
            self.cutbacks += stepper.num_cutbacks - cutbacks
            return out

        def made(contact, *args, **kwargs):
            overlay = kwargs.get("quadrature", "overlay") == "overlay"
            if self.constraints and overlay and kwargs.get("sliding", "small") == "small":
                kwargs.setdefault("constraints", self.constraints)
            make(contact, *args, **kwargs)

        qs.ContactProblem.solve, qs.TimeStepper.step = counted, stepped
        qs.Contact.__init__ = made
        try:
            yield self
        finally:
            qs.ContactProblem.solve, qs.TimeStepper.step = solve, step
            qs.Contact.__init__ = make


def run(arguments, constraints):
    """Run a demo; return the counts, how it ended, and seconds."""
    script, began = DEMOS / arguments[0], time.perf_counter()
    kept, sys.argv = sys.argv, [str(script), *arguments[1:]]
    sys.path.insert(0, str(DEMOS))
    end = ""
    with Counted(constraints).counting() as counted, contextlib.redirect_stdout(io.StringIO()):
        try:
            runpy.run_path(str(script), run_name="__main__")
        except SystemExit:
            pass
        except qs.StepError as error:
            end = type(error).__name__
        finally:
            sys.argv = kept
    return counted, end, time.perf_counter() - began


def line(name, counted, end, seconds):
    """Return a line of the table."""
    steps = counted.steps or [0]
    found = f"{np.median(steps):.0f} | {np.percentile(steps, 90):.0f} | {max(steps)} | {sum(steps)}"
    return (
        f"| {name} | {len(steps)} | {found} | {counted.cutbacks} | {seconds:.1f} "
        f"| {end or 'ended'} |"
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--constraints", choices=("nodes", "points"))
    given = parser.parse_args()
    show = print if MPI.COMM_WORLD.rank == 0 else lambda *_: None
    show("| scene | steps | median | 90 % | worst | all | cut back | s | |")
    show("|---|---|---|---|---|---|---|---|---|")
    warnings.simplefilter("ignore")
    every, began = Counted(given.constraints), time.perf_counter()
    for name in given.scenes:
        counted, end, seconds = run(SCENES[name], given.constraints)
        every.steps += counted.steps
        every.cutbacks += counted.cutbacks
        show(line(name, counted, end, seconds))
    show(line("all", every, "", time.perf_counter() - began))


if __name__ == "__main__":
    main()
