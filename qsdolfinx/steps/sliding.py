"""How far contacts have slid since they were paired, in a step that is solved."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place
from qsdolfinx.gap.weighted_gap import WeightedGap, handle_of
from qsdolfinx.surface.affine import affine_vec

Array = npt.NDArray[np.float64]

#: Gap, in units of the smallest facet, of what touched where it was paired.
TOUCHING = 0.01


def slid(model: ContactModel) -> float:
    """Largest way along the surface, in facets, that nodes in contact have gone since. Collective.

    Points, normals and weights are those of the pairing: what has slid by much of a facet presses
    where the other surface has been. Nodes that touched there count even if they are open now:
    points of a round surface that turns in place go away from where they were, and others come.
    """
    if model.law.jump:  # a tie keeps its pairs
        return 0.0
    local = max(_slid(model, gap) for gap in model.gaps)
    return float(model.comm.allreduce(local, op=MPI.MAX))


def _slid(model: ContactModel, gap: WeightedGap) -> float:
    touched = (
        gap.operator.initial_gap + gap.state.allowance < TOUCHING * gap.slave.facet_size_range[0]
    )
    closed = np.asarray(
        gap.rows.on_nodes(active_set.closed(model, gap) | touched, False), dtype=bool
    )
    jump = np.asarray(gap.rows.on_nodes(_mean_jump(model, gap), 0.0), dtype=np.float64)
    normal = gap.slave.node_normal[:, : gap.slave.gdim]
    along = jump - np.sum(jump * normal, axis=1)[:, None] * normal
    ways = np.linalg.norm(along, axis=1) / gap.slave.node_size
    return float(np.max(ways[closed], initial=0.0))


def _mean_jump(model: ContactModel, gap: WeightedGap) -> Array:
    """Mean of what the two sides have moved against each other since, at the rows. Collective."""
    operator, placement = gap.jump_operator(), model.placement
    other = placement.master
    vecs = placement.slave.vec(), other.vec() if isinstance(other, Place) else None
    slave, master = model.ordered(gap, vecs)
    assert slave is not None
    jump = operator.apply(slave.handle, handle_of(master))
    if model.tool_motion is not None:
        moved = affine_vec(gap.slave, model.tool_motion)
        jump = jump - operator.apply(moved.handle, 0)
        moved.destroy()
    for vec in (slave, master):
        if vec is not None:
            vec.destroy()
    return np.asarray(jump / operator.slave_sum[:, :1])
