"""Send Ctrl-C at random moments: ``interrupted.py NUMBER [SEED]``, on any number of ranks.

A scene is solved for a series of loads. Each solve is interrupted once and must restore the state
before it. The next solve must give the same result as a twin scene that is not interrupted.
"""

import os
import pathlib
import signal
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from scenes import WORLD, Pair, clamp, drag_top, plane, vector_space
from step_scenes import Upset, same

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import multipliers

#: Displacements over a load cycle, as fractions of the largest one.
LOADS = (0.5, 1.0, 0.3, 0.8)

#: Tolerance of the difference from the twin, relative to the largest value.
TOLERANCE = 1e-6


class Scene:
    """A problem that is solved for a series of loads."""

    def shown(self):
        """Return all values that an interrupted solve must leave unchanged."""
        out = [u.x.array for u in self.problem.u]
        out += [u.function_space.mesh.geometry.x for u in self.problem.u]
        for contact in self.problem.contacts:
            out += multipliers.on_nodes(contact.model.parts)
            out += [np.nan_to_num(contact.gap())]
            if contact.model.penalty.value is not None:  # the problem has been solved
                out += [contact.multiplier(), contact.force("slave")]
            tool = contact.master
            if isinstance(tool, qs.RigidSurface):
                out += [tool.position, tool.displacement, tool.rotation]
        return [np.array(array) for array in out]


class Blocks(Scene):
    """Two linear blocks."""

    def __init__(self, friction=None, load=0.1, solver="direct", petsc_options=None, **contact):
        options = {"contact_options": {"friction": friction, **contact}, "wave": 0.0}
        self.pair = Pair("triangle", "master-slave", n=(14, 11), penalty="auto", **options)
        self.problem = self.pair.problem(solver=solver, petsc_options=petsc_options)
        self.load, self.drag = load, 0.0 if friction is None else 0.05
        self.shift = 0.0

    def set(self, load):
        """Set the load of the next solve."""
        self.shift += self.drag * (load - 0.4)
        drag_top(self.pair, self.shift, -self.load * load)

    def go(self):
        """Solve."""
        self.problem.solve()


class Tool(Scene):
    """A neo-Hookean block under a tilted plane.

    Args:
        force: Whether a force drives the plane.
    """

    def __init__(self, force=False, **contact):
        msh = mesh.create_rectangle(WORLD, [[0, 0], [1, 1]], [10, 10])
        V = vector_space(msh)
        u = fem.Function(V)
        F = ufl.inner(qs.materials.neo_hookean(u, 1.0, 0.3), ufl.grad(ufl.TestFunction(V))) * ufl.dx
        self.tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.05, -1.0])
        top = qs.Surface(V, facets=plane(msh, 1, 1.0))
        bc = clamp(V, plane(msh, 1, 0.0))
        self.problem = qs.ContactProblem([F], [u], [qs.Contact(top, self.tool, **contact)], [[bc]])
        self.force = force

    def set(self, load):
        """Set the load of the next solve."""
        if self.force:
            self.tool.drive(0.1 * load, [0.0, -1.0])
        else:
            self.tool.displacement = [0.0, -0.2 * load]

    def go(self):
        """Solve."""
        self.problem.solve()


class Steps(Scene):
    """A viscous block on an elastic die, pressed in time steps."""

    def __init__(self, **stepping):
        self.case = Upset(die=True, n=6, dt=0.02, **stepping)
        self.problem = self.case.problem

    def set(self, load):
        """Set the length of the next step."""
        self.case.stepper.dt = self.case.stepper.dt_max * (0.5 + load) / 1.5

    def go(self):
        """Make a step."""
        self.case.stepper.step()

    def shown(self):
        """Return the values of the problem and of the stepper."""
        stepper = self.case.stepper
        return [*super().shown(), np.array([stepper.t, stepper.num_steps]), *stepper.rates]


SCENES = {
    "linear": Blocks,
    "linear, amg": lambda: Blocks(solver="amg"),
    "penalty": lambda: Blocks(enforcement="penalty"),
    "friction": lambda: Blocks(friction=qs.Coulomb(0.3)),
    "friction, amg": lambda: Blocks(friction=qs.Coulomb(0.3), solver="amg"),
    "neo-Hookean": Tool,
    "driven": lambda: Tool(force=True),
    "steps": Steps,
    "steps, paired twice": lambda: Steps(num_pairings=2),
}


class CtrlC:
    """Send a SIGINT to this rank after some time, if it is in the block then."""

    def __init__(self, delay):
        self.delay, self.sent = delay, False

    def __enter__(self):
        self._before = signal.signal(signal.SIGALRM, self._send)
        if self.delay is not None:
            signal.setitimer(signal.ITIMER_REAL, self.delay)
        return self

    def __exit__(self, *error):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, self._before)

    def _send(self, number, frame):
        # Not before and after the solve, where Python would raise on this rank only.
        if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            self.sent = True
            os.kill(os.getpid(), signal.SIGINT)


def interrupt(scene, delays):
    """Return whether any rank got Ctrl-C, and what each rank raised; ``None`` for nothing."""
    found = None
    with CtrlC(delays[WORLD.rank]) as ctrl_c:
        try:
            scene.go()
        except BaseException as error:
            found = type(error).__name__
    return WORLD.allreduce(ctrl_c.sent), WORLD.allgather(found)


def run(name, number, seed):
    """Interrupt ``number`` solves of a scene; return how many interrupts came too late."""
    rng = np.random.default_rng([seed, *name.encode()])
    scene, twin = SCENES[name](), SCENES[name]()
    late = hits = tries = 0
    while hits < number:
        assert tries < 20 * number + 20, "Ctrl-C never came during a solve"
        load = LOADS[tries % len(LOADS)]
        scene.set(load)
        twin.set(load)
        before, start = scene.shown(), time.perf_counter()
        twin.go()
        took = WORLD.bcast(time.perf_counter() - start)
        delay = 1e-6 + took * float(rng.uniform(0, 1))
        chosen = [(True, False), (False, True), (True, True)][rng.integers(3)]
        delays = [
            delay if chosen[rank % 2] or WORLD.size == 1 else None for rank in range(WORLD.size)
        ]
        sent, raised = interrupt(scene, delays)
        tries += 1
        if sent and WORLD.size > 1 and not any(raised):
            # It came to one rank after the others had finished: it waits for the next solve.
            late, sent, now = late + 1, 0, scene.shown()
            assert interrupt(scene, [None] * WORLD.size)[1] == ["KeyboardInterrupt"] * WORLD.size
            assert same(now, scene.shown())
        assert raised == ["KeyboardInterrupt" if sent else None] * WORLD.size, (sent, raised)
        done = not sent
        if sent:
            hits += 1
            if not same(before, scene.shown()):
                late, done = late + 1, True
        if not done:
            scene.go()
        for i, (a, b) in enumerate(zip(twin.shown(), scene.shown(), strict=True)):
            scale = max(WORLD.allreduce(float(np.abs(a).max(initial=0.0)), op=max), 1e-3)
            assert np.all(np.abs(a - b) <= TOLERANCE * scale), (i, np.abs(a - b).max(), scale)
    return late, tries


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    total, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    each = -(-total // len(SCENES))
    for name in SCENES:
        late, tries = run(name, each, seed)
        if WORLD.rank == 0:
            print(
                f"{name:26s} {each} interrupted, {tries} solves, {late} at the very end", flush=True
            )
