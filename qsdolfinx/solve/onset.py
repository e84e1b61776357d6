"""When in a step rows close: what friction counts slip from."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.slip import Slip
from qsdolfinx.system.equations import Equations, Pass

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Least part of a step that is left when a row closes: slip rates are slip over that.
LEAST_SHARE = 1e-2


class Onset:
    """Finds for each row that closes in a step when it does so, and how it has moved until then.

    Such a row has no friction before it is closed. The end of the step does not tell when that is:
    its gap is closed, whatever the way was. So the first iteration is made with all rows open that
    were open when the step began: it leads to a gap ḡ_free > 0 and a jump J_free, where bodies
    would have gone without them. On a straight way, rows close after the part

        s = ḡ_0 / (ḡ_0 − ḡ_free)

    of the step, with the jump J_0 + s (J_free − J_0), from which slip counts in all that follows.

    Args:
        equations: The equations, at the last evaluation.

    Attributes:
        open: Rows of each pass that were open when the step began, and have friction.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations = equations
        self.open = [_were_open(p) for p in equations.passes]
        any_ = any(bool(rows.any()) for rows in self.open)
        #: Whether there are any.
        self.counts: bool = equations.system.comm.allreduce(any_, op=MPI.LOR)

    def find(self, change: Array) -> bool:
        """Let slip count from where rows close; whether any does. Collective.

        Args:
            change: Of this rank's unknowns, from the last evaluation to where they end without the
                rows that were open.
        """
        equations, closing = self._equations, False
        displacements = equations.displacements(change)
        with _vectors(equations, change) as vecs:
            for p, rows in zip(equations.passes, self.open, strict=True):
                if p.slip is not None:
                    closing |= self._count(p, p.slip, rows, vecs, displacements)
        return bool(equations.system.comm.allreduce(closing, op=MPI.LOR))

    def _count(
        self, p: Pass, slip: Slip, rows: Flags, vecs: list[PETSc.Vec], displacements: Array
    ) -> bool:
        """The same of one pass, on this rank."""
        slave, master = p.bodies
        assert slave is not None
        u = vecs[slave], None if master is None else vecs[master]
        gap = p.gap.state.values[:, 0]
        before = slip.gap_at_start(gap)
        after = gap + p.gap.change_of(u)[:, 0]
        jump = slip.state.jump - slip.state.start + slip.jump_of(u)
        if p.tool is not None:
            by_gap, by_jump = self._equations.changes(p)
            after = after + by_gap[:, 0] * displacements[p.tool]
            if by_jump is not None:
                jump = jump + by_jump * displacements[p.tool]
        closes = rows & (after > 0)
        part = np.where(rows, 1.0, 0.0)
        part[closes] = -before[closes] / (after - before)[closes]
        share = np.where(rows, np.maximum(1 - part, LEAST_SHARE), 1.0)
        slip.count_from(part[:, None] * jump, share)
        return bool(closes.any())

    def forget(self) -> None:
        """Count slip from the start of the step at all rows."""
        for p in self._equations.passes:
            if p.slip is not None:
                p.slip.count_whole_step()


def _were_open(p: Pass) -> Flags:
    """Rows of a pass that were open at the start of the step. Collective."""
    if p.slip is None:
        return np.zeros(p.rows.num_rows, dtype=bool)
    before = p.slip.gap_at_start(p.gap.state.values[:, 0])
    return np.asarray(p.slip.is_fresh & (before < -p.model.paired.touching))


@contextlib.contextmanager
def _vectors(equations: Equations, z: Array) -> typing.Iterator[list[PETSc.Vec]]:
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
