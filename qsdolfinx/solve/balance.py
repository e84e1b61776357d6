"""Whether unknowns solve R(z) = 0: forces in balance, constraints met, tools in balance."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.solve.newton import Newton
from qsdolfinx.surface.unknowns import is_vertex_scalar
from qsdolfinx.system.condensed_rows import LEAST_PROXIMAL, PROXIMAL
from qsdolfinx.system.derivative import REGULAR
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import State
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Most springs of bodies that have no condition at all, over the diagonal of their stiffness.
SPRINGS = 1e-4

#: Springs, over that diagonal, of bodies that some conditions and closed rows leave a rigid motion.
UNHELD = 1e-3

#: Residual, relative to contact forces, from which on rows at points are less and less soft.
LITTLE = 1e-2

#: Unbalanced force of a tool over the force that drives it.
RTOL_TOOLS = 1e-8

#: Iterations within what rounding leaves after which a solve ends, even if steps are halved there.
MOST_REFINED = 10

#: What rounding leaves of forces and gaps, in units in the last place of the largest coordinate.
ROUNDING = 50 * np.finfo(np.float64).eps


class Iterate(typing.NamedTuple):
    """One iteration.

    Attributes:
        residual: |R_u|.
        forces: The same over the contact forces.
        constraints: Largest complementarity residual over the largest multiplier.
        tools: Largest unbalanced force of a tool over the force that drives it.
        active: Closed rows over all ranks.
        sticking: Of these those that stick.
        step: Part of the step that was taken to get here; NaN where PETSc has taken it.
    """

    residual: float
    forces: float
    constraints: float
    tools: float
    active: int
    sticking: int
    step: float


#: Part of what was left so many iterations before, above which it falls slowly:
#: ``tests/sliding/test_pads.py``, strong friction.
SLOW, SOME = 0.5, 6


class Balance:
    """Measures iterates, and knows which one solves the equations.

    |R_u| is to be below ``snes_rtol`` of the contact forces, what gaps stand for in stress below
    that of the largest multiplier, and unbalanced forces on tools below 1e-8 of those that drive
    them; none of them below what rounding leaves.

    Args:
        equations: The equations.
        newton: Whose tolerances it has.
        stiffness: Most springs of bodies that conditions leave a rigid motion, over the diagonal of
            their stiffness; by default of those without any condition alone.
    """

    def __init__(
        self, equations: Equations, newton: Newton, stiffness: float | None = None
    ) -> None:
        self._stiffness = stiffness
        self._equations = equations
        self._rtol, self._atol, _, _ = newton.snes.getTolerances()
        #: Largest unknown of each body that is a displacement, and what rounding is a part of where
        #: the form is not linear: a cell, strained by 1.
        self._sizes = [_sizes_of(equations.system, i) for i in range(len(equations.system.bodies))]
        self.begin()

    def begin(self) -> None:
        """Begin with a solve."""
        #: Its iterates.
        self.history: list[Iterate] = []
        #: Whether gaps are all that the last iterate lacks.
        self.lacks_closure = False
        #: Norm of forces with which the solve ends.
        self.until = 0.0
        #: Largest gap (length) that multipliers have left at the last iterate, over all ranks.
        self.open_gap = 0.0
        #: Iterates so far when a step was last cut.
        self._cut_after = 0
        self._times_in_floor, self._is_held, self._unheld = 0, True, UNHELD
        #: Closed rows of each pass at the last iterate, and those that stick; and whether the one
        #: before had the same.
        self._sets: list[npt.NDArray[np.bool_]] = []
        self.keeps_its_set = False
        #: Largest residual and contact forces of the solve so far.
        self._seen: Array = np.zeros(2)
        #: Largest multiplier of the last iterate: a step from there leaves rounding of it.
        self._last = 0.0

    def is_found(self, at: State, step: float) -> bool:
        """Whether an evaluation's unknowns solve the equations; notes the iterate. Collective.

        Args:
            at: The evaluation.
            step: For the iterate.
        """
        equations, comm = self._equations, self._equations.system.comm
        if step < 1:
            self._cut_after = len(self.history)
        R, f = equations.forces_of(at), at.contact
        bodies = equations.system.bodies
        rounding = [
            body.diagonal[body.free] * (np.minimum(self._sizes_in(at, i), most) + least)
            for i, (body, (most, least)) in enumerate(zip(bodies, self._sizes, strict=True))
        ]
        rounding += [p.rows.forces_of_coordinates() for p in equations.passes]
        of_slips = [
            p.rows.rounded_forces(e) for p, e in zip(equations.passes, at.passes, strict=True)
        ]
        squares = [sum(float(r @ r) for r in of) for of in (rounding, of_slips)]
        sums = np.array([R @ R, f @ f, *squares])
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        residual, forces, rounded, of_rates = np.sqrt(sums)
        largest = np.zeros(3)
        counts: npt.NDArray[np.int64] = np.zeros(3, dtype=np.int64)
        before, self._sets = self._sets, [f for e in at.passes for f in (e.closed, e.sticking)]
        counts[2] = len(before) != len(self._sets)
        pairs = zip(before, self._sets, strict=False)
        counts[2] += sum(not np.array_equal(a, b) for a, b in pairs)
        for p, e in zip(equations.passes, at.passes, strict=True):
            largest[0] = max(largest[0], p.rows.violation(e))
            largest[1] = max(largest[1], float(np.max(np.abs(e.pressure), initial=0.0)))
            largest[2] = max(largest[2], p.rows.rounding())
            counts[:2] += np.sum(e.closed), np.sum(e.sticking)
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, counts, op=MPI.SUM)
        self.keeps_its_set = bool(counts[2] == 0)
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
        free = equations.system.made.hold.free_motions([e.active for e in at.passes])
        self._is_held = free.shape[1] == 0
        self._unheld = UNHELD
        if not self._is_held and self._may_go_far:
            self._unheld = min(UNHELD, self._spring_of(R, free))
        limits = max(self._rtol * forces, of_rates), self._rtol * largest[1]
        self.until = max(float(limits[0]), self._atol)
        self._seen = np.maximum(self._seen, [residual, forces])
        rounded, largest[2] = max(rounded, *self._seen), max(*largest[1:], self._last)
        self._last = float(largest[1])
        self.until = max(self.until, float(ROUNDING * rounded))
        floors = max(limits[0], ROUNDING * rounded), max(limits[1], ROUNDING * largest[2])
        in_floor = bool(residual <= floors[0] and largest[0] <= floors[1])
        # An iteration more, as a refinement, makes the most of what rounding leaves: a whole one.
        self._times_in_floor = self._times_in_floor + 1 if in_floor else 0
        refined = self._times_in_floor > (MOST_REFINED if step < 1 else 1)
        if in_floor and (refined or largest[1] == 0):
            limits = floors
        balanced = residual <= max(limits[0], self._atol) and tools <= RTOL_TOOLS
        met, closed = largest[0] <= limits[1], self._are_closed(at)
        self.lacks_closure = bool(balanced and met and not closed)
        return bool(balanced and met and closed)

    def _sizes_in(self, at: State, i: int) -> Array:
        """Size of body i's free unknowns, or of those that its residual counts from."""
        body = self._equations.system.bodies[i]
        sizes = np.maximum(np.abs(self._equations.part(at.z, i)), body.reference)
        return np.asarray(sizes[body.free])

    @property
    def _may_go_far(self) -> bool:
        """Whether a step may pass what it will meet: nothing but gaps changes on the way."""
        follows = any(p.gap.following is not None for p in self._equations.passes)
        return self._equations.system.linear and not follows

    def _spring_of(self, R: Array, free: Array) -> float:
        """Springs, over the diagonal, that let bodies go as far as they are large. Collective.

        Stiffer ones hold a body that has been let go where it is.

        Args:
            R: What is not balanced.
            free: Motions that closed rows leave.
        """
        equations, comm = self._equations, self._equations.system.comm
        rigid, bodies = equations.system.made.rigid, equations.system.bodies
        work = free.T @ rigid.work([equations.part(R, i) for i in range(len(bodies))])
        stiffness, length = np.zeros(free.shape[1]), np.zeros(free.shape[1])
        for j in range(free.shape[1]):
            for i, body in enumerate(bodies):
                m = rigid.displacement(free[:, j], i)
                stiffness[j] += np.sum(body.diagonal * m**2)
                length[j] = max(length[j], np.max(np.abs(m), initial=0.0))
        comm.Allreduce(MPI.IN_PLACE, stiffness, op=MPI.SUM)
        comm.Allreduce(MPI.IN_PLACE, length, op=MPI.MAX)
        size = max(most for most, _ in self._sizes)
        return float(np.max(np.abs(work) * length / (stiffness * size)))

    def _are_closed(self, at: State) -> bool:
        """Whether no multiplier leaves a gap that is more than its contact allows. Collective."""
        open_, allowed = np.zeros(len(at.passes)), np.full(len(at.passes), np.inf)
        for i, (p, e) in enumerate(zip(self._equations.passes, at.passes, strict=True)):
            if not p.model.is_scalar:  # whose jumps are no lengths
                open_[i], allowed[i] = p.rows.open_gap(e), p.model.allowed_gap
        self._equations.system.comm.Allreduce(MPI.IN_PLACE, open_, op=MPI.MAX)
        self.open_gap = float(open_.max(initial=0.0))
        return bool(np.all(open_ <= allowed))

    def num_closed(self, at: State) -> list[int]:
        """Closed rows of each contact on this rank.

        Args:
            at: The evaluation.
        """
        closed = {id(contact): 0 for contact in self._equations.system.contacts}
        for p, e in zip(self._equations.passes, at.passes, strict=True):
            closed[id(p.model)] += int(np.sum(e.closed))
        return list(closed.values())

    @property
    def shift(self) -> tuple[float, float]:
        """Springs for ``Derivative.of``; most of them vanish with the residual.

        Stiffer ones hold bodies that have some condition where closed rows leave them a rigid
        motion: as long as forces are far from balanced, they would go anywhere.
        """
        some, none = REGULAR, max(REGULAR, SPRINGS * self._left)
        if self._stiffness is not None:
            some = none = max(REGULAR, self._stiffness * self._left)
        if not self._is_held:
            # Over the largest contact forces of the solve: those of now may have vanished. Bodies
            # that have been let go have had none in all of it.
            now, (residual, forces) = self.history[-1], self._seen
            largest = forces if forces > 0 else residual
            unbalanced = now.residual / largest if largest > 0 else 0.0
            some = max(some, self._unheld * min(1.0, unbalanced + now.constraints))
        return some, none

    @property
    def is_far(self) -> bool:
        """Whether much is left of the residual, unless it falls slowly in steps that are whole."""
        if len(self.history) < 2:
            return True
        before, now = (
            max(each.forces, each.constraints, each.tools)
            for each in (self.history[-1 - SOME :][0], self.history[-1])
        )
        is_slow = len(self.history) - self._cut_after > SOME and now > SLOW * before
        return now > LITTLE and not is_slow

    @property
    def proximal(self) -> float:
        """For ``Equations.set_proximal``: its most until little is left, or the set stays."""
        if self.keeps_its_set:
            return LEAST_PROXIMAL
        if len(self.history) < 2:
            return PROXIMAL
        now = self.history[-1]
        left = max(now.forces, now.constraints, now.tools)
        return float(np.clip(PROXIMAL * left / LITTLE, LEAST_PROXIMAL, PROXIMAL))

    @property
    def _left(self) -> float:
        """What is left of the residual; a solve begins where springs have put the bodies."""
        if len(self.history) < 2:
            return 0.0
        now, first = self.history[-1], self.history[0]
        fallen = now.residual / first.residual if first.residual > 0 else 1.0
        return float(min(1.0, fallen, now.forces + now.constraints))


def _sizes_of(system: ContactSystem, i: int) -> tuple[float, float]:
    """Largest and least size of body i's unknowns for rounding. Collective."""
    body, scale, msh = system.bodies[i], system.scales[i], system.bodies[i].V.mesh
    if is_vertex_scalar(body.V):
        return np.inf, 0.0
    cells = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
    cell = 0.0 if body.linear else float(np.max(msh.h(msh.topology.dim, cells), initial=0.0))
    local = np.array([np.abs(msh.geometry.x).max(initial=0.0), cell])
    largest = np.zeros(2)
    body.comm.Allreduce(local, largest, op=MPI.MAX)
    return float(largest[0] / scale), float(largest[1] / scale)
