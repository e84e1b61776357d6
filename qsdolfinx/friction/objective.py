"""Slip between bodies that contact follows: what rigid motions have none of."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.following import Places
from qsdolfinx.gap.weighted_gap import Vecs, WeightedGap

Array = npt.NDArray[np.float64]

#: Change in a step of the covered part of a node's area, over that part, up to which it is the
#: same: curved surfaces cover each other by a little more or less wherever they are.
SAME_COVER = 1e-2


@dataclasses.dataclass(frozen=True)
class PairsAtStart:
    """What was opposite to what when a step began, of gaps that follow the bodies.

    Attributes:
        operator: Of the jump with places on the facets as then.
        area: What its rows are divided by, shape (rows,).
        gap: ḡ then, shape (rows,).
        cover: Part of these areas that was covered, (rows,).
        places: Where everything was, see ``Following``.
        normal: Sum of the slave's normals, (rows, gdim).
        on_tool: Mean place of the points of a rigid tool, (rows, gdim), times that part; and where
            the tool was, see ``RigidSurface.position``. None without.
    """

    operator: _cpp.GapOperator
    area: Array
    gap: Array
    cover: Array
    places: Places
    normal: Array
    on_tool: tuple[Array, Array] | None

    @classmethod
    def of(cls, gap: WeightedGap) -> PairsAtStart:
        """The pairs of the last evaluation. Collective."""
        assert gap.following is not None and gap.cut is not None
        operator, on_tool = gap.jump_operator(), None
        if gap.following.tool is not None:
            on_tool = gap.present_places_of_tool(), gap.cut.places[1]
        return cls(
            operator,
            operator.row_area,
            gap.state.values[:, 0],
            operator.slave_sum[:, 0],
            gap.cut.places,
            gap.operator.slave_sum,
            on_tool,
        )

    def moved_tool(self, position: Array) -> Array:
        """Where the tool's points are when it is there, times the part that was covered."""
        assert self.on_tool is not None
        points, before = self.on_tool
        gdim = points.shape[1]
        turn = position[:, :gdim] @ before[:, :gdim].T
        shift = position[:, gdim] - turn @ before[:, gdim]
        return np.asarray(points @ turn.T + self.cover[:, None] * shift)


def objective_slip(gap: WeightedGap, pairs: PairsAtStart, u: Vecs) -> Array:
    """Slip since the step began, times what is covered of the rows, (rows, gdim). Collective.

    D₀ x_s − M₀ x_m, by the pairs at the start of the step where the bodies are now, less the same
    by the present pairs. Where a node has come into contact since, there are none at the start: the
    present pairs tell from where the bodies were then.

    Args:
        gap: The pass, at the last evaluation.
        pairs: Those at the start of the step.
        u: Unknowns of the slave's and the master's body.
    """
    assert gap.cut is not None
    operator = gap.jump_operator()
    before = gap.jump_of_positions(pairs.operator, u)
    if pairs.on_tool is not None:
        before = before - pairs.moved_tool(gap.cut.places[1])
    now, then = operator.slave_sum[:, 0], pairs.cover
    some = then[:, None] > 0
    mean = np.divide(before, then[:, None], out=np.zeros_like(before), where=some)
    slip = now[:, None] * mean - gap.present_jump()
    known = np.minimum(then * pairs.area / operator.row_area, now)
    part = np.divide(known, now, out=np.zeros_like(now), where=now > 0)
    part[part > 1 - SAME_COVER] = 1.0
    if not gap.slave.comm.allreduce(bool(np.any(part < 1)), op=MPI.LOR):
        return np.asarray(slip)
    came = -_jump_at_start(gap, pairs, operator)
    return np.asarray(part[:, None] * slip + (1 - part[:, None]) * came)


def _jump_at_start(gap: WeightedGap, pairs: PairsAtStart, operator: _cpp.GapOperator) -> Array:
    """Mean of x_slave − x_master by the present pairs where the bodies were. Collective."""
    assert gap.following is not None
    out = gap.following.jump_of_places(operator, pairs.places)
    if pairs.on_tool is not None:
        out = out - PairsAtStart.of(gap).moved_tool(pairs.places[1])
    return out
