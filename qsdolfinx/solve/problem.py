"""Nonlinear problem of all bodies and contacts."""

from __future__ import annotations

import contextlib
import itertools
import typing
import weakref

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import FLAG, check, either, instance, one_of, require
from qsdolfinx.base.collective import checked, is_of_all
from qsdolfinx.base.messages import ContactWarning, renamed, say, warn
from qsdolfinx.base.timing import Span
from qsdolfinx.contact import motion, multipliers
from qsdolfinx.contact.chosen_sliding import check_fields, let_follow
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.held import begin_solve, check_held
from qsdolfinx.contact.law_check import check_law
from qsdolfinx.contact.memory import begin_step, end_step
from qsdolfinx.contact.shown import copy_of
from qsdolfinx.gap.no_value import NoValueError
from qsdolfinx.linear.presets import PRESETS, pick
from qsdolfinx.linear.schur import Forms, check_schur, has_schur, num_inside_cells
from qsdolfinx.linear.solver import LinearSolver, preset_options
from qsdolfinx.solve.arguments import (
    LIST,
    OPTIONS,
    Given,
    check_bodies,
    check_free,
    communicator,
)
from qsdolfinx.solve.at_once import AtOnce, are_condensed
from qsdolfinx.solve.before import Before
from qsdolfinx.solve.diagnostics import OF_A_SOLVE, OF_AN_ATTEMPT, diagnose
from qsdolfinx.solve.first_guess import guess
from qsdolfinx.solve.lost import is_a_body_lost
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.snap_through import Jump, SnapThrough, check_snap_through
from qsdolfinx.solve.snes import (
    LOST,
    OF_USER,
    ConvergenceError,
    check_type,
    read_options,
    remove_options,
    set_options,
)
from qsdolfinx.solve.stabilisation import Stabilisation, vanishing
from qsdolfinx.solve.summary import summary
from qsdolfinx.solve.tool_balance import ToolBalance
from qsdolfinx.solve.unsupported import check_unsupported
from qsdolfinx.system.blocks import Blocks, Side
from qsdolfinx.system.body import Body
from qsdolfinx.system.compiling import Compiling
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.matrices import Form
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]
Conditions = typing.Sequence[fem.DirichletBC]
_counter = itertools.count()

#: Linear solvers that ``"auto"`` has chosen in this process, and that have been logged.
told: set[str] = set()


class ContactProblem:
    """Nonlinear problem: F_i(u_i; v_i) + ∂Φ/∂u_i (v_i) = 0 for all bodies i and test functions v_i.

    Φ is the energy of all contacts. Every body has its own mesh. The unknowns of a rank are those
    of its part of body 0, then of body 1, and so on. The tangent is a MatNest (``blocks.nest``):
    diagonal blocks contain the bulk forms and contact, the other blocks contain contact only. With
    ``kind="mpi"`` the tangent is one AIJ matrix; with ``"amg"`` it is a sum that is never formed.

    Args:
        F: Residual of each body, such as ``inner(sigma(u), grad(v)) * dx - inner(f, v) * dx``. A
            single body needs no list.
        u: Unknown of each body; its values are the initial guess.
        contacts: Contacts between the bodies; may be empty. A single contact needs no list. A
            contact belongs to one problem at a time. The first solve of a new problem takes its
            contacts over; the earlier problem can then no longer be solved.
        bcs: Dirichlet conditions of all bodies in one list, or a list for each body; also on
            contact nodes.
        J: For each body the derivative of F, or None to derive it automatically. UFL detects forms
            that are linear in u; their matrix is assembled once.
        petsc_options_prefix: Prefix of the solver's options; by default a new one for each problem.
        petsc_options: PETSc options without the prefix; they override those of the solver. The
            defaults are ``snes_max_it`` 50 (Newton iterations of a run), ``snes_rtol`` 1e-9
            (unbalanced force over contact forces), ``snes_linesearch_type`` ``"basic"``,
            ``snes_divergence_tolerance`` 1e300. If you name ``snes_type``, a line search or
            ``snes_convergence_test``, your choice is used without a fallback. With the penalty of
            the paper, and without contact, it solves for the bodies; otherwise for bodies,
            multipliers and force-controlled tools together. In the second case the type must be
            ``"newtonls"``, ``"newtontr"`` (direct solvers), ``"ksponly"`` or ``"python"``, or one
            of ``"ngmres"``, ``"anderson"``, ``"nrichardson"`` and ``"qn"`` with ``npc_snes_type``
            ``"newtonls"``.
        kind: Matrix type for the linear solver, ``"mpi"`` or ``"nest"``.
        linear_solver: ``"direct"``: MUMPS. ``"amg"``: CG, or GMRES where the tangent is not
            symmetric, with algebraic multigrid; it needs an augmented Lagrangian or another
            moderate penalty. ``"fieldsplit"``: as ``"amg"``, with multigrid for each body's block
            of the MatNest. ``"schur"``, for bodies in velocity and pressure: FGMRES, with multigrid
            for velocities and displacements, and pressure mass matrices. ``"auto"``, the default:
            direct unless the problem is large; the choice of another solver is logged once in each
            process. With an option ``ksp_type`` or ``pc_type``, ``"auto"`` uses these options.
        pressure_preconditioner: For ``"schur"``: for each body None, or a bilinear form on its
            space that approximates its Schur complement, such as ``p * q / (2 * eta) * dx``, with
            either sign. By default it is computed from the tangent, with the viscosity of each
            iterate. Not used if ``"auto"`` chooses another solver; an error if another solver is
            given by name.
        stabilisation: Springs for bodies for which the Dirichlet conditions leave a rigid motion;
            they do not change the result, see :class:`Stabilisation`. With None, only bodies
            without any Dirichlet condition have springs.
        form_compiler_options: Options of FFCx for the bodies' forms, as in ``dolfinx.fem.form``.
        jit_options: Options of the C compiler for these forms, as in ``dolfinx.fem.form``. Without
            ``"cffi_extra_compile_args"``, here or in a file of DOLFINx's options, forms are
            optimised for the processors of all ranks.
        entity_maps: Maps between meshes, as in ``dolfinx.fem.form``, where a form has coefficients
            on another mesh, such as a sub-mesh of the body's mesh.
        verbose: Whether to log a line for every solve (rank 0, logger ``"qsdolfinx"``; it is
            printed if logging has no handlers).
        solver: Former name of ``linear_solver``.

    Raises:
        ValueError: If the numbers of forms, unknowns and conditions differ, a surface belongs to
            none of the bodies, or a name is unknown (also of a type in PETSc's options); or if the
            type of SNES cannot solve for multipliers.

    Attributes:
        linear_solver: Preset of the linear solver, or ``"options"`` if PETSc's options alone
            determine the solver. It does not change while a direct solver is used as a fallback:
            see :attr:`solver_in_use`.
        stabilisation_shares: Share of the springs of ``stabilisation`` in the forces of the last
            result: ``[0.0]``, since they vanish; empty without ``stabilisation``.
        active_history: Number of active constraints of each contact at each iteration of the last
            solve, over all ranks.
        system: Residual and tangent of the problem.
        newton: Newton's method for the system.
    """

    def __init__(
        self,
        F: ufl.Form | typing.Sequence[ufl.Form],
        u: fem.Function | typing.Sequence[fem.Function],
        contacts: Contact | typing.Sequence[Contact],
        bcs: Conditions | typing.Sequence[Conditions] | None = None,
        J: ufl.Form | typing.Sequence[ufl.Form | None] | None = None,
        *,
        petsc_options_prefix: str | None = None,
        petsc_options: dict[str, typing.Any] | None = None,
        kind: str | None = None,
        linear_solver: str | None = None,
        pressure_preconditioner: Forms = None,
        stabilisation: Stabilisation | None = None,
        form_compiler_options: dict[str, typing.Any] | None = None,
        jit_options: dict[str, typing.Any] | None = None,
        entity_maps: typing.Any = None,
        verbose: bool = False,
        solver: str | None = None,
    ) -> None:
        self._is_single = isinstance(u, fem.Function)
        given = Given.from_arguments(F, u, contacts, bcs, J)
        with checked(communicator(given.u)) as same:
            linear_solver = renamed("solver", "linear_solver", solver, linear_solver) or "auto"
            check(LIST, F=given.F, u=given.u, contacts=given.contacts)
            check(either(LIST, None), bcs=given.bcs, J=given.J)
            given = given.with_lists()
            same(contacts=len(given.contacts))
            same(one_of(("auto", *PRESETS)), linear_solver=linear_solver)
            if kind is None:
                kind = "nest" if linear_solver == "fieldsplit" else "mpi"
            same(one_of(("mpi", "nest")), kind=kind)
            fits = linear_solver != "amg" or kind == "mpi"
            require(fits, 'kind: linear_solver="amg" needs kind="mpi"; use "fieldsplit"')
            check_bodies(*given)
            check_fields([contact.model for contact in given.contacts])
            same(u=len(given.u), bcs=[len(entry) for entry in given.bcs])
            check_schur(given.F, given.u, linear_solver, kind, pressure_preconditioner)
            same(either(instance(str, "a string"), None), petsc_options_prefix=petsc_options_prefix)
            same(either(OPTIONS, None), petsc_options=petsc_options)
            kind_of = instance(Stabilisation, "a Stabilisation")
            same(either(kind_of, None), stabilisation=stabilisation)
            names = {"form_compiler_options": form_compiler_options, "jit_options": jit_options}
            check(either(OPTIONS, None), **names)
            same(**names)
            same(FLAG, verbose=verbose)
        self.verbose = bool(verbose)
        self.stabilisation = stabilisation
        self.stabilisation_shares: list[float] = []
        self._had_contacts = False
        self._steps_within = 0
        self._watches_reach, self._is_checked = True, False
        compiling = Compiling(form_compiler_options, jit_options, entity_maps)
        bodies = [Body(f, x, held, K, compiling) for f, x, held, K in given.bodies]
        prefix = f"qsdolfinx_{next(_counter)}_" if petsc_options_prefix is None else ""
        prefix = petsc_options_prefix or prefix
        remove_options(prefix)
        options_given = petsc_options or {}
        chosen = {*options_given, *PETSc.Options(prefix).getAll()}
        self.linear_solver = _pick(linear_solver, given.F, bodies, kind, chosen)
        sums = self.linear_solver in ("amg", "schur") and "pc_type" not in chosen
        if self.linear_solver == "fieldsplit" and len(bodies) == 1:
            kind = "mpi"  # there is nothing to split
        self._contacts = list(given.contacts)
        models = [contact.model for contact in given.contacts]
        self.system = ContactSystem(bodies, models, Form.SUM if sums else Form(kind))
        options = preset_options(self.linear_solver, len(bodies), chosen)
        defaults = set_options(prefix, options_given, options)
        snes: PETSc.SNES = PETSc.SNES().create(comm=self.comm)
        snes.setOptionsPrefix(prefix)
        try:
            read_options(snes)
            linear = LinearSolver(
                snes.getKSP(),
                self.linear_solver,
                self.system,
                chosen,
                pressure_preconditioner,
                linear_solver != "auto",
            )
            if models and not are_condensed(models):
                check_type(snes, linear.has_factors)
        except ValueError:
            remove_options(prefix)
            snes.destroy()
            self.system.destroy()
            raise
        let_follow(
            [
                model
                for model, sides in zip(models, self.system.sides, strict=True)
                if not all(i is None or bodies[i].linear for i in sides)
            ]
        )
        self.newton = Newton(self.system, snes, linear, defaults)
        self._at_once = AtOnce(self.newton)
        self._snap_through = SnapThrough(self.system)
        self.active_history: list[list[int]] = []
        self._equations: Equations | None = None
        self._is_at_once = False

    # --- Parts of the problem

    @property
    def solver(self) -> PETSc.SNES:
        """PETSc's nonlinear solver, as in ``dolfinx.fem.petsc.NonlinearProblem``.

        Raises:
            RuntimeError: If the problem has been destroyed.
        """
        return self.newton.snes

    @property
    def snes(self) -> PETSc.SNES:
        """The same as :attr:`solver`."""
        return self.solver

    @property
    def u(self) -> list[fem.Function]:
        """Unknown of each body."""
        return self.system.u

    @property
    def bodies(self) -> list[Body]:
        """The bodies."""
        return self.system.bodies

    @property
    def contacts(self) -> list[Contact]:
        """The contacts."""
        return self._contacts

    @property
    def sides(self) -> list[Side]:
        """Indices of the slave's and master's body for each contact; None for a rigid tool."""
        return self.system.sides

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the bodies."""
        return self.system.comm

    @property
    def unknowns(self) -> list[str]:
        """Unknown of each body in its contacts: ``"displacement"`` or ``"velocity"``."""
        return self.system.unknowns

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric; its matrix is marked accordingly."""
        return self.system.symmetric

    @property
    def blocks(self) -> Blocks | None:
        """Tangent as a MatNest, ``blocks.nest``; with the bulk forms only if ``kind="nest"``.

        None before the first solve, and with ``"amg"`` and ``"schur"``, which never form it.
        """
        return self.system.made.blocks if self.system.has_matrices else None

    @property
    def solver_in_use(self) -> str:
        """Value of :attr:`linear_solver`, or ``"direct"`` while that is used as a fallback."""
        linear = self.newton.linear
        return "direct" if linear.given_up.is_now else self.linear_solver

    # --- Results of the last solve

    @property
    def residual_history(self) -> list[float]:
        """Norm of the residual at each iteration of the last solve."""
        return self.newton.record.residuals

    @property
    def violation_history(self) -> list[float]:
        """Largest gap (length) left by the multipliers of augmented Lagrangians, if any."""
        return self.newton.record.violations

    @property
    def num_iterations(self) -> int:
        """Newton iterations of the last solve."""
        return self.newton.record.iterations

    @property
    def num_linear_iterations(self) -> int:
        """Iterations of the linear solver in the last solve."""
        return self.newton.record.linear_iterations

    @property
    def num_augmentations(self) -> int:
        """Always 0, since multipliers are unknowns; kept for programs that read this attribute."""
        return 0

    @property
    def num_restarts(self) -> int:
        """Number of runs of Newton's method in the last solve that failed and were restarted.

        A run is restarted from the start of the step, or, if an iterative linear solver has failed,
        with a direct solver.
        """
        return self.newton.record.restarts

    @property
    def timings(self) -> dict[str, Span]:
        """Wall time (s) of each stage since the problem was made. Collective.

        For stages of contacts, the time since the contacts were made.

        Returns:
            The largest and the smallest time of all ranks in each stage: ``"pairing"``, ``"gap"``,
            ``"insertion"`` of contact blocks, ``"bulk assembly"``, ``"conversion"`` of the MatNest,
            and ``"solve"``, the rest of the nonlinear solver, which is the linear solver. PETSc's
            ``-log_view`` has the same stages.
        """
        return self.system.timings

    # --- For other solvers

    def equations(self) -> Equations:
        """Return one system R(z) = 0 for all unknowns, for a solver of your own. Collective.

        See :class:`qs.Equations`. The equations belong to the present contact pairs, loads and
        conditions: call this method again after one of these has changed.

        Raises:
            RuntimeError, ValueError: As :meth:`set_up`; also for scalar fields, and for contact
                with constraints at points.
        """
        self.set_up()
        if self._equations is not None:
            self._equations.destroy()
        self._equations = Equations(self.system)
        self._equations.one_step = self.one_step
        return self._equations

    def residual(self, z: Array) -> Array:
        """Residual R(z) of the last :meth:`equations`, or of new equations. Collective.

        Args:
            z: This rank's part of the unknowns.
        """
        return self._current_equations().residual(z)

    def tangent(self, z: Array) -> PETSc.Mat:
        """Derivative of R(z), an AIJ matrix that belongs to the problem. Collective.

        Args:
            z: As for :meth:`residual`.
        """
        return self._current_equations().tangent(z)

    def _current_equations(self) -> Equations:
        """The last equations, or new ones if the contact pairs have changed since. Collective."""
        if self._equations is None or not self._equations.is_current:
            return self.equations()
        return self._equations

    # --- Solving

    @contextlib.contextmanager
    def one_step(self, watch: bool = True, has_checks: bool = False) -> typing.Iterator[None]:
        """Treat all solves inside the block as attempts at one step. Collective.

        Friction counts slip from the end of the last step. Without this block each solve that
        succeeds is a step.

        Args:
            watch: Whether solves warn of points that have passed through the other surface without
                being found, see :class:`ReachWarning`. Not needed if the caller checks this at the
                end of the step.
            has_checks: Whether the caller makes all other checks of contacts at the end of the
                step, as a time stepper does: contact pairs may still be updated in the step.
        """
        self.system.check_alive()
        if self._steps_within == 0:
            self._at_once.begin_step()
        self._steps_within += 1
        before = self._watches_reach, self._is_checked
        self._watches_reach = watch and self._watches_reach
        self._is_checked = has_checks or self._is_checked
        try:
            yield
        finally:
            self._steps_within -= 1
            self._watches_reach, self._is_checked = before
        if self._steps_within == 0:
            self._snap_through.accept()
            for contact in self.system.contacts:
                end_step(contact)

    def check_step(self) -> Jump | None:
        """Warn if the present step has jumped to a distant equilibrium. Collective.

        A single :meth:`solve` and a time stepper do this themselves. Call it inside the block of
        :meth:`one_step`, after its last solve.

        Returns:
            The jump, or None. If ``is_wrong``, no motion leads to this equilibrium, and there is no
            warning: the step should be made again with a smaller Δt. Otherwise the next step should
            begin at rest: the motion of a jump does not continue.
        """
        return check_snap_through(self._snap_through, self._at_once.start, self._at_once.missed)

    def set_up(self) -> None:
        """Compute automatic penalties and build the matrices, as solve() does. Collective.

        Raises:
            RuntimeError: If the problem has been destroyed, or a rigid tool has another position
                than in the last contact detection.
            ValueError: If another problem has taken over a contact since.
        """
        self.system.check_alive()
        self._claim_contacts()
        with interrupt.heeded(self.comm):
            self._set_up()

    def _set_up(self) -> None:
        for contact in self.system.contacts:
            begin_step(contact)
            motion.catch_up(contact)
        for body in self.bodies:
            body.begin_solve()
        self.newton.update_matrices()
        for contact in self.system.contacts:
            check_law(contact)
            motion.move_tool(contact)
            if contact.friction is not None:
                contact.friction.read_parameters(contact.slips)
        for contact, (s, m) in zip(self.system.contacts, self.sides, strict=True):
            motion.begin_to_follow(contact, self.u[s], None if m is None else self.u[m])
            motion.begin_slip(contact, self.u[s], None if m is None else self.u[m])
        self._find_moved()

    def _find_moved(self) -> None:
        """Set the motion of contact nodes that Dirichlet conditions hold on both sides."""
        if not any(contact.held_slips for contact in self.system.contacts):
            return
        vecs = [body.create_vec() for body in self.bodies]
        for vec, body in zip(vecs, self.bodies, strict=True):
            vec.array[:] = body.with_conditions(body.u.x.array[: body.num_owned])
        for contact, (s, m) in zip(self.system.contacts, self.sides, strict=True):
            begin_solve(contact, vecs[s], None if m is None else vecs[m])
        for vec in vecs:
            vec.destroy()

    def _claim_contacts(self) -> None:
        """Make the contacts part of this problem. Collective."""
        with checked(self.comm):
            if self._had_contacts:  # the first solve of a new problem takes them over
                check_free(self.system.contacts, self)
        self._had_contacts = True
        for contact in self.system.contacts:
            contact.problem = weakref.ref(self)

    def solve(self) -> fem.Function | list[fem.Function]:
        """Solve for all bodies, from their present u. Collective.

        With friction each solve is the next step of the history, see :meth:`one_step`.

        Returns:
            The unknowns, which contain the solution: a list, or a single Function if ``u`` was
            given as a single Function.

        Raises:
            ConvergenceError: If the nonlinear solver does not converge; the unknowns and the
                results of the contacts are then as before the solve.
            RuntimeError, ValueError: As :meth:`set_up`.
            KeyboardInterrupt: After Ctrl-C, on all ranks, whichever ranks have received it;
                unknowns, multipliers, tools and the results of the contacts are then as before the
                solve.

        Warns:
            ReachWarning: If points have passed through the other surface, further away than contact
                detection had searched.
            ContactWarning: If Dirichlet conditions on both sides press contact nodes into each
                other; if an edge has penetrated between nodes, with hardly any contact force; or if
                the solve has jumped to a distant equilibrium.
        """
        with (
            interrupt.heeded(self.comm),
            self._or_as_before(),
            self.one_step(),
            summary(self.newton, self.verbose),
        ):
            self._solve()
            interrupt.look(self.comm)
        return self.u[0] if self._is_single else self.u

    @contextlib.contextmanager
    def _or_as_before(self) -> typing.Iterator[None]:
        """Restore everything if the block is interrupted, or if a callback fails."""
        before = Before(self.system)
        try:
            yield
        except (ConvergenceError, Warning):
            raise
        except BaseException as error:
            alone = self.comm.size > 1 and not isinstance(error, Exception)
            if interrupt.is_of_all(error) or is_of_all(error) or not alone:
                before.restore()
            raise

    def _solve(self) -> None:
        self._claim_contacts()
        shown = [copy_of(contact) for contact in self.system.contacts]
        for contact in self.system.contacts:
            motion.catch_up(contact)
        state = [body.u.x.array.copy() for body in self.bodies]
        known = [multipliers.known(contact) for contact in self.system.contacts]
        vertices = [gap.state.vertices for gap in self.system.gaps]
        self._begin_slips()
        with interrupt.heeded(self.comm):
            self._set_up()
        balance = ToolBalance(self.system)
        start = self._starting_point()
        self.newton.begin()
        try:
            self._find(balance, start)
            if is_a_body_lost(self.system, start):
                self.newton.fail(LOST)
        except BaseException as error:
            self._put_back(known, vertices)
            if isinstance(error, ConvergenceError):
                balance.restore()
            self._begin_slips()
            if isinstance(error, ConvergenceError):
                self.active_history = error.active_history
                if error.reason != OF_USER:
                    self._advise(error)
                with contextlib.suppress(NoValueError):  # of a law, after the gaps
                    self.system.residual(start)  # gaps and multipliers too
                for contact, before in zip(self.system.contacts, shown, strict=True):
                    contact.kept = before
            for body, array in zip(self.bodies, state, strict=True):
                body.u.x.array[:] = array
            raise
        self.active_history = self.newton.record.active_of_all(self.comm)
        for contact, (s, m) in zip(self.system.contacts, self.sides, strict=True):
            unknowns = self.bodies[s].x, None if m is None else self.bodies[m].x
            if self._watches_reach:
                diagnose(self.newton, contact, OF_AN_ATTEMPT if self._is_checked else OF_A_SOLVE)
            check_held(contact, *unknowns)
        if self._steps_within == 1 and (jump := self.check_step()) is not None and jump.is_wrong:
            warn(jump.text, ContactWarning)
        if self._watches_reach:
            check_unsupported(self.system, start)

    def _find(self, balance: ToolBalance, start: Array) -> None:
        """Solve for all unknowns, or by the paper's own method if it applies. Collective."""
        self._is_at_once = self._at_once.fits or self.stabilisation is not None
        if not self._is_at_once:
            if self._is_found_by_penalty(balance, start):
                return
            self._is_at_once = True
        before, again = Before(self.system), self._at_once.again
        self._find_at_once()
        while self._has_other_rates():
            # Which constraints begin the step open, and from when slip counts, must be as before.
            frictions = [c.friction for c in self.system.contacts if c.friction is not None]
            rates = [friction.rate for friction in frictions]
            before.restore()
            for friction, rate in zip(frictions, rates, strict=True):
                friction.continue_with(rate)
            self._at_once.again = again
            self._find_at_once()
        if not self.newton.has_users_snes:
            self.newton.end_at(PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE)
        self.stabilisation_shares = [] if self.stabilisation is None else [0.0]

    def _find_at_once(self) -> None:
        """Solve for all unknowns together. Collective."""
        at_once = self._at_once
        if not at_once.solve(vanishing(self.stabilisation)):
            self.newton.fail(at_once.reason, at_once.linear_reason, at_once.why)

    def _is_found_by_penalty(self, balance: ToolBalance, start: Array) -> bool:
        """Whether SNES finds the bodies' unknowns alone, with contact condensed. Collective.

        If it does not, the problem is solved for all unknowns.
        """
        guess(self.system)
        try:
            self.newton.solve()
        except ConvergenceError:
            if self.newton.has_users_snes:
                raise
            balance.restore()
            self._begin_slips()
            self.system.x.array[:] = start
            count = self.newton.record.iterations
            self.newton.begin()
            self.newton.record.iterations = count
            return False
        return True

    def _put_back(self, known: list[list[multipliers.Known]], vertices: list[typing.Any]) -> None:
        """Restore the multipliers, and the set of vertices that have points."""
        for contact, kept in zip(self.system.contacts, known, strict=True):
            multipliers.set_known(contact, kept)
        for gap, chosen in zip(self.system.gaps, vertices, strict=True):
            gap.state.vertices = chosen

    def _advise(self, error: ConvergenceError) -> None:
        """Add remedies to the error."""
        contacts = self.system.contacts
        if contacts and all(contact.is_scalar for contact in contacts):
            if self.system.made.rigid.free_motions.shape[1] > 0:
                error.advise(
                    "nothing may hold the field: give Dirichlet conditions, a capacity or a tool"
                )
            return
        if self.stabilisation is None and self.system.made.rigid.free_motions.shape[1] > 0:
            error.advise(
                "bodies that only contact holds may have lost contact during the solve: "
                "stabilisation=qs.Stabilisation() holds them by springs that vanish at the end; "
                "a rotation that frictionless curved surfaces do not resist needs a condition"
            )

    def _has_other_rates(self) -> bool:
        """Whether slip rates differ from the rate that friction has assumed as slow. Collective."""
        found = [
            contact.friction.learn_rate(
                contact.slips, contact.kinematics.dt, contact.paired.facet_size
            )
            for contact in self.system.contacts
            if contact.friction is not None
        ]
        return any(found)

    def _begin_slips(self) -> None:
        for slip in self.system.slips:
            slip.begin_solve()

    def _starting_point(self) -> Array:
        """Set the system to the bodies' unknowns; returns a copy of them."""
        for body, part in zip(self.bodies, self.system.parts(self.system.x.array), strict=True):
            values = body.u.x.array[: body.num_owned].copy()
            # Linear ones are evaluated as if their Dirichlet values were in place.
            part[:] = body.with_conditions(values) if body.linear else values
        return self.system.x.array.copy()

    def destroy(self) -> None:
        """Free PETSc's objects and options; later use of the problem raises an error. Collective.

        In parallel, PETSc's objects are not freed when Python deletes them. A program that makes
        many problems should call this method for each problem. A second call does nothing. Contacts
        do not change: they may be used in another problem, and keep their penalty, multipliers and
        history of friction there.
        """
        if self.system.is_destroyed:
            return
        self.newton.linear.destroy()
        if self._equations is not None:
            self._equations.destroy()
        remove_options(self.snes.getOptionsPrefix())
        self.newton.snes.destroy()
        self.system.destroy()
        for contact in self.system.contacts:
            if contact.problem is not None and contact.problem() is self:
                contact.problem = None


def _pick(
    solver: str,
    F: typing.Sequence[ufl.Form],
    bodies: typing.Sequence[Body],
    kind: str,
    chosen: typing.Collection[str],
) -> str:
    """Choose the linear solver if the user has not named one; returns its name. Collective."""
    if solver != "auto":
        return solver
    if {"ksp_type", "pc_type"} & set(chosen):
        return "options"
    gdim, comm = bodies[0].V.mesh.geometry.dim, bodies[0].comm
    has_modes = all(body.V.dofmap.index_map_bs == gdim for body in bodies)
    size = sum(body.V.dofmap.index_map.size_global * body.V.dofmap.index_map_bs for body in bodies)
    is_flow = has_schur(F, [body.u for body in bodies])
    if is_flow:  # all solvers eliminate bubbles cell by cell
        size -= sum(num_inside_cells(body.V) for body in bodies)
    name, reason = pick(size, gdim, has_modes, kind, is_flow)
    if name != "direct" and name not in told:
        told.add(name)
        say(comm, f'linear_solver="{name}": {reason}')
    return name
