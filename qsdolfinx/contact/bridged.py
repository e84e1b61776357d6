"""Constraints with tiny gaps between active constraints: they count as in contact."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues

Flags = npt.NDArray[np.bool_]

#: Gap over the size of the facets around a node that is below the resolution of the mesh. With
#: more, nodes at the edge of the contact zone would count as in contact.
NARROW = 1e-3

#: State of a node: in contact, perhaps in contact, not in contact.
CLOSED, NARROWLY_OPEN, OPEN = 0.0, 1.0, 2.0


def in_contact(model: ContactModel, gap: WeightedGap) -> Flags:
    """Constraints of an integration side that are in contact. Collective.

    Beside an edge where the pressure is singular, weighted gaps of closed surfaces alternate: the
    constraint beside the edge may be inactive, with a gap that is a small part of the penetration
    of its neighbours. Such a constraint counts as in contact under two conditions. Its gap is less
    than NARROW times its facet size, and it is beside an active constraint. And the same holds for
    all inactive constraints around it: nowhere are they beside an open node for which it does not
    hold.
    """
    closed = active_set.closed(model, gap)
    if not model.has_gaps or gap.rows.are_points:
        return closed
    size = gap.rows.from_nodes(gap.slave.node_size)
    narrow = ~closed & (-gap.state.values[:, 0] <= NARROW * size)
    if not model.comm.allreduce(bool(narrow.any()), op=MPI.LOR):
        return closed
    share, some = (
        np.asarray(gap.rows.on_nodes(flags.astype(np.float64), 0.0), dtype=np.float64)
        for flags in (closed, narrow)
    )
    # At least half of the points of an active node are active.
    state = np.where(share >= 0.5, CLOSED, np.where(some > 0, NARROWLY_OPEN, OPEN))
    inside = between_closed(gap.slave, state)
    return np.asarray(closed | (narrow & (gap.rows.from_nodes(inside) > 1 - SOLVED)))


def like_neighbours(surface: Surface, closed: Flags, flags: Flags, bridged: Flags) -> Flags:
    """Flags of active nodes; at bridged nodes, the flag of most active nodes beside them.

    Collective.

    Args:
        surface: The surface.
        closed: Owned nodes that are active.
        flags: Flags of the active nodes.
        bridged: Owned nodes that are in contact and not active.
    """
    if not surface.comm.allreduce(bool(bridged.any()), op=MPI.LOR):
        return flags
    trace, vec = TraceValues(surface), surface.create_vec()
    own = surface.node_dofs[:, 0] - vec.owner_range[0]
    vertices = surface.num_facet_vertices
    vec.array[own] = np.where(closed, np.where(flags, 1.0, -1.0), 0.0)
    of_facets = trace(vec)[:, :vertices, 0].sum(axis=1)
    vec.set(0.0)
    dofs = surface.trace_dofs[0][:, :vertices, 0].astype(PETSc.IntType)
    vec.setValues(dofs.ravel(), np.repeat(of_facets, vertices), addv=PETSc.InsertMode.ADD)
    vec.assemble()
    most = vec.array_r[own] > 0
    vec.destroy()
    return np.asarray(np.where(bridged, most, flags))


def between_closed(surface: Surface, state: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """1 at the owned nodes that are active or between active nodes, otherwise 0. Collective.

    Args:
        surface: The surface.
        state: State of its owned nodes.
    """
    trace, vec = TraceValues(surface), surface.create_vec()
    own = surface.node_dofs[:, 0] - vec.owner_range[0]
    dofs = surface.trace_dofs[0][:, : surface.num_facet_vertices, 0]
    vec.array[own] = state
    on_facets = trace(vec)[:, : surface.num_facet_vertices, 0]
    beside = (on_facets == NARROWLY_OPEN) & np.any(on_facets == CLOSED, axis=1)[:, None]
    vec.array[own] = np.where(state == NARROWLY_OPEN, OPEN, state)
    _put(vec, dofs[beside], NARROWLY_OPEN)
    while True:
        on_facets = trace(vec)[:, : surface.num_facet_vertices, 0]
        spoiled = (on_facets == NARROWLY_OPEN) & np.any(on_facets == OPEN, axis=1)[:, None]
        if not surface.comm.allreduce(bool(spoiled.any()), op=MPI.LOR):
            break
        _put(vec, dofs[spoiled], OPEN)
    out = np.asarray(vec.array_r[own] < OPEN, dtype=np.float64)
    vec.destroy()
    return out


def _put(vec: PETSc.Vec, dofs: npt.NDArray[np.int64], value: float) -> None:
    """Set entries of a vector, also entries of other ranks. Collective."""
    vec.setValues(dofs.astype(PETSc.IntType), np.full(len(dofs), value))
    vec.assemble()
