"""Time steps: bodies in velocities flow, bodies in displacements deform, contact pairs anew."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.checks import check_positive
from qsdolfinx.collective import check_agreement, collective_errors
from qsdolfinx.mesh_motion import MeshMotion
from qsdolfinx.problem import ContactProblem
from qsdolfinx.rigid_surface import RigidSurface
from qsdolfinx.solver import ConvergenceError

Array = npt.NDArray[np.float64]


class StepError(RuntimeError):
    """No step could be made; unknowns, meshes and tools are those at the end of the last one."""


class _State(typing.NamedTuple):
    """What an attempt changes, at the start of the step."""

    unknowns: list[Array]
    multipliers: list[list[Array]]
    positions: list[Array]


class TimeStepper:
    """Steps t → t + Δt of a contact problem.

    A body in velocities v is solved for where its mesh is during the step, and its mesh then moves:
    x ← x + v Δt, (2). With ``theta=0`` that is the mesh at t, the paper's scheme, of order 1. With
    ``theta=0.5`` it is the mesh at t + Δt/2, moved there by the velocity of the last step, of order
    2 at the same cost; the very first step is made twice. A body in displacements u, total ones,
    keeps its mesh as the reference, so that the matrix of a linear one is assembled once; contact
    sees it deformed. Either way gaps are those at the end of the step.

    When the solver does not converge, a cell turns inside out or something penetrates too far, the
    step is made again with a smaller Δt.

    Args:
        problem: The problem. A body in velocities is one whose contacts say so.
        dt: First Δt, time.
        drive: Called as ``drive(t + Δt, Δt)`` before each attempt: sets loads, Dirichlet values,
            and displacements of rigid tools over the step.
        solve: Called instead of ``problem.solve``, with the step's number from 0 on.
        theta: Part of the step, from 0 to 1, after which bodies in velocities are solved for.
        num_pairings: How often contact pairs in a step; after the first, the end of the step that
            was found so far is where it pairs.
        dt_min: Δt below which no step is tried; by default dt / 1000.
        dt_max: Largest Δt; by default dt.
        growth: Factor of Δt after a step of at most ``easy`` Newton iterations.
        cutback: Factor of Δt after a failure.
        easy: See growth.
        max_penetration: Largest gap (length, positive in penetration) at the end of a step; not
            limited by default.
        min_quality: Shape of the worst cell, see MeshMotion.quality, at which to stop.

    Raises:
        ValueError: If a number is out of range.
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
        max_penetration: float | None = None,
        min_quality: float = 0.02,
    ) -> None:
        dt_min = dt / 1000 if dt_min is None else dt_min
        dt_max = dt if dt_max is None else dt_max
        numbers = {"dt": dt, "dt_min": dt_min, "dt_max": dt_max, "growth": growth}
        numbers |= {"cutback": cutback, "num_pairings": num_pairings, "min_quality": min_quality}
        if max_penetration is not None:
            numbers["max_penetration"] = max_penetration
        with collective_errors(problem.comm):
            for name, number in numbers.items():
                check_positive(name, number)
            if not dt_min <= dt <= dt_max:
                raise ValueError("dt: must be between dt_min and dt_max")
            if not 0 <= theta <= 1:
                raise ValueError(f"theta: must be between 0 and 1, not {theta!r}")
            if growth < 1 or cutback >= 1:
                raise ValueError("growth: must be at least 1; cutback: less than 1")
        check_agreement(problem.comm, theta=theta, easy=easy, **numbers)
        self.problem = problem
        self.drive = drive or (lambda t, dt: None)
        self._solve = solve or (lambda step: problem.solve())
        self.theta, self.num_pairings = float(theta), int(num_pairings)
        self.dt_min, self.dt_max = float(dt_min), float(dt_max)
        self.growth, self.cutback, self.easy = float(growth), float(cutback), int(easy)
        self.max_penetration, self.min_quality = max_penetration, float(min_quality)
        #: Time at the end of the last step.
        self.t = 0.0
        #: Δt that will be tried next.
        self.dt = float(dt)
        #: Δt of the last step.
        self.last_dt = 0.0
        #: Steps made.
        self.num_steps = 0
        #: Attempts that failed, so far.
        self.num_cutbacks = 0
        #: Newton iterations of the last step, over its attempts and pairings.
        self.num_iterations = 0
        #: How the meshes of the bodies move.
        self.motions = [MeshMotion(u) for u in problem.u]
        #: Called after each solve of a step, while the meshes are where it was made.
        self.on_solved: typing.Callable[[], None] | None = None
        #: Rigid tools, each once.
        self.tools: list[RigidSurface] = []
        for contact in problem.contacts:
            tool = contact.master
            if isinstance(tool, RigidSurface) and all(tool is not known for known in self.tools):
                self.tools.append(tool)
        self._tools_at_end = False
        self.in_velocity = [kind == "velocity" for kind in problem.unknowns]
        #: Velocities of the last step: the unknowns, or the change of displacements over Δt; at
        #: first zero. They are where the next step starts from.
        self.rates: list[Array] = [np.zeros_like(u.x.array) for u in problem.u]

    # --- Steps

    def step(self, t_end: float | None = None) -> float:
        """Make one step. Collective.

        Args:
            t_end: Time not to step over.

        Returns:
            Its Δt.

        Raises:
            StepError: If it cannot be made, even with the smallest Δt, or a mesh is distorted.
        """
        dt = min(self.dt, self.dt_max)
        if t_end is not None:
            left = t_end - self.t
            # No tiny last step: the rest is made in one or two equal parts.
            dt = left if left <= dt * (1 + 1e-9) else min(dt, max(left / 2, self.dt_min))
        self.num_iterations = 0
        start = self._state()
        while True:
            reason, hopeless = self._attempt(dt)
            if not reason:
                break
            self._restore(start)
            self.num_cutbacks += 1
            dt *= self.cutback
            if hopeless:
                raise StepError(f"t = {self.t:g}: {reason}")
            if dt < self.dt_min:
                raise StepError(
                    f"t = {self.t:g}: no step with Δt of at least dt_min = {self.dt_min:g} "
                    f"succeeds; the last attempt: {reason}"
                )
        iterations = self.num_iterations
        self._accept(dt, start.unknowns)
        grown = dt * self.growth if iterations <= self.easy * self.num_pairings else dt
        self.dt = min(grown, self.dt_max) if dt >= self.dt or grown < self.dt else self.dt
        return dt

    def run(self, t_end: float) -> typing.Iterator[float]:
        """Make steps until t_end; yields the time after each. Collective.

        Raises:
            StepError: As :meth:`step`.
        """
        while self.t < t_end * (1 - 1e-12):
            self.step(t_end)
            yield self.t

    def _attempt(self, dt: float) -> tuple[str, bool]:
        """Solve for a step; why it failed, empty if it did not, and whether a smaller one would."""
        self._tools_at_end = False
        try:
            self.drive(self.t + dt, dt)
            for contact in self.problem.contacts:
                if contact.dt is not None:
                    contact.set_dt(dt)
            known = self.rates
            for i, motion in enumerate(self.motions):
                if not self.in_velocity[i]:
                    motion.u.x.array[:] += dt * known[i]
            if self.theta > 0 and self.num_steps == 0 and not any(p.any() for p in known):
                self._pair_and_solve(known, dt)
                known = [u.x.array.copy() for u in self.problem.u]
            self._pair_and_solve(known, dt)
            for _ in range(self.num_pairings - 1):
                if not self._tools_at_end:
                    self._advance_tools()
                self._pair(known, dt, at_end=True)
                self._run_solver()
        except ConvergenceError as error:
            return str(error), False
        if self.on_solved is not None:
            self.on_solved()
        return self._fault(dt)

    def _advance_tools(self) -> None:
        for tool in self.tools:
            tool.advance()
        self._tools_at_end = True

    def _pair_and_solve(self, known: list[Array], dt: float) -> None:
        self._pair(known, dt, at_end=False)
        self._run_solver()

    def _run_solver(self) -> None:
        try:
            self._solve(self.num_steps)
        finally:
            self.num_iterations += self.problem.num_iterations

    def _pair(self, known: list[Array], dt: float, at_end: bool) -> None:
        """Pair with the surfaces where they are in the step, and put the meshes for the solver.

        Args:
            known: Velocities of the last step, or so.
            dt: Δt.
            at_end: Pair where the solution at hand says the surfaces are at the end of the step.
        """
        offsets = []
        for i, motion in enumerate(self.motions):
            u = motion.u
            kept = u.x.array.copy()
            factor = dt if at_end else self.theta * dt
            if self.in_velocity[i] and not at_end:
                u.x.array[:] = known[i]
            moved = motion.values() * (factor if self.in_velocity[i] else 1.0)
            motion.move(moved)
            offset = fem.Function(u.function_space)
            offset.x.array[:] = -u.x.array * (factor if self.in_velocity[i] else 1.0)
            offsets.append(offset)
            u.x.array[:] = kept
        for contact, (s, m) in zip(self.problem.contacts, self.problem.sides, strict=True):
            contact.update()
            contact.set_offset(offsets[s], None if m is None else offsets[m])
        self._place(known, dt)

    def _place(self, known: list[Array], dt: float) -> None:
        """Meshes where the bodies are solved for."""
        for i, motion in enumerate(self.motions):
            kept = motion.u.x.array.copy()
            motion.u.x.array[:] = known[i]
            motion.move(motion.values() * self.theta * dt if self.in_velocity[i] else 0.0)
            motion.u.x.array[:] = kept

    def _fault(self, dt: float) -> tuple[str, bool]:
        """What is wrong with the end of the step, and whether it would be with a smaller one."""
        for i, motion in enumerate(self.motions):
            solved_at = motion.mesh.geometry.x.copy()
            motion.move()
            before = motion.quality()
            motion.move(motion.values() * (dt if self.in_velocity[i] else 1.0))
            quality = motion.quality()
            motion.mesh.geometry.x[:] = solved_at
            if quality < self.min_quality:
                return (
                    f"the mesh of u[{i}] is distorted: its worst cell would have a quality of "
                    f"{quality:.3g}, below min_quality = {self.min_quality:g}",
                    quality > 0.5 * before,
                )
        if self.max_penetration is not None:
            deepest = self.penetration()
            if deepest > self.max_penetration:
                return (
                    f"a penetration of {deepest:.3g}, above max_penetration = "
                    f"{self.max_penetration:g}",
                    False,
                )
        return "", False

    def _accept(self, dt: float, start: list[Array]) -> None:
        for i, motion in enumerate(self.motions):
            if self.in_velocity[i]:
                motion.set_reference(motion.reference + dt * motion.values())
                self.rates[i] = motion.u.x.array.copy()
            else:
                self.rates[i] = np.asarray((motion.u.x.array - start[i]) / dt)
        if not self._tools_at_end:
            self._advance_tools()
        self.t += dt
        self.last_dt = dt
        self.num_steps += 1

    def penetration(self) -> float:
        """Largest gap (length, positive in penetration) of all contacts. Collective."""
        gaps = [np.abs(c.gap()) if c.law.linear else c.gap() for c in self.problem.contacts]
        local = max((float(np.nanmax(g)) for g in gaps if np.isfinite(g).any()), default=0.0)
        return float(self.problem.comm.allreduce(max(local, 0.0), op=MPI.MAX))

    # --- State

    def _state(self) -> _State:
        return _State(
            [u.x.array.copy() for u in self.problem.u],
            [c.multipliers_on_nodes() for c in self.problem.contacts],
            [tool.position for tool in self.tools],
        )

    def _restore(self, state: _State) -> None:
        for motion, unknowns in zip(self.motions, state.unknowns, strict=True):
            motion.u.x.array[:] = unknowns
            motion.move()
        for contact, multipliers in zip(self.problem.contacts, state.multipliers, strict=True):
            contact.set_multipliers_on_nodes(multipliers)
        for tool, position in zip(self.tools, state.positions, strict=True):
            tool.position = position
