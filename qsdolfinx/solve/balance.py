"""Check whether unknowns solve R(z) = 0: balance of forces, constraints, balance of tools."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.solve.convergence import ROUNDING
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.stabilisation import VANISHING
from qsdolfinx.surface.unknowns import is_vertex_scalar
from qsdolfinx.system.condensed_rows import PROXIMAL
from qsdolfinx.system.derivative import REGULAR
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.normal_rows import LEAST_PROXIMAL
from qsdolfinx.system.passes import State
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Largest stiffness of the springs of bodies without any Dirichlet condition, over the diagonal of
#: the stiffness matrix of the body. Stiffer springs take more iterations; with much softer ones, a
#: body leaves its contacts in one iteration.
SPRINGS = 1e-4

#: Residual, relative to contact forces, below which the regularisation of constraints at contact
#: quadrature points decreases. With much less, the last iterations converge slowly; with 1, it
#: never acts.
LITTLE = 1e-2

#: Unbalanced force of a tool over the force that drives it, at the end of a solve. It is the
#: accuracy of the tool's force; with less than some 1e-12, rounding could keep solves from ending.
RTOL_TOOLS = 1e-8


class Iterate(typing.NamedTuple):
    """One iteration.

    Attributes:
        residual: |R_u|.
        forces: |R_u| over the contact forces.
        constraints: Largest complementarity residual over the largest multiplier.
        tools: Largest unbalanced force of a tool over the force that drives it.
        active: Active constraints over all ranks.
        sticking: Number of active constraints that stick.
        step: Part of the Newton step that led to this iterate; NaN if PETSc took the step.
    """

    residual: float
    forces: float
    constraints: float
    tools: float
    active: int
    sticking: int
    step: float


#: The residual falls slowly if it is larger than this part of its value so many iterations before;
#: active points then get no compliance. With a small part, it would always fall slowly; with a
#: large one, never: ``tests/sliding/test_pads.py``, strong friction.
SLOW, SOME = 0.5, 6


class Balance:
    """Measure iterates, and decide whether they solve the equations.

    The tolerances are: |R_u| below ``snes_rtol`` of the contact forces, gaps converted to stress
    below this part of the largest multiplier, and unbalanced forces on tools below 1e-8 of the
    prescribed forces. No tolerance is below rounding level.

    Args:
        equations: The equations.
        newton: Solver whose tolerances are used.
        stiffness: Largest stiffness of the springs of bodies that conditions leave a rigid motion,
            over the diagonal of the stiffness matrix; by default, only bodies without any condition
            have springs.
    """

    def __init__(
        self, equations: Equations, newton: Newton, stiffness: float | None = None
    ) -> None:
        self._stiffness = stiffness
        self._equations = equations
        self._rtol, self._atol, _, _ = newton.snes.getTolerances()
        #: Largest size of each body's displacements for rounding, and the size that rounding is
        #: relative to if the form is not linear: a cell, at strain 1.
        self._sizes = [_sizes_of(equations.system, i) for i in range(len(equations.system.bodies))]
        self.begin()

    def begin(self) -> None:
        """Reset everything at the start of a solve."""
        #: Iterates of the solve.
        self.history: list[Iterate] = []
        #: Whether gaps are the only criterion that the last iterate does not meet.
        self.lacks_closure = False
        #: Norm of forces at which the solve ends.
        self.until = 0.0
        #: Largest gap (length) that multipliers have left at the last iterate, over all ranks.
        self.open_gap = 0.0
        #: Number of iterates when a step was last shortened.
        self._cut_after = 0
        self._times_in_floor, self._is_held, self._unheld = 0, True, VANISHING
        #: Active and sticking constraints of each integration side at the last iterate, and whether
        #: these sets are unchanged since the iterate before.
        self._sets: list[npt.NDArray[np.bool_]] = []
        self.keeps_its_set = False
        #: Largest residual and contact forces of the solve so far.
        self._seen: Array = np.zeros(2)
        #: Largest multiplier of the last iterate: a step from there has rounding errors of this
        #: size.
        self._last = 0.0

    def is_found(self, at: State, step: float) -> bool:
        """Whether an evaluation's unknowns solve the equations; stores the iterate. Collective.

        Args:
            at: The evaluation.
            step: Part of the Newton step, for the iterate.
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
        self._unheld = VANISHING
        if not self._is_held and self._may_go_far:
            self._unheld = min(VANISHING, self._spring_of(R, free))
        limits = max(self._rtol * forces, of_rates), self._rtol * largest[1]
        share = ROUNDING * float(np.finfo(np.float64).eps)
        self.until = max(float(limits[0]), self._atol)
        self._seen = np.maximum(self._seen, [residual, forces])
        rounded, largest[2] = max(rounded, *self._seen), max(*largest[1:], self._last)
        self._last = float(largest[1])
        self.until = max(self.until, float(share * rounded))
        floors = max(limits[0], share * rounded), max(limits[1], share * largest[2])
        in_floor = bool(residual <= floors[0] and largest[0] <= floors[1])
        # One more iteration with a full step, as a refinement, reduces the error to rounding level.
        self._times_in_floor = self._times_in_floor + 1 if in_floor else 0
        # Even if steps are halved, an iteration at rounding level ends.
        refined = self._times_in_floor > (10 if step < 1 else 1)
        if in_floor and (refined or largest[1] == 0):
            limits = floors
        balanced = residual <= max(limits[0], self._atol) and tools <= RTOL_TOOLS
        met, closed = largest[0] <= limits[1], self._are_closed(at)
        self.lacks_closure = bool(balanced and met and not closed)
        return bool(balanced and met and closed)

    @property
    def is_at_rounding(self) -> bool:
        """Whether all that is left of the last iterate are rounding errors."""
        return self._times_in_floor > 0

    def _sizes_in(self, at: State, i: int) -> Array:
        """Size of body i's free unknowns, or of its residual's reference unknowns if larger."""
        body = self._equations.system.bodies[i]
        sizes = np.maximum(np.abs(self._equations.part(at.z, i)), body.reference)
        return np.asarray(sizes[body.free])

    @property
    def _may_go_far(self) -> bool:
        """Whether a step may go beyond contact onset: only gaps change along the step."""
        follows = any(p.gap.following is not None for p in self._equations.passes)
        return self._equations.system.linear and not follows

    def _spring_of(self, R: Array, free: Array) -> float:
        """Stiffness (over the diagonal) of springs that let bodies move by their size. Collective.

        Stiffer springs would hold a body in place that has been released.

        Args:
            R: Unbalanced forces.
            free: Rigid motions that active constraints leave free.
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
        """Whether no gap under a multiplier is larger than its contact allows. Collective."""
        open_, allowed = np.zeros(len(at.passes)), np.full(len(at.passes), np.inf)
        for i, (p, e) in enumerate(zip(self._equations.passes, at.passes, strict=True)):
            if not p.model.is_scalar:  # jumps of scalar fields are not lengths
                open_[i], allowed[i] = p.rows.open_gap(e), p.model.allowed_gap
        self._equations.system.comm.Allreduce(MPI.IN_PLACE, open_, op=MPI.MAX)
        self.open_gap = float(open_.max(initial=0.0))
        return bool(np.all(open_ <= allowed))

    def num_closed(self, at: State) -> list[int]:
        """Active constraints of each contact on this rank.

        Args:
            at: The evaluation.
        """
        closed = {id(contact): 0 for contact in self._equations.system.contacts}
        for p, e in zip(self._equations.passes, at.passes, strict=True):
            closed[id(p.model)] += int(np.sum(e.closed))
        return list(closed.values())

    @property
    def shift(self) -> tuple[float, float]:
        """Stiffness of the springs for ``Derivative.of``; most of it vanishes with the residual.

        Stiffer springs hold bodies with some conditions, if active constraints leave them a rigid
        motion: while forces are far from balance, these bodies could move arbitrarily far.
        """
        some, none = REGULAR, max(REGULAR, SPRINGS * self._left)
        if self._stiffness is not None:
            some = none = max(REGULAR, self._stiffness * self._left)
        if not self._is_held:
            # Relative to the largest contact forces of the solve, because the present forces may
            # have vanished. Bodies that have been released had no contact forces in the whole
            # solve.
            now, (residual, forces) = self.history[-1], self._seen
            largest = forces if forces > 0 else residual
            unbalanced = now.residual / largest if largest > 0 else 0.0
            some = max(some, self._unheld * min(1.0, unbalanced + now.constraints))
        return some, none

    @property
    def is_far(self) -> bool:
        """Whether the residual is still large, and does not fall slowly in full steps."""
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
        """Value for ``Equations.set_proximal``; reduced with the residual, or if the set stays."""
        if self.keeps_its_set:
            return LEAST_PROXIMAL
        if len(self.history) < 2:
            return PROXIMAL
        now = self.history[-1]
        left = max(now.forces, now.constraints, now.tools)
        return float(np.clip(PROXIMAL * left / LITTLE, LEAST_PROXIMAL, PROXIMAL))

    @property
    def _left(self) -> float:
        """Part of the residual that is left; a solve begins where springs have put the bodies."""
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
