"""When in a step rows close: what friction counts slip from."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.solve.newton import Newton
from qsdolfinx.system.blocks import Side

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Times that a step is solved again since rows close at other times than was assumed.
MAX_CORRECTIONS = 3

#: Change of what moves before closing, over the largest way of a closing row, that is none.
SAME = 1e-3

#: Least part of a step that is left when a row closes: slip rates are slip over that.
LEAST_SHARE = 1e-2

#: Iterations to where the bodies would be without the rows that close, and part of the first
#: residual at which they end.
MAX_ITERATIONS, FREE = 6, 1e-6


class Closing(typing.NamedTuple):
    """Rows of a slip that were open when the step began, whether they are closed now or not.

    Attributes:
        contact: The contact.
        side: Its bodies.
        slip: The slip.
        rows: The rows, (rows,).
        at_start: Gaps at the start of the step (length), (rows,).
        gap: Gaps now (length), (rows,).
        jump: Change of the jump in the step so far (length), (rows, gdim).
    """

    contact: ContactModel
    side: Side
    slip: Slip
    rows: Flags
    at_start: Array
    gap: Array
    jump: Array

    @classmethod
    def of(cls, contact: ContactModel, side: Side, slip: Slip) -> Closing:
        """Those of the last evaluation. Collective."""
        gap = slip.at_nodes(slip.of.state.values)[:, 0]
        at_start = slip.gap_at_start(gap)
        rows = slip.is_fresh & (at_start < -contact.paired.touching)
        return cls(contact, side, slip, rows, at_start, gap, slip.state.jump - slip.state.start)


class Closings:
    """Finds for each row that closes in a step when it does so, and how it has moved until then.

    Such a row has no friction before it is closed. The end of the step alone does not tell when
    that is: its gap is closed, whatever the way was. So the rows are opened, at the end of the
    step, all of them: where the bodies are without them, in a gap ḡ_free > 0 and with a jump
    J_free, is where they would have gone on the way they began. On a straight way, rows close
    after the part

        s = ḡ_0 / (ḡ_0 − ḡ_free)

    of the step, with the jump J_0 + s (J_free − J_0), from which slip counts. For linear bodies
    that takes one solution of linear equations, and one more solve of the step.

    Args:
        newton: Has solved for the end of the step.
    """

    def __init__(self, newton: Newton) -> None:
        self._newton, self._system = newton, newton.system
        self._left = MAX_CORRECTIONS if self._system.slips else 0

    def have_changed(self) -> bool:
        """Whether slip is to be counted from other places than in the last solve. Collective."""
        if self._left == 0:
            return False
        self._left -= 1
        parts = zip(self._system.contacts, self._system.sides, strict=True)
        closings = [Closing.of(c, side, slip) for c, side in parts for slip in c.slips]
        if not self._any([c.rows & c.slip.state.closed for c in closings]):
            return False
        change = self._without(closings)
        if change is None:
            return False
        return self._move(closings, change)

    def _any(self, flags: typing.Sequence[Flags]) -> bool:
        local = any(f.any() for f in flags)
        return bool(self._system.comm.allreduce(local, op=MPI.LOR))

    def _without(self, closings: typing.Sequence[Closing]) -> Array | None:
        """How owned unknowns change if the rows open. Collective.

        Returns:
            None where they alone hold a body: nothing tells where that would be.
        """
        system = self._system
        solution = system.x.array_r.copy()
        try:
            with _released(closings):
                change = self._free_motion(solution)
        finally:
            system.residual(solution)
        for slip in system.slips:
            slip.stick_slip.end_iterations()
        return change

    def _free_motion(self, solution: Array) -> Array | None:
        """Newton's method with the rows open. Collective."""
        system, linear = self._system, self._newton.linear
        for slip in system.slips:
            slip.stick_slip.begin_iterations(False)  # the exact tangent
        x, best, first = solution.copy(), None, 0.0
        norm = np.inf
        for i in range(MAX_ITERATIONS):
            residual = system.residual(x)
            last, norm = norm, system.norm(residual)
            if not norm < last:
                break
            best, first = x.copy(), max(first, norm)
            if i > 0 and norm <= FREE * first:
                break
            if system.made.hold.free_motions().shape[1]:
                return None
            linear.assemble()
            change, reason = linear.solve(-residual)
            if reason < 0:
                break
            x = x + change
        moved = best is not None and not np.array_equal(best, solution)
        if best is None or not self._any([np.array([moved])]):  # on all ranks
            return None
        return np.asarray(best - solution)

    def _move(self, closings: typing.Sequence[Closing], change: Array) -> bool:
        """Let slip count from where the rows close; whether that is elsewhere. Collective."""
        vecs = [body.create_vec() for body in self._system.bodies]
        for vec, part in zip(vecs, self._system.parts(change), strict=True):
            vec.array[:] = part
        moved = way = 0.0
        for contact, (s, m), slip, rows, at_start, gap, jump in closings:
            u = contact.ordered(slip.gap, (vecs[s], None if m is None else vecs[m]))
            free_gap = gap + slip.gap.change_of(u)[:, 0]
            free_jump = jump + slip.jump_of(u)
            whole = np.where(rows, at_start - free_gap, 1.0)
            part = np.where(rows & (whole < 0), at_start / whole, 1.0)
            part = np.where(rows, np.clip(part, 0.0, 1.0), 0.0)
            until_closed = part[:, None] * free_jump
            change_of_start = slip.tangential(until_closed - slip.state.until_closed)
            moved = max(moved, _largest(change_of_start[rows]))
            way = max(way, _largest(slip.tangential(free_jump)[rows]))
            slip.count_from(until_closed, np.maximum(1 - part, LEAST_SHARE))
        for vec in vecs:
            vec.destroy()
        comm = self._system.comm
        moved, way = (comm.allreduce(x, op=MPI.MAX) for x in (moved, way))
        return bool(moved > SAME * way)


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


@contextlib.contextmanager
def _released(closings: typing.Sequence[Closing]) -> typing.Iterator[None]:
    """Keep the rows open inside the block. Collective."""
    for closing in closings:
        closing.slip.of.released = _rows_of_pass(closing.slip, closing.rows)
    try:
        yield
    finally:
        for closing in closings:
            closing.slip.of.released = None


def _rows_of_pass(slip: Slip, rows: Flags) -> Flags:
    """The rows of the pass whose multiplier is the pressure: points between such nodes. Collective.

    Points are rows of the pass if friction is at nodes and the pressure is not.
    """
    if slip.of is slip.gap:
        return rows
    at_nodes = np.asarray(slip.gap.rows.on_nodes(rows, False), dtype=np.float64)
    return np.asarray(slip.of.rows.from_nodes(at_nodes) > 0.5)
