"""Vertices that bear alone: no facet beside them, or opposite to them, does."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.weighted_gap import WeightedGap

Flags = npt.NDArray[np.bool_]


def lone_vertices(gap: WeightedGap, all_: typing.Sequence[WeightedGap]) -> Flags | None:
    """Vertices that the last solution leaves to bear alone. Collective.

    A vertex beside a face that is nearly parallel to what is opposite has no point: the facets' own
    see as much, and both would be one constraint twice. But as long as these are open, what the
    vertex bears would find nothing closed in the next solve, and the bodies would spring back.

    Args:
        gap: Of vertices of its slave.
        all_: Those of the contact.

    Returns:
        Sides of owned nodes, (nodes, block); None if the gap is not of such vertices.
    """
    measure, following = gap.state.measure, gap.following
    if following is None or not following.points_are_own:
        return None
    if measure is None or measure.vertices is None:
        return None
    found: Flags = gap.state.augmented > 0
    for other in all_:
        closed = other.state.closed
        if other is gap or closed is None or (other.following and other.following.points_are_own):
            continue
        bears = np.any(closed > 0, axis=1)
        if other.slave is gap.slave:
            found = found & ~bears[:, None]
        elif other.slave is gap.master:
            found = found & ~_opposite(gap, other, bears)[:, None]
    return found


def _opposite(gap: WeightedGap, other: WeightedGap, flags: Flags) -> Flags:
    """Whether vertices are before facets with a node that has a flag, (nodes,). Collective."""
    columns = np.repeat(flags[:, None].astype(np.float64), other.slave.block, axis=1)
    own, there = gap.slave.create_vec(), other.slave.nodal_vec(columns)
    jump = gap.jump_operator().apply(handle_of(own), handle_of(there))
    for vec in (own, there):
        vec.destroy()
    some = np.any(np.abs(np.asarray(jump)) > 0, axis=1)
    return np.asarray(gap.rows.on_nodes(some, False), dtype=bool)
