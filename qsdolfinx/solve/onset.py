"""Find the contact onset of constraints within a step, from which friction counts slip."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.slid import NEARBY
from qsdolfinx.friction.slip import Slip
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import Pass

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Smallest remaining part of a step after contact onset: slip rates are slip divided by it.
LEAST_SHARE = 1e-2


class _Way:
    """Path of the constraints of an integration side in a step, and their onset times.

    Args:
        p: The integration side.
        slip: Its slip, at the last evaluation.

    Attributes:
        open: Constraints that were inactive at the start of the step and still are on the path so
            far. closing: Part of the step after which they become active, at most 1; 0 for others.
    """

    def __init__(self, p: Pass, slip: Slip) -> None:
        self.p, self.slip = p, slip
        self._gap = slip.gap_at_start(p.gap.state.values[:, 0])
        self._jump = np.zeros_like(slip.state.jump)
        self.open: Flags = slip.is_fresh & (self._gap < -p.model.paired.touching)
        self._began_open = self.open.copy()
        self.closing: Array = self.open.astype(np.float64)
        self._until: Array = np.zeros_like(self._jump)

    @property
    def num_closed(self) -> int:
        """Number of constraints on this rank that were active at the start of the step."""
        return int(np.count_nonzero(self.slip.state.closed & ~self._began_open))

    def go_on(self, now: float, gap: Array, jump: Array) -> None:
        """Continue the path along a straight line.

        Args:
            now: Part of the step so far.
            gap: Gap at the end of the step without the inactive constraints (length).
            jump: Change of the relative displacement in the step until the end (length).
        """
        self._to_gap, self._to_jump = gap, jump
        if self.p.gap.following is not None:
            # Beyond this distance it slides onto parts that were in contact before, for the whole
            # step: the energy of contact that slides by facets would be too small.
            near = np.linalg.norm(jump, axis=1) < NEARBY * self.p.gap.slave.facet_size_range[1]
            self.open, self._began_open = self.open & near, self._began_open & near
            self.closing = np.where(self._began_open, self.closing, 0.0)
        closes = self.open & (gap > np.maximum(self._gap, 0.0))
        part = np.ones_like(gap)
        part[closes] = -self._gap[closes] / (gap - self._gap)[closes]
        part = np.clip(part, 0.0, 1.0)
        self.closing = np.where(self.open, now + (1 - now) * part, self.closing)
        reached = self._jump + part[:, None] * (jump - self._jump)
        self._until = np.where(self.open[:, None], reached, self._until)

    def advance(self, now: float, to: float) -> None:
        """Advance to a part of the step, and activate the constraints with an onset until then."""
        part = (to - now) / (1 - now)
        self._gap = self._gap + part * (self._to_gap - self._gap)
        self._jump = self._jump + part * (self._to_jump - self._jump)
        self.open = self.open & (self.closing > to)

    def count(self) -> None:
        """Count slip from contact onset on this path; for other constraints, from its end."""
        share = np.where(self._began_open, np.maximum(1 - self.closing, LEAST_SHARE), 1.0)
        until = np.where(self._began_open[:, None], self._until, 0.0)
        self.slip.count_from(until, share, ~self._began_open | (self.closing < 1))


class Onset:
    """Find the onset time of each constraint in a step, and its relative displacement until then.

    A constraint has no friction before its onset. The end of the step does not show the onset time:
    the gap is closed there, whatever the path was. So one Newton step is made with all constraints
    inactive that were inactive at the start of the step. It gives a gap ḡ_free > 0 and a relative
    displacement J_free, as if these constraints did not exist. On a straight path, the onset is
    after the part

        s = ḡ_0 / (ḡ_0 − ḡ_free)

    of the step, with the relative displacement J_0 + s (J_free − J_0). Slip counts from there. Each
    constraint that becomes active bends the path of the others. So the path is straight only until
    twice as many constraints are active as at its start. Then it continues to the position of the
    bodies with these constraints active, and so on. If a body is supported only by constraints that
    become active in the step, its path is unknown, and slip counts from the start of the step.

    Args:
        equations: The equations, at the last evaluation.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations, self._comm = equations, equations.system.comm
        self._ways = [None if p.slip is None else _Way(p, p.slip) for p in equations.passes]
        found = any(bool(way.open.any()) for way in self._with_friction)
        #: Whether there are constraints that were inactive.
        self.counts: bool = self._comm.allreduce(found, op=MPI.LOR)

    @property
    def _with_friction(self) -> list[_Way]:
        return [way for way in self._ways if way is not None]

    def find(self, step: typing.Callable[[list[Flags]], Array | None]) -> Array | None:
        """Count slip from contact onset. Collective.

        Args:
            step: Newton step from the last evaluation, with given constraints of each integration
                side inactive; None if a body is supported by these constraints alone.

        Returns:
            The first step, if no constraint becomes active in it.
        """
        now, closed = 0.0, self._sum(way.num_closed for way in self._with_friction)
        rows = self._sum(int(np.count_nonzero(way.open)) for way in self._with_friction)
        # At most four straight parts, in each of which the active constraints at least double.
        num_parts = 4
        more = max(2.0, (1 + rows / max(closed, 1)) ** (1 / num_parts))
        for part in range(num_parts):
            change = step(self._open())
            if change is None:
                return None
            self._go_on(now, change)
            to, closing, left = self._until((more - 1) * max(closed, 1))
            for way in self._with_friction:
                way.count()
            if left == 0:
                return change if part == 0 and closing == 0 else None
            for way in self._with_friction:
                way.advance(now, to)
            now, closed = to, closed + closing
        return None

    def _open(self) -> list[Flags]:
        rows = zip(self._equations.passes, self._ways, strict=True)
        return [
            np.zeros(p.rows.num_rows, dtype=bool) if way is None else way.open for p, way in rows
        ]

    def _go_on(self, now: float, change: Array) -> None:
        equations = self._equations
        displacements = equations.displacements(change)
        with vectors_of(equations, change) as vecs:
            for way in self._with_friction:
                p, slip = way.p, way.slip
                slave, master = p.bodies
                assert slave is not None
                u = vecs[slave], None if master is None else vecs[master]
                gap = p.gap.state.values[:, 0] + p.gap.change_of(u)[:, 0]
                jump = slip.state.jump - slip.state.start + slip.jump_of(u)
                if p.tool is not None:
                    by_gap, by_jump = equations.driven.changes(p)
                    gap = gap + by_gap[:, 0] * displacements[p.tool]
                    if by_jump is not None:
                        jump = jump + by_jump * displacements[p.tool]
                way.go_on(now, gap, jump)

    def _until(self, many: float) -> tuple[float, int, int]:
        """Time until which a given number of constraints becomes active. Collective.

        Returns:
            Part of the step, the number of onsets until then, and the number later in the step.
        """
        parts = np.concatenate([
            way.closing[way.open & (way.closing < 1)] for way in self._with_friction
        ])  # fmt: skip
        first = self._comm.allreduce(float(parts.min(initial=1.0)), op=MPI.MIN)
        num_times = 64  # that are distinguished
        times = first + (1 - first) * np.arange(1, num_times + 1) / num_times
        by_then = np.array([np.count_nonzero(parts <= time) for time in times], dtype=np.int64)
        self._comm.Allreduce(MPI.IN_PLACE, by_then, op=MPI.SUM)
        i = min(int(np.searchsorted(by_then, many)), num_times - 1)
        return float(times[i]), int(by_then[i]), int(by_then[-1] - by_then[i])

    def _sum(self, counts: typing.Iterable[int]) -> int:
        return int(self._comm.allreduce(int(sum(counts)), op=MPI.SUM))


@contextlib.contextmanager
def vectors_of(equations: Equations, z: Array) -> typing.Iterator[list[PETSc.Vec]]:
    """The bodies' part of the unknowns as vectors."""
    bodies = equations.system.bodies
    vecs = [body.create_vec() for body in bodies]
    for i, vec in enumerate(vecs):
        vec.array[:] = equations.part(z, i)
    try:
        yield vecs
    finally:
        for vec in vecs:
            vec.destroy()
