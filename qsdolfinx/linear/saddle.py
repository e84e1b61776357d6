"""Newton's step for bodies, multipliers and tools by a Krylov solver."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.passing import passing
from qsdolfinx.base.reasons import reason_name
from qsdolfinx.linear.condensation import ContactRows, condensation_of
from qsdolfinx.linear.presets import GMRES_RESTART
from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.linear.stop import Stop
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.equations import Equations, State
from qsdolfinx.system.factors import Number
from qsdolfinx.system.numbering import numbering
from qsdolfinx.system.row_blocks import RowBlocks

Array = npt.NDArray[np.float64]

#: Iterations of GMRES from which on a symmetric matrix is left to conjugate gradients.
CRAWLING = 2 * GMRES_RESTART

#: Part of what Newton's method may end with that a linear solve leaves, at the last; and the least
#: where gaps have to be closed for bodies that are much stiffer than the softest one.
PART, LEAST_PART = 0.3, 1e-2


class SaddlePoint:
    """Solves [K, Lᵀ F; D R, C] [du; dm] = −[R_u; R_m], m being multipliers, F, D and C of few rows.

    L and R have the gaps and slips of all rows as functions of the bodies' unknowns; F, D and C are
    blocks of the rows of a node, see :class:`RowBlocks`; at points gaps add to forces, and K is
    K + Lᵀ F_γ R. GMRES is preconditioned with factors of the matrix in which closed rows have the
    compliance of a penalty, C_γ: with S = −F C_γ⁻¹ D

        [I, 0; D R V, I]⁻¹ · diag(V, C_γ)⁻¹ · [I, Lᵀ F C_γ⁻¹; 0, I]⁻¹,   V ≈ (K + Lᵀ S R)⁻¹.

    V is multigrid's cycle, that of the Schur complement, or a solver that options name. With V
    exact all eigenvalues are 1, but for those of closed rows without a compliance, which tend to 1
    as the penalty grows (Benzi & Olshanskii, 2006). Driven tools are eliminated last, by
    their Schur complement with V. Where all closed rows have a compliance and the matrix is
    symmetric, conjugate gradients with V solve instead of V alone.

    Args:
        equations: The equations.
        linear: The problem's linear solver, not one with factors.
    """

    def __init__(self, equations: Equations, linear: LinearSolver) -> None:
        self._equations, self._linear = equations, linear
        self._comm = equations.system.comm
        bodies = equations.system.bodies
        self._num_u = sum(body.num_owned for body in bodies)
        of_bodies = numbering([body.matrix() for body in bodies])
        self._numbers: list[Number] = [number.__call__ for number in of_bodies]
        self._condensation = condensation_of(equations.system, linear)
        blocks, tangent = RowBlocks(equations), equations.system.made.tangent
        #: L and R that multigrid has already, as long as contact does not pair anew.
        self._kept_rows = isinstance(tangent, Additive) and tangent.has_factors
        if isinstance(tangent, Additive) and tangent.has_factors:
            product = tangent.factors.product
            self._rows = ContactRows(product.left, product.right, None, blocks)
        else:
            self._rows = ContactRows(*self._factors(blocks), None, blocks)
        self._m, self._n = self._rows.L.createVecLeft(), self._rows.L.createVecLeft()
        self._u, self._f = self._rows.L.createVecRight(), self._rows.L.createVecRight()
        #: Of tools: how rows move with them, (tools, rows).
        self._rigid: Array = np.zeros((len(equations.tools), blocks.num_rows))
        self._before = b""
        #: Whether GMRES is too slow.
        self._crawls = False
        #: Whether rows close, open or slip.
        self._may_change = any(not p.gap.law.jump or p.slip is not None for p in equations.passes)
        softest = min((p.rows.softness for p in equations.passes), default=1.0)
        #: Part of what Newton's method may end with that a linear solve leaves, at the last.
        self._part = PART * max(LEAST_PART, self._comm.allreduce(softest, op=MPI.MIN))
        #: What a callback has raised: PETSc would make an error of its own of it.
        self._failure: BaseException | None = None
        #: Norms of the right-hand sides of the solve.
        self._norms: list[float] = []
        size = (equations.num_local, equations.size)
        self._matrix: PETSc.Mat = PETSc.Mat().createPython((size, size), self, self._comm)
        self._matrix.setUp()
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
        """Take the derivative at an evaluation, the last one. Collective.

        Args:
            at: The evaluation.
            springs: On top of the diagonal of the bodies' matrices, owned unknowns.
        """
        self._rows.blocks.take(at)
        self._follow(at, springs)

    def solve(
        self, rhs: Array, until: float, exact: bool = False, guess: Array | None = None
    ) -> Array | None:
        """Change of z for a change of R; None if it is not found. Collective.

        Args:
            rhs: This rank's part of the change of R.
            until: Norm of forces, and of gaps times a stiffness, with which Newton's method ends.
            exact: Whether to solve with a small tolerance, whatever Newton's method needs.
            guess: What the change may be like.
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
        self._note_pace(norm)
        self._correct(b, x)
        out: Array = x.array_r.copy()
        b.destroy()
        x.destroy()
        fine = self._ksp.getConvergedReason() > 0 and bool(np.isfinite(out).all())
        return out if self._comm.allreduce(fine, op=MPI.LAND) else None

    def _in_forces(self, values: Array) -> Array:
        """Rows of multipliers and tools multiplied to be forces."""
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
        """Begin with a guess, if it is better than none; whether it is. Collective."""
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
        """New vector of what x leaves of b. Collective."""
        out = b.duplicate()
        self.mult(self._matrix, x, out)
        out.aypx(-1.0, b)
        return out

    def _iterate(self, b: PETSc.Vec, x: PETSc.Vec, until: float, exact: bool) -> None:
        """GMRES, and conjugate gradients inside where they do and it is slow. Collective."""
        linear, ksp = self._linear, self._ksp
        condensed = self._comm.allreduce(self._rows.blocks.is_condensed, op=MPI.LAND)
        symmetric = linear.system.symmetric and not self._equations.tools
        linear.choose_inner(symmetric and (condensed or self._crawls))
        self._choose_type()
        part = self._part * until
        tolerance, longest = linear.tolerance(self._norms, part, self._has_changed(), exact)
        if linear.is_inner and not condensed:
            longest = linear.loosen_inner(tolerance)
        may_crawl = symmetric and not linear.is_inner and longest > CRAWLING
        most = CRAWLING if may_crawl else longest
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
        """Solve exactly for motions that next to nothing resists. Collective."""
        soft = self._linear.soft
        if not soft.count:
            return
        left = self._left(b, x)
        x.array[: self._num_u] += soft.change(left.array_r[: self._num_u])
        left.destroy()

    def _choose_type(self) -> None:
        """GMRES, or its flexible form where the preconditioner is another each time."""
        linear, kinds = self._linear, PETSc.KSP.Type
        kind = kinds.FGMRES if linear.schur is not None or linear.is_inner else kinds.GMRES
        if self._ksp.getType() != kind:
            self._ksp.setType(kind)
        self._ksp.setGMRESRestart(GMRES_RESTART)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)

    def _call(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Let PETSc solve; what a callback raises is raised as it is. Collective."""
        try:
            self._ksp.solve(b, x)
        except PETSc.Error:
            self._equations.system.make_stale()  # what PETSc was in the midst of
            failure, self._failure = self._failure, None
            if failure is None:
                raise
            raise failure from None

    def _has_changed(self) -> bool:
        """Whether blocks of rows are others than at the last solve. Collective."""
        if not self._may_change:
            return False
        digest = self._rows.blocks.digest
        same = self._comm.allreduce(digest == self._before, op=MPI.LAND)
        self._before = digest
        return not same

    def _note_pace(self, norm: float) -> None:
        left = self._ksp.getResidualNorm()
        if self._ksp.getConvergedReason() > 0 and 0 < left < norm:
            self._linear.note_pace(self.num_iterations / np.log10(norm / left))

    @property
    def row_scale(self) -> Array:
        """What rows of multipliers and of tools were multiplied with to be forces."""
        return self._rows.blocks.scale

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
        """Why the last solve has ended."""
        return reason_name(PETSc.KSP.ConvergedReason, self._ksp.getConvergedReason())

    # --- What PETSc calls

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
        u, m, s = self._split(x.array_r)
        self._u.array[:] = u
        self._condensation.multiply_bodies(self._u, self._f)
        if self._rows.H is not None:
            self._rows.H.multAdd(self._u, self._f, self._f)
        forces, gaps = self._f.array_r.copy(), self._gaps(u) + self._rigid.T @ s
        blocks = self._rows.blocks
        at_rows = blocks.forces(m) + blocks.own_forces(gaps)
        y.array[: self._num_u] = forces + self._forces(at_rows)
        of_rows = blocks.by_gaps(gaps) + blocks.by_multipliers(m)
        y.array[self._num_u : self._num_u + len(m)] = of_rows
        self._put_tools(y, self._of_tools(at_rows))

    def _precondition(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        u, m, s = self._split(r.array_r)
        blocks = self._rows.blocks
        known = blocks.solve(m)
        pushing = blocks.forces(known)
        du = self._cycle(u - self._forces(pushing))
        ds: Array = np.zeros(len(s))
        if len(s):
            left = s - self._of_tools(pushing + blocks.resisting(self._gaps(du)))
            ds = np.asarray(np.linalg.solve(self._schur, left))
            du -= ds @ self._moved
        dm = known + blocks.condensed(self._gaps(du) + self._rigid.T @ ds)
        z.array[: self._num_u] = du
        z.array[self._num_u : self._num_u + len(m)] = dm
        self._put_tools(z, ds)

    # --- Parts of it

    def _split(self, x: Array) -> tuple[Array, Array, Array]:
        """Unknowns of bodies and multipliers, and those of tools on all ranks. Collective."""
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

    def _forces(self, at_rows: Array) -> Array:
        """Lᵀ times forces at the rows. Collective."""
        self._m.array[:] = at_rows
        self._rows.L.multTranspose(self._m, self._f)
        return self._f.array_r.copy()

    def _gaps(self, u: Array) -> Array:
        """R u. Collective."""
        self._u.array[:] = u
        self._rows.R.mult(self._u, self._n)
        return self._n.array_r.copy()

    def _cycle(self, f: Array) -> Array:
        """V f. Collective."""
        self._u.array[:] = f
        self._condensation.solve(self._u, self._f)
        return self._f.array_r.copy()

    # --- L, R and how forces change with multipliers held

    def _follow(self, at: State, springs: Array) -> None:
        """Follow bodies, contact and tools. Collective."""
        blocks, system = self._rows.blocks, self._equations.system
        if self._equations.moves:
            self._forget_rows()
            self._rows = ContactRows(*self._factors(blocks), self._curvature(at), blocks)
        elif self._equations.follows:
            if self._rows.H is not None:
                self._rows.H.destroy()
            self._rows = self._rows._replace(H=self._curvature(at))
        free = system.made.hold.free_motions([e.active for e in at.passes])
        self._condensation.update(self._rows, springs, free)
        self._find_rigid()

    def _factors(self, blocks: RowBlocks) -> tuple[PETSc.Mat, PETSc.Mat]:
        """New L and R at the last evaluation. Collective."""
        rows = self._equations.rows(self._numbers)
        left, right = (e.matrix(blocks.num_rows, self._num_u, self._comm) for e in rows)
        return left, right

    def _curvature(self, at: State) -> PETSc.Mat | None:
        """New matrix of all bodies. Collective."""
        blocks = self._equations.curvature(at)
        if not blocks:
            return None
        bodies = range(len(self._equations.system.bodies))
        nest = PETSc.Mat().createNest(
            [[blocks.get((i, j)) for j in bodies] for i in bodies], comm=self._comm
        )
        out: PETSc.Mat = nest.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        for mat in (nest, *blocks.values()):
            mat.destroy()
        return out

    def _forget_rows(self) -> None:
        """Free L, R and H, unless they are the tangent's. Collective."""
        for mat in (self._rows.H,) if self._kept_rows else self._rows[:3]:
            if mat is not None:
                mat.destroy()

    # --- Driven tools

    def _of_tools(self, at_rows: Array) -> Array:
        """Forces at the rows on tools, on all ranks. Collective."""
        out: Array = self._rigid @ at_rows
        if len(out):
            self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
        return np.asarray(out)

    def _find_rigid(self) -> None:
        """What tools need: their gaps, and their Schur complement with V. Collective."""
        equations = self._equations
        self._rigid = np.zeros((len(equations.tools), len(self._m.array_r)))
        if not equations.tools:
            return
        first = 0
        for p in equations.passes:
            end = first + p.rows.num_values
            if p.tool is not None:
                gap, slip = equations.changes(p)
                parts = [gap.ravel()] if slip is None else [gap.ravel(), slip.ravel()]
                self._rigid[p.tool, first:end] = np.concatenate(parts)
            first = end
        blocks, tools = self._rows.blocks, range(len(equations.tools))
        reached = [blocks.resisting(np.asarray(self._rigid[i])) for i in tools]
        moved = [self._cycle(self._forces(f)) for f in reached]
        left = [
            self._of_tools(f - blocks.resisting(self._gaps(u)))
            for f, u in zip(reached, moved, strict=True)
        ]
        #: V Lᵀ F of what multipliers change by with each tool, (tools, unknowns).
        self._moved: Array = np.array(moved)
        self._schur: Array = np.array(left).T

    def free(self) -> None:
        """Free PETSc's objects. Collective."""
        self._forget_rows()
        self._condensation.free()
        for thing in (self._ksp, self._matrix, self._m, self._n, self._u, self._f):
            thing.destroy()
