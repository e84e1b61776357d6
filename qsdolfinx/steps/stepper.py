"""Time steps for displacement-based and velocity-based bodies, with contact detection."""

from __future__ import annotations

import functools
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import (
    CALLABLE,
    COUNT,
    FINITE,
    FLAG,
    FRACTION,
    POSITIVE,
    check,
    either,
    instance,
    number,
    require,
)
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.messages import during, say
from qsdolfinx.base.progress import progress as progress_bar
from qsdolfinx.contact.chosen_sliding import let_follow
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.no_value import NoValueError
from qsdolfinx.pairing.curved import CurvedError
from qsdolfinx.solve.diagnostics import OF_A_STEP, diagnose
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.solve.snes import ConvergenceError, in_smallest_step
from qsdolfinx.steps.end_of_step import Place, pair_at
from qsdolfinx.steps.hand_over import HandOver, RemeshingReport
from qsdolfinx.steps.mesh_motion import MeshMotion, check_own_meshes
from qsdolfinx.steps.pairings import DistortedError
from qsdolfinx.steps.prediction import part_of_rates
from qsdolfinx.steps.remeshing import Remeshing
from qsdolfinx.steps.scene import Scene
from qsdolfinx.steps.snapshot import Snapshot
from qsdolfinx.steps.staggered import Staggered
from qsdolfinx.steps.step_log import ACCEPTED, CUT_BACK, FAILED, Attempt, StepLog, reason_of
from qsdolfinx.steps.tool_motion import ToolRate
from qsdolfinx.tools.rigid_surface import RigidSurface, is_rigid, is_shape

Array = npt.NDArray[np.float64]

#: Largest number of updates of the contact pairs in a step in addition to the requested ones. With
#: 0, points slide on from the partners of the start of the step; more than some do not change the
#: pairs.
MORE_PAIRINGS = 3

GROWTH = number("a number of at least 1", lambda x: x >= 1)
CUTBACK = number("a number above 0 and below 1", lambda x: 0 < x < 1)

NO_REMESHING = "there is nothing to make a new mesh with: give the stepper remesh=qs.Remeshing(...)"


class StepError(RuntimeError):
    """No step could be made; the state, with results of contacts, is that after the last step."""


class _Fault(Exception):
    """Error in the solution of an attempt.

    Attributes:
        hopeless: Whether a smaller Δt would not help.
        distorted: Whether a mesh is distorted.
    """

    def __init__(self, text: str, hopeless: bool = False, distorted: bool = False) -> None:
        super().__init__(text)
        self.hopeless, self.distorted = hopeless, distorted


class _Tried(typing.NamedTuple):
    """An attempt at a step.

    Attributes:
        number: From 1 on in each step.
        t: Time at its end.
        dt: Its Δt.
        before: Newton iterations of the step before the attempt.
    """

    number: int
    t: float
    dt: float
    before: int


class TimeStepper:
    """Time stepper: steps t → t + Δt of a contact problem, with automatic control of Δt.

    A velocity-based body with velocity v is solved on its mesh at a time within the step; its mesh
    then moves: x ← x + v Δt, (2). With ``theta=0`` this is the mesh at t: the scheme of the paper,
    of order 1. With ``theta=0.5`` it is the mesh at t + Δt/2, predicted with the velocity of the
    last step: of order 2 at the same cost; the very first step is solved twice. A displacement-
    based body with total displacements u keeps its mesh as the reference configuration, so that the
    matrix of a linear body is assembled once. Contact uses its deformed configuration. In both
    cases gaps are those at the end of the step.

    If the solver does not converge, a cell turns inside out or a point penetrates too far, the step
    is made again with a smaller Δt. Any other exception, such as one of ``drive`` or of a law, is
    passed on. Then, too, the state is that at the end of the last step: unknowns, meshes, tools
    with their prescribed motion, and contacts. Each attempt is a row of :attr:`log`; an attempt
    that is cut back is logged (INFO) with its reason. A ``problem.solve()`` after a step starts
    from the end of the step: contact detection is done at the positions of bodies and tools there.

    Contacts whose ``sliding`` was not given get finite sliding in the stepper, where this is
    possible; see :class:`qs.Contact`.

    Args:
        problem: The problem. A body is velocity-based if its contacts have ``unknown="velocity"``
            for it.
        dt: First Δt, time.
        drive: Called as ``drive(t + Δt, Δt)`` before each attempt: sets loads, Dirichlet values,
            and displacements of rigid tools over the step. An exception on one rank is raised on
            all ranks, unless others wait for that rank in a collective call within ``drive``.
        solve: Called instead of ``problem.solve``, with the number of the step, from 0 on.
        theta: Part of the step, from 0 to 1, after which velocity-based bodies are solved.
        num_pairings: Least number of contact detections in a step, for contact with small sliding:
            the first at the positions predicted with the rate of the last step, the next ones at
            the solution found so far (velocity-based bodies: after the part theta of the step). Up
            to three more follow while nodes in contact are further than a twentieth of a facet
            (velocity-based bodies: a quarter) from their positions in the last contact detection.
            This happens in steps in which a tool starts, stops, or turns.
        dt_min: Smallest Δt that is tried; by default dt / 1000.
        dt_max: Largest Δt; by default dt.
        growth: Factor of Δt after a step with at most ``easy`` Newton iterations for each contact
            detection.
        cutback: Factor of Δt after a failed attempt.
        easy: Number of Newton iterations for ``growth``.
        max_penetration: Largest true depth (length) of points of either surface at the end of a
            step, in addition to the initial overclosure that is allowed. Points that have passed
            through the other surface count at any depth, also those that have left a part on its
            other side if it is thicker than a hundredth of the smallest facet. ``"auto"``: half of
            the largest facet, and no limit for ties. None: no limit.
        max_rotation: Largest rotation (radians) of rigid tools and of normals of contact surfaces
            in a step; no limit by default.
        max_slip: Largest distance that nodes in contact slide along the other surface in a step, in
            units of its facets; no limit by default.
        min_quality: Least part of its undeformed quality that a cell has to keep, see
            MeshMotion.quality_kept; a step in which one keeps less is not accepted.
        progress: Whether :meth:`run` shows a progress bar on rank 0, if tqdm is installed.
        staggered: Another problem, such as for the temperatures of the bodies, that is solved after
            the bodies in each step: see :class:`qs.Staggered`.
        remesh: When and how bodies get new meshes: at the start of a step, or when no step can be
            made because a mesh is distorted. None: no remeshing.

    Raises:
        TypeError: If the problem is of another type.
        ValueError: If a number is out of range, or differs between ranks, or two bodies are on one
            mesh.

    Attributes:
        t: Time at the end of the last step.
        dt: Δt that will be tried next; can be set, up to ``dt_max``.
        last_dt: Δt of the last step; 0 before the first step.
        num_steps: Number of steps made.
        num_cutbacks: Number of failed attempts so far.
        log: All attempts so far, one row each: ``print(stepper.log)`` is a table.
        num_iterations: Newton iterations of the last step, over its attempts and contact
            detections.
        total_iterations: Newton iterations of all steps so far, including failed attempts and
            remeshings.
        on_solved: Function without arguments that is called once in each successful step, with the
            meshes where the bodies were solved; None, the default, for no function. Can be set. An
            exception on one rank is raised on all ranks.
        remeshing: When and how bodies get new meshes; None for no remeshing.
        remeshings: Report of each remeshing, in order of time.
        remeshed_at: Number of steps made before the last remeshing; -1 before the first remeshing.
    """

    def __init__(
        self,
        problem: ContactProblem,
        dt: float,
        drive: typing.Callable[[float, float], None] | None = None,
        *,
        solve: typing.Callable[[int], object] | None = None,
        theta: float = 0.5,
        num_pairings: int = 1,
        dt_min: float | None = None,
        dt_max: float | None = None,
        growth: float = 1.5,
        cutback: float = 0.5,
        easy: int = 8,
        max_penetration: float | str | None = "auto",
        max_rotation: float | None = None,
        max_slip: float | None = None,
        min_quality: float = 0.02,
        progress: bool = False,
        staggered: Staggered | None = None,
        remesh: Remeshing | None = None,
    ) -> None:
        check(instance(ContactProblem, "a ContactProblem"), problem=problem)
        with checked(problem.comm) as same:
            check_own_meshes(problem.u)
            check(either(CALLABLE, None), drive=drive, solve=solve)
            same(POSITIVE, dt=dt)
            dt_min = dt / 1000 if dt_min is None else dt_min
            dt_max = dt if dt_max is None else dt_max
            same(POSITIVE, dt_min=dt_min, dt_max=dt_max, min_quality=min_quality)
            require(dt_min <= dt <= dt_max, "dt: must be between dt_min and dt_max")
            same(FRACTION, theta=theta)
            same(COUNT, num_pairings=num_pairings, easy=easy)
            same(GROWTH, growth=growth)
            same(CUTBACK, cutback=cutback)
            same(either(either(POSITIVE, "auto"), None), max_penetration=max_penetration)
            same(either(POSITIVE, None), max_rotation=max_rotation, max_slip=max_slip)
            same(FLAG, progress=progress)
            check(either(instance(Staggered, "a qs.Staggered"), None), staggered=staggered)
            if staggered is not None:
                staggered.check(problem)
            check(either(instance(Remeshing, "a Remeshing"), None), remesh=remesh)
            if remesh is not None:
                remesh.check(problem)
        self.drive = drive or (lambda t, dt: None)
        self._solve = solve or (lambda step: self.problem.solve())
        self.theta, self.num_pairings = float(theta), int(num_pairings)
        self.dt_min, self.dt_max = float(dt_min), float(dt_max)
        self.growth, self.cutback, self.easy = float(growth), float(cutback), int(easy)
        self.min_quality = float(min_quality)
        self.progress = bool(progress)
        if max_penetration is not None and max_penetration != "auto":
            max_penetration = float(max_penetration)
        self._limits = max_rotation, max_slip, max_penetration
        let_follow([contact.model for contact in problem.contacts])
        self._scene = self._scene_of(problem, staggered)
        if staggered is not None:
            staggered.begin()
        self.remeshing = remesh
        self.remeshings: list[RemeshingReport] = []
        self.remeshed_at = -1
        self.t = 0.0
        self.dt = float(dt)
        self.last_dt = 0.0
        self.num_steps = 0
        self.num_cutbacks = 0
        self.log = StepLog(problem.comm)
        self.num_iterations = 0
        self.total_iterations = 0
        self._num_solves = 0
        self._has_jumped = False
        self.on_solved: typing.Callable[[], None] | None = None

    def _scene_of(self, problem: ContactProblem, staggered: Staggered | None) -> Scene:
        return Scene(problem, self.theta, *self._limits, staggered)

    @property
    def problem(self) -> ContactProblem:
        """The problem; replaced by a new problem after a remeshing."""
        return self._scene.problem

    @property
    def staggered(self) -> Staggered | None:
        """The problem that is solved after the bodies; replaced by a new one after a remeshing."""
        return self._scene.staggered

    @property
    def motions(self) -> list[MeshMotion]:
        """Mesh motions of the bodies."""
        return self._scene.motions

    @property
    def tools(self) -> list[RigidSurface]:
        """Rigid tools, each once."""
        return self._scene.tools

    @property
    def in_velocity(self) -> list[bool]:
        """Whether each body is velocity-based."""
        return self._scene.in_velocity

    @property
    def rates(self) -> list[Array]:
        """Velocities of the last step: the unknowns, or the change of displacements over Δt.

        They are the initial guess of the next step; zero before the first step, and after
        a snap-through for displacements and force-controlled tools: its motion does not continue.
        """
        return self._scene.rates

    @property
    def tool_rates(self) -> list[ToolRate]:
        """Velocities of the rigid tools in the last step; see ``rates`` for driven ones."""
        return self._scene.tool_rates

    @property
    def missed(self) -> list[Array]:
        """Difference of the last step's solution and its prediction (length); at first zero."""
        return self._scene.missed

    def ends(self) -> list[tuple[ContactModel, Place, Place | None]]:
        """Each contact with the positions of its slave's and master's body between two steps."""
        places = [Place.of(*given) for given in zip(self.motions, self.in_velocity, strict=True)]
        return [
            (contact.model, places[s], None if m is None else places[m])
            for contact, (s, m) in zip(self.problem.contacts, self.problem.sides, strict=True)
        ]

    @property
    def max_penetration(self) -> float | str | None:
        """Largest depth at the end of a step."""
        return self._scene.penetration.limit

    @property
    def max_rotation(self) -> float | None:
        """Largest angle (radians) in a step."""
        return self._scene.limits.max_rotation

    @property
    def max_slip(self) -> float | None:
        """Largest slip in a step, in facets."""
        return self._scene.limits.max_slip

    # --- Steps

    def step(self, t_end: float | None = None) -> float:
        """Make one step. Collective.

        Args:
            t_end: Latest time at which the step may end.

        Returns:
            Δt of the step.

        Raises:
            StepError: If the step cannot be made, even with the smallest Δt, or a mesh is
                distorted.
            KeyboardInterrupt: After Ctrl-C, on all ranks, whichever ranks have received it; the
                state is that at the end of the last step or, if it came very late, of this step.
        """
        with checked(self.problem.comm) as same:
            same(either(FINITE, None), t_end=t_end)
        with interrupt.heeded(self.problem.comm):
            if self.remeshing is not None and self.remeshed_at != self.num_steps:
                why = self.remeshing.due(self._scene, self.steps_since_remeshing, self)
                if why is not None:
                    self._remesh(why)
            try:
                return self._step(t_end)
            except StepError as error:
                fault = error.__cause__
                distorted = isinstance(fault, _Fault) and fault.distorted
                may = self.remeshing is not None and self.remeshed_at != self.num_steps
                if not (distorted and may):
                    raise
                why = str(fault)
            self._remesh(why)
            return self._step(t_end)

    @property
    def steps_since_remeshing(self) -> int:
        """Number of steps since the last remeshing, or since the start."""
        return self.num_steps - max(self.remeshed_at, 0)

    def remesh(self, why: str = "asked for") -> RemeshingReport:
        """Remesh the bodies in their present configuration, and find equilibrium. Collective.

        Args:
            why: Reason for the remeshing, for the report.

        Returns:
            Report of the remeshing; also the last entry of :attr:`remeshings`.

        Raises:
            RemeshError: If no valid mesh can be made, with the places that cause it.
            StepError: If there is no equilibrium on the new mesh.
            RuntimeError: If the stepper was made without ``remesh``.
        """
        with checked(self.problem.comm) as same:
            require(self.remeshing is not None, NO_REMESHING, RuntimeError)
            same(instance(str, "a string"), why=why)
        with interrupt.heeded(self.problem.comm):
            return self._remesh(why)

    def _remesh(self, why: str) -> RemeshingReport:
        assert self.remeshing is not None
        old = self._scene
        handing = HandOver(self.remeshing, old, self._prepare, self._balance, self._scene_of)
        try:
            self._scene, report = handing(why, self.num_steps, self.t)
        except ConvergenceError as error:
            self._scene = old
            raise StepError(f"t = {self.t:g}: no equilibrium on the new mesh: {error}") from error
        except BaseException:
            self._scene = old
            raise
        old.problem.destroy()
        self.remeshed_at = self.num_steps
        self.remeshings.append(report)
        return report

    def _prepare(self) -> float:
        """Set loads and motions of the coming step; returns its Δt."""
        dt = min(self.dt, self.dt_max)
        with collective_errors(self.problem.comm), interrupt.user_code():
            self.drive(self.t + dt, dt)
        return dt

    def _balance(self, scene: Scene) -> None:
        """Solve the problem of a scene, with the user's function."""
        self._scene = scene
        try:
            self._solve(self.num_steps)
        finally:
            self.total_iterations += self.problem.num_iterations

    def _step(self, t_end: float | None) -> float:
        with checked(self.problem.comm) as same:
            same(POSITIVE, dt=self.dt)
        planned = dt = self._planned(t_end)
        self.num_iterations = self._num_solves = 0
        start = self._scene.snapshot()
        self._starts = self._scene.penetration.starts()
        try:
            watch = not self._scene.penetration.is_limited
            with self.problem.one_step(watch=watch, has_checks=True):
                made = self._try(t_end, dt, start)
            self._note(made, None)
        except BaseException:  # also of a law's commit, which is called at the end of the block
            self._restore(start)
            raise
        dt = made.dt
        self._accept(made.t, dt, start)
        if dt < planned:
            self.dt = dt
        elif dt >= self.dt and self.num_iterations <= self.easy * self._num_solves:
            self.dt = min(dt * self.growth, self.dt_max)
        return dt

    def _try(self, t_end: float | None, dt: float, start: Snapshot) -> _Tried:
        """Make attempts until one succeeds; returns this attempt.

        Raises:
            StepError: If none does.
        """
        number = 0
        while True:
            number += 1
            # t + (t_end - t) may differ from t_end by rounding.
            lands = t_end is not None and dt == t_end - self.t
            t = t_end if lands and t_end is not None else self.t + dt
            tried = _Tried(number, t, dt, self.num_iterations)
            try:
                with during(f"step {self.num_steps + 1}, t = {t:g}"):
                    self._attempt(t, dt, start)
                return tried
            except (ConvergenceError, NoValueError, _Fault) as error:
                hopeless = isinstance(error, _Fault) and error.hopeless
                smallest = dt * self.cutback < self.dt_min
                self._note(tried, error, hopeless or smallest)
                self._restore(start)
                self.num_cutbacks += 1
                if hopeless:
                    raise StepError(f"t = {self.t:g}: {error}") from error
                if smallest:
                    raise StepError(
                        f"t = {self.t:g}: no step with Δt of at least dt_min = {self.dt_min:g} "
                        f"succeeds; the last attempt: {self._in_smallest_step(error)}"
                    ) from error
                dt *= self.cutback

    def _in_smallest_step(self, error: Exception) -> str:
        """Message of an error at the smallest step."""
        system = self.problem.system
        masters = [contact.master for contact in system.contacts]
        shapes, tools = (all(each(m) for m in masters) for each in (is_shape, is_rigid))
        return in_smallest_step(error, shapes, tools, system.moves)

    def _note(self, tried: _Tried, error: Exception | None, is_last: bool = False) -> None:
        """Add an attempt to the log, and print a message if it is cut back. Collective."""
        system = self.problem.system
        names = [contact.called(i) for i, contact in enumerate(system.contacts)]
        reason = "" if error is None else reason_of(error, names)
        closed: typing.Sequence[int] = []
        if isinstance(error, ConvergenceError):
            closed = error.active_history[-1] if error.active_history else []
        elif not isinstance(error, NoValueError) and system.has_matrices:
            counts = np.array(system.num_active_local(), dtype=np.int64)
            closed = system.comm.allreduce(counts, op=MPI.SUM).tolist()
        result = ACCEPTED if error is None else FAILED if is_last else CUT_BACK
        iterations, step = self.num_iterations - tried.before, self.num_steps + 1
        of_attempt = step, tried.number, tried.t, tried.dt, iterations
        self.log.add(Attempt(*of_attempt, result, reason, tuple(closed)))
        if result == CUT_BACK:
            say(
                system.comm,
                f"step {step}, attempt {tried.number} from t = {self.t:g} with Δt = {tried.dt:g} "
                f"is cut back to Δt = {tried.dt * self.cutback:g} after {iterations} iterations: "
                f"{reason}",
            )

    def _restore(self, start: Snapshot) -> None:
        start.restore()
        if self.staggered is not None:
            self.staggered.restore()

    def _planned(self, t_end: float | None) -> float:
        """Δt of the first attempt; no tiny last step: the rest is one or two equal parts.

        Raises:
            ValueError: If t_end is not ahead.
        """
        dt = min(self.dt, self.dt_max)
        if t_end is None:
            return dt
        left = t_end - self.t
        require(left > 0, f"t_end: must be after t = {self.t:g}, not {t_end!r}")
        return left if left <= dt * (1 + 1e-9) else min(dt, max(left / 2, self.dt_min))

    def run(self, t_end: float) -> typing.Iterator[float]:
        """Make steps until t_end; yields the time after each step. Collective.

        Raises:
            StepError: As :meth:`step`.
        """
        with checked(self.problem.comm) as same:
            same(FINITE, t_end=t_end)
        with progress_bar(self.problem.comm, self.progress, self.t, t_end) as show:
            while t_end - self.t > 1e-9 * self.dt:
                self.step(t_end)
                show(self.t)
                yield self.t

    def _attempt(self, t: float, dt: float, start: Snapshot) -> None:
        """Solve for a step to t.

        Raises:
            ConvergenceError: If the solver does not converge.
            _Fault: If the end of the step is not acceptable.
        """
        with collective_errors(self.problem.comm), interrupt.user_code():
            self.drive(t, dt)
        interrupt.look(self.problem.comm)
        if (fault := self._scene.limits.fault_of(self.tools)) is not None:
            raise _Fault(fault)
        for contact in self.problem.contacts:
            if contact.dt is not None:
                contact.set_dt(dt)
        try:
            self._pair_and_solve(dt, start)
        except DistortedError as error:
            raise _Fault(str(error), distorted=True) from error
        except CurvedError as error:
            raise _Fault(str(error)) from error
        self._check_shape(dt, start)
        self._check_motion()
        if self.staggered is not None:
            places = zip(self.motions, self.in_velocity, strict=True)
            self.staggered.solve(dt, [Place.of(*place) for place in places])
        if self.on_solved is not None:
            with collective_errors(self.problem.comm), interrupt.user_code():
                self.on_solved()
        interrupt.look(self.problem.comm)

    def _pair_and_solve(self, dt: float, start: Snapshot) -> None:
        pairings = self._scene.pairings
        part = part_of_rates(
            self.problem, self.in_velocity, self.rates, self.tools, self.tool_rates, dt
        )
        rates = self.rates if part == 1 else [part * rate for rate in self.rates]
        pairings.begin(dt, start, rates, self.tool_rates)
        # A failed attempt may have left nodes unpaired, and so forgotten their multipliers.
        start.restore_multipliers()
        self._run_solver()
        if self.theta > 0 and self.num_steps == 0 and any(self.in_velocity):
            pairings.learn_velocities()
            self._run_solver()
        made = 1
        while not self._all_follow and (
            made < self.num_pairings
            or (made < self.num_pairings + MORE_PAIRINGS and pairings.have_slid())
        ):
            made += 1
            self._pair_again(dt, start)
        if pairings.swing(self.missed) and not self._all_follow:
            self._pair_again(dt, start)

    @property
    def _all_follow(self) -> bool:
        """Whether all contacts use updated geometry, so that contact detection is not repeated."""
        return all(contact.model.follows for contact in self.problem.contacts)

    def _pair_again(self, dt: float, start: Snapshot) -> None:
        """Update the contact pairs at the solution, and solve again."""
        self._check_shape(dt, start)
        self._scene.pairings.again()
        self._run_solver()

    def _run_solver(self) -> None:
        try:
            self._solve(self.num_steps)
        finally:
            self.num_iterations += self.problem.num_iterations
            self.total_iterations += self.problem.num_iterations
            self._num_solves += 1

    def _check_shape(self, dt: float, start: Snapshot) -> None:
        """Raise an error for cells that would be distorted at the end of the step."""
        for i, motion in enumerate(self.motions):
            x, flows = motion.u.x.array, self.in_velocity[i]
            kept = motion.quality_kept(motion.reference + motion.values(x * dt if flows else x))
            if kept < self.min_quality:
                old = 0.0 if flows else motion.values(start.unknowns[i])
                raise _Fault(
                    f"the mesh of u[{i}] is distorted: a cell would keep {kept:.3g} of its "
                    f"undeformed quality, less than min_quality = {self.min_quality:g}",
                    hopeless=kept > 0.5 * motion.quality_kept(motion.reference + old),
                    distorted=True,
                )

    def _check_motion(self) -> None:
        """Raise an error if penetration, rotation or slip is too large."""
        fault = self._scene.limits.fault(self._starts) or self._scene.penetration.fault(
            self._starts
        )
        if fault is not None:
            raise _Fault(fault)
        for contact in self.problem.contacts:
            diagnose(self.problem.newton, contact.model, OF_A_STEP)
        jump = self.problem.check_step()
        if jump is not None and jump.is_wrong:
            raise _Fault(jump.text)
        self._has_jumped = jump is not None

    def _accept(self, t: float, dt: float, start: Snapshot) -> None:
        for i, motion in enumerate(self.motions):
            if self.in_velocity[i]:
                motion.set_reference(motion.reference + dt * motion.values())
                self.rates[i] = motion.u.x.array.copy()
            else:
                way = np.asarray(motion.u.x.array - start.unknowns[i])
                self.rates[i] = np.zeros_like(way) if self._has_jumped else way / dt
        for i, tool in enumerate(self.tools):
            tool.advance()
            stops = self._has_jumped and tool.driven is not None
            rate = ToolRate.zero(tool) if stops else ToolRate.since(tool, start.pose_of(tool), dt)
            self.tool_rates[i] = rate
        self._scene.penetration.accept()
        if self.staggered is not None:
            self.staggered.accept()
        self._scene.missed = self._scene.pairings.missed
        # Results of contacts remain those of the step until the next solve.
        for model, slave, master in self.ends():
            model.catch_up = functools.partial(pair_at, model, slave, master)
        self.t = t
        self.last_dt = dt
        self.num_steps += 1
