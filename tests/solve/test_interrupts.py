"""Ctrl-C during solves and steps: all ranks stop, the state is restored, the next solve works."""

import functools
import signal
import threading

import numpy as np
import pytest
from interrupted import SCENES, Blocks, run
from scenes import WORLD
from step_scenes import Upset, same

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.linear.stop import EVERY


@pytest.fixture(autouse=True)
def python_handler():
    """Set Python's handler of SIGINT, since background jobs of a shell ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    after = signal.signal(signal.SIGINT, before)
    assert after is signal.default_int_handler


def last():
    return WORLD.rank == WORLD.size - 1


def raised(call):
    """Names of the exceptions that the ranks raise, None without one."""
    found = None
    try:
        call()
    except BaseException as error:
        found = type(error).__name__
    return WORLD.allgather(found)


def press():
    """Send Ctrl-C to the last rank."""
    if last():
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("name", SCENES)
def test_random_moments(name):
    """Ctrl-C on one rank or on all ends the solve; at most one of the interrupts comes too late."""
    assert run(name, 3, 0)[0] <= 1


def test_long_linear_solve():
    """The Krylov solver ends within a few iterations, and then has its iteration limit again."""
    options = {"ksp_type": "cg", "pc_type": "none", "ksp_rtol": 1e-10, "ksp_max_it": 5000}
    scene = Blocks(petsc_options=options, solver="auto")
    scene.set(1.0)
    ksp, seen = scene.problem.snes.getKSP(), []

    def monitor(ksp, iteration, norm):
        seen.append(iteration)
        if len(seen) == 20:
            press()

    ksp.setMonitor(monitor)
    assert raised(scene.go) == ["KeyboardInterrupt"] * WORLD.size
    assert len(seen) <= 20 + EVERY
    scene.go()
    assert len(seen) > 200 and ksp.getTolerances()[3] == 5000


def test_second_one_is_handled_at_once():
    """A second Ctrl-C ends a callback that hangs, and the state before the step is restored."""
    case = Upset(drive=lambda t, dt: None)
    case.stepper.step()
    before, reached = case.state(), []

    def drive(t, dt):
        signal.raise_signal(signal.SIGINT)
        reached.append("first")
        signal.raise_signal(signal.SIGINT)
        reached.append("second")

    case.stepper.drive = drive
    assert raised(case.stepper.step) == ["KeyboardInterrupt"] * WORLD.size
    assert reached == ["first"] and same(before, case.state())


@pytest.mark.one_rank
@pytest.mark.parametrize(
    "solver, name",
    [
        ("direct", "residual"),
        ("direct", "matrix"),
        ("direct", "rebuild"),
        ("amg", "matrix"),
        ("amg", "have_vertices_changed"),
    ],
)
def test_second_one_in_the_midst_of_assembly(solver, name):
    """After a second Ctrl-C during assembly the problem can still be solved."""
    scene, twin = Blocks(solver=solver), Blocks(solver=solver)
    twin.set(1.0)
    twin.go()
    scene.set(1.0)
    owner = owner_of(scene, name)
    method = getattr(owner, name)

    def twice(*args):
        out = method(*args)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        return out

    setattr(owner, name, twice)
    before = [u.x.array.copy() for u in scene.problem.u]
    assert raised(scene.go) == ["KeyboardInterrupt"] * WORLD.size
    assert same(before, [u.x.array for u in scene.problem.u])
    delattr(owner, name)
    scene.go()
    for u, expected in zip(scene.problem.u, twin.problem.u, strict=True):
        np.testing.assert_allclose(u.x.array, expected.x.array, atol=1e-9)


def owner_of(scene, name):
    """Object that has this method: body 0, or the system."""
    problem = scene.problem
    of_body = name in ("residual", "matrix")
    return problem.bodies[0] if of_body else problem.system


def test_handler_of_the_program():
    """The program's handler is called once; if it does not raise, the solve continues."""
    scene, twin, calls = Blocks(), Blocks(), []
    twin.set(1.0)
    twin.go()

    def own(number, frame):
        calls.append(number)

    signal.signal(signal.SIGINT, own)
    evaluate = scene.problem.bodies[0].residual
    count = []

    def pressing(x):
        count.append(1)
        if len(count) == 3:
            press()
        return evaluate(x)

    scene.problem.bodies[0].residual = pressing
    scene.set(1.0)
    scene.go()
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is own
    assert calls == ([signal.SIGINT] if last() else []) and scene.problem.num_restarts == 0
    for a, b in zip(scene.shown(), twin.shown(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_handler_that_raises_something_else():
    """The rank whose handler raises gets its exception, the others KeyboardInterrupt."""
    scene = Blocks()
    evaluate = scene.problem.bodies[0].residual

    def own(number, frame):
        raise SystemExit(3)

    count = []

    def pressing(x):
        count.append(1)
        if len(count) == 1:
            press()
        return evaluate(x)

    signal.signal(signal.SIGINT, own)
    scene.problem.bodies[0].residual = pressing
    names = raised(scene.go)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert names == ["KeyboardInterrupt"] * (WORLD.size - 1) + ["SystemExit"]


def test_other_threads():
    """Signals belong to the main thread: a solve in another thread does not change the handler."""
    scene, handlers = Blocks(), []
    evaluate = scene.problem.bodies[0].residual

    def watching(x):
        handlers.append(signal.getsignal(signal.SIGINT))
        return evaluate(x)

    scene.problem.bodies[0].residual = watching
    scene.set(1.0)
    thread = threading.Thread(target=scene.go)
    thread.start()
    thread.join()
    assert handlers and all(handler is signal.default_int_handler for handler in handlers)
    scene.problem.bodies[0].residual = evaluate
    scene.go()


def test_continuation():
    """Ctrl-C during a continuation also restores the parameter."""
    case = Upset(drive=lambda t, dt: None)
    case.tool.displacement = [0.0, -0.02]
    count, solve = [], case.problem.solve

    def pressing():
        count.append(1)
        if len(count) == 2:
            press()
        return solve()

    case.problem.solve = pressing
    m = fem.Constant(case.mesh, 1.0)
    before = case.state()
    path = functools.partial(qs.solve_with_continuation, case.problem, m, 0.1)
    assert raised(path) == ["KeyboardInterrupt"] * WORLD.size
    assert m.value == 1.0 and same(before, case.state())


# --- Other signals, and callbacks that raise


class Stop(Exception):
    """Exception of the program itself."""


@pytest.fixture
def alarm():
    """Install a SIGALRM handler that raises; yields a function that sends it on the last rank."""

    def handler(number, frame):
        raise Stop("late")

    before = signal.signal(signal.SIGALRM, handler)
    yield lambda: signal.raise_signal(signal.SIGALRM) if last() else None
    assert signal.signal(signal.SIGALRM, before) is handler


def stops(call):
    """All ranks raise: the rank with the alarm its own error, the others KeyboardInterrupt."""
    assert raised(call) == ["KeyboardInterrupt"] * (WORLD.size - 1) + ["Stop"]


@pytest.mark.parametrize(
    "solver, moment",
    [
        *(("direct", moment) for moment in ("residual", "matrix", "snes")),
        *(("amg", moment) for moment in ("residual", "matrix", "have_vertices_changed", "ksp")),
    ],
)
def test_alarm_inside_of_petsc(alarm, solver, moment):
    """An exception from a handler is raised on all ranks together.

    Then the state is as before, and the problem can be solved.
    """
    options = {"enforcement": "augmented-lagrangian"} if solver == "amg" else {}
    scene, twin = Blocks(solver=solver, **options), Blocks(solver=solver, **options)
    on = [True]

    def monitor(ksp, iteration, norm):
        if on:
            alarm()

    if moment == "ksp":
        scene.problem.snes.getKSP().setMonitor(monitor)
    elif moment == "snes":
        scene.problem.snes.setMonitor(monitor)
    else:
        owner = owner_of(scene, moment)
        method = getattr(owner, moment)

        def late(*args):
            out = method(*args)
            monitor(None, 0, 0.0)
            return out

        setattr(owner, moment, late)
    for case in (scene, twin):
        case.set(1.0)
    before = scene.shown()
    stops(scene.go)
    assert same(before, scene.shown())
    on.clear()
    scene.go()
    twin.go()
    for a, b in zip(scene.shown(), twin.shown(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("error", (Stop("own"), KeyboardInterrupt("own"), SystemExit(3)))
@pytest.mark.parametrize("of", ("snes", "ksp"))
def test_monitors_that_raise(of, error):
    """An error of a user's monitor on all ranks is raised unchanged, not as an error of PETSc."""
    scene, on = Blocks(solver="direct" if of == "snes" else "amg"), [True]
    scene.set(1.0)

    def monitor(solver, iteration, norm):
        if on and iteration == (of == "snes"):
            raise error

    snes = scene.problem.snes
    (snes if of == "snes" else snes.getKSP()).setMonitor(monitor)
    before = [u.x.array.copy() for u in scene.problem.u]
    with pytest.raises(type(error)) as caught:
        scene.go()
    assert caught.value is error and same(before, [u.x.array for u in scene.problem.u])
    on.clear()
    scene.go()
    assert scene.problem.contacts[0].force("slave")[1] != 0


@pytest.mark.parametrize("where", ("drive", "on_solved"))
@pytest.mark.parametrize("kind", (KeyboardInterrupt, SystemExit, Stop))
def test_callbacks_of_steps_that_raise(where, kind):
    """If a callback raises on one rank, all ranks raise; the step is reset and can be repeated."""
    case = Upset()
    case.stepper.step()
    before, drive = case.state(), case.stepper.drive

    def fail(*args):
        if last():
            raise kind("own")

    setattr(case.stepper, where, fail)
    name = kind.__name__
    others = "RuntimeError" if kind is Stop else name
    assert raised(case.stepper.step) == [others] * (WORLD.size - 1) + [name]
    assert same(before, case.state())
    case.stepper.drive, case.stepper.on_solved = drive, None
    case.stepper.step()
    assert case.stepper.num_steps == 2


def test_limit_of_time_in_a_callback(alarm):
    """An exception that the user's callback raises and catches has no effect outside."""
    case, caught = Upset(), []

    def drive(t, dt):
        case.move(t, dt)
        try:
            alarm()
        except Stop:
            caught.append(t)

    case.stepper.drive = drive
    case.stepper.step()
    assert len(caught) == (1 if last() else 0) and case.stepper.num_steps == 1
