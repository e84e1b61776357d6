"""When in a step rows close: what friction counts slip from."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import NO_PRESSURE, Slip
from qsdolfinx.gap.following import NoGapError
from qsdolfinx.linear.krylov import SAFETY
from qsdolfinx.solve.curvature import WITH_CURVATURE
from qsdolfinx.solve.newton import Newton
from qsdolfinx.system.blocks import Side

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Bodies: typing.TypeAlias = list[PETSc.Vec]

#: Times that a step is solved again since rows close at other times than was assumed.
MAX_CORRECTIONS = 3

#: Change of what moves before closing, over the largest way of a closing row, that is none.
SAME = 1e-3

#: Least part of a step that is left when a row closes: slip rates are slip over that.
LEAST_SHARE = 1e-2

#: Iterations to where the bodies would be without the rows that close, and part of the first
#: residual at which they end.
MAX_ITERATIONS, FREE = 8, 1e-8

#: Part of the last residual that the next is below, or they end: where states take turns, the two
#: residuals may be the same but for rounding, which must not decide.
FALLS = 1 - 1e-6

#: Relative tolerance of a linear solve on the way there.
ENOUGH = 1e-7

#: Straight parts of a way at most, by how much more rows are closed at the end of each at least,
#: and how many times of closing are told apart.
MAX_PARTS, MORE, NUM_TIMES = 4, 2.0, 64


class Way:
    """The way of the rows of a slip through a step, and when those close that were open.

    Where friction is at nodes and the pressure at points, rows of the pass are points: a node
    closes with the mean of those of its points that close.

    Args:
        contact: The contact.
        side: Its bodies.
        slip: The slip, at the last evaluation.

    Attributes:
        rows: Rows of the slip that had no pressure when the step began, (rows,).
        open: Rows of the pass that were open when it began and are not closed yet on the way so
            far, (rows of the pass,).
        closing: Part of the step after which they close, at most 1; 0 of others.
        part: The same of the rows of the slip, (rows,).
        until_closed: Change of the jump until then (length), (rows, gdim).
    """

    def __init__(self, contact: ContactModel, side: Side, slip: Slip) -> None:
        self._contact, self._side, self.slip = contact, side, slip
        self._end_gap = slip.of.state.values[:, 0]
        self._end_jump = slip.state.jump - slip.state.start
        self._gap = slip.gap_at_start(self._end_gap)
        self._jump = np.zeros_like(self._end_jump)
        self._before = slip.state.until_closed, slip.state.share
        was_open = self._gap < -contact.paired.touching
        self.open: Flags = _of_pass(slip, slip.is_fresh) & was_open
        self.rows: Flags = slip.is_fresh & slip.at_nodes(self.open)
        self.closing: Array = self.open.astype(np.float64)
        self.part: Array = self.rows.astype(np.float64)
        self.until_closed: Array = np.zeros_like(self._jump)
        #: Largest way along the surface of a row that closes, on this rank (length).
        self.length = 0.0

    def num_closed_at_start(self) -> int:
        """Rows of the pass on this rank that are closed from the start on."""
        closed = _of_pass(self.slip, self.slip.state.closed & ~self.rows)
        return int(np.count_nonzero(closed))

    def go_on(self, now: float, change: Bodies) -> None:
        """Let the way lead straight from where it is to where open rows would end. Collective.

        Args:
            now: Part of the step that is behind.
            change: Of the bodies' unknowns, from those of the last evaluation to there.
        """
        s, m = self._side
        slip = self.slip
        u = self._contact.ordered(slip.gap, (change[s], None if m is None else change[m]))
        self._to_gap = self._end_gap + slip.of.change_of(u)[:, 0]
        self._to_jump = self._end_jump + slip.jump_of(u)
        closes = self.open & (self._to_gap > self._gap)
        coming = np.where(closes, self._to_gap - self._gap, 1.0)
        part = np.clip(np.where(closes, -self._gap / coming, 1.0), 0.0, 1.0)
        self.closing = np.where(self.open, now + (1 - now) * part, self.closing)
        part_of_rows = self._means_of_closing()
        ahead = self.rows & (part_of_rows >= now)
        self.part = np.where(ahead, part_of_rows, self.part)
        along = ((part_of_rows - now) / (1 - now))[:, None]
        reached = self._jump + along * (self._to_jump - self._jump)
        self.until_closed = np.where(ahead[:, None], reached, self.until_closed)
        self.length = max(self.length, _largest(slip.tangential(self._to_jump)[self.rows]))

    def _means_of_closing(self) -> Array:
        """When rows of the slip close, means of their points that do; 1 of those that do not."""
        slip = self.slip
        if slip.of is slip.gap:
            return self.closing
        closes = ((self.closing < 1) & (self.closing > 0)).astype(np.float64)
        share, part = slip.at_nodes(closes), slip.at_nodes(closes * self.closing)
        return np.divide(part, share, out=np.ones_like(share), where=share > 0)

    def advance(self, now: float, to: float) -> None:
        """Go on to a part of the step: what closes until then is closed."""
        part = (to - now) / (1 - now)
        self._gap = self._gap + part * (self._to_gap - self._gap)
        self._jump = self._jump + part * (self._to_jump - self._jump)
        self.open = self.open & (self.closing > to)

    def count(self) -> None:
        """Let slip count from where the rows close on this way."""
        self.slip.count_from(self.until_closed, np.maximum(1 - self.part, LEAST_SHARE))

    def count_as_before(self) -> None:
        """Let slip count from where it did in the last solve."""
        self.slip.count_from(*self._before)

    def moved(self) -> float:
        """Largest change on this rank of where slip counts from, since the last solve (length)."""
        return _largest(self.slip.tangential(self.until_closed - self._before[0])[self.rows])


class Closings:
    """Finds for each row that closes in a step when it does so, and how it has moved until then.

    Such a row has no friction before it is closed. The end of the step alone does not tell when
    that is: its gap is closed, whatever the way was. So the rows are opened, at the end of the
    step, all of them: where the bodies are without them, in a gap ḡ_free > 0 and with a jump
    J_free, is where they would have gone on the way they began. On a straight way, rows close
    after the part

        s = ḡ_0 / (ḡ_0 − ḡ_free)

    of the step, with the jump J_0 + s (J_free − J_0), from which slip counts. Each row that closes
    bends the way of the others. So it is straight only until twice as many rows are closed as at
    its beginning; from there on the bodies go to where they are without the rows still open, and
    so on. For linear bodies each part takes one solution of linear equations, and all of them one
    more solve of the step.

    Args:
        newton: Has solved for the end of the step.
    """

    def __init__(self, newton: Newton) -> None:
        self._newton, self._system = newton, newton.system
        self._left = MAX_CORRECTIONS if self._system.slips else 0
        self._ends: dict[int, Array] = {}  # of the parts of the last way

    def have_changed(self) -> bool:
        """Whether slip is to be counted from other places than in the last solve. Collective."""
        if self._left == 0:
            return False
        self._left -= 1
        parts = zip(self._system.contacts, self._system.sides, strict=True)
        ways = [Way(c, side, slip) for c, side in parts for slip in c.slips]
        if not self._any(self._pressed(ways)):
            return False
        solution = self._system.x.array_r.copy()
        try:
            found = self._find(ways, solution)
        finally:
            for way in ways:
                way.count_as_before()
            self._system.residual(solution)
        if not found or not self._differ(ways):
            return False
        for way in ways:
            way.count()
        return True

    def _pressed(self, ways: typing.Sequence[Way]) -> list[Flags]:
        """Rows that have closed, if they have a pressure to speak of. Collective."""
        largest = max(float(way.slip.state.pressure.max(initial=0.0)) for way in ways)
        least = NO_PRESSURE * self._system.comm.allreduce(largest, op=MPI.MAX)
        states = [(way.rows, way.slip.state) for way in ways]
        return [rows & state.closed & (state.pressure > least) for rows, state in states]

    def _find(self, ways: typing.Sequence[Way], solution: Array) -> bool:
        """Follow the ways to the end of the step; whether there are any. Collective.

        There are none where the rows alone hold a body: nothing tells where that would be.
        """
        now, closed = 0.0, self._sum(way.num_closed_at_start() for way in ways)
        rows = self._sum(np.count_nonzero(way.open) for way in ways)
        more = max(MORE, (1 + rows / max(closed, 1)) ** (1 / MAX_PARTS))
        for part in range(MAX_PARTS):
            change = self._without(ways, solution, part)
            if change is None:
                break
            with self._bodies(change) as bodies:
                for way in ways:
                    way.go_on(now, bodies)
            to, closing, left = self._until(ways, (more - 1) * max(closed, 1))
            if left == 0:
                return True
            for way in ways:
                way.advance(now, to)
                way.count()
            now, closed = to, closed + closing
        return now > 0

    def _until(self, ways: typing.Sequence[Way], many: float) -> tuple[float, int, int]:
        """Until when a number of rows has closed. Collective.

        Returns:
            Part of the step, how many rows close until then, and how many later in the step.
        """
        parts = np.concatenate([way.closing[way.open & (way.closing < 1)] for way in ways])
        first = self._system.comm.allreduce(float(parts.min(initial=1.0)), op=MPI.MIN)
        times = first + (1 - first) * np.arange(1, NUM_TIMES + 1) / NUM_TIMES
        by_then = np.array([np.count_nonzero(parts <= time) for time in times], dtype=np.int64)
        self._system.comm.Allreduce(MPI.IN_PLACE, by_then, op=MPI.SUM)
        i = min(int(np.searchsorted(by_then, many)), NUM_TIMES - 1)
        return float(times[i]), int(by_then[i]), int(by_then[-1] - by_then[i])

    @contextlib.contextmanager
    def _bodies(self, change: Array) -> typing.Iterator[Bodies]:
        """Owned unknowns of the system as vectors of its bodies."""
        vecs = [body.create_vec() for body in self._system.bodies]
        for vec, part in zip(vecs, self._system.parts(change), strict=True):
            vec.array[:] = part
        try:
            yield vecs
        finally:
            for vec in vecs:
                vec.destroy()

    def _sum(self, counts: typing.Iterable[int | np.intp]) -> int:
        return int(self._system.comm.allreduce(int(sum(counts)), op=MPI.SUM))

    def _any(self, flags: typing.Sequence[Flags]) -> bool:
        local = any(f.any() for f in flags)
        return bool(self._system.comm.allreduce(local, op=MPI.LOR))

    def _differ(self, ways: typing.Sequence[Way]) -> bool:
        local = [max(way.moved() for way in ways), max(way.length for way in ways)]
        moved, length = (self._system.comm.allreduce(x, op=MPI.MAX) for x in local)
        return bool(moved > SAME * length)

    def _without(self, ways: typing.Sequence[Way], solution: Array, part: int) -> Array | None:
        """How owned unknowns change if the rows that are open on their ways open. Collective.

        Returns:
            None where they alone hold a body.
        """
        try:
            with _released(ways):
                end = self._free_motion(solution, self._ends.pop(part, None))
        except NoGapError:  # on all ranks: without these rows bodies go too far
            return None
        finally:
            self._system.set_curvature(True)
            for slip in self._system.slips:
                slip.stick_slip.end_iterations()
        if end is None:
            return None
        self._ends[part] = end
        return np.asarray(end - solution)

    def _free_motion(self, solution: Array, guess: Array | None) -> Array | None:
        """Where Newton's method ends with the rows open. Collective.

        What sticks and what slips at the end of the step may be another state than the one which
        the way leads to: it is from stick that closed rows set out.

        Args:
            solution: With the rows as they are.
            guess: Where it ended the last time, if there was one: taken where it is nearer.
        """
        system, linear = self._system, self._newton.linear
        x, first = solution.copy(), system.norm(self._residual(solution))
        from_guess = guess is not None and system.norm(self._residual(guess)) < first
        if from_guess and guess is not None:
            x = guess.copy()
        best, norm = None, np.inf
        for i in range(MAX_ITERATIONS):
            residual = self._residual(x, from_stick=i == 0 and not from_guess)
            last, norm = norm, system.norm(residual)
            if i > 1 and not norm < FALLS * last:
                break
            best = x.copy()
            if norm <= FREE * first and (i > 0 or from_guess):
                break
            if system.made.hold.free_motions().shape[1]:
                return None
            system.set_curvature(norm <= WITH_CURVATURE * first)
            self._newton.assemble()
            change, reason = linear.solve(-residual, _tolerance(norm, FREE * first))
            if reason < 0:
                break
            x = x + change
        moved = best is not None and not np.array_equal(best, solution)
        return best if self._any([np.array([moved])]) else None  # on all ranks

    def _residual(self, x: Array, from_stick: bool = False) -> Array:
        for slip in self._system.slips:  # the exact tangent
            slip.stick_slip.begin_iterations(False, from_stick=from_stick)
        return self._system.residual(x)


def _tolerance(norm: float, until: float) -> float:
    """Of a linear solve, after which Newton's method may find nothing better."""
    return max(SAFETY * until / norm if norm > 0 else 1.0, ENOUGH)


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


@contextlib.contextmanager
def _released(ways: typing.Sequence[Way]) -> typing.Iterator[None]:
    """Keep the rows that are open on their ways open inside the block. Collective."""
    for way in ways:
        way.slip.of.released = way.open
    try:
        yield
    finally:
        for way in ways:
            way.slip.of.released = None


def _of_pass(slip: Slip, rows: Flags) -> Flags:
    """The rows of the pass whose multiplier is the pressure: points between such nodes. Collective.

    Points are rows of the pass if friction is at nodes and the pressure is not.
    """
    if slip.of is slip.gap:
        return rows
    at_nodes = np.asarray(slip.gap.rows.on_nodes(rows, False), dtype=np.float64)
    return np.asarray(slip.of.rows.from_nodes(at_nodes) > 0.5)
