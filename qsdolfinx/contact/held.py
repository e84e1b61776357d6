"""Multipliers of directions that Dirichlet conditions hold on both sides of a contact."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.weighted_gap import WeightedGap, handle_of
from qsdolfinx.pairing.pair import Sampling, pair
from qsdolfinx.tools.rigid_surface import as_tool

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Part of the master's unknowns at a slave node's partner that conditions hold: less than 1 beside
#: the plane that both end in, where a curved slave's normal leads away from it.
MOST = 0.9

#: Component of a normal that is none but for rounding.
_ALONG = 1e-8


def find(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Tell all parts which of their multipliers' components conditions hold. Collective.

    At such a node, as where a plane of symmetry crosses the contact, the bodies cannot be moved
    against each other: what a multiplier would have to close there are the gaps of its neighbours,
    which have multipliers of their own. One too many for the unknowns that are left, it would be
    determined badly or not at all.

    Args:
        model: The contact.
        slave: Nonzero at the unknowns of the slave's body that have Dirichlet conditions.
        master: The same of the master's.
    """
    for i, gap in enumerate(model.gaps):
        held = _held_on_both_sides(model, gap, *model.ordered(gap, (slave, master)))
        pressed = _along_normal(gap, held)
        clamped = held & pressed
        of_gap = (held, clamped) if gap.law.jump else (pressed, pressed)
        gap.extension = _extension(model, gap, *of_gap)
        if model.slips:
            model.slips[i].hold(_extension(model, gap, held, clamped))


def _extension(
    model: ContactModel, gap: WeightedGap, held: Flags, clamped: Flags
) -> Extension | None:
    """None if nothing is to be done on any rank. Collective."""
    if not model.augmented:
        held, clamped = held & ~clamped, np.zeros_like(held)
    if not model.comm.allreduce(bool(np.any(held)), op=MPI.LOR):
        return None
    return Extension(gap.slave, gap.row_node, held, clamped)


def _held_on_both_sides(
    model: ContactModel, gap: WeightedGap, slave: PETSc.Vec, master: PETSc.Vec | None
) -> Flags:
    """Components of the slave's node and its partner that are held, shape (rows, gdim)."""
    own = slave.array_r[gap.slave.node_dofs - slave.owner_range[0]] != 0
    tool = as_tool(gap.master)
    driven = tool is not None and tool.driven is not None
    if driven or not model.comm.allreduce(bool(np.any(own)), op=MPI.LOR):
        return np.zeros((len(gap.row_node), gap.slave.gdim), dtype=bool)
    if tool is None:
        assert master is not None
        own &= _held_partner(model, gap, master)
    return own[gap.row_node]


def _held_partner(model: ContactModel, gap: WeightedGap, master: PETSc.Vec) -> Flags:
    """Components that are held where the slave's nodes are projected, shape (nodes, gdim)."""
    sampling = Sampling("nodal", 1, model.settings.sampling.normals)
    points = pair(gap.slave, gap.master, sampling, False, model.paired.search_radius)
    surfaces = gap.slave.cpp_object, gap.master.cpp_object
    partner = _cpp.GapOperator(*surfaces, points, jump=True, by_cover=True)
    none = gap.slave.create_vec()
    part = -partner.apply(none.handle, handle_of(master))
    # Where a node's normal misses the master: as it is beside the node.
    whole = gap.jump_operator()
    out = np.zeros((len(gap.slave.node_area), gap.slave.gdim), dtype=bool)
    out[gap.row_node] = -whole.apply(none.handle, handle_of(master)) > _ALONG
    out[partner.row_node] = part > MOST
    none.destroy()
    return out


def _along_normal(gap: WeightedGap, held: Flags) -> Flags:
    """Rows along whose node's normal there is no free component, shape (rows, 1)."""
    normal = gap.slave.node_normal[gap.row_node, : gap.slave.gdim]
    return np.asarray(np.all(held | (np.abs(normal) <= _ALONG), axis=1, keepdims=True))
