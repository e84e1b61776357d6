"""Newton's method for a system with given augmented multipliers, by PETSc's SNES."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.krylov import Tolerances
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.solve.snes import ConvergenceError, forget_failure, line_search
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Iterations in which nodes that are open by rounding alone count as closed.
LENIENT = 4

#: Solves with friction in a row in which nodes whose slip turns may be made to stick.
MAX_ATTEMPTS = 3


@dataclasses.dataclass
class Record:
    """What happened in a solve.

    Attributes:
        residuals: Norm of the residual at each iteration.
        active: Closed rows of each contact on this rank at each iteration.
        violations: Largest gap that augmented multipliers leave, after each of their updates.
        iterations: Newton iterations, over all updates of the multipliers.
        linear_iterations: Iterations of the linear solver in them.
        norms: Norms since SNES began for the last time.
    """

    residuals: list[float] = dataclasses.field(default_factory=list)
    active: list[list[int]] = dataclasses.field(default_factory=list)
    violations: list[float] = dataclasses.field(default_factory=list)
    iterations: int = 0
    linear_iterations: int = 0
    norms: list[float] = dataclasses.field(default_factory=list)

    def add(self, iteration: int, norm: float, active: list[int]) -> None:
        """Record an iteration; number 0 starts ``norms`` again."""
        self.residuals.append(norm)
        self.norms = [*(self.norms if iteration else []), norm]
        self.active.append(active)

    def active_of_all(self, comm: MPI.Intracomm) -> list[list[int]]:
        """``active`` over all ranks. Collective."""
        counts = np.array(self.active, dtype=np.int64)
        return typing.cast(list[list[int]], comm.allreduce(counts, op=MPI.SUM).tolist())


# --- What SNES calls


@dataclasses.dataclass
class Context:
    """What the callbacks know. Without SNES itself, which keeps it where Python cannot see it.

    Attributes:
        system: The system.
        linear: Its linear solver.
        record: Where iterations are recorded.
        atol: Absolute tolerance that was asked for, before what rounding leaves.
        failure: What a callback has raised: PETSc would make an error of its own of it.
    """

    system: ContactSystem
    linear: LinearSolver
    record: Record
    atol: float = 0.0
    failure: BaseException | None = None


def _callback(function: typing.Callable[..., None]) -> typing.Callable[..., None]:
    """Keep what is raised; the context is the last argument."""

    @functools.wraps(function)
    def call(*args: typing.Any) -> None:
        try:
            function(*args)
        except BaseException as error:
            args[-1].failure = error
            raise

    return call


@_callback
def residual(snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, context: Context) -> None:
    """Evaluate the residual."""
    f.array[:] = context.system.residual(x.array_r)


@_callback
def tangent(snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat, context: Context) -> None:
    """Assemble the tangent, and get the linear solver ready."""
    system, linear = context.system, context.linear
    # SNES usually asks for the tangent where it evaluated the residual last.
    moved = not np.array_equal(x.array_r, system.evaluated)
    if system.comm.allreduce(moved, op=MPI.LOR):
        system.residual(x.array_r)
    for slip in system.slips:
        slip.note()
    linear.make_hierarchy()
    system.set_strict(snes.getIterationNumber() >= LENIENT)
    changed = linear.assemble()
    rtol = snes.getTolerances()[0]
    until = Tolerances(rtol, max(context.atol, system.rounding()))
    snes.setTolerances(atol=until.absolute)
    linear.prepare(system.matrix, context.record.norms, until, changed)


@_callback
def monitor(snes: PETSc.SNES, iteration: int, norm: float, context: Context) -> None:
    """Record an iteration."""
    context.record.add(iteration, norm, context.system.num_active_local())


class Newton:
    """Solves a :class:`ContactSystem` from where ``system.x`` is.

    Args:
        system: The system.
        snes: PETSc's nonlinear solver, with its options set.
        linear: The linear solver.
        full_steps: Whether the line search is our default: one that fails is followed by another.
    """

    def __init__(
        self, system: ContactSystem, snes: PETSc.SNES, linear: LinearSolver, full_steps: bool
    ) -> None:
        self.system, self._snes, self.linear = system, snes, linear
        self.has_full_steps = full_steps
        self.record = Record()
        self._context = Context(system, linear, self.record)
        #: Norm of the residual at the start of the solve.
        self.first_norm = 0.0
        #: Residual before a first guess was made over that after, at most 1.
        self.predicted = 1.0
        snes.setMonitor(monitor, (self._context,))

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        self.system.check_alive()
        return self._snes

    def begin(self) -> None:
        """Begin a new record."""
        self.record = self._context.record = Record()

    def update_matrices(self) -> None:
        """Make matrices for the present pairing, if there are none. Collective."""
        if not self.system.is_stale:
            return
        self.linear.forget()
        self.system.rebuild()
        self.snes.reset()
        self.snes.setFunction(residual, self.system.r, (self._context,))
        matrix = self.system.matrix
        self.snes.setJacobian(tangent, matrix, matrix, (self._context,))
        self.linear.set_up()

    # --- Accuracy

    @contextlib.contextmanager
    def accuracy(self, rtol: float, atol: float) -> typing.Iterator[None]:
        """End Newton's method inside the block by these norms of the residual."""
        kept = self.snes.getTolerances()
        self.snes.setTolerances(rtol, atol, *kept[2:])
        try:
            yield
        finally:
            self.snes.setTolerances(*kept)

    @property
    def final_norm(self) -> float:
        """Norm of the residual that a solution may have."""
        rtol, atol, _, _ = self.snes.getTolerances()
        return max(atol, rtol * self.first_norm)

    def same_accuracy(self) -> contextlib.AbstractContextManager[None]:
        """Solve as exactly as at first, not by the same factor again."""
        return self.accuracy(self.snes.getTolerances()[0], self.final_norm)

    # --- Solving

    def solve(self) -> None:
        """Solve for multipliers and tools as they are. Collective.

        Raises:
            ConvergenceError: If that fails.
        """
        self._iterate(0)
        slips, comm = self.system.slips, self.system.comm
        if not slips:
            return
        attempt = 0
        with self.same_accuracy():
            while comm.allreduce(any([slip.unsettled() for slip in slips]), op=MPI.LOR):
                attempt += 1
                self._iterate(attempt)

    def respond(self, load: Array) -> Array:
        """Change of the owned unknowns under a small load, by the tangent at the solution."""
        for slip in self.system.slips:
            slip.stick_slip.begin_iterations(False)  # the exact tangent
        self.linear.assemble()
        change, reason = self.linear.solve(load)
        if reason < 0:
            self.fail(PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)
        return change

    def follow(self, change: Array) -> None:
        """Solve from changed unknowns; without success they are as before."""
        before = self.system.x.array.copy()
        self.system.x.array[:] += change
        try:
            self.solve()
        except ConvergenceError:
            self.system.x.array[:] = before
            raise

    def fail(self, reason: int) -> typing.NoReturn:
        """Raise the error of a solve that ends with this reason. Collective."""
        linear_reason = self.snes.getKSP().getConvergedReason()
        forget_failure(self.snes)
        record = self.record
        active = record.active_of_all(self.system.comm)
        raise ConvergenceError(reason, record.residuals, active, linear_reason, record.violations)

    def _iterate(self, attempt: int) -> None:
        """Newton's method, with full steps or else with a line search.

        Args:
            attempt: Counts those with friction from the same first guess on.
        """
        first_guess, slips = self.system.x.copy(), self.system.slips
        database = PETSc.Options(self.snes.getOptionsPrefix())
        full_steps = database.getString("snes_linesearch_type", "") == "basic"
        for slip in slips:
            slip.stick_slip.begin_iterations(full_steps and attempt < MAX_ATTEMPTS)
        self._run()
        if self.snes.getConvergedReason() < 0 and self.has_full_steps:
            first_guess.copy(self.system.x)
            forget_failure(self.snes)
            for slip in slips:
                slip.stick_slip.begin_attempt()
                slip.stick_slip.begin_iterations(False)
            with line_search(self.snes):
                self._run()
        first_guess.destroy()
        if self.snes.getConvergedReason() <= 0:
            self.fail(self.snes.getConvergedReason())
        self.system.residual(self.system.x.array_r)  # a line search may have ended elsewhere
        for slip in slips:
            slip.stick_slip.end_iterations()

    def _run(self) -> None:
        """One run of SNES; its absolute tolerance is at least what rounding leaves."""
        rtol, atol, _, _ = self.snes.getTolerances()
        self._context.atol = atol
        self.snes.setTolerances(rtol=rtol * self.predicted)
        try:
            with self.system.watch.stage("solve"):
                self._call_snes()
        finally:
            self.snes.setTolerances(rtol=rtol, atol=atol)
            self.system.set_strict(False)
        self.record.iterations += self.snes.getIterationNumber()
        self.record.linear_iterations += self.snes.getLinearSolveIterations()

    def _call_snes(self) -> None:
        """Let SNES solve; what a callback raises is raised as it is."""
        try:
            self.snes.solve(None, self.system.x)
        except PETSc.Error:
            self.system.replace_vectors()
            failure, self._context.failure = self._context.failure, None
            if failure is None:
                raise
            raise failure from None
