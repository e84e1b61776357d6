"""One semismooth Newton's method on bodies, multipliers and driven tools."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.gap.following import NoGapError
from qsdolfinx.linear.saddle import SaddlePoint
from qsdolfinx.linear.saddle_factors import SaddleFactors
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.onset import Onset
from qsdolfinx.system.equations import Equations, State

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Halvings of a step, and what the merit has to fall by over what a whole step promises.
MAX_HALVINGS, FALL = 8, 1e-4

#: Springs of bodies that conditions leave a rigid motion, over their diagonal, and most of those
#: that have no condition at all.
SPRINGS = 1e-11, 1e-4

#: Accuracy: unbalanced forces over contact forces, gaps times c over the largest multiplier, and
#: unbalanced force of a tool over the force that drives it.
RTOL_TOOLS = 1e-8

#: What rounding leaves of forces and gaps, in units in the last place of the largest coordinate.
ROUNDING = 50 * np.finfo(np.float64).eps


class NoConvergence(RuntimeError):
    """The iteration has not converged; the text says where it stood.

    Attributes:
        is_late: Whether it has come to its limit, and no linear solve has failed.
    """

    def __init__(self, text: str, is_late: bool = True) -> None:
        super().__init__(text)
        self.is_late = is_late


class Iterate(typing.NamedTuple):
    """One iteration.

    Attributes:
        residual: |R_u|.
        forces: The same over the contact forces.
        constraints: Largest complementarity residual over the largest multiplier.
        tools: Largest unbalanced force of a tool over the force that drives it.
        active: Closed rows over all ranks.
        sticking: Of these those that stick.
        step: Part of the step that was taken to get here.
    """

    residual: float
    forces: float
    constraints: float
    tools: float
    active: int
    sticking: int
    step: float


class OneNewton:
    """Finds R(z) = 0 by a semismooth Newton's method with a line search.

    The merit is m² = |R_u|² + Σ W² (λ − [λ + c ḡ*]₊)² + the same of τ + |R_s|², which is continuous
    where sets change. A step is halved as long as the residual is not finite, a gap cannot be
    evaluated, or the merit has not fallen. In the first iteration what has λ > 0 stays closed, and
    what is closed without any τ sticks.

    Args:
        equations: The equations.
        newton: Whose record, monitors and tolerances it has.
        again: Whether the step has been solved before, with other pairs.
    """

    def __init__(self, equations: Equations, newton: Newton, again: bool = False) -> None:
        self.equations, self._newton, self._again = equations, newton, again
        self._rtol, self._atol, _, self.max_it = newton.snes.getTolerances()
        #: Largest coordinate of each body: what is much larger is no displacement.
        self._sizes = [
            float(body.comm.allreduce(np.abs(body.V.mesh.geometry.x).max(initial=0.0), op=MPI.MAX))
            for body in equations.system.bodies
        ]
        #: Iterations of the last solve.
        self.history: list[Iterate] = []
        self._factors: SaddleFactors | None = None
        self._saddle: SaddlePoint | None = None
        self._is_iterative = not newton.linear.has_factors
        self._guess: Array | None = None
        #: Norm of forces with which the solve ends.
        self._until = 0.0
        self._was_in_floor = False
        #: Largest residual, contact forces and multiplier of the solve so far.
        self._seen: Array = np.zeros(3)

    def solve(self, z: Array, begins: bool = True) -> Array:
        """Solution, from z on. Collective.

        Args:
            z: Unknowns of this rank.
            begins: Whether it is to be found where slip counts from.

        Raises:
            NoConvergence: If none is found.
        """
        self.history, step = [], 1.0
        self._was_in_floor, self._seen = False, np.zeros(3)
        z = z.copy()
        free = self._free_step(z) if begins else None
        at = self.equations.evaluate(z, first=True, again=self._again)
        for iteration in range(self.max_it + 1):
            if self._has_converged(at, step):
                return z
            if iteration == self.max_it:
                break
            change = self._change(at) if free is None else free
            z, at, step = self._search(z, at, change)
            if self.equations.measure():
                at = self.equations.evaluate(z)
            free = None
        raise NoConvergence(f"no convergence in {self.max_it} iterations: {self.history[-1]}")

    def _free_step(self, z: Array) -> Array | None:
        """Find where slip counts from, see :class:`Onset`. Collective.

        Returns:
            The first step, if no row closes; it is another one if some do.
        """
        onset = Onset(self.equations)
        if not onset.counts:
            return None

        def step(opened: list[Flags]) -> Array | None:
            at = self.equations.evaluate(z, opened=opened, again=self._again)
            hold = self.equations.system.made.hold
            if hold.free_motions([e.active for e in at.passes]).shape[1]:
                return None
            try:
                return self._change(at, exact=True)
            except NoConvergence:
                return None

        return onset.find(step)

    # --- The linear system

    def _change(self, at: State, exact: bool = False) -> Array:
        """Newton's step from the last evaluation. Collective.

        Args:
            at: The evaluation.
            exact: Whether an iterative solver is to find it whatever Newton's method needs.
        """
        record, shift = self._newton.record, (SPRINGS[0], self._springs())
        record.iterations += 1
        out = None
        if self._is_iterative and not self._newton.linear.given_up.is_now:
            out = self._iterated(at, shift, exact)
        if out is None:
            self._factors = self._factors or SaddleFactors(self.equations, self._newton.linear)
            out = self._factors.solve(at, shift)
            record.linear_iterations += 1
        if out is None:
            assert self._factors is not None
            raise NoConvergence(self._factors.reason, False)
        return out

    def _iterated(self, at: State, shift: tuple[float, float], exact: bool) -> Array | None:
        """The same by a Krylov solver, whose place a direct one takes if it fails. Collective."""
        newton = self._newton
        self._saddle = self._saddle or SaddlePoint(self.equations, newton.linear)
        out = self._saddle.solve(at, self.equations.springs(shift), self._until, exact, self._guess)
        self._guess = out if exact else None  # of where bodies would go without some rows
        newton.record.linear_iterations += self._saddle.num_iterations
        if out is None:
            newton.record.restarts += 1
            if not newton.linear.give_up(self._saddle.reason):
                raise NoConvergence(f"linear solver: {self._saddle.reason}", False)
        return out

    def _springs(self) -> float:
        """Springs of bodies that contact alone holds, which vanish with the residual."""
        if len(self.history) < 2:  # it begins where springs have put them
            return SPRINGS[0]
        now, first = self.history[-1], self.history[0]
        fallen = now.residual / first.residual if first.residual > 0 else 1.0
        left = min(1.0, fallen, now.forces + now.constraints)
        return max(SPRINGS[0], SPRINGS[1] * left)

    # --- The line search

    def _search(self, z: Array, at: State, change: Array) -> tuple[Array, State, float]:
        """As much of the step as makes the merit fall, or else all of it. Collective."""
        before, step, largest = self._merit(at), 1.0, None
        for _ in range(MAX_HALVINGS):
            try:
                there = self.equations.evaluate(z + step * change)
                merit = self._merit(there)
            except NoGapError:
                merit = np.inf
            if np.isfinite(merit):
                if merit <= (1 - FALL * step) * before:
                    return z + step * change, there, step
                largest = largest or step
            step /= 2
        if largest is None:
            raise NoConvergence("no residual can be evaluated along the step")
        found = z + largest * change
        return found, self.equations.evaluate(found), largest

    def _merit(self, at: State) -> float:
        equations = self.equations
        sums = float(np.sum(equations.forces_of(at) ** 2))
        for p, e in zip(equations.passes, at.passes, strict=True):
            sums += sum(float(np.sum(r**2)) for r in p.rows.complementarity(e))
        total = self.equations.system.comm.allreduce(sums, op=MPI.SUM)
        return float(np.sqrt(total + np.sum(at.tools**2)))

    # --- The end

    def _has_converged(self, at: State, step: float) -> bool:
        """Whether z solves the equations; notes the iterate. Collective."""
        equations, comm = self.equations, self.equations.system.comm
        R, f = equations.forces_of(at), at.contact
        bodies = equations.system.bodies
        rounding = [
            body.diagonal[body.free] * np.minimum(np.abs(equations.part(at.z, i)[body.free]), most)
            for i, (body, most) in enumerate(zip(bodies, self._sizes, strict=True))
        ]
        sums = np.array([R @ R, f @ f, sum(float(r @ r) for r in rounding)])
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        residual, forces, rounded = np.sqrt(sums)
        largest = np.zeros(3)
        counts: npt.NDArray[np.int64] = np.zeros(2, dtype=np.int64)
        for p, e in zip(equations.passes, at.passes, strict=True):
            largest[0] = max(largest[0], p.rows.violation(e))
            largest[1] = max(largest[1], float(np.max(np.abs(e.multipliers.normal), initial=0.0)))
            largest[2] = max(largest[2], p.rows.rounding())
            counts += np.sum(e.closed), np.sum(e.sticking)
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, counts, op=MPI.SUM)
        driving = [tool.driven.force for tool in equations.tools if tool.driven is not None]
        tools = float(np.max(np.abs(at.tools / np.array(driving)), initial=0.0))
        found = Iterate(
            float(residual),
            residual / forces if forces > 0 else float(residual > 0),
            largest[0] / largest[1] if largest[1] > 0 else 0.0,
            tools,
            int(counts[0]),
            int(counts[1]),
            step,
        )
        self.history.append(found)
        number, x = len(self.history) - 1, equations.bodies_of(at.z)
        self._newton.note(number, x, found.residual, self._num_closed(at))
        limits = self._rtol * forces, self._rtol * largest[1]
        self._until = max(float(limits[0]), self._atol)
        self._seen = np.maximum(self._seen, [residual, forces, largest[1]])
        rounded, largest[2] = max(rounded, *self._seen[:2]), max(largest[2], self._seen[2])
        self._until = max(self._until, float(ROUNDING * rounded))
        floors = max(limits[0], ROUNDING * rounded), max(limits[1], ROUNDING * largest[2])
        in_floor = bool(residual <= floors[0] and largest[0] <= floors[1])
        # An iteration more, as a refinement, makes the most of what rounding leaves.
        if in_floor and (self._was_in_floor or largest[1] == 0):
            limits = floors
        self._was_in_floor = in_floor
        balanced = residual <= max(limits[0], self._atol)
        closed = largest[0] <= limits[1] and self._are_closed(at)
        return bool(balanced and closed and tools <= RTOL_TOOLS)

    def _are_closed(self, at: State) -> bool:
        """Whether no multiplier leaves a gap that is more than its contact allows. Collective."""
        passes = zip(self.equations.passes, at.passes, strict=True)
        return self._all(all(p.rows.open_gap(e) <= p.model.allowed_gap for p, e in passes))

    def _num_closed(self, at: State) -> list[int]:
        """Closed rows of each contact on this rank."""
        closed = {id(contact): 0 for contact in self.equations.system.contacts}
        for p, e in zip(self.equations.passes, at.passes, strict=True):
            closed[id(p.model)] += int(np.sum(e.closed))
        return list(closed.values())

    def _all(self, here: bool) -> bool:
        return bool(self.equations.system.comm.allreduce(here, op=MPI.LAND))

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        if self._factors is not None:
            self._factors.destroy()
        if self._saddle is not None:
            self._saddle.free()
        self._factors = self._saddle = None
