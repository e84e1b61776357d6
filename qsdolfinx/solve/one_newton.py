"""One semismooth Newton method for bodies, multipliers and force-controlled tools."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.reasons import NOT_FINITE
from qsdolfinx.contact.slid import NEARBY
from qsdolfinx.gap.no_value import NoValueError
from qsdolfinx.solve.balance import LITTLE, Balance
from qsdolfinx.solve.mixing import LEFT, Mixing
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.newton_step import LATE, NewtonStep, NoConvergence
from qsdolfinx.solve.no_progress import Progress
from qsdolfinx.solve.onset import Onset, vectors_of
from qsdolfinx.solve.snes import NO_PROGRESS, NOT_CLOSED
from qsdolfinx.solve.snes_on_z import SnesOnZ
from qsdolfinx.solve.watchdog import Watchdog
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Largest number of halvings of a step: with none, steps that are too long are taken; with many, a
#: direction without a decrease takes as many evaluations.
MAX_HALVINGS = 8

#: Increase of the merit in the first full step above which the start is far from the solution. With
#: less, as where contact begins or friction depends on slip rates, Newton's method needs fewer
#: iterations from there; with much more, bodies that bend on each other need many.
FAR_OFF = 2.0

#: Soft penalties that are followed then, over the automatic one: with 1, the contact zone moves by
#: a row of facets in each iteration; with 1e-4, bodies begin too deep in each other, and from 1e-4
#: to 1e-2 the contact zone of a leaf pack moves too far (``tests/problems/test_leaf_spring.py``).
#: The last one is used if the start is still far off, as where more constraints touch than nodes
#: can follow (``test_many_tips``).
SOFT = (1e-3, 1e-2, 0.5)


class OneNewton:
    """Solve R(z) = 0 by a semismooth Newton method with a line search.

    The merit is m² = |R_u|² + Σ W² (λ − [λ + c ḡ*]₊)² + the same term for τ + |R_s|². It is
    continuous where sets change. A step is halved while the residual is not finite, a gap cannot be
    evaluated, or the merit has not decreased; after several short steps see :class:`Watchdog`. If
    little of the step would remain, or frictional contact would slide far, the step ends where the
    work of the forces vanishes, see :meth:`_until_rest`. In the first iteration, constraints with
    λ > 0 stay active, and active constraints without any τ stick. If the user's options set a type
    of SNES or a line search, it is used after the first step.

    Args:
        equations: The equations.
        newton: Solver whose record, monitors and tolerances are used.
        again: Whether the step has been solved before, with other contact pairs.
        stiffness: Stiffness of springs, as for :class:`Balance`.
    """

    def __init__(
        self,
        equations: Equations,
        newton: Newton,
        again: bool = False,
        stiffness: float | None = None,
    ) -> None:
        self.equations, self._newton, self._again = equations, newton, again
        self.max_it = newton.snes.getTolerances()[3]
        #: Unknowns at the first iterate that satisfies all Dirichlet conditions.
        self.first: Array | None = None
        self._step, self._balance = (
            NewtonStep(equations, newton),
            Balance(equations, newton, stiffness),
        )

    def solve(self, z: Array, begins: bool = True, softly: bool = False) -> Array:
        """Compute the solution, starting from z. Collective.

        Args:
            z: Unknowns of this rank.
            begins: Whether to find the positions from which slip counts. Otherwise z is the
                solution with other multipliers, and its own active set is the first one.
            softly: Whether to approach the solution first if the start is poor, see
                :meth:`_approach`.

        Raises:
            NoConvergence: If none is found: after the largest number of iterations, or as soon as
                there is no :class:`Progress`.
        """
        self._balance.begin()
        self._mixing = Mixing(self.equations.system.comm)
        progress, self.first = Progress(self.equations.system), None
        z, step = z.copy(), 1.0
        if begins and self._is_solution(z):
            return z
        change = self._free_step(z) if begins else None
        at = self.equations.evaluate(z, first=begins, again=self._again)
        begun = self._merit(at)
        if not np.isfinite(begun):
            raise NoConvergence("the residual is not finite", NOT_FINITE)
        watchdog = Watchdog(begun)
        if self._newton.has_users_snes:
            if begins:
                z, at, _ = self._search(z, at, self._change(at) if change is None else change)
            return SnesOnZ(self.equations, self._newton, self._step, self._balance).solve(z)
        for iteration in range(self.max_it + 1):
            if self._is_found(at, step):
                return z
            merit = self._merit(at)
            progress.add(at, merit, step, self._balance.num_closed(at))
            fault = None if self._balance.is_at_rounding else progress.fault()
            if fault is not None:
                raise NoConvergence(fault, self._reason(NO_PROGRESS))
            if iteration == self.max_it:
                break
            back = watchdog.back(merit)
            if back is not None:
                z, at, change = back, self.equations.evaluate(back), None
                merit = self._merit(at)
            is_first = iteration == 0
            if begins and iteration == 1:
                sticking = self._sticking(at)
                if sticking is not None:
                    at, is_first = self.equations.evaluate(z, sticking=sticking), True
            change = self._change(at) if change is None else change
            if softly and self._has_active(at):
                softly = False
                z, at, change = self._begun_softly(z, at, change, begun)
            mixed = self._mixed(z, at, change) if iteration > 1 and self._has_secants else None
            full = None
            if mixed is None and watchdog.wants_full_step(merit):
                full = self._full_step(z, at, change)
            if full is not None:
                watchdog.hold(z, merit)
            z, at, step = mixed or full or self._search(z, at, change, is_first)
            watchdog.note(step)
            change = None
            if self.first is None and self.equations.meets_conditions(z):
                self.first = z.copy()
        raise NoConvergence(progress.late(), self._reason(LATE))

    def _reason(self, usual: int) -> int:
        """Reason of a run that ends without a solution, if gaps are not all that is left."""
        return NOT_CLOSED if self._balance.lacks_closure else usual

    @property
    def _has_secants(self) -> bool:
        """Whether slopes may be secants, as in laws with history variables."""
        return any(p.gap.law.memory for p in self.equations.passes)

    def _mixed(self, z: Array, at: State, change: Array) -> tuple[Array, State, float] | None:
        """Result of the step mixed with earlier steps, if it is better; see :class:`Mixing`.

        Collective.
        """
        residual = self.equations.in_forces(self.equations.residual_of(at))
        step = self._mixing.step(z, residual, change, self._balance.keeps_its_set)
        if step is None:
            return None
        try:
            there = self.equations.evaluate(z + step)
            if self._merit(there) <= LEFT * self._merit(at):
                return z + step, there, 1.0
        except NoValueError:
            pass
        self.equations.evaluate(z)
        return None

    def _sticking(self, at: State) -> list[bool] | None:
        """Integration sides that must stick to keep bodies supported; None if there are none.

        In the first iteration, sticking constraints may exceed the friction limit by far in all
        contacts of a body that has no other support. If all of them slipped, the body could move
        arbitrarily. Only the contact that exceeds its friction limit by most slips. Collective.

        Args:
            at: The evaluation after the first iteration.
        """
        equations, count = self.equations, len(self.equations.system.contacts)
        number = {id(c): i for i, c in enumerate(equations.system.contacts)}
        sums, sticks = np.zeros((count, 2)), np.zeros(count)
        for p, e in zip(equations.passes, at.passes, strict=True):
            if p.slip is None or e.tangential is None:
                continue
            i, told, found = number[id(p.model)], e.tangential.told, e.tangential.response
            trial = told.traction + told.penalty[:, None] * told.slip
            for k, stress in enumerate((trial, found.traction)):
                size = np.linalg.norm(stress, axis=1) * e.active
                sums[i, k] += p.slip.weight @ size
            sticks[i] += np.count_nonzero(e.active & ~found.slipping)
        equations.system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        equations.system.comm.Allreduce(MPI.IN_PLACE, sticks, op=MPI.SUM)
        slide = (sticks == 0) & (sums[:, 1] > 0)
        beyond = sums[:, 0] / np.maximum(sums[:, 1], 1e-300)
        kept = set[int]()
        for body in equations.system.free_bodies:
            own = [i for i, sides in enumerate(equations.system.sides) if body in sides]
            own = [i for i in own if equations.system.contacts[i].friction is not None]
            if len(own) > 1 and all(slide[i] for i in own):
                kept.add(min(own, key=lambda i: float(beyond[i])))
        if not kept:
            return None
        return [number[id(p.model)] in kept for p in equations.passes]

    def _is_solution(self, z: Array) -> bool:
        """Whether z is a solution: the first iteration would activate points, or let some stick.

        Collective.
        """
        if not (self.equations.knows_closed_points or self.equations.slips_at_points):
            return False
        at = self.equations.evaluate(z, again=self._again)
        found = bool(np.isfinite(self._merit(at))) and self._balance.is_found(at, 1.0)
        self._balance.begin()
        return found and self._is_found(at, 1.0)

    def _is_found(self, at: State, step: float) -> bool:
        """Whether z solves the equations; stores the iterate. Collective."""
        balance = self._balance
        found = balance.is_found(at, step)
        number, x = len(balance.history) - 1, self.equations.bodies_of(at.z)
        self._newton.note(number, x, balance.history[-1].residual, balance.num_closed(at))
        return found

    @property
    def open_gap(self) -> float:
        """Largest gap (length) left open by multipliers at the last iterate, over all ranks."""
        return self._balance.open_gap

    @property
    def has_idle_tools(self) -> bool:
        """Whether force-controlled tools exist, and nothing was in contact at the last iterate."""
        history = self._balance.history
        return bool(self.equations.tools and history and history[-1].active == 0)

    def _has_active(self, at: State) -> bool:
        """Whether any constraint is active. Collective."""
        some = any(self._balance.num_closed(at))
        return bool(self.equations.system.comm.allreduce(some, op=MPI.LOR))

    def _begun_softly(
        self, z: Array, at: State, change: Array, begun: float
    ) -> tuple[Array, State, Array]:
        """Unknowns, evaluation and Newton step after soft penalties, if z is far off. Collective.

        Args:
            z: Unknowns of this rank at the first iterate with active constraints.
            at: The evaluation at z.
            change: The Newton step from z.
            begun: Merit at the start of the solve: a step into the other body can make it large.
        """
        for parts in (SOFT[:-1], SOFT[-1:]):
            if not self._is_far_off(z, change, min(begun, self._merit(at))):
                break
            z = self._approach(z, parts)
            at = self.equations.evaluate(z, first=True, again=self._again)
            change = self._change(at)
        return z, at, change

    def _is_far_off(self, z: Array, change: Array, merit: float) -> bool:
        """Whether the full step leads away from R = 0, above this merit. Collective.

        Where R is not finite, cells have turned inside out, and a shorter step is what helps.
        """
        try:
            there = self._merit(self.equations.evaluate(z + change))
        except NoValueError:
            return True
        return bool(FAR_OFF * merit < there < np.inf)

    def _approach(self, z: Array, parts: tuple[float, ...]) -> Array:
        """Follow the path of the solutions with soft penalties. Collective.

        Where slender bodies bend, most active constraints are wrong at first, and Newton's method
        moves the contact zone by a facet or two in each iteration. With a soft penalty it takes few
        iterations, and the solution is a good start for a penalty that is less soft (Hintermüller,
        Kunisch, SIAM J. Control Optim. 45, 2006, 1198). There is no line search, since its merit
        belongs to the set before.

        Args:
            z: Unknowns of this rank.
            parts: The penalties, over the automatic one.

        Returns:
            Unknowns to continue from: of the last penalty with a solution, or z.
        """
        found = z
        try:
            for part in parts:
                self.equations.soften(part)
                there = self._follow(found)
                if there is None:
                    break
                found = there
        except (NoConvergence, NoValueError):
            pass
        finally:
            self.equations.soften(1.0)
        return found

    def _follow(self, z: Array) -> Array | None:
        """Solve nearly, starting from z; None if an active set occurs again. Collective."""
        sets = list[bytes]()
        self._balance.begin()
        at = self.equations.evaluate(z, first=True, again=self._again)
        for _ in range(min(15, self.max_it)):  # only a start
            done, now = self._is_found(at, 1.0), self._balance.history[-1]
            if done or max(now.forces, now.constraints, now.tools) <= LITTLE:
                return z
            sets.append(b"".join(e.closed.tobytes() for e in at.passes))
            if self._comes_back(sets):
                break
            z = z + self._change(at)
            at = self.equations.evaluate(z)
        return None

    def _comes_back(self, sets: list[bytes]) -> bool:
        """Whether the last set equals an earlier one, with other sets in between. Collective.

        Args:
            sets: Active set on this rank in each iteration.
        """
        same = np.array([each == sets[-1] for each in sets[:-1]], dtype=bool)
        self.equations.system.comm.Allreduce(MPI.IN_PLACE, same, op=MPI.LAND)
        return bool(same.any() and not same[-1])

    def _free_step(self, z: Array) -> Array | None:
        """Find the positions from which slip counts, see :class:`Onset`. Collective.

        Returns:
            The first step, if no constraint becomes active; otherwise the first step is different.
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

    def _change(self, at: State, exact: bool = False) -> Array:
        """Newton step from the last evaluation. Collective.

        Args:
            at: The evaluation.
            exact: Whether an iterative solver uses a small tolerance, whatever Newton's method
                needs.
        """
        self._newton.record.iterations += 1
        self.equations.set_proximal(self._balance.proximal, self._balance.is_far)
        self._step.set_up(at, self._balance.shift)
        return self._step.solve(-self.equations.residual_of(at), self._balance.until, exact)

    # --- The line search

    def _full_step(self, z: Array, at: State, change: Array) -> tuple[Array, State, float] | None:
        """The full step, whatever its merit; None if it cannot be evaluated. Collective."""
        try:
            there = self.equations.evaluate(z + change)
            if np.isfinite(self._merit(there)) and not self._loses_a_tool(at, there):
                return z + change, there, 1.0
        except NoValueError:  # on all ranks
            pass
        self.equations.evaluate(z)
        return None

    def _search(
        self, z: Array, at: State, change: Array, is_first: bool = True
    ) -> tuple[Array, State, float]:
        """Part of the step that decreases the merit, or else the full step. Collective.

        A step that deactivates the last constraint of a force-controlled tool is taken only if all
        parts of the step do so.
        """
        before, step = self._merit(at), 1.0
        if not is_first and self.equations.slips_at_points:
            rest = self._rest_nearby(z, at, change)
            if rest is not None:
                return rest
        largest: float | None = None
        losing: float | None = None
        unseen: NoValueError | None = None
        for _ in range(MAX_HALVINGS):
            try:
                there = self.equations.evaluate(z + step * change)
                merit = self._merit(there)
            except NoValueError as error:
                merit, unseen = np.inf, error
            if np.isfinite(merit):
                if self._loses_a_tool(at, there):
                    losing = losing or step
                elif merit <= (1 - 1e-4 * step) * before:  # Armijo's condition
                    return z + step * change, there, step
                else:
                    largest = largest or step
            step /= 2
            if step < 1 / 8 <= 2 * step and largest is not None and self.equations.slips_at_points:
                rest = self._until_rest(z, at, change, largest)
                if rest is not None:
                    return rest
        largest = largest or losing
        if largest is None:
            if unseen is not None:
                raise unseen
            raise NoConvergence("no residual is finite along the step", NOT_FINITE)
        found = z + largest * change
        return found, self.equations.evaluate(found), largest

    def _rest_nearby(self, z: Array, at: State, change: Array) -> tuple[Array, State, float] | None:
        """Zero of the work of forces nearby, if a step slides further; else None. Collective."""
        far = NEARBY / max(self._way(change), 1e-300)
        if far >= 1:
            return None
        try:
            return self._until_rest(z, at, change, far)
        except NoValueError:  # on all ranks
            return None

    def _until_rest(
        self, z: Array, at: State, change: Array, most: float
    ) -> tuple[Array, State, float] | None:
        """Part of the step at which the work of R_u changes sign; None if it does not. Collective.

        Where bodies slip along each other, R_u is nearly constant and has no curvature. |R_u| then
        falls only if the step ends where something sticks, and the full Newton step goes far beyond
        this point. For constraints at contact quadrature points, R_u is nearly the gradient of an
        energy, which decreases up to this point.

        Args:
            z: Unknowns at the start of the step.
            at: The evaluation at z.
            change: The step.
            most: Largest part of the step that can be evaluated.
        """
        equations = self.equations
        along = equations.bodies_of(change)

        def work(at: State) -> float:
            """Work of R_u along the step."""
            local = float(along @ equations.bodies_of(equations.residual_of(at)))
            return float(equations.system.comm.allreduce(local, op=MPI.SUM))

        low, high = 0.0, most
        begins, ends = work(at), work(equations.evaluate(z + most * change))
        if not begins < 0 < ends:
            return None
        of_low, of_high = begins, ends
        for _ in range(24):  # a zero of one variable, to a tenth of the work at the start
            # Zero of the secant, kept away from both ends of the interval.
            part = min(max(of_low / (of_low - of_high), 0.1), 0.9)
            step = low + part * (high - low)
            there = equations.evaluate(z + step * change)
            found = work(there)
            if abs(found) <= -0.1 * begins:
                break
            if found < 0:
                low, of_low = step, found
            else:
                high, of_high = step, found
        return z + step * change, there, step

    def _way(self, change: Array) -> float:
        """Largest sliding distance of frictional contact in a step, in facets. Collective."""
        most = 0.0
        with vectors_of(self.equations, change) as vecs:
            for p in self.equations.passes:
                if p.slip is None:
                    continue
                slave, master = p.bodies
                assert slave is not None
                follows = p.gap.following is not None
                operator = p.gap.jump_operator() if follows else p.slip.operator
                handles = handle_of(vecs[slave]), 0 if master is None else handle_of(vecs[master])
                way = operator.apply(*handles, p.gap.state.scale)
                longest = float(np.linalg.norm(way, axis=1).max(initial=0.0))
                most = max(most, longest / p.slip.slave.facet_size_range[1])
        return float(self.equations.system.comm.allreduce(most, op=MPI.MAX))

    def _loses_a_tool(self, at: State, there: State) -> bool:
        """Whether no active constraint resists the force on a tool any more. Collective."""
        if not self.equations.tools:
            return False
        return bool(np.any((self._closed_on_tools(at) > 0) & (self._closed_on_tools(there) == 0)))

    def _closed_on_tools(self, at: State) -> npt.NDArray[np.int64]:
        """Active constraints of each force-controlled tool over all ranks. Collective."""
        counts: npt.NDArray[np.int64] = np.zeros(len(self.equations.tools), dtype=np.int64)
        for p, e in zip(self.equations.passes, at.passes, strict=True):
            if p.tool is not None:
                counts[p.tool] += np.sum(e.closed)
        self.equations.system.comm.Allreduce(MPI.IN_PLACE, counts, op=MPI.SUM)
        return counts

    def _merit(self, at: State) -> float:
        forces = self.equations.in_forces(self.equations.residual_of(at))
        total = self.equations.system.comm.allreduce(float(forces @ forces), op=MPI.SUM)
        return float(np.sqrt(total))

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self._step.destroy()
