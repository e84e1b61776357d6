"""Newton's method for the bodies' unknowns, with contact condensed, by PETSc's SNES."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.base.passing import passing
from qsdolfinx.base.reasons import NOT_FINITE
from qsdolfinx.gap.no_value import NoMultiplierError, NoValueError
from qsdolfinx.linear.factors_again import OF_A_LIBRARY, begin_afresh
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.solve.convergence import RESTING, Convergence, Measures
from qsdolfinx.solve.snes import LAW_NOT_FINITE, SNES_OPTIONS, ConvergenceError, forget_failure
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

FAILED_LINEARLY = PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE

#: Beginnings of the option names that select PETSc's SNES, and the name of its convergence test.
TEST = "snes_convergence_test"
OF_USERS_SNES = "snes_type", "snes_linesearch_", TEST


@dataclasses.dataclass
class Record:
    """Record of a solve.

    Attributes:
        residuals: Norm of the residual at each iteration.
        active: Active constraints of each contact on this rank at each iteration.
        violations: Largest gap that augmented Lagrangian multipliers leave at the end, if there are
            any.
        iterations: Newton iterations.
        restarts: Runs that failed and were restarted, from other unknowns or with a direct solver.
        linear_iterations: Iterations of the linear solver in the solve.
    """

    residuals: list[float] = dataclasses.field(default_factory=list)
    active: list[list[int]] = dataclasses.field(default_factory=list)
    violations: list[float] = dataclasses.field(default_factory=list)
    iterations: int = 0
    restarts: int = 0
    linear_iterations: int = 0

    def add(self, norm: float, active: list[int]) -> None:
        """Record an iteration."""
        self.residuals.append(norm)
        self.active.append(active)

    def active_of_all(self, comm: MPI.Intracomm) -> list[list[int]]:
        """``active`` over all ranks. Collective."""
        counts = np.array(self.active, dtype=np.int64)
        return typing.cast(list[list[int]], comm.allreduce(counts, op=MPI.SUM).tolist())


# --- Callbacks of SNES


class Other(typing.Protocol):
    """Equations for unknowns other than the bodies' alone, to be solved by SNES."""

    matrix: PETSc.Mat
    ksp: PETSc.KSP

    def residual(self, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """Evaluate the residual."""

    def tangent(self, x: PETSc.Vec) -> None:
        """Prepare the matrix and the linear solver."""

    def converged(self, snes: PETSc.SNES) -> int:
        """Converged reason of SNES at the present iterate, or 0."""

    def shown(self, snes: PETSc.SNES) -> tuple[float, list[int]]:
        """Norm of the bodies' residual, and active constraints of each contact on this rank."""


@dataclasses.dataclass
class Context:
    """Context of the callbacks.

    It has no reference to SNES, because PETSc keeps the context where Python's garbage collector
    cannot see it.

    Attributes:
        system: The system.
        linear: Its linear solver.
        record: Record of the iterations.
        convergence: Measures the residual; None before there are matrices.
        norms: Norm of the residual at each iteration of the run.
        least: Smallest norm of each group in the run so far.
        forces: For each group, the largest acting or unbalanced forces at the start of any run of
            the solve. None before the first run.
        until: Norm of the residual at which a linear solve is accurate enough.
        unseen: Why the residual could not be evaluated somewhere; None if it always could.
        failure: Exception raised by a callback: PETSc would replace it by an error of its own.
        active: Active constraints of each contact on this rank, in an iteration on other unknowns.
        other: Equations on other unknowns that SNES solves; None if it solves for the bodies'
            unknowns.
    """

    system: ContactSystem
    linear: LinearSolver
    record: Record
    convergence: Convergence | None = None
    norms: list[float] = dataclasses.field(default_factory=list)
    least: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    forces: Array | None = None
    until: float = 0.0
    unseen: NoValueError | None = None
    failure: BaseException | None = None
    active: list[int] | None = None
    other: Other | None = None

    def keep(self, error: BaseException) -> None:
        """Store the exception raised by a callback."""
        self.failure = error

    def taken(self) -> BaseException:
        """The exception raised by a callback, which is forgotten."""
        failure, self.failure = self.failure, None
        assert failure is not None
        return failure


def _callback(function: typing.Callable[..., None]) -> typing.Callable[..., None]:
    """Wrap a callback so that exceptions are stored in the context, its last argument."""

    @functools.wraps(function)
    def call(*args: typing.Any) -> None:
        with passing(args[-1].keep):
            function(*args)

    return call


@_callback
def residual(snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, context: Context) -> None:
    """Evaluate the residual."""
    try:
        f.array[:] = context.system.residual(x.array_r)
    except NoValueError as error:  # on all ranks
        context.unseen = error
        f.array[:] = np.nan


@_callback
def tangent(snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat, context: Context) -> None:
    """Assemble the tangent, and prepare the linear solver."""
    system, linear = context.system, context.linear
    _evaluate(system, x)
    changed = linear.assemble()
    linear.prepare(context.norms, context.until, changed)


@_callback
def other_residual(snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, context: Context) -> None:
    """Evaluate the residual on other unknowns."""
    assert context.other is not None
    context.other.residual(x, f)


@_callback
def other_tangent(
    snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat, context: Context
) -> None:
    """Evaluate the derivative of the residual on other unknowns."""
    assert context.other is not None
    context.other.tangent(x)
    if A != context.other.matrix:  # finite differences, chosen by options
        A.assemble()


@_callback
def monitor(snes: PETSc.SNES, iteration: int, norm: float, context: Context) -> None:
    """Record an iteration."""
    active = context.active
    if context.other is not None:
        norm, active = context.other.shown(snes)
    context.record.add(norm, context.system.num_active_local() if active is None else active)


def converged(
    snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float], context: Context
) -> int:
    """Convergence test of SNES: whether the forces are in balance."""
    with passing(context.keep):
        return _has_converged(snes, iteration, norms, context)


def _has_converged(
    snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float], context: Context
) -> int:
    reasons = PETSc.SNES.ConvergedReason
    if interrupt.requested(context.system.comm):
        return int(reasons.DIVERGED_FUNCTION_COUNT)  # PETSc returns; then the error is raised
    size, step, norm = norms
    if not np.isfinite(norm):
        return NOT_FINITE
    if context.other is not None:
        return context.other.converged(snes)
    relative, absolute, _, _ = snes.getTolerances()
    _evaluate(context.system, snes.getSolution())
    assert context.convergence is not None
    measures = context.convergence.measure(reactions=iteration > 0)
    if iteration == 0:
        context.norms = []
        context.least = np.full_like(measures.residuals, np.inf)
        now = np.maximum(measures.sizes, measures.residuals)
        context.forces = now if context.forces is None else np.maximum(now, context.forces)
    context.norms.append(norm)
    limits = measures.limits(relative)
    rests = iteration > 0 and step <= RESTING * size
    assert context.forces is not None
    limits = measures.with_rounding(limits, context.least, context.forces, rests)
    context.least = np.minimum(context.least, measures.residuals)
    exceeded = ~(measures.residuals <= limits)
    targets = np.maximum(limits, measures.settled)[exceeded]
    context.until = max(absolute, float(targets.min(initial=np.inf)))
    if not np.any(exceeded):
        return int(reasons.CONVERGED_FNORM_RELATIVE)
    if norm <= absolute:
        return int(reasons.CONVERGED_FNORM_ABS)
    return 0


def _evaluate(system: ContactSystem, x: PETSc.Vec) -> None:
    """Evaluate the residual at x, unless the last evaluation was at x."""
    moved = not np.array_equal(x.array_r, system.evaluated)
    if system.comm.allreduce(moved, op=MPI.LOR):
        system.residual(x.array_r)


def _with_inner(snes: PETSc.SNES) -> typing.Iterator[PETSc.SNES]:
    """A solver, and its nonlinear preconditioners."""
    yield snes
    while snes.hasNPC():
        snes = snes.getNPC()
        yield snes


class Newton:
    """Solve a :class:`ContactSystem`, starting from ``system.x``.

    Args:
        system: The system.
        snes: PETSc's nonlinear solver, with its options set.
        linear: The linear solver.
        defaults: Names of the PETSc options that are defaults of the library, not the user's
            choice.
    """

    def __init__(
        self,
        system: ContactSystem,
        snes: PETSc.SNES,
        linear: LinearSolver,
        defaults: typing.Collection[str],
    ) -> None:
        self.system, self._snes, self.linear = system, snes, linear
        chosen = set(PETSc.Options(snes.getOptionsPrefix()).getAll()) - set(defaults)
        #: Whether the user has set a type of SNES, a line search or a convergence test of PETSc.
        self.has_users_snes = any(name.startswith(OF_USERS_SNES) for name in chosen)
        self._users_test = PETSc.Options(snes.getOptionsPrefix()).getString(TEST, "")
        #: Reason for the end of the last run.
        self._reason = 0
        self.record = Record()
        self._context = Context(system, linear, self.record)
        snes.setMonitor(monitor, (self._context,))
        snes.setConvergenceTest(converged, (self._context,))

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        self.system.check_alive()
        return self._snes

    def begin(self) -> None:
        """Start a new record."""
        self.record = self._context.record = Record()
        self._context.forces = None
        self._context.unseen = None

    def update_matrices(self) -> None:
        """Create matrices for the present contact pairs, if there are none. Collective."""
        if self.system.is_stale:
            self.linear.forget()
            self.system.rebuild()
            self._take_matrices()

    def _take_matrices(self) -> None:
        """Use the system's new matrices. Collective."""
        self.snes.reset()
        self.snes.setFunction(residual, self.system.r, (self._context,))
        matrix = self.system.matrix
        self.linear.set_up()
        self.snes.setJacobian(tangent, matrix, matrix, (self._context,))
        self._context.convergence = Convergence(self.system)

    # --- Other unknowns

    @property
    def has_users_test(self) -> bool:
        """Whether options set a convergence test of PETSc."""
        return bool(self._users_test)

    def kept(self) -> contextlib.AbstractContextManager[None]:
        """Store exceptions raised in the block, which is called by PETSc."""
        return passing(self._context.keep)

    def solve_other(self, other: Other, x: PETSc.Vec, f: PETSc.Vec) -> int:
        """Let SNES solve equations on other unknowns, with its options and monitors. Collective.

        Args:
            other: The equations.
            x: Initial unknowns; on return, the final unknowns of SNES.
            f: Vector for the residual.

        Returns:
            SNES' reason.
        """
        snes, context = self.snes, self._context
        matrices, all_ = snes.getJacobian()[:2], list(_with_inner(snes))
        solvers = [each.getKSP() for each in all_]
        for each in all_:
            each.setKSP(other.ksp)
        snes.reset()
        snes.setFunction(other_residual, f, (context,))
        snes.setJacobian(other_tangent, other.matrix, other.matrix, (context,))
        if self._users_test:
            snes.setConvergenceTest(self._users_test)
        context.other = other
        try:
            snes.solve(None, x)
            self.record.iterations += snes.getIterationNumber()
            return int(snes.getConvergedReason())
        except PETSc.Error:
            if context.failure is None:
                raise
            raise context.taken() from None
        finally:
            context.other = None
            reason = snes.getConvergedReason()
            snes.reset()
            for each, ksp in zip(all_, solvers, strict=True):
                each.setKSP(ksp)
            snes.setFunction(residual, self.system.r, (context,))
            snes.setJacobian(tangent, *matrices, (context,))
            snes.setConvergedReason(reason)
            if self._users_test:
                snes.setConvergenceTest(converged, (context,))

    def measure(self) -> tuple[Measures, Array]:
        """Norms of the residual at the last evaluation, and their limits for a solution."""
        self.system.check_alive()
        assert self._context.convergence is not None, "no solve has been made"
        measures = self._context.convergence.measure()
        relative = self.snes.getTolerances()[0]
        return measures, np.maximum(relative * measures.sizes, measures.settled)

    # --- Solving

    def solve(self) -> None:
        """Solve for the bodies' unknowns with fixed tools. Collective.

        Raises:
            ConvergenceError: If that fails.
        """
        self._run()
        if self._reason <= 0:
            self.fail(self._reason)
        self.system.residual(self.system.x.array_r)  # a line search may have ended elsewhere

    def assemble(self) -> None:
        """Assemble the tangent at the last evaluation, outside SNES. Collective.

        Results, and so penalties, stay as they are.
        """
        if not self.system.fits_pattern():
            self.linear.forget()
            self.system.renew_matrices()
            self._take_matrices()
        self.linear.assemble()

    def note_unseen(self, error: NoValueError) -> None:
        """Store why contact could not be evaluated somewhere, for error messages."""
        self._context.unseen = error

    def fail(self, reason: int, linear_reason: int | None = None, why: str = "") -> typing.NoReturn:
        """Raise the error for a solve that ends with this reason. Collective.

        Args:
            reason: Reason of SNES, or of the library.
            linear_reason: Reason of the linear solver; by default the reason of SNES' own KSP.
            why: The reason in words.
        """
        interrupt.look(self.system.comm)
        if linear_reason is None:
            linear_reason = self.snes.getKSP().getConvergedReason()
        forget_failure(self.snes)
        unseen = self._context.unseen
        if isinstance(unseen, NoMultiplierError) and reason == NOT_FINITE:
            reason, why = LAW_NOT_FINITE, why or str(unseen)
        record = self.record
        active = record.active_of_all(self.system.comm)
        linear = self.system.linear and not self.system.slips
        error = ConvergenceError(
            reason, record.residuals, active, linear_reason, record.violations, linear, why
        )
        longest = self.snes.getTolerances()[3]
        is_short = longest < SNES_OPTIONS["snes_max_it"]
        if is_short and reason == PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT:
            error.advise(f"snes_max_it = {longest} in petsc_options allows few iterations")
        if unseen is not None and not why:
            error.advise(str(unseen))
        try:
            raise error
        finally:
            del error  # no cycle of error, traceback and frame: see base/collective.py

    def note(self, iteration: int, x: Array, norm: float, active: list[int]) -> None:
        """Record an iteration on other unknowns, and call the monitors. Collective.

        Args:
            iteration: Its number.
            x: Unknowns of the bodies.
            norm: Norm of their residual.
            active: Active constraints of each contact on this rank. Raises:
            KeyboardInterrupt: After Ctrl-C.
        """
        self._context.active = active
        self.system.x.array[:] = x
        try:
            self.snes.setSolution(self.system.x)
            self.snes.setIterationNumber(iteration)
            self.snes.setFunctionNorm(norm)
            self.snes.monitor(iteration, norm)
        except BaseException:  # it leaves vectors locked
            self.system.replace_vectors()
            if self._context.failure is None:
                raise
            raise self._context.taken() from None
        finally:
            self._context.active = None
        interrupt.look(self.system.comm)

    def end_at(self, reason: int) -> None:
        """Set the converged reason of SNES."""
        self.snes.setConvergedReason(reason)

    def _run(self) -> None:
        with self.system.watch.stage("solve"):
            self._call_snes()
        self._reason = self._judged()
        self.record.iterations += self.snes.getIterationNumber()
        self.record.linear_iterations += self.snes.getLinearSolveIterations()

    def _judged(self) -> int:
        """Reason of SNES; if it is not from the library's test, it is confirmed by this test.

        A line search with a residual that is not finite may end with the reason for a short step.
        Some types of SNES end when they reach their number of iterations.
        """
        snes, reasons = self.snes, PETSc.SNES.ConvergedReason
        reason = int(snes.getConvergedReason())
        failures = {
            reasons.CONVERGED_SNORM_RELATIVE: reasons.DIVERGED_LINE_SEARCH,
            reasons.CONVERGED_ITS: reasons.DIVERGED_MAX_IT,
        }
        if reason not in failures:
            return reason
        try:
            norm = float(np.linalg.norm(self.system.residual(self.system.x.array_r)))
        except NoValueError as error:
            self._context.unseen = error
            return failures[reason]
        norm = float(np.sqrt(self.system.comm.allreduce(norm**2)))
        judged = 0 if reason == reasons.CONVERGED_ITS else 1  # no test was made in its iterations
        return _has_converged(snes, judged, (0.0, np.inf, norm), self._context) or failures[reason]

    def _call_snes(self) -> None:
        """Let SNES solve; exceptions of callbacks are raised unchanged."""
        self._context.norms = []
        try:
            self.snes.solve(None, self.system.x)
        except PETSc.Error as error:
            self.system.replace_vectors()
            if self._context.failure is None:
                self.linear.look()
                if self.linear.is_direct:
                    begin_afresh(self.snes.getKSP())
                if error.ierr == OF_A_LIBRARY:  # such as a failed factorisation
                    self.fail(FAILED_LINEARLY)
                raise
            raise self._context.taken() from None
        self.linear.look()
