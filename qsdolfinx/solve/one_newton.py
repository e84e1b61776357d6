"""One semismooth Newton's method on bodies, multipliers and driven tools."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.reasons import NOT_FINITE
from qsdolfinx.gap.following import NoGapError
from qsdolfinx.solve.balance import Balance
from qsdolfinx.solve.mixing import LEFT, Mixing
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.newton_step import LATE, NewtonStep, NoConvergence
from qsdolfinx.solve.onset import Onset, vectors_of
from qsdolfinx.solve.snes import NOT_CLOSED
from qsdolfinx.solve.snes_on_z import SnesOnZ
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Halvings of a step, and what the merit has to fall by over what a whole step promises.
MAX_HALVINGS, FALL = 8, 1e-4

#: Part of a step below which it is asked first where forces do no more work; how little that is to
#: be, over that at its start, and most evaluations.
SMALL, AT_REST, MOST_ASKED = 0.125, 0.1, 24

#: Way (facets) of bodies along each other beyond which steps are asked first, too: see
#: ``tests/problems/test_engineering_2.py``, a pad that friction alone holds.
FAR = 0.5

#: Part of the first step that is less than a good start allows.
POOR = 0.1

#: Part of γ with which solves begin that know no multipliers, what they end with, and most
#: iterations of them.
SOFT, NEAR, MOST_SOFT = 1e-4, 1e-2, 30


class OneNewton:
    """Finds R(z) = 0 by a semismooth Newton's method with a line search.

    The merit is m² = |R_u|² + Σ W² (λ − [λ + c ḡ*]₊)² + the same of τ + |R_s|², which is continuous
    where sets change. A step is halved as long as the residual is not finite, a gap cannot be
    evaluated, or the merit has not fallen; where that would leave little of it, or what has
    friction would go far, it ends where forces do no more work, see :meth:`_until_rest`. In the
    first iteration what has λ > 0 stays closed, and what is closed without any τ sticks. If the
    user's options name a type of SNES or a line search, that follows after the first step.

    Args:
        equations: The equations.
        newton: Whose record, monitors and tolerances it has.
        again: Whether the step has been solved before, with other pairs.
        stiffness: Of springs, as for :class:`Balance`.
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
        self._step, self._balance = (
            NewtonStep(equations, newton),
            Balance(equations, newton, stiffness),
        )

    def solve(self, z: Array, begins: bool = True, is_guess: bool = False) -> Array:
        """Solution, from z on. Collective.

        Args:
            z: Unknowns of this rank.
            begins: Whether it is to be found where slip counts from.
            is_guess: Whether to give up at once if the first step leads next to nowhere: there is
                another start.

        Raises:
            NoConvergence: If none is found.
        """
        self._balance.begin()
        self._mixing = Mixing(self.equations.system.comm)
        z, step = z.copy(), 1.0
        if begins and self._is_solution(z):
            return z
        change = self._free_step(z) if begins else None
        at = self.equations.evaluate(z, first=True, again=self._again)
        if not np.isfinite(self._merit(at)):
            raise NoConvergence("the residual is not finite", NOT_FINITE)
        if self._newton.has_users_snes:
            if begins:
                z, at, _ = self._search(z, at, self._change(at) if change is None else change)
            return SnesOnZ(self.equations, self._newton, self._step, self._balance).solve(z)
        for iteration in range(self.max_it + 1):
            if self._is_found(at, step):
                return z
            if iteration == self.max_it:
                break
            is_first = iteration == 0
            if begins and iteration == 1:
                sticking = self._sticking(at)
                if sticking is not None:
                    at, is_first = self.equations.evaluate(z, sticking=sticking), True
            change = self._change(at) if change is None else change
            mixed = self._mixed(z, at, change) if iteration > 1 and self._has_secants else None
            z, at, step = mixed or self._search(z, at, change, is_first)
            if is_guess and iteration == 0 and step < POOR:
                raise NoConvergence("the first step leads nowhere")
            change = None
        last = self._balance.history[-1]
        reason = NOT_CLOSED if self._balance.lacks_closure else LATE
        raise NoConvergence(f"no convergence in {self.max_it} iterations: {last}", reason)

    @property
    def _has_secants(self) -> bool:
        """Whether slopes may be secants: those of laws that remember."""
        return any(p.gap.law.memory for p in self.equations.passes)

    def _mixed(self, z: Array, at: State, change: Array) -> tuple[Array, State, float] | None:
        """Where the step mixed with those before leads, if that is better; see :class:`Mixing`.

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
        except NoGapError:
            pass
        self.equations.evaluate(z)
        return None

    def _sticking(self, at: State) -> list[bool] | None:
        """Passes that go on sticking, since bodies would have nothing to hold them; None for none.

        What all sticks in the first iteration may be far beyond friction on all sides of a body
        that nothing else holds, and if all of it slipped, the body would go anywhere. Of its
        contacts the one slips that is beyond its friction by most. Collective.

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
        """Whether z is one already: the first iteration would add closed points, or let some stick.

        Collective.
        """
        if not (self.equations.knows_closed_points or self.equations.slips_at_points):
            return False
        at = self.equations.evaluate(z, again=self._again)
        found = bool(np.isfinite(self._merit(at))) and self._balance.is_found(at, 1.0)
        self._balance.begin()
        return found and self._is_found(at, 1.0)

    def _is_found(self, at: State, step: float) -> bool:
        """Whether z solves the equations; notes the iterate. Collective."""
        balance = self._balance
        found = balance.is_found(at, step)
        number, x = len(balance.history) - 1, self.equations.bodies_of(at.z)
        self._newton.note(number, x, balance.history[-1].residual, balance.num_closed(at))
        return found

    @property
    def open_gap(self) -> float:
        """Largest gap (length) that multipliers have left at the last iterate, over all ranks."""
        return self._balance.open_gap

    @property
    def has_idle_tools(self) -> bool:
        """Whether there are driven tools, and nothing was in contact at the last iterate."""
        history = self._balance.history
        return bool(self.equations.tools and history and history[-1].active == 0)

    def approach(self, z: Array) -> Array:
        """Where a small γ leads: many rows may open or close at once. Collective.

        With γ near the bodies' own stiffness what is in contact travels by a facet or two in each
        iteration; the smaller it is the further it goes. Without line search, whose merit belongs
        to the set of before; a set that comes back would do so again.

        Args:
            z: Unknowns of this rank.

        Returns:
            What to go on from: z itself if that leads nowhere.
        """
        equations, found, sets = self.equations, z.copy(), list[bytes]()
        equations.soften(SOFT)
        self._balance.begin()
        try:
            at = equations.evaluate(found, first=True, again=self._again)
            for _ in range(min(MOST_SOFT, self.max_it)):
                done, now = self._is_found(at, 1.0), self._balance.history[-1]
                if done or max(now.forces, now.constraints, now.tools) <= NEAR:
                    return found
                sets.append(b"".join(e.closed.tobytes() for e in at.passes))
                if self._comes_back(sets):
                    break
                found = found + self._change(at)
                at = equations.evaluate(found)
        except (NoConvergence, NoGapError):
            pass
        finally:
            equations.soften(1.0)
        return z

    def _comes_back(self, sets: list[bytes]) -> bool:
        """Whether the last of these sets is that of an earlier one, with others since. Collective.

        Args:
            sets: What has been closed on this rank in each iteration.
        """
        same = np.array([each == sets[-1] for each in sets[:-1]], dtype=bool)
        self.equations.system.comm.Allreduce(MPI.IN_PLACE, same, op=MPI.LAND)
        return bool(same.any() and not same[-1])

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

    def _change(self, at: State, exact: bool = False) -> Array:
        """Newton's step from the last evaluation. Collective.

        Args:
            at: The evaluation.
            exact: Whether an iterative solver is to find it whatever Newton's method needs.
        """
        self._newton.record.iterations += 1
        self.equations.set_proximal(self._balance.proximal, self._balance.is_far)
        self._step.set_up(at, self._balance.shift)
        return self._step.solve(-self.equations.residual_of(at), self._balance.until, exact)

    # --- The line search

    def _search(
        self, z: Array, at: State, change: Array, is_first: bool = True
    ) -> tuple[Array, State, float]:
        """As much of the step as makes the merit fall, or else all of it. Collective.

        A step that takes the last closed row from a tool that a force drives is taken if all do.
        """
        before, step = self._merit(at), 1.0
        if not is_first and self.equations.slips_at_points:
            rest = self._rest_nearby(z, at, change)
            if rest is not None:
                return rest
        largest: float | None = None
        losing: float | None = None
        unseen: NoGapError | None = None
        for _ in range(MAX_HALVINGS):
            try:
                there = self.equations.evaluate(z + step * change)
                merit = self._merit(there)
            except NoGapError as error:
                merit, unseen = np.inf, error
            if np.isfinite(merit):
                if self._loses_a_tool(at, there):
                    losing = losing or step
                elif merit <= (1 - FALL * step) * before:
                    return z + step * change, there, step
                else:
                    largest = largest or step
            step /= 2
            if step < SMALL <= 2 * step and largest is not None and self.equations.slips_at_points:
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
        """Where forces do no more work within FAR along a step beyond it; else None. Collective."""
        far = FAR / max(self._way(change), 1e-300)
        if far >= 1:
            return None
        try:
            return self._until_rest(z, at, change, far)
        except NoGapError:  # on all ranks
            return None

    def _until_rest(
        self, z: Array, at: State, change: Array, most: float
    ) -> tuple[Array, State, float] | None:
        """The step until the work of R_u along it changes its sign, None if not. Collective.

        Where bodies slip along each other R_u is next to constant and has no curvature: |R_u| does
        not fall before a step ends where something sticks, which Newton's step goes far beyond. Of
        constraints at points R_u is nearly the gradient of an energy, which falls until there.

        Args:
            z: Where the step begins.
            at: The evaluation there.
            change: The step.
            most: Part of it that can be evaluated.
        """
        equations = self.equations
        along = equations.bodies_of(change)

        def work(at: State) -> float:
            """Of R_u along the step."""
            local = float(along @ equations.bodies_of(equations.residual_of(at)))
            return float(equations.system.comm.allreduce(local, op=MPI.SUM))

        low, high = 0.0, most
        begins, ends = work(at), work(equations.evaluate(z + most * change))
        if not begins < 0 < ends:
            return None
        of_low, of_high = begins, ends
        for _ in range(MOST_ASKED):
            # The secant's point between, or the middle where that is near either end.
            part = min(max(of_low / (of_low - of_high), 0.1), 0.9)
            step = low + part * (high - low)
            there = equations.evaluate(z + step * change)
            found = work(there)
            if abs(found) <= -AT_REST * begins:
                break
            if found < 0:
                low, of_low = step, found
            else:
                high, of_high = step, found
        return z + step * change, there, step

    def _way(self, change: Array) -> float:
        """Largest way in a step of what has friction against each other, in facets. Collective."""
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
        """Whether nothing is left that resists the force on a tool. Collective."""
        if not self.equations.tools:
            return False
        return bool(np.any((self._closed_on_tools(at) > 0) & (self._closed_on_tools(there) == 0)))

    def _closed_on_tools(self, at: State) -> npt.NDArray[np.int64]:
        """Closed rows of each driven tool over all ranks. Collective."""
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
