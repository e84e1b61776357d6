"""What Newton's method has beside its iteration: where it fires, and which test fails without it.

The first command counts, for each remedy, how often it fires in scenes of ``bench/one_newton.py``.
The second one runs each remedy's test without it, and prints whether that fails, as it should.

    python3 bench/remedies.py [--scenes block ironing …]
    python3 bench/remedies.py --without
"""

import argparse
import collections
import dataclasses
import pathlib
import subprocess
import sys
import typing
import warnings

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parent))

import one_newton

from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.solve import at_once, balance, problem
from qsdolfinx.solve.at_once import AtOnce
from qsdolfinx.solve.one_newton import OneNewton
from qsdolfinx.solve.onset import Onset
from qsdolfinx.solve.tool_balance import ToolBalance
from qsdolfinx.system.derivative import REGULAR
from qsdolfinx.system.friction_rows import FrictionRows
from qsdolfinx.system.normal_rows import LEAST_PROXIMAL

TESTS = pathlib.Path(__file__).resolve().parents[1] / "tests"
SCENES = "block", "roller", "o-ring", "ironing", "wedge", "shaft", "o-ring, engineering"


@dataclasses.dataclass
class Remedy:
    """One of them.

    Attributes:
        name: What it does.
        owner, attribute: What is called, or read, where it fires.
        fires: Whether it has, by what the call returns and its arguments.
        without: What stands in for it where it is left out.
        test: What fails then.
        left_out: Owner and attribute for that, if others.
    """

    name: str
    owner: typing.Any
    attribute: str
    fires: typing.Callable[..., bool]
    without: typing.Any
    test: str
    left_out: tuple[typing.Any, str] | None = None


def _no(*args, **kwargs):
    return False


def _full(self, z, at, change):
    found = z + change
    return found, self.equations.evaluate(found), 1.0


REMEDIES = (
    Remedy(
        "a step is halved (line search)",
        OneNewton,
        "_search",
        lambda out, *_: out[2] < 1,
        _full,
        "solve/test_viscoplastic.py",
    ),
    Remedy(
        "steps are mixed where a law with history gives secants",
        OneNewton,
        "_mixed",
        lambda out, *_: out is not None,
        lambda *_: None,
        "contact/test_memory.py::test_bond_beyond_the_search_radius",
    ),
    Remedy(
        "a step ends where the residual forces do no more work",
        OneNewton,
        "_until_rest",
        lambda out, *_: out is not None,
        lambda *_: None,
        "problems/test_engineering_2.py::test_three_bodies",
    ),
    Remedy(
        "a solve starts again from the beginning of the step",
        AtOnce,
        "_begin_again",
        lambda *_: True,
        _no,
        "problems/test_engineering_1.py::test_a_guess_that_changes_volumes",
        (AtOnce, "_has_moved"),
    ),
    Remedy(
        "penalties are soft at first",
        OneNewton,
        "_approach",
        lambda *_: True,
        lambda self, z: z,
        "problems/test_leaf_spring.py",
    ),
    Remedy(
        "first guess: bodies in equilibrium on springs",
        at_once,
        "guess",
        lambda out, system: bool(np.any(system.x.array_r)),
        _no,
        "solve/test_first_guess.py",
    ),
    Remedy(
        "first guess: force-controlled tools in equilibrium on springs",
        ToolBalance,
        "_settle",
        lambda out, *_: out != 0,
        lambda *_: 0.0,
        "tools/test_rigid_motion.py",
    ),
    Remedy(
        "springs hold bodies while forces are unbalanced",
        balance.Balance,
        "shift",
        lambda out, *_: max(out) > REGULAR,
        property(lambda self: (REGULAR, REGULAR)),
        "sliding/test_dragged_by_a_side.py",
    ),
    Remedy(
        "active points are compliant far from a solution",
        balance.Balance,
        "proximal",
        lambda out, *_: out > LEAST_PROXIMAL,
        property(lambda self: LEAST_PROXIMAL),
        "contact/test_edges_of_tools.py::test_many_tips",
    ),
    Remedy(
        "slip counts from the contact onset",
        Onset,
        "find",
        lambda out, *_: out is None,
        lambda self, step: None,
        "friction/test_first_contact.py",
    ),
    Remedy(
        "the solve is repeated with an updated slow slip rate",
        problem.ContactProblem,
        "_has_other_rates",
        lambda out, *_: out,
        _no,
        "friction/test_first_contact.py",
    ),
    Remedy(
        "discontinuous friction has a part at the edge of contact",
        FrictionRows,
        "_filled",
        lambda out, *_: bool(np.any(out.filled.edge)),
        lambda self, found, *_: found,
        "friction/test_edge_of_contact.py",
    ),
    Remedy(
        "a direct solver replaces an iterative one",
        LinearSolver,
        "give_up",
        lambda out, *_: out,
        _no,
        "linear/test_rescue.py",
    ),
)


def counted(remedy, counts):
    """Count where it fires from now on."""
    was = vars(remedy.owner)[remedy.attribute]
    call = was.fget if isinstance(was, property) else was

    def instead(*args, **kwargs):
        out = call(*args, **kwargs)
        counts[remedy.name] += bool(remedy.fires(out, *args))
        return out

    setattr(remedy.owner, remedy.attribute, property(instead) if call is not was else instead)


def count(scenes):
    """Print how often each fires in each scene."""
    counts = collections.Counter()
    for remedy in REMEDIES:
        counted(remedy, counts)
    rows = {remedy.name: [] for remedy in REMEDIES}
    for scene in scenes:
        counts.clear()
        one_newton.run(one_newton.SCENES[scene], None)
        for name, row in rows.items():
            row.append(counts[name])
    print("| remedy | " + " | ".join(scenes) + " |\n" + "|---" * (len(scenes) + 1) + "|")
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(map(str, row)) + " |")


def leave_out(name):
    """Run a remedy's test without it, in this process."""
    import pytest

    remedy = next(each for each in REMEDIES if each.name == name)
    owner, attribute = remedy.left_out or (remedy.owner, remedy.attribute)
    setattr(owner, attribute, remedy.without)
    return pytest.main(["-q", "-x", "-p", "no:cacheprovider", str(TESTS / remedy.test)])


def main():
    """Print one of the two tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", choices=one_newton.SCENES, default=SCENES)
    parser.add_argument("--without", nargs="?", const="all")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.without is None:
        count(given.scenes)
        return
    if given.without != "all":
        sys.exit(leave_out(given.without))
    print("| without | test | |\n|---|---|---|")
    for remedy in REMEDIES:
        command = [sys.executable, __file__, "--without", remedy.name]
        said = subprocess.run(command, capture_output=True, text=True, check=False)
        failed = [line.split()[1] for line in said.stdout.splitlines() if line[:6] == "FAILED"]
        name = failed[0].rpartition("tests/")[2] if failed else remedy.test
        print(f"| {remedy.name} | {name} | {'fails' if failed else 'passes'} |", flush=True)


if __name__ == "__main__":
    main()
