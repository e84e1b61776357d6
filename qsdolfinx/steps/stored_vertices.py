"""Store vertices with points of their own in a checkpoint, for any partition.

Vertices of bodies have areas, which stay as they were when the vertices were chosen, at the slave's
nodes. Vertices of a tool have keys, and multipliers of their own.
"""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.memory import OfNodes
from qsdolfinx.contact.model import ContactModel, Part
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.own_rows import OfVertices
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.steps.checkpoint import Checkpoint

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def areas_of_vertices(model: ContactModel) -> list[OfNodes]:
    """Areas of vertices of bodies that have points, (nodes, block), for each gap that has some.

    Vertices that bear keep their points and areas in the next step: those that would be chosen at
    the end of the run may be others.
    """
    return [
        OfNodes(
            f"vertices_{j}",
            gap.slave,
            functools.partial(_areas, gap),
            functools.partial(_set_areas, model, gap),
        )
        for j, gap in enumerate(model.gaps)
        if gap.state.vertices is not None and gap.own is None
    ]


def _areas(gap: WeightedGap) -> Array:
    assert gap.state.vertices is not None
    return gap.state.vertices


def _set_areas(model: ContactModel, gap: WeightedGap, areas: Array) -> None:
    """Use other vertices and areas, at the same positions. Collective."""
    assert gap.following is not None and gap.cut is not None
    gap.state.vertices = areas
    gap.show(gap.following.cut(gap.cut.places, areas))
    for slip in model.slips:
        if slip.gap is gap:
            slip.take_operator()


def parts_at_vertices(model: ContactModel) -> list[tuple[int, Part, WeightedGap]]:
    """Parts whose multipliers belong to vertices of a tool: number, part and its gap."""
    gaps = [part.gap if isinstance(part, Slip) else part for part in model.parts]
    parts = zip(model.parts, gaps, strict=True)
    return [(j, part, gap) for j, (part, gap) in enumerate(parts) if gap.own is not None]


def stored_vertices(part: Part, gap: WeightedGap) -> tuple[Indices, Array]:
    """Keys of vertices with multipliers, these, and whether vertices have points."""
    own, known, chosen = gap.own, part.state.of_vertices, gap.state.vertices
    assert own is not None and chosen is not None
    width = part.gap.slave.gdim if isinstance(part, Slip) else 1
    values = np.zeros((own.num_multipliers, width)) if known is None else known.at(own)
    return _keys(gap), np.column_stack([values, chosen[own.vertex, 0] > 0])


def load_vertices(part: Part, gap: WeightedGap, checkpoint: Checkpoint, name: str) -> None:
    """Load what :func:`stored_vertices` has stored. Collective.

    Args:
        part: The part; nodes already have their multipliers.
        gap: Its gap.
        checkpoint: The checkpoint.
        name: Name of the stored vertices.
    """
    own, keys = gap.own, _keys(gap)
    points = checkpoint.points(name)
    if points is None:
        return
    found = points.find(keys)
    assert own is not None and gap.state.vertices is not None
    at = [np.flatnonzero(np.all(found[0] == key, axis=1))[0] for key in keys]
    values = found[1][np.array(at, dtype=np.int64)]
    part.state.of_vertices = OfVertices(part.state.augmented, own.vertex, values[:, :-1])
    if part is gap:
        vertices = np.zeros_like(gap.state.vertices)
        vertices[own.vertex, 0] = values[:, -1] * own.from_rows(own.area)
        gap.state.vertices = vertices


def _keys(gap: WeightedGap) -> Indices:
    """Keys of the vertices that have multipliers: bits of initial coordinates, (multipliers, 3)."""
    (tool,), own = gap.master.tools, gap.own
    assert own is not None
    x = tool.as_facets(gap.slave.axisymmetric).initial_vertices(own.vertex)
    return np.ascontiguousarray(x).view(np.int64)
