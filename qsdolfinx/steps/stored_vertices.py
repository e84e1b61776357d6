"""Store the multipliers of a tool's vertices in a checkpoint, with keys for any partition."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel, Part
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.own_rows import OfVertices
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.steps.checkpoint import Checkpoint

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


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
    found = checkpoint.points(name, keys)
    if found is None:
        return
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
    unknowns = tool.as_facets(gap.slave.axisymmetric).node_dofs[own.vertex, 0]
    return np.ascontiguousarray(tool.initial_vertices(unknowns)).view(np.int64)
