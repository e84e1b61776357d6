"""Rows that are open between closed ones by less than a mesh can tell: they are in contact too."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.trace import TraceValues

Flags = npt.NDArray[np.bool_]

#: Gap over the size of the facets around a node that no mesh of this size can tell from none.
NARROW = 1e-3

#: Part of a node's points that have to be closed before others of them may be bridged.
MOST = 0.5

#: What is known of a node: in contact, perhaps, not.
CLOSED, NARROWLY_OPEN, OPEN = 0.0, 1.0, 2.0


def in_contact(model: ContactModel, gap: WeightedGap) -> Flags:
    """Rows of a pass that are in contact. Collective.

    Beside an edge where the pressure is singular, weighted gaps of closed surfaces take turns: the
    row beside the edge may be open by a small part of the penetration of its neighbours. A row is
    in contact all the same if it is open by less than NARROW times its facets, beside a closed one,
    and if so are all that are open around it: nowhere do they meet an open node that is not.
    """
    closed = active_set.closed(model, gap)
    if model.law.linear or model.is_scalar or gap.rows.are_points:
        return closed
    size = gap.rows.from_nodes(gap.slave.node_size)
    narrow = ~closed & (-gap.state.values[:, 0] <= NARROW * size)
    if not model.comm.allreduce(bool(narrow.any()), op=MPI.LOR):
        return closed
    share, some = (
        np.asarray(gap.rows.on_nodes(flags.astype(np.float64), 0.0), dtype=np.float64)
        for flags in (closed, narrow)
    )
    state = np.where(share >= MOST, CLOSED, np.where(some > 0, NARROWLY_OPEN, OPEN))
    inside = between_closed(gap.slave, state)
    return np.asarray(closed | (narrow & (gap.rows.from_nodes(inside) > 1 - 1e-6)))


def like_neighbours(surface: Surface, closed: Flags, flags: Flags, bridged: Flags) -> Flags:
    """Flags of closed nodes, and at bridged ones what most closed nodes beside them have.

    Collective.

    Args:
        surface: The surface.
        closed: Owned nodes that are closed.
        flags: Of these.
        bridged: Owned nodes that are in contact and not closed.
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
    """1 at the owned nodes that are closed or between closed ones, else 0. Collective.

    Args:
        surface: The surface.
        state: Of its owned nodes.
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
    """Set entries, of other ranks too. Collective."""
    vec.setValues(dofs.astype(PETSc.IntType), np.full(len(dofs), value))
    vec.assemble()
