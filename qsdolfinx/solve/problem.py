"""Bodies and contacts as one nonlinear problem, solved by PETSc's SNES."""

from __future__ import annotations

import contextlib
import itertools
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from qsdolfinx.base.checks import check_choice, check_flag
from qsdolfinx.base.collective import check_agreement, collective_errors
from qsdolfinx.base.log import say, summary
from qsdolfinx.contact.balance import check_balance
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.reach import check_reach
from qsdolfinx.linear.krylov import Krylov
from qsdolfinx.linear.presets import BLOCK, ITERATIVE, PRESETS, pick
from qsdolfinx.linear.schur import Forms, Schur, check_schur, has_schur
from qsdolfinx.solve.arguments import check_arguments, check_options, check_sequences, communicator
from qsdolfinx.solve.augmented import AugmentedNewton
from qsdolfinx.solve.first_guess import BALANCED, Foundation
from qsdolfinx.solve.snes import (
    ConvergenceError,
    chosen_by_user,
    remove_options,
    set_options,
    weak,
)
from qsdolfinx.solve.tool_balance import Drive
from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]
_counter = itertools.count()


class ContactProblem(AugmentedNewton):
    """Find u_i with F_i(u_i; v_i) + ∂Φ/∂u_i (v_i) = 0 for all bodies i and test functions v_i.

    Φ is the energy of all contacts. Every body has its own mesh. The unknowns of a rank are those
    of its part of body 0, then of body 1, and so on. The tangent is a MatNest (``blocks.nest``)
    with the bulk forms and contact on the diagonal and contact alone elsewhere; with
    ``kind="mpi"`` it is one AIJ matrix, or with ``"amg"`` a sum that is never formed.

    Args:
        F: Residual of each body, such as ``inner(sigma(u), grad(v)) * dx - inner(f, v) * dx``.
        u: Unknown of each body, the initial guess.
        contacts: Contacts between the bodies; may be empty.
        bcs: For each body the list of its Dirichlet conditions; also on contact nodes.
        J: For each body the derivative of F, or None to derive it. Forms that are linear in u are
            found by UFL, and their matrix is assembled once.
        petsc_options_prefix: Prefix of the solver's options; by default a new one for each problem.
        petsc_options: PETSc options without the prefix, on top of those of the solver.
        kind: ``"mpi"`` or ``"nest"``, the matrix type that the linear solver sees.
        solver: Linear solver: ``"direct"`` (MUMPS), ``"amg"`` (CG, or GMRES where the tangent is
            not symmetric, with algebraic multigrid; wants an augmented Lagrangian or another
            moderate penalty), ``"fieldsplit"`` (the same, with multigrid for each body's block of
            the MatNest), ``"schur"`` (bodies in velocity and pressure: FGMRES, with multigrid for
            velocities and displacements, and pressure mass matrices), or ``"auto"``: direct unless
            the problem is large, which is then logged; nothing of all this if there is any
            ``ksp_`` or ``pc_`` option.
        pressure_preconditioner: For ``"schur"``: for each body None or a bilinear form on its space
            that stands for its Schur complement, such as ``p * q / (2 * eta) * dx``, of either
            sign. By default it is found from the tangent, at the viscosity of each iterate.
        verbose: Whether to log a line about every solve (rank 0, logger ``"qsdolfinx"``, which
            prints as long as logging has no handlers).

    Raises:
        ValueError: If the numbers of forms, unknowns and conditions differ, a surface belongs to
            none of the bodies, or a name is unknown.
    """

    def __init__(
        self,
        F: typing.Sequence[ufl.Form],
        u: typing.Sequence[fem.Function],
        contacts: typing.Sequence[Contact],
        bcs: typing.Sequence[typing.Sequence[fem.DirichletBC]] | None = None,
        J: typing.Sequence[ufl.Form | None] | None = None,
        *,
        petsc_options_prefix: str | None = None,
        petsc_options: dict[str, typing.Any] | None = None,
        kind: str | None = None,
        solver: str = "auto",
        pressure_preconditioner: Forms = None,
        verbose: bool = False,
    ) -> None:
        with collective_errors(communicator(u)):
            check_sequences(F=F, u=u, contacts=contacts, bcs=bcs, J=J)
            bcs = [[] for _ in u] if bcs is None else bcs
            J = [None for _ in u] if J is None else J
            check_choice("solver", solver, ("auto", *PRESETS))
            if kind is None:
                kind = "nest" if solver == "fieldsplit" else "mpi"
            if solver == "amg" and kind == "nest":
                raise ValueError('kind: solver="amg" needs kind="mpi"; use "fieldsplit"')
            check_arguments(F, u, contacts, bcs, J, kind)
            check_schur(u, solver, kind, pressure_preconditioner)
            check_options(petsc_options_prefix, petsc_options)
            check_flag("verbose", verbose)
        check_agreement(
            communicator(u),
            contacts=len(contacts),
            kind=kind,
            solver=solver,
            petsc_options_prefix=petsc_options_prefix,
            petsc_options=petsc_options,
            verbose=verbose,
        )
        super().__init__([Body(*given) for given in zip(F, u, bcs, J, strict=True)], contacts, kind)
        self.verbose = bool(verbose)
        self._steps_within = 0
        prefix = petsc_options_prefix
        prefix = f"qsdolfinx_{next(_counter)}_" if prefix is None else prefix
        remove_options(prefix)
        given = petsc_options or {}
        chosen = {*given, *PETSc.Options(prefix).getAll()}
        self.solver = self._pick(solver, prefix, petsc_options or {})
        self._sums = self.solver == "amg" and "pc_type" not in chosen
        self._schur = None
        if self.solver == "schur":
            self._schur = Schur(self.bodies, pressure_preconditioner)
        self.has_full_steps = set_options(prefix, petsc_options or {}, self._linear_options())
        self.snes = PETSc.SNES().create(comm=self.comm)
        self.snes.setOptionsPrefix(prefix)
        self.snes.setFromOptions()
        self.snes.setMonitor(weak(self._monitor))
        self._krylov = None
        if self.solver in ITERATIVE:
            self._krylov = Krylov(self.snes, chosen, all(body.linear for body in self.bodies))

    def _pick(self, solver: str, prefix: str, given: dict[str, typing.Any]) -> str:
        if solver != "auto":
            return solver
        if chosen_by_user(prefix, given):
            return "options"
        gdim = self.bodies[0].V.mesh.geometry.dim
        has_modes = all(body.V.dofmap.index_map_bs == gdim for body in self.bodies)
        size, flows = self._x.getSize(), has_schur(self.u)
        name, reason = pick(size, gdim, has_modes, self._kind, flows)
        if name != "direct":
            say(self.comm, f'solver="{name}": {reason}')
        return name

    def _linear_options(self) -> dict[str, typing.Any]:
        """The preset's options."""
        options = dict(PRESETS.get(self.solver, {}))
        if self.solver == "amg" and not self._sums:  # the user has another preconditioner
            options = {key: value for key, value in options.items() if key.startswith("ksp_")}
        if self.solver == "fieldsplit":
            for i in range(len(self.bodies)):
                options |= {f"fieldsplit_{i}_{key}": value for key, value in BLOCK.items()}
        return options

    @contextlib.contextmanager
    def one_step(self) -> typing.Iterator[None]:
        """Make all solves inside the block attempts at one step. Collective.

        Friction counts slip from the end of the last step. Without this block each solve that
        succeeds is a step.
        """
        self._steps_within += 1
        try:
            yield
        finally:
            self._steps_within -= 1
        if self._steps_within == 0:
            for contact in self.contacts:
                contact.end_step()

    def set_up(self) -> None:
        """Compute automatic penalties and build the matrices, as solve() does. Collective."""
        for body in self.bodies:
            body.begin_solve()
        if self.blocks is None or self._paired != [c.version for c in self.contacts]:
            self._rebuild()
        for contact in self.contacts:
            contact.move_tool()
            if contact.tangential is not None:
                contact.tangential.read_parameters()

    def solve(self) -> list[fem.Function]:
        """Solve for all bodies, from their present u. Collective.

        With friction it is the next step of the history, see :meth:`one_step`.

        Returns:
            The unknowns, which hold the solution.

        Raises:
            ConvergenceError: If SNES does not converge; the unknowns are then as they were before.

        Warns:
            BalanceWarning: If the forces on the two sides differ by much (two-half-pass).
            ReachWarning: If nodes that were too far away to be paired may have been in contact.
        """
        with self.one_step(), summary(self):
            self._solve()
        return self.u

    def _solve(self) -> None:
        start = [body.u.x.array.copy() for body in self.bodies]
        multipliers = [contact.known_multipliers() for contact in self.contacts]
        for slip in self._slips:
            slip.stick_slip.begin_solve()
        self._begin_solve()
        self.residual_history, self.active_history, self.violation_history = [], [], []
        self.num_iterations = self.num_linear_iterations = 0
        try:
            if self._drive.tools:
                self._evaluate(self._start)
                self._drive.approach()
            self._predict()
            with self._first_accuracy():
                self._equilibrate()
            self._augment()
        except BaseException as error:  # Ctrl-C, too
            for contact, kept in zip(self.contacts, multipliers, strict=True):
                contact.set_known_multipliers(kept)
            if isinstance(error, Exception) or self.comm.size == 1:  # else on this rank alone
                self._drive.restore()
            for slip in self._slips:
                slip.stick_slip.begin_solve()
                slip.stick_slip.end_iterations()
            if isinstance(error, ConvergenceError):
                self._evaluate(self._start)  # gaps and multipliers too
            self._restore(start)
            raise
        self.active_history = self._all_active()
        for contact, (s, m) in zip(self.contacts, self.sides, strict=True):
            check_balance(contact)
            check_reach(contact, self.bodies[s].x, None if m is None else self.bodies[m].x)

    # --- State

    def _begin_solve(self) -> None:
        self.set_up()
        self._drive = Drive(self.contacts, self.sides, self._moduli)
        for i, body in enumerate(self.bodies):
            values = body.u.x.array[: body.num_owned].copy()
            if body.linear:  # evaluated as if its Dirichlet values were in place
                values = body.with_conditions(values)
            self._part(self._x.array, i)[:] = values
        self._start = self._x.array.copy()

    def _restore(self, arrays: list[Array]) -> None:
        for body, array in zip(self.bodies, arrays, strict=True):
            body.u.x.array[:] = array

    def _rebuild(self) -> None:
        if self._krylov is not None:
            self._krylov.forget()
        super()._rebuild()
        assert self.blocks is not None
        self.snes.reset()
        self.snes.setFunction(weak(self._function), self._r)
        self.snes.setJacobian(weak(self._jacobian), self._matrix, self._matrix)
        pc = self.snes.getKSP().getPC()
        if pc.getType() == PETSc.PC.Type.FIELDSPLIT:
            # A reset takes the options from the splits: start from scratch.
            pc.setType(PETSc.PC.Type.NONE)
            pc.setFromOptions()
            if self._schur is not None:
                self._schur.split(pc, self._scales)
                return
            index_sets = self.blocks.nest.getNestISs()[0]
            pc.setFieldSplitIS(*((str(i), index_set) for i, index_set in enumerate(index_sets)))

    def destroy(self) -> None:
        """Free PETSc's objects and options; the problem cannot be used again. Collective.

        In parallel PETSc's objects are not freed when Python drops them. A program that makes many
        problems should call this for each. A second call does nothing.
        """
        if not self.snes:
            return
        if self._krylov is not None:
            self._krylov.forget()
        self._destroy_matrices()
        if self._schur is not None:
            self._schur.destroy()
        remove_options(self.snes.getOptionsPrefix())
        self.snes.destroy()
        self._x.destroy()
        self._r.destroy()
        for body in self.bodies:
            body.destroy()

    # --- First guess and near-nullspace

    def _predict(self) -> None:
        """Bring bodies that only contact holds to where their loads press them together.

        The bulk matrix of such a body is singular, and Newton's method would start from whatever
        happens to touch. Left alone if contact balances a good part of the loads already.
        """
        assert self._rigid is not None
        residual = self._evaluate(self._x.array_r)
        self._first_norm = self._norm(residual)
        self._predicted = 1.0
        motions = self._rigid.free_motions
        if not self.contacts or motions.shape[1] == 0 or min(self._moduli) == 0:
            return
        parts = [self._part(residual, i) for i in range(len(self.bodies))]
        bulk, whole = (motions.T @ self._rigid.work(r) for r in (self._bulk_residuals, parts))
        if np.linalg.norm(whole) <= BALANCED * np.linalg.norm(bulk):
            return
        foundation = Foundation(
            self._rigid, self.contacts, self.sides, self._moduli, self._bulk_residuals
        )
        motion = foundation.settle()
        if motion is not None:
            for i in range(len(self.bodies)):
                displacement = self._rigid.displacement(motion, i)
                self._part(self._x.array, i)[:] += displacement / self._scales[i]
            # A stiff penalty makes much of the guess's gaps: what counts are the loads.
            guessed = self._norm(self._evaluate(self._x.array_r))
            if 0 < self._first_norm < guessed:
                self._predicted = self._first_norm / guessed
