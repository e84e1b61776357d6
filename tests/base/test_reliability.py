"""Causes that end a run early: exceptions on one rank, Ctrl-C, a full disk, a killed process.

Programs are started on one and two ranks, if the suite itself runs on one rank.
"""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from scenes import WORLD, Pair, drag_top, elastic, raises_everywhere
from step_scenes import Upset, refuse, same

import ufl
from dolfinx import fem

import qsdolfinx as qs

PROGRAMS = pathlib.Path(__file__).resolve().parent / "reliability_runs.py"

#: Time limit (seconds) after which a program counts as hanging.
LIMIT = 120

RANKS = [1, pytest.param(2, marks=pytest.mark.skipif(not shutil.which("mpirun"), reason="mpirun"))]

TWO = [pytest.param(1, marks=pytest.mark.long), RANKS[1]]

alone = pytest.mark.one_rank


def on_last_rank(error):
    """Raise an error on the last rank alone."""
    if WORLD.rank == WORLD.size - 1:
        raise error


# --- Callbacks


def shown(case):
    """All results that contacts show."""
    out = []
    for contact in case.contacts:
        out += [
            contact.gap(),
            contact.weighted_gap(),
            contact.multiplier(),
            contact.force("slave"),
            contact.moment("slave"),
        ]
        out += [contact.traction("slave").x.array.copy(), contact.active(), contact.slave.node_x]
        out += [contact.pairing.slave.x, contact.pairing.gap, contact.pairing.normal]
        out += [
            np.array([contact.penetration(), contact.stored_energy(), contact.penalty, contact.dt])
        ]
        if contact.friction is not None:
            out += [contact.slip(), contact.tangential_multiplier(), contact.slipping()]
            out += [contact.dissipation(), np.array([contact.dissipated_energy()])]
    return [np.nan_to_num(a, nan=-1.0) for a in out]


@pytest.mark.parametrize("friction", [None, qs.Coulomb(0.2)], ids=["smooth", "rough"])
@pytest.mark.parametrize("enforcement", ["penalty", "augmented-lagrangian"])
@pytest.mark.parametrize("die", [False, True])
def test_results_after_a_failed_step(friction, enforcement, die):
    """After a failed step contacts show the last valid state exactly, and the run continues.

    The failed step has no effect on it.
    """
    fails = []

    def solve(step):
        case.problem.solve()
        if fails:
            refuse()

    contact = {"friction": friction, "enforcement": enforcement}
    case = Upset(die=die, dt=0.04, dt_min=0.01, solve=solve, contact=contact)
    for _ in range(2):
        case.stepper.step()
    state, before = case.state(), shown(case)
    fails.append(True)
    raises_everywhere(WORLD, qs.StepError, "dt_min = 0.01", case.stepper.step)
    assert same(state, case.state())
    assert same(before, shown(case))
    fails.clear()
    case.stepper.step()
    straight = Upset(die=die, dt=0.04, contact=contact)
    for _ in range(3):
        straight.stepper.step()
    np.testing.assert_allclose(case.forces(), straight.forces(), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("place", ["drive", "on_solved", "motion"])
def test_callbacks_on_one_rank(place):
    """An exception, or another motion of a tool, on one rank alone fails on all ranks.

    The state is kept.
    """
    broken = []

    def drive(t, dt):
        case.move(t, dt)
        if broken and place == "drive":
            on_last_rank(ValueError("load table"))
        if broken and place == "motion" and WORLD.rank == WORLD.size - 1:
            case.tool.displacement = [0.0, np.nan]

    def on_solved():
        if broken:
            on_last_rank(ValueError("load table"))

    case = Upset(dt=0.04, drive=drive)
    if place == "on_solved":
        case.stepper.on_solved = on_solved
    case.stepper.step()
    state, before = case.state(), shown(case)
    broken.append(True)
    match = "displacement" if place == "motion" else "load table"
    raises_everywhere(WORLD, ValueError, match, case.stepper.step)
    assert same(state, case.state()) and same(before, shown(case))
    broken.clear()
    case.stepper.step()
    assert case.stepper.num_steps == 2 and case.stepper.num_cutbacks == 0


class Broken(qs.Unilateral):
    """A contact law that fails on one rank, during Newton's method."""

    def __init__(self):
        self.calls = 0

    def multiplier(self, gap, penalty):
        self.calls += 1
        if self.calls == 4:
            on_last_rank(ValueError("this law"))
        return super().multiplier(gap, penalty)


class BrokenFriction(qs.Coulomb):
    """A friction law that fails on one rank, during Newton's method."""

    calls = 0

    def respond(self, rows):
        self.calls += 1
        if self.calls == 4:
            on_last_rank(ValueError("this law"))
        return super().respond(rows)


class BrokenEnergy(qs.Coulomb):
    """A friction law that fails on one rank when the energy of the solve is computed."""

    calls = 0

    def growth(self, rows):
        self.calls += 1
        if self.calls == 1:
            on_last_rank(ValueError("this law"))
        return super().growth(rows)


@pytest.mark.parallel
@pytest.mark.parametrize("kind", ["law", "friction", "energy"])
def test_laws_on_one_rank(kind):
    """If a law fails on one rank, the unknowns are as before, and the next solve succeeds."""
    law = Broken() if kind == "law" else qs.Unilateral()
    friction = {"friction": BrokenFriction(0.2), "energy": BrokenEnergy(0.2)}.get(kind)
    options = {"friction": friction, "enforcement": "augmented-lagrangian"}
    pair = Pair("triangle", law=law, gap=0.02, contact_options=options)
    problem = pair.problem()
    raises_everywhere(WORLD, ValueError, "this law", problem.solve)
    assert not any(WORLD.allreduce(bool(np.any(u.x.array))) for u in pair.u)
    problem.solve()
    reference = Pair(
        "triangle", gap=0.02, contact_options={"friction": friction and qs.Coulomb(0.2)}
    )
    reference.problem().solve()
    expected = reference.contact.force("slave")
    np.testing.assert_allclose(pair.contact.force("slave"), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("where", ["guess", "condition", "load", "stiffness"])
@pytest.mark.parametrize("penalty", [30.0, "auto"])
@pytest.mark.parametrize("law", [qs.Unilateral(), qs.Tied()], ids=["unilateral", "tied"])
def test_not_a_number(where, penalty, law):
    """NaN raises an error without a hang in the factorisation; the unknowns stay."""
    pair = Pair("triangle", penalty=penalty, law=law)
    bad = fem.Constant(pair.meshes[1], np.nan)
    if where == "guess":
        pair.u[1].x.array[:] = np.nan
    elif where == "condition":
        drag_top(pair, np.nan)
    elif where == "load":
        pair.F[1] = elastic(pair.u[1], force=ufl.as_vector([0.0, bad]))
    else:
        pair.F[1] = elastic(pair.u[1], E=bad)
    before = [u.x.array.copy() for u in pair.u]
    errors = qs.ConvergenceError, ValueError
    raises_everywhere(WORLD, errors, "", pair.problem().solve)
    for u, array in zip(pair.u, before, strict=True):
        np.testing.assert_array_equal(u.x.array, array)


def test_fields_on_one_rank(tmp_path_factory):
    folder = pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("fields")), root=0))
    case = Upset()
    broken = []

    def field():
        velocity = case.w.sub(0).collapse()  # collective, so all ranks must take part
        if broken:
            on_last_rank(ValueError("this field"))
        return velocity

    writer = qs.FieldWriter(folder / "a.xdmf", case.mesh, {"v": field})
    writer.write(0.0)
    broken.append(True)
    raises_everywhere(WORLD, ValueError, "this field", lambda: writer.write(1.0))
    broken.clear()
    writer.write(1.0)
    writer.close()


def test_penalty_that_was_set_is_restored(tmp_path_factory):
    """A penalty that was set during the run is restored; an automatic penalty stays automatic."""
    folder = pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0)) / "state"
    penalty = {"enforcement": "penalty", "penalty": 50.0}
    case = Upset(dt=0.02, contact=penalty)
    case.stepper.step()
    case.contacts[0].set_penalty(80.0)
    case.stepper.step()
    qs.save_run(case.stepper, folder)
    case.stepper.step()
    again = Upset(dt=0.02, contact=penalty)
    qs.load_run(again.stepper, folder)
    assert [c.penalty for c in again.contacts] == [80.0, 50.0]
    again.stepper.step()
    np.testing.assert_allclose(again.forces(), case.forces(), rtol=1e-12)
    automatic = Upset(dt=0.02)
    automatic.stepper.step()
    qs.save_run(automatic.stepper, folder)
    qs.load_run(again.stepper, folder)
    qs.load_run(automatic.stepper, folder)
    assert [c.model.penalty.automatic for c in automatic.contacts] == [True, True]


# --- Programs


def start(name, folder, ranks=1):
    """Start one of the programs, so that it can be killed with all its children."""
    command = [sys.executable, str(PROGRAMS), name, str(folder)]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    mpi = "PMIX_", "OMPI_COMM_", "OMPI_UNIVERSE_", "PMI_"
    environment = {k: v for k, v in os.environ.items() if not k.startswith(mpi)}
    return subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # Background jobs of a shell, and their children, would ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


class Hang(AssertionError):
    """A program did not end in time."""


def finish(process, until=None, then=None):
    """Exit code and output of a program; ``then`` is called when a line starts with ``until``."""
    hangs = threading.Event()

    def kill():
        hangs.set()
        os.killpg(process.pid, signal.SIGKILL)

    timer = threading.Timer(LIMIT, kill)
    timer.start()
    lines = []
    for line in process.stdout:
        lines.append(line)
        if until is not None and line.startswith(until):
            until = then()
    code = process.wait()
    timer.cancel()
    text = "".join(lines)
    if hangs.is_set():
        raise Hang(text)
    return code, text


def run(name, folder, ranks=1):
    return finish(start(name, folder, ranks))


@alone
@pytest.mark.parametrize("ranks", RANKS)
def test_exception_that_nobody_catches(tmp_path, ranks):
    """If ``drive`` raises on one rank and nothing catches it, all ranks end with the error."""
    code, text = run("thrown", tmp_path, ranks)
    assert code == 1, text
    assert text.count("KeyError: 'load table'") >= 1, text


@alone
@pytest.mark.parametrize("ranks", RANKS)
@pytest.mark.parametrize(
    "name",
    [
        *("no_space", "no_unknowns"),
        *(pytest.param(n, marks=pytest.mark.long) for n in ("no_communicator", "no_slave")),
    ],
)
def test_no_communicator_on_one_rank(tmp_path, name, ranks):
    """A rank without communicator raises alone, and this ends all ranks."""
    code, text = run(name, tmp_path, ranks)
    assert code == 1 and "TypeError: " in text and "must be" in text, text
    assert ranks == 1 or "rank 1 has failed alone: ending all" in text, text


@alone
def test_interrupt(tmp_path):
    """Ctrl-C in the middle of a step restores the state before, and the run continues from it."""
    code, text = run("interrupted", tmp_path)
    assert code == 0 and "as before\n" in text and "went on\n" in text, text


@alone
@pytest.mark.parametrize("ranks", RANKS)
def test_interrupt_from_outside(tmp_path, ranks):
    """Ctrl-C that is not caught ends the program with an error."""
    process = start("endless", tmp_path, ranks)
    code, text = finish(process, "ready", lambda: process.send_signal(signal.SIGINT))
    assert code != 0, text
    assert ranks > 1 or "KeyboardInterrupt" in text


@alone
@pytest.mark.parametrize("ranks", TWO)
def test_killed_during_a_checkpoint(tmp_path, ranks):
    """After a kill, the previous checkpoint is found on one rank and on two.

    The next checkpoint replaces it.
    """
    code, text = run("killed", tmp_path, ranks)
    assert code in (-signal.SIGKILL, 128 + signal.SIGKILL), (code, text)
    assert (tmp_path / "state.new").exists()
    code, text = run("loaded", tmp_path)
    assert code == 0 and "step 1 2\n" in text, text
    code, text = run("saved_again", tmp_path, ranks)
    assert code == 0 and "step 5\n" in text, text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["state"]


@alone
@pytest.mark.parametrize("ranks", TWO)
def test_full_disk(tmp_path, ranks):
    """On a full disk each writer raises an error, and earlier files stay."""
    code, text = run("full_disk", tmp_path, ranks)
    assert code == 0, text
    for name in ("checkpoint", "table", "fields"):
        # DOLFINx ignores the error if HDF5 (2.2: sid) writes a dataset only when closing it.
        printed = name == "fields" and "H5Dclose" in text and "file write failed" in text
        assert f"{name} refused" in text or printed, text
    assert "left ['fields.h5', 'fields.xdmf', 'run.csv', 'state']" in text, text
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 2
    code, text = run("loaded", tmp_path)
    assert code == 0 and "step 1 2\n" in text, text
