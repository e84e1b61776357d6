"""Linear solver of a problem: a preset, and its updates when the tangent changes."""

from __future__ import annotations

import dataclasses
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import say
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.linear.factors_again import OF_A_LIBRARY, begin_afresh
from qsdolfinx.linear.hierarchy import Hierarchy
from qsdolfinx.linear.krylov import Krylov
from qsdolfinx.linear.presets import (
    AGGREGATION,
    BLOCK,
    EXACT,
    GMRES_RESTART,
    ITERATIVE,
    KRYLOV,
    PRESETS,
    patience,
)
from qsdolfinx.linear.schur import Forms, Schur
from qsdolfinx.linear.soft_motions import SoftMotions
from qsdolfinx.linear.stop import Stop
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.matrices import Form
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Relative tolerance of that solver as an inner solver. With more, the outer iteration needs
#: several; with less, each takes longer.
INNER = 1e-2

#: Number of unknowns in 2D and 3D up to which a direct solver may be the fallback: more unknowns
#: need too much memory.
LARGEST = {2: 2_000_000, 3: 200_000}

#: Largest number of successive failures that count: a direct solver is then used for 2^this updates
#: of the contact pairs.
MAX_FAILURES = 6


def preset_options(
    name: str, num_bodies: int, chosen: typing.Collection[str]
) -> dict[str, typing.Any]:
    """PETSc options of a preset.

    Args:
        name: Name of the preset; other names have no options.
        num_bodies: Number of bodies.
        chosen: Names of the options that the user has chosen, without the prefix.
    """
    options = dict(PRESETS.get(name, {}))
    if name == "amg" and "pc_type" in chosen:
        options = {key: value for key, value in options.items() if key.startswith("ksp_")}
    if name == "fieldsplit" and num_bodies == 1:
        return KRYLOV | AGGREGATION
    if name == "fieldsplit":
        for i in range(num_bodies):
            options |= {f"fieldsplit_{i}_{key}": value for key, value in BLOCK.items()}
    return options


@dataclasses.dataclass
class GivenUp:
    """Duration of the fallback to a direct solver after a failure.

    It lasts until the next update of the contact pairs; after another failure, for twice as many
    updates.

    Attributes:
        is_now: Whether the fallback is in use.
        failures: Number of failures since the last success.
        pairings: Remaining updates of the contact pairs with the fallback.
    """

    is_now: bool = False
    failures: int = 0
    pairings: int = 0

    def begin(self) -> None:
        """Start the fallback after a failure."""
        self.is_now, self.pairings = True, 2**self.failures - 1
        self.failures = min(self.failures + 1, MAX_FAILURES)

    def pair(self) -> None:
        """Count an update of the contact pairs."""
        if not self.is_now:
            self.failures = 0
        elif self.pairings == 0:
            self.is_now = False
        else:
            self.pairings -= 1


class LinearSolver:
    """Solve linear systems with the tangent of a system.

    Args:
        ksp: PETSc's solver, with its options set.
        name: The preset, or ``"options"``.
        system: The system.
        chosen: Names of the options that the user has chosen, without the prefix.
        pressure_preconditioner: For ``"schur"``, see :class:`qs.ContactProblem`.
        is_named: Whether the user has named the solver.
    """

    def __init__(
        self,
        ksp: PETSc.KSP,
        name: str,
        system: ContactSystem,
        chosen: typing.Collection[str],
        pressure_preconditioner: Forms = None,
        is_named: bool = True,
    ) -> None:
        self.ksp = ksp
        self._system = system
        #: Type and tolerances of an iterative preset.
        self.krylov: Krylov | None = None
        if name in ITERATIVE:
            small = self.may_be_factored and not {"ksp_max_it"} & set(chosen)
            wait = patience(system.x.getSize()) if small and not is_named else None
            slips, is_flow = bool(system.slips), name == "schur"
            self.krylov = Krylov(ksp, chosen, system.linear, slips, is_flow, wait)
        #: Multigrid of ``"amg"``.
        self._hierarchy: Hierarchy | None = None
        #: Preconditioner of ``"schur"``.
        self.schur: Schur | None = None
        if name == "amg" and system.form is Form.SUM:
            self._hierarchy = Hierarchy(system.bodies)
        elif name == "schur" and system.form is Form.SUM:
            self.schur = Schur(ksp, system.bodies, pressure_preconditioner)
        self._may_be_rescued = name in ITERATIVE and not {"ksp_type", "pc_type"} & set(chosen)
        self._is_named = self.krylov is None or "ksp_type" in chosen
        #: Whether the Krylov solver is for the condensed tangent: options set it, or there are no
        #: other unknowns.
        self.is_inner = self._is_named
        #: Iterations of that solver in the last linear solve.
        self.inner_iterations = 0
        #: Fallback to direct solves.
        self.given_up = GivenUp()
        self._stop = Stop(ksp, system.comm)
        #: Motions that the tangent hardly resists.
        self.soft = SoftMotions(system)
        if not self.is_direct:
            ksp.setPostSolve(self.soft.solve)

    @property
    def system(self) -> ContactSystem:
        """The system."""
        return self._system

    def choose_inner(self, is_condensed: bool) -> None:
        """Choose conjugate gradients for a symmetric tangent that is condensed exactly.

        Args:
            is_condensed: Whether the tangent is condensed exactly.
        """
        if self._is_named or self.krylov is None or self.schur is not None:
            return
        self.is_inner = is_condensed
        if is_condensed:
            self.krylov.choose_type(True)

    def loosen_inner(self, tolerance: float) -> int:
        """Allow inexact inner solves; returns the most outer iterations.

        Args:
            tolerance: Relative tolerance of the outer iterations.
        """
        if not self._is_named:
            self.ksp.setTolerances(rtol=max(tolerance, INNER))
        return GMRES_RESTART

    @property
    def watch(self) -> Stopwatch:
        """Stopwatch of the stage "solve"."""
        return self._system.watch

    @property
    def is_direct(self) -> bool:
        """Whether linear solves use factors, whatever the condition of the matrix."""
        return str(self.ksp.getType()) == PETSc.KSP.Type.PREONLY

    @property
    def has_factors(self) -> bool:
        """Whether linear solves use LU factors, which any matrix has."""
        return self.is_direct and self.ksp.getPC().getType() == PETSc.PC.Type.LU

    @property
    def may_be_factored(self) -> bool:
        """Whether the problem is small enough for a direct solver."""
        dim = self._system.bodies[0].V.mesh.geometry.dim
        return bool(self._system.x.getSize() <= LARGEST[dim])

    def forget(self) -> None:
        """Free everything created for the matrices, which are about to be freed. Collective."""
        self.given_up.pair()
        self._forget_multigrid()

    def _forget_multigrid(self) -> None:
        self.soft.forget()
        if self._hierarchy is not None:
            self._hierarchy.forget()
        if self.schur is not None:
            self.schur.forget()

    def set_up(self) -> None:
        """Pass parts of new matrices to the preconditioner, if it needs them. Collective."""
        pc, tangent = self.ksp.getPC(), self._system.made.tangent
        if self.schur is not None:
            assert isinstance(tangent, Additive)
            self.schur.set_up(pc, tangent.sum, self._system.scales)
        if pc.getType() == PETSc.PC.Type.FIELDSPLIT:
            self._split(pc)

    def _split(self, pc: PETSc.PC) -> None:
        """Set the bodies as the fields of PCFIELDSPLIT."""
        blocks = self._system.made.blocks
        assert blocks is not None  # PCFIELDSPLIT is not for sums
        # A reset removes the options from the splits: create the preconditioner again.
        pc.setType(PETSc.PC.Type.NONE)
        pc.setFromOptions()
        index_sets = blocks.matrix.getNestISs()[0]
        pc.setFieldSplitIS(*((str(i), index_set) for i, index_set in enumerate(index_sets)))

    def assemble(self) -> bool:
        """Assemble the tangent at the last evaluation, update multigrid; whether it has changed."""
        changed = self._system.assemble()
        if changed:
            self.follow()
        return changed

    def _forget_pattern(self) -> None:
        """Rebuild multigrid, except the bodies' spaces, if the pattern of contact has changed."""
        tangent = self._system.made.tangent
        if not isinstance(tangent, Additive):
            return
        if tangent.has_other_pattern:
            self._forget_multigrid()
            self.set_up()
            tangent.has_other_pattern = False

    def follow(self) -> None:
        """Update multigrid for a tangent that has changed. Collective."""
        system = self._system
        with self.watch.stage("solve"):
            self._forget_pattern()
            if self.is_direct:
                self.soft.forget()
            else:
                self.soft.find()
            if self.schur is not None:
                self.schur.update()
            elif self._hierarchy is not None:
                assert isinstance(system.made.tangent, Additive)
                pc, modes = self.ksp.getPC(), system.made.rigid.modes
                self._hierarchy.update(pc, system.made.tangent.sum, modes)

    def prepare(self, norms: typing.Sequence[float], until: float, changed: bool) -> None:
        """Prepare the next linear solve of Newton's method. Collective.

        Args:
            norms: Norm of the residual at each iteration so far.
            until: Norm of the residual at which Newton's method ends.
            changed: Whether the tangent has changed since the last linear solve.
        """
        if self.krylov is not None:
            self.krylov.choose_type(self._system.symmetric)
            self.krylov.set_tolerance(norms, until, changed, self._system.moves)

    def solve(self, load: Array, tolerance: float | None = None) -> tuple[Array, int]:
        """Solve with the present tangent, outside Newton's method. Collective.

        Args:
            load: Right-hand side, owned values.
            tolerance: Norm of the residual over the norm of the load; by default EXACT.

        Returns:
            Owned values of the solution, and PETSc's KSPConvergedReason, negative on failure.
        """
        matrix = self._system.matrix
        self.ksp.setOperators(matrix, matrix)
        b, y = self._system.x.duplicate(), self._system.x.duplicate()
        b.array[:] = load
        if self.krylov is not None:
            self.krylov.choose_type(self._system.symmetric)
            self.krylov.set(EXACT if tolerance is None else tolerance)
        reason = None
        try:
            with self.watch.stage("solve"):
                self.ksp.solve(b, y)
        except PETSc.Error as error:
            if error.ierr != OF_A_LIBRARY:  # such as a failed factorisation
                raise
            self.look()
            begin_afresh(self.ksp)
            reason = int(PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED)
        out = y.array_r.copy()
        b.destroy()
        y.destroy()
        self.look()
        return out, self.ksp.getConvergedReason() if reason is None else reason

    def look(self) -> None:
        """Raise an error after Ctrl-C, which ends linear solves early. Collective.

        Raises:
            KeyboardInterrupt: On all ranks.
        """
        self._stop.look(self.ksp)

    # --- Newton's method for bodies and multipliers together

    def give_up(self, reason: str) -> bool:
        """Use a direct solver as a fallback, at least until the next contact pairs. Collective.

        Args:
            reason: Reason for the log.

        Returns:
            Whether the fallback is used; it is not if the problem is too large, or options set the
            solver.
        """
        if not (self._may_be_rescued and self.may_be_factored):
            return False
        say(self._system.comm, f"linear solver: {reason}; a direct solver takes over")
        self.given_up.begin()
        return True

    def tolerance(
        self, norms: typing.Sequence[float], until: float, changed: bool, exact: bool
    ) -> tuple[float, int]:
        """Relative tolerance of the next linear solve, and its largest number of iterations.

        Args:
            norms: Norms of the right-hand sides of the solve so far.
            until: Norm at which Newton's method ends.
            changed: Whether the matrix differs from that of the last linear solve.
            exact: Whether the tolerance is :data:`EXACT`, whatever Newton's method needs.
        """
        if self._is_named or self.krylov is None:
            return EXACT, GMRES_RESTART
        if exact:
            self.krylov.set(EXACT)
        else:
            self.krylov.set_tolerance(norms, until, changed, self._system.moves)
        tolerance, _, _, longest = self.ksp.getTolerances()
        # Hardly more than one outer iteration around a solver of the condensed tangent is needed.
        return float(tolerance), 5 if self.is_inner else int(longest)

    def copy_monitors(self, ksp: PETSc.KSP) -> None:
        """Copy the user's monitors to another solver."""
        own = self._stop.monitor
        for function, args, options in self.ksp.getMonitor() or ():
            if function != own:
                ksp.setMonitor(function, args, options)

    def apply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write the approximate solution with the condensed tangent for x to y. Collective."""
        if self.is_inner:
            self.ksp.solve(x, y)
            self.inner_iterations += self.ksp.getIterationNumber()
            self.look()
        else:
            self.ksp.getPC().apply(x, y)

    def precondition(self, free: Array) -> None:
        """Update multigrid for the present sum. Collective.

        Args:
            free: Motions that active constraints do not resist, from ``Hold.free_motions``.
        """
        system, pc = self._system, self.ksp.getPC()
        assert isinstance(system.made.tangent, Additive)
        with self.watch.stage("solve"):
            self._forget_pattern()
            self.soft.find(free)
            if self.schur is not None:
                self.schur.update()
            elif self._hierarchy is not None:
                self._hierarchy.update(pc, system.made.tangent.sum, system.made.rigid.modes)
            self.ksp.setOperators(system.matrix, system.matrix)
            self.ksp.setUp()

    def precondition_formed(self, matrix: PETSc.Mat) -> None:
        """Update the preconditioner for this matrix. Collective."""
        with self.watch.stage("solve"):
            self.soft.forget()
            pc = self.ksp.getPC()
            if pc.getType() == PETSc.PC.Type.FIELDSPLIT:
                pc.reset()
                self._split(pc)
            self.ksp.setOperators(matrix, matrix)
            self.ksp.setUp()

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.forget()
        if self.schur is not None:
            self.schur.free()
        if self._hierarchy is not None:
            self._hierarchy.destroy()
