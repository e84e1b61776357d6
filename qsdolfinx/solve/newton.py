"""Newton's method for a system with given augmented multipliers."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.contact import Contact
from qsdolfinx.friction.slip import Slip
from qsdolfinx.linear.krylov import Krylov
from qsdolfinx.linear.schur import Schur
from qsdolfinx.solve.snes import (
    NOT_BALANCED,
    ConvergenceError,
    forget_failure,
    line_search,
)
from qsdolfinx.solve.tool_balance import Drive
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.body import Body
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Iterations in which nodes that are open by rounding alone count as closed.
LENIENT = 4

#: Solves with friction in a row in which nodes that slip to and fro may be made to stick.
MAX_ATTEMPTS = 3


class Newton(ContactSystem):
    """Solves a :class:`ContactSystem` from where it is; see :class:`ContactProblem`.

    Args:
        bodies: The bodies.
        contacts: Contacts between them.
        kind: ``"mpi"`` or ``"nest"``, the matrix type that the linear solver sees.
    """

    #: PETSc's nonlinear solver.
    snes: PETSc.SNES
    #: The preset of the linear solver, or ``"options"`` if it is PETSc's options alone.
    solver: str
    #: Whether the line search is the default and not the user's choice.
    has_full_steps: bool
    #: Prepares the linear solves of an iterative preset.
    _krylov: Krylov | None
    _schur: Schur | None
    _drive: Drive
    _first_norm: float

    def __init__(
        self, bodies: typing.Sequence[Body], contacts: typing.Sequence[Contact], kind: str
    ) -> None:
        super().__init__(bodies, contacts, kind)
        #: Norm of the residual at each iteration of the last solve.
        self.residual_history: list[float] = []
        #: Active rows of each contact at each iteration of the last solve, over all ranks.
        self.active_history: list[list[int]] = []
        #: Largest gap that an augmented multiplier leaves, after each of its updates.
        self.violation_history: list[float] = []
        #: Newton iterations of the last solve, over all updates of the multipliers.
        self.num_iterations = 0
        #: Iterations of the linear solver in them.
        self.num_linear_iterations = 0
        #: What was raised in one of PETSc's callbacks.
        self.failure: BaseException | None = None
        self._norms: list[float] = []
        #: Residual before a first guess was made over that after, at most 1.
        self._predicted = 1.0

    def _assemble(self) -> bool:
        """Tangent at the last evaluation, and multigrid for it; whether it has changed."""
        changed = super()._assemble()
        if changed and self._krylov is not None:
            with self.watch.stage("solve"):
                self._krylov.update()
        return changed

    def _equilibrate(self) -> None:
        """Solve for the multipliers at hand, with tools that a force drives in balance."""
        self._run_snes()
        if self._drive.tools:
            with self._same_accuracy():
                balanced = self._drive.balance(self.bodies, self._respond, self._follow)
            if not balanced:
                self._raise_error(NOT_BALANCED)

    def _respond(self, load: Array) -> Array:
        """Change of the owned unknowns under a small load, by the tangent at the solution."""
        for slip in self._slips:
            slip.stick_slip.begin_iterations(False)  # the exact tangent
        self._assemble()
        ksp = self.snes.getKSP()
        ksp.setOperators(self._matrix, self._matrix)
        b, y = self._x.duplicate(), self._x.duplicate()
        b.array[:] = load
        if self._krylov is not None:
            self._krylov.set_exact()
        with self.watch.stage("solve"):
            ksp.solve(b, y)
        if ksp.getConvergedReason() < 0:
            self._raise_error(PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)
        change = y.array_r.copy()
        b.destroy()
        y.destroy()
        return change

    def _follow(self, change: Array) -> None:
        """Solve from changed unknowns; without success they are as before."""
        before = self._x.array.copy()
        self._x.array[:] += change
        try:
            self._run_snes()
        except ConvergenceError:
            self._x.array[:] = before
            raise

    @contextlib.contextmanager
    def _accuracy(self, rtol: float, atol: float) -> typing.Iterator[None]:
        """End Newton's method inside the block by these norms of the residual."""
        kept = self.snes.getTolerances()
        self.snes.setTolerances(rtol, atol, *kept[2:])
        try:
            yield
        finally:
            self.snes.setTolerances(*kept)

    @property
    def _final_norm(self) -> float:
        """Norm of the residual that a solution may have."""
        rtol, atol, _, _ = self.snes.getTolerances()
        return max(atol, rtol * self._first_norm)

    def _same_accuracy(self) -> contextlib.AbstractContextManager[None]:
        """Solve as exactly as at first, not by the same factor again."""
        return self._accuracy(self.snes.getTolerances()[0], self._final_norm)

    def _run_snes(self) -> None:
        """Solve for the multipliers at hand."""
        self._iterate(0)
        if not self._slips:
            return
        attempt = 0
        with self._same_accuracy():
            while self.comm.allreduce(any([slip.unsettled() for slip in self._slips]), op=MPI.LOR):
                attempt += 1
                self._iterate(attempt)

    @property
    def _slips(self) -> list[Slip]:
        """Slips of all contacts; none without friction."""
        return [slip for contact in self.contacts for slip in contact.slips]

    def _iterate(self, attempt: int) -> None:
        """Newton's method, with full steps or else with a line search.

        Args:
            attempt: Counts those with friction from the same first guess on.
        """
        first_guess = self._x.copy()
        database = PETSc.Options(self.snes.getOptionsPrefix())
        full_steps = database.getString("snes_linesearch_type", "") == "basic"
        for slip in self._slips:
            slip.stick_slip.begin_iterations(full_steps and attempt < MAX_ATTEMPTS)
        self._run()
        if self.snes.getConvergedReason() < 0 and self.has_full_steps:
            first_guess.copy(self._x)
            forget_failure(self.snes)
            for slip in self._slips:
                slip.stick_slip.begin_attempt()
                slip.stick_slip.begin_iterations(False)
            with line_search(self.snes):
                self._run()
        first_guess.destroy()
        if self.snes.getConvergedReason() <= 0:
            self._raise_error(self.snes.getConvergedReason())
        self._evaluate(self._x.array_r)  # a line search may have ended elsewhere
        for slip in self._slips:
            slip.stick_slip.end_iterations()

    def _run(self) -> None:
        """One run of SNES; its absolute tolerance is at least what rounding leaves."""
        rtol, self._atol, _, _ = self.snes.getTolerances()
        self.snes.setTolerances(rtol=rtol * self._predicted)
        try:
            with self.watch.stage("solve"):
                self._call_snes()
        finally:
            self.snes.setTolerances(rtol=rtol, atol=self._atol)
            self._set_strict(False)
        self.num_iterations += self.snes.getIterationNumber()
        self.num_linear_iterations += self.snes.getLinearSolveIterations()

    def _call_snes(self) -> None:
        """Let SNES solve; what a callback raises is raised as it is."""
        try:
            self.snes.solve(None, self._x)
        except PETSc.Error:
            self._replace_locked()
            failure, self.failure = self.failure, None
            if failure is None:
                raise
            raise failure from None

    def _replace_locked(self) -> None:
        """Vectors that PETSc has locked for a callback that raised stay locked: take new ones."""
        new = [vec.duplicate() for vec in (self._x, self._r)]
        self._x.copy(new[0])
        self._x.destroy()
        self._r.destroy()
        self._x, self._r = new
        self._paired = [-1]  # the next solve sets up the solver again

    def _set_strict(self, strict: bool) -> None:
        """Say whether gaps that are open by rounding alone count as open, without friction.

        At first they count as closed, or bodies that just touch would fall through each other. But
        they bear no force: with light loads Newton's method would never end with such a tangent.
        """
        for contact in self.contacts:
            contact.strict = strict and contact.tangential is None

    def _raise_error(self, reason: int) -> typing.NoReturn:
        linear_reason = self.snes.getKSP().getConvergedReason()
        forget_failure(self.snes)
        raise ConvergenceError(
            reason,
            self.residual_history,
            self._all_active(),
            linear_reason,
            self.violation_history,
        )

    def _norm(self, owned: Array) -> float:
        """2-norm of a vector whose owned values these are. Collective."""
        return float(np.sqrt(self.comm.allreduce(owned @ owned, op=MPI.SUM)))

    def _all_active(self) -> list[list[int]]:
        counts = np.array(self.active_history, dtype=np.int64)
        return typing.cast(list[list[int]], self.comm.allreduce(counts, op=MPI.SUM).tolist())

    # --- Callbacks

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array[:] = self._evaluate(x.array_r)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        # SNES usually asks for the tangent where it evaluated the residual last.
        moved = not np.array_equal(x.array_r, self._evaluated)
        if self.comm.allreduce(moved, op=MPI.LOR):
            self._evaluate(x.array_r)
        for slip in self._slips:
            slip.note()
        self._prepare_multigrid()
        self._set_strict(snes.getIterationNumber() >= LENIENT)
        changed = self._assemble()
        snes.setTolerances(atol=max(self._atol, self._rounding()))
        if self._schur is not None:
            self._schur.update(self.snes.getKSP(), self._matrix)
        if self._krylov is not None:
            self._krylov.choose_type(self.symmetric)
            self._krylov.set_tolerance(self._norms, changed)

    def _prepare_multigrid(self) -> None:
        """Choose multigrid's coarse spaces where there are none that fit. Collective."""
        if not isinstance(self._tangent, Additive):
            return
        fingerprints = [body.fingerprint for body in self.bodies]
        assert self._krylov is not None and self._rigid is not None
        if self._krylov.needs_hierarchy(fingerprints):
            self._assemble_bulk()
            with self.watch.stage("solve"):
                self._krylov.make_hierarchy(self._tangent, self._rigid.modes, fingerprints)

    def _monitor(self, snes: PETSc.SNES, iteration: int, norm: float) -> None:
        self.residual_history.append(norm)
        self._norms = [*(self._norms if iteration else []), norm]
        self.active_history.append([contact.num_active_local() for contact in self.contacts])
