"""When in a step rows close: what friction counts slip from."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.slip import Slip
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.passes import Pass

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Least part of a step that is left when a row closes: slip rates are slip over that.
LEAST_SHARE = 1e-2

#: Straight parts of a way at most, by how much more rows are closed at the end of each at least,
#: and how many times of closing are told apart.
MAX_PARTS, MORE, NUM_TIMES = 4, 2.0, 64

#: Way (facets) in a step of points that follow the bodies, up to which it is told when they close:
#: beyond it the energy of what slides by facets would lack (``tests/sliding/test_points.py``).
NEAR = 0.5


class _Way:
    """The way of the rows of a pass through a step, and when those close that were open.

    Args:
        p: The pass.
        slip: Its slip, at the last evaluation.

    Attributes:
        open: Rows that were open when the step began and are not closed yet on the way so far.
        closing: Part of the step after which they close, at most 1; 0 of others.
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
        """Rows on this rank that were closed when the step began."""
        return int(np.count_nonzero(self.slip.state.closed & ~self._began_open))

    def go_on(self, now: float, gap: Array, jump: Array) -> None:
        """Let the way lead straight from where it is.

        Args:
            now: Part of the step that is behind.
            gap: At its end without rows that are open (length).
            jump: Change of the jump in the step until then (length).
        """
        self._to_gap, self._to_jump = gap, jump
        if self.p.gap.following is not None:
            # Further on it slides to what has been in contact with others, for all of the step.
            near = np.linalg.norm(jump, axis=1) < NEAR * self.p.gap.slave.facet_size_range[1]
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
        """Go on to a part of the step: what closes until then is closed."""
        part = (to - now) / (1 - now)
        self._gap = self._gap + part * (self._to_gap - self._gap)
        self._jump = self._jump + part * (self._to_jump - self._jump)
        self.open = self.open & (self.closing > to)

    def count(self) -> None:
        """Let slip count from where rows close on this way, and that of others from its end."""
        share = np.where(self._began_open, np.maximum(1 - self.closing, LEAST_SHARE), 1.0)
        until = np.where(self._began_open[:, None], self._until, 0.0)
        self.slip.count_from(until, share, ~self._began_open | (self.closing < 1))


class Onset:
    """Finds for each row that closes in a step when it does so, and how it has moved until then.

    Such a row has no friction before it is closed. The end of the step does not tell when that is:
    its gap is closed, whatever the way was. So a Newton's step is made with all rows open that were
    open when the step began: it leads to a gap ḡ_free > 0 and a jump J_free, where bodies would
    have gone without them. On a straight way, rows close after the part

        s = ḡ_0 / (ḡ_0 − ḡ_free)

    of the step, with the jump J_0 + s (J_free − J_0), from which slip counts in all that follows.
    Each row that closes bends the way of the others. So it is straight only until twice as many
    rows are closed as at its beginning; from there on it leads to where bodies are with those
    closed, and so on. Where rows that close alone hold a body, nothing tells where it was going,
    and slip counts from the start of the step.

    Args:
        equations: The equations, at the last evaluation.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations, self._comm = equations, equations.system.comm
        self._ways = [None if p.slip is None else _Way(p, p.slip) for p in equations.passes]
        found = any(bool(way.open.any()) for way in self._with_friction)
        #: Whether there are rows that were open.
        self.counts: bool = self._comm.allreduce(found, op=MPI.LOR)

    @property
    def _with_friction(self) -> list[_Way]:
        return [way for way in self._ways if way is not None]

    def find(self, step: typing.Callable[[list[Flags]], Array | None]) -> Array | None:
        """Let slip count from where rows close. Collective.

        Args:
            step: Newton's step with given rows of each pass open, from the last evaluation; None
                where they alone hold a body.

        Returns:
            The first step, if no row closes on it.
        """
        now, closed = 0.0, self._sum(way.num_closed for way in self._with_friction)
        rows = self._sum(int(np.count_nonzero(way.open)) for way in self._with_friction)
        more = max(MORE, (1 + rows / max(closed, 1)) ** (1 / MAX_PARTS))
        for part in range(MAX_PARTS):
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
        """Until when a number of rows has closed. Collective.

        Returns:
            Part of the step, how many rows close until then, and how many later in the step.
        """
        parts = np.concatenate([
            way.closing[way.open & (way.closing < 1)] for way in self._with_friction
        ])  # fmt: skip
        first = self._comm.allreduce(float(parts.min(initial=1.0)), op=MPI.MIN)
        times = first + (1 - first) * np.arange(1, NUM_TIMES + 1) / NUM_TIMES
        by_then = np.array([np.count_nonzero(parts <= time) for time in times], dtype=np.int64)
        self._comm.Allreduce(MPI.IN_PLACE, by_then, op=MPI.SUM)
        i = min(int(np.searchsorted(by_then, many)), NUM_TIMES - 1)
        return float(times[i]), int(by_then[i]), int(by_then[-1] - by_then[i])

    def _sum(self, counts: typing.Iterable[int]) -> int:
        return int(self._comm.allreduce(int(sum(counts)), op=MPI.SUM))


@contextlib.contextmanager
def vectors_of(equations: Equations, z: Array) -> typing.Iterator[list[PETSc.Vec]]:
    """The bodies' part of unknowns as vectors."""
    bodies = equations.system.bodies
    vecs = [body.create_vec() for body in bodies]
    for i, vec in enumerate(vecs):
        vec.array[:] = equations.part(z, i)
    try:
        yield vecs
    finally:
        for vec in vecs:
            vec.destroy()
