"""Newton step for bodies, multipliers and tools by a Krylov solver."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.passing import passing
from qsdolfinx.base.reasons import reason_name
from qsdolfinx.linear.condensation import ContactPart, condensation_of
from qsdolfinx.linear.krylov import SAFETY
from qsdolfinx.linear.presets import GMRES_RESTART
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.linear.stop import Stop
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State
from qsdolfinx.system.row_blocks import RowBlocks

Array = npt.NDArray[np.float64]


class _Parts(typing.NamedTuple):
    """Parts of a product; rows of multipliers are scaled to forces.

    Attributes:
        forces: Part of the bodies' unknowns.
        rows: Part of the multipliers.
        tools: Part of the tools, on all ranks.
    """

    forces: Array
    rows: Array
    tools: Array


class SaddlePoint:
    """Solve [K + H, Lᵀ F; D R, C] [du; dm] = −[R_u; R_m], m being multipliers.

    K are the bodies' own matrices; everything else is one matrix with few rows. L and R contain the
    gaps and slips of all constraints as functions of the bodies' unknowns. F, D and C are blocks of
    the constraints of a node, see :class:`RowBlocks`. Gaps at contact quadrature points add Lᵀ F_γ
    R to H. GMRES is preconditioned with factors of the matrix in which active constraints have the
    compliance of a penalty, C_γ: with S = −F C_γ⁻¹ D

        [I, 0; D R V, I]⁻¹ · diag(V, C_γ)⁻¹ · [I, Lᵀ F C_γ⁻¹; 0, I]⁻¹,   V ≈ (K + Lᵀ S R)⁻¹.

    V is a multigrid cycle, the Schur complement preconditioner, or a solver set by options. With
    exact V all eigenvalues are 1, except those of active constraints without a compliance, which
    tend to 1 as the penalty grows (Benzi & Olshanskii, 2006). Force-controlled tools are eliminated
    last, by their Schur complement with V. If all active constraints have a compliance and the
    matrix is symmetric, conjugate gradients preconditioned by V replace V.

    Args:
        equations: The equations.
        linear: The problem's linear solver, without factors.
    """

    def __init__(self, equations: Equations, linear: LinearSolver) -> None:
        self._equations, self._linear = equations, linear
        self._comm = equations.system.comm
        bodies = equations.system.bodies
        self._num_u = sum(body.num_owned for body in bodies)
        self._condensation = condensation_of(equations.system, linear)
        self._blocks = RowBlocks(equations)
        self._u, self._f = equations.system.x.duplicate(), equations.system.x.duplicate()
        #: The derivative without the bodies' own matrices, owned by the equations.
        self._contact: PETSc.Mat | None = None
        self._before = b""
        #: Whether GMRES is too slow.
        self._crawls = False
        #: Whether constraints can change between active and inactive, or slip.
        self._may_change = any(not p.gap.law.jump or p.slip is not None for p in equations.passes)
        softest = min((p.rows.softness for p in equations.passes), default=1.0)
        #: Residual of the last linear solve, over the residual at which Newton's method ends.
        self._part = SAFETY * self._comm.allreduce(softest, op=MPI.MIN)
        #: Exception raised by a callback: PETSc would replace it by an error of its own.
        self._failure: BaseException | None = None
        #: Norms of the right-hand sides of the solve.
        self._norms: list[float] = []
        size = (equations.num_local, equations.size)
        self._matrix: PETSc.Mat = PETSc.Mat().createPython((size, size), self, self._comm)
        self._matrix.setUp()
        self._x, self._y = self._matrix.createVecs()
        self._ksp = PETSc.KSP().create(self._comm)
        self._ksp.setOptionsPrefix(linear.ksp.getOptionsPrefix())
        self._ksp.setFromOptions()
        self._ksp.setOperators(self._matrix)
        self._choose_type()
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        self._ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        self._ksp.getPC().setPythonContext(self)
        if not linear.is_inner:
            linear.copy_monitors(self._ksp)
        self._stop = Stop(self._ksp, self._comm)

    def set_up(self, at: State, springs: Array) -> None:
        """Form the derivative at the last evaluation. Collective.

        Args:
            at: The evaluation.
            springs: Added to the diagonal of the bodies' matrices, owned unknowns.
        """
        self._blocks.take(at)
        self._follow(at, springs)

    def solve(
        self, rhs: Array, until: float, exact: bool = False, guess: Array | None = None
    ) -> Array | None:
        """Change of z for a change of R; None if it is not found. Collective.

        Args:
            rhs: This rank's part of the change of R.
            until: Norm of forces, and of gaps times a stiffness, at which Newton's method ends.
            exact: Whether to solve with a small tolerance, whatever Newton's method needs.
            guess: Initial guess of the change.
        """
        rhs = self._in_forces(rhs)
        norm = float(np.sqrt(self._comm.allreduce(float(rhs @ rhs), op=MPI.SUM)))
        if norm == 0:
            return np.zeros(self._equations.num_local)
        self._norms.append(norm)
        b = PETSc.Vec().createWithArray(rhs, comm=self._comm)
        x = b.duplicate()
        self._ksp.setInitialGuessNonzero(self._begin(b, x, guess))
        self._iterate(b, x, until, exact)
        self._correct(b, x)
        out: Array = x.array_r.copy()
        b.destroy()
        x.destroy()
        fine = self._ksp.getConvergedReason() > 0 and bool(np.isfinite(out).all())
        return out if self._comm.allreduce(fine, op=MPI.LAND) else None

    def _in_forces(self, values: Array) -> Array:
        """Scale the rows of multipliers and tools to forces."""
        out = values.copy()
        out[self._num_u :] *= self.row_scale
        return out

    def multiply(self, x: Array) -> Array:
        """Product of the derivative with this rank's part of x. Collective."""
        vec, out = self._matrix.createVecs()
        vec.array[:] = x
        self._multiply(vec, out)
        found: Array = out.array_r.copy()
        found[self._num_u :] /= self.row_scale
        vec.destroy()
        out.destroy()
        return found

    def _begin(self, b: PETSc.Vec, x: PETSc.Vec, guess: Array | None) -> bool:
        """Use the initial guess if it is better than zero; returns whether it is. Collective."""
        if guess is None:
            return False
        x.array[:] = guess
        left = self._left(b, x)
        helps = bool(left.norm() < b.norm())
        left.destroy()
        if not helps:
            x.zeroEntries()
        return helps

    def _left(self, b: PETSc.Vec, x: PETSc.Vec) -> PETSc.Vec:
        """New vector with the residual of x. Collective."""
        out = b.duplicate()
        self.mult(self._matrix, x, out)
        out.aypx(-1.0, b)
        return out

    def _iterate(self, b: PETSc.Vec, x: PETSc.Vec, until: float, exact: bool) -> None:
        """Iterate by GMRES, with inner conjugate gradients if GMRES is slow. Collective."""
        linear, ksp = self._linear, self._ksp
        condensed = self._comm.allreduce(self._blocks.is_condensed, op=MPI.LAND)
        symmetric = linear.system.symmetric and not self._equations.tools
        linear.choose_inner(symmetric and (condensed or self._crawls))
        self._choose_type()
        part = self._part * until
        tolerance, longest = linear.tolerance(self._norms, part, self._has_changed(), exact)
        if linear.is_inner and not condensed:
            longest = linear.loosen_inner(tolerance)
        crawling = 2 * GMRES_RESTART  # iterations: restarts make GMRES slow
        may_crawl = symmetric and not linear.is_inner and longest > crawling
        most = crawling if may_crawl else longest
        ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=most)
        linear.inner_iterations = 0
        with linear.watch.stage("solve"):
            self._call(b, x)
            late = ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT
            self._crawls |= may_crawl and late
            if may_crawl and late:
                linear.choose_inner(True)
                self._choose_type()
                ksp.setTolerances(max_it=linear.loosen_inner(tolerance))
                ksp.setInitialGuessNonzero(True)
                self._call(b, x)
        self._stop.look(ksp)

    def _correct(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve exactly for motions with almost no resistance. Collective."""
        soft = self._linear.soft
        if not soft.count:
            return
        left = self._left(b, x)
        x.array[: self._num_u] += soft.change(left.array_r[: self._num_u])
        left.destroy()

    def _choose_type(self) -> None:
        """Choose GMRES, or flexible GMRES if the preconditioner varies."""
        linear, kinds = self._linear, PETSc.KSP.Type
        kind = kinds.FGMRES if linear.schur is not None or linear.is_inner else kinds.GMRES
        if self._ksp.getType() != kind:
            self._ksp.setType(kind)
        self._ksp.setGMRESRestart(GMRES_RESTART)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)

    def _call(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Let PETSc solve; exceptions of callbacks are raised unchanged. Collective."""
        try:
            self._ksp.solve(b, x)
        except PETSc.Error:
            self._equations.system.make_stale()  # PETSc was interrupted while using it
            if self._failure is None:
                raise
            raise self._taken() from None

    def _taken(self) -> BaseException:
        """The exception raised by a callback, which is forgotten."""
        failure, self._failure = self._failure, None
        assert failure is not None
        return failure

    def _has_changed(self) -> bool:
        """Whether blocks of constraints differ from those of the last solve. Collective."""
        if not self._may_change:
            return False
        digest = self._blocks.digest
        same = self._comm.allreduce(digest == self._before, op=MPI.LAND)
        self._before = digest
        return not same

    @property
    def row_scale(self) -> Array:
        """Factors that scale the rows of multipliers and tools to forces."""
        return self._blocks.scale

    @property
    def num_iterations(self) -> int:
        """Iterations of the last solve, of the inner solver if there is one."""
        inner = self._linear.inner_iterations
        return inner if self._linear.is_inner else int(self._ksp.getIterationNumber())

    @property
    def converged_reason(self) -> int:
        """PETSc's KSPConvergedReason of the last solve."""
        return int(self._ksp.getConvergedReason())

    @property
    def reason(self) -> str:
        """Reason why the last solve ended."""
        return reason_name(PETSc.KSP.ConvergedReason, self._ksp.getConvergedReason())

    # --- Callbacks of PETSc

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The product of the matrix."""
        with passing(self._keep):
            self._multiply(x, y)

    def apply(self, _: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """The product of the preconditioner."""
        with passing(self._keep):
            self._precondition(r, z)

    def _keep(self, error: BaseException) -> None:
        self._failure = error

    # --- Products

    def _multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        assert self._contact is not None
        self._contact.mult(x, y)
        self._u.array[:] = x.array_r[: self._num_u]
        self._condensation.multiply_bodies(self._u, self._f)
        y.array[: self._num_u] += self._f.array_r
        y.array[self._num_u :] *= self.row_scale

    def _precondition(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        u, m, s = self._split(r.array_r)
        known = self._blocks.solve(m)
        pushing = self._beside(multipliers=known)
        du = self._cycle(u - pushing.forces)
        ds: Array = np.zeros(len(s))
        change = self._condensed(du)
        if len(s):
            left = s - self._beside(du, known + change).tools
            ds = np.asarray(np.linalg.solve(self._schur, left))
            du -= ds @ self._moved
            change = self._condensed(du, ds)
        z.array[: self._num_u] = du
        z.array[self._num_u : self._num_u + len(m)] = known + change
        self._put_tools(z, ds)

    def _condensed(self, du: Array | None, ds: Array | None = None) -> Array:
        """Change of multipliers due to motions of bodies and tools. Collective."""
        return self._blocks.condensed(self._beside(du, None, ds).rows)

    def _beside(
        self,
        bodies: Array | None = None,
        multipliers: Array | None = None,
        tools: Array | None = None,
    ) -> _Parts:
        """Product of the contact matrix with these unknowns. Collective."""
        assert self._contact is not None
        x, y = self._x, self._y
        x.zeroEntries()
        if bodies is not None:
            x.array[: self._num_u] = bodies
        if multipliers is not None:
            x.array[self._num_u : self._num_u + len(multipliers)] = multipliers
        if tools is not None:
            self._put_tools(x, tools)
        self._contact.mult(x, y)
        y.array[self._num_u :] *= self.row_scale
        return _Parts(*(part.copy() for part in self._split(y.array_r)))

    # --- Parts of the system

    def _split(self, x: Array) -> tuple[Array, Array, Array]:
        """Unknowns of bodies and multipliers, and of tools on all ranks. Collective."""
        count = len(self._equations.tools)
        s = np.zeros(count)
        if count == 0:
            return x[: self._num_u], x[self._num_u :], s
        end = len(x) - (count if self._comm.rank == 0 else 0)
        s[: len(x) - end] = x[end:]
        self._comm.Bcast(s, root=0)
        return x[: self._num_u], x[self._num_u : end], s

    def _put_tools(self, x: PETSc.Vec, s: Array) -> None:
        if len(s) and self._comm.rank == 0:
            x.array[-len(s) :] = s

    def _cycle(self, f: Array) -> Array:
        """V f. Collective."""
        self._u.array[:] = f
        self._condensation.solve(self._u, self._f)
        return self._f.array_r.copy()

    def _follow(self, at: State, springs: Array) -> None:
        """Update for the present bodies, contact and tools. Collective."""
        system = self._equations.system
        self._contact = self._equations.derivative.beside_bodies(at)
        free = system.made.hold.free_motions([e.active for e in at.passes])
        contact = ContactPart(self._contact, self._blocks, self._num_u)
        self._condensation.update(contact, springs, free)
        self._find_rigid()

    # --- Force-controlled tools

    def _find_rigid(self) -> None:
        """Compute the motion of bodies with the tools, and the tools' Schur complement with V.

        Collective.
        """
        moved, left = [], []
        for unit in np.eye(len(self._equations.tools)):
            change = self._condensed(None, unit)
            pushed = self._beside(None, change, unit)
            moved.append(self._cycle(pushed.forces))
            back = self._beside(moved[-1], self._condensed(moved[-1]))
            left.append(pushed.tools - back.tools)
        #: V times the forces due to the motion of each tool, (tools, unknowns).
        self._moved: Array = np.array(moved)
        self._schur: Array = np.array(left).T
        #: Whether nothing resists a motion of the tools.
        self.is_singular = bool(len(left) and np.linalg.slogdet(self._schur)[0] == 0)

    def free(self) -> None:
        """Free PETSc's objects. Collective."""
        self._condensation.free()
        self._blocks.free()
        for thing in (self._ksp, self._matrix, self._x, self._y, self._u, self._f):
            thing.destroy()
