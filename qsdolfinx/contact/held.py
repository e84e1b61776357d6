"""Contact nodes that Dirichlet conditions hold on both sides: what multipliers are for them."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.model import ContactModel, HeldNodes
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.weighted_gap import WeightedGap, handle_of
from qsdolfinx.pairing.pair import Sampling, pair
from qsdolfinx.tools.rigid_surface import as_tool

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Part of the master's unknowns at a slave node's partner that conditions hold: less than 1 beside
#: the plane that both end in, where a curved slave's normal leads away from it.
MOST = 0.9

#: Gap over the smallest facet that conditions leave at held nodes by how meshes approximate what
#: is the same on both sides.
MEANT = 0.01

#: Component of a normal, or part of a marker, that is none but for rounding.
_NONE = 1e-8


def find(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Tell all passes and slips what conditions hold of their nodes. Collective.

    Where conditions hold a node and its partner, as where a plane of symmetry crosses the contact,
    these cannot be moved against each other. What a multiplier could close there are the gaps of
    the nodes around, which have multipliers of their own: one too many for the unknowns that are
    left, it would lock them or be determined by nothing.

    Args:
        model: The contact.
        slave: Nonzero at the unknowns of the slave's body that have Dirichlet conditions.
        master: The same of the master's.
    """
    model.held_nodes = []
    for i, gap in enumerate(model.gaps):
        # Points between the nodes have rows of their own; edges' unknowns have no projections.
        if gap.rows.are_points or max(gap.slave.degree, gap.master.degree) > 1:
            continue
        held = _held_on_both_sides(model, gap, *model.ordered(gap, (slave, master)))
        pressed = _along_normal(gap, held)
        clamped = held & pressed
        of_gap = (held, clamped) if gap.law.jump else (pressed, pressed)
        gap.extension = _extension(model, gap, *of_gap)
        if model.slips:
            model.slips[i].extension = _extension(model, gap, held, clamped)


def _extension(
    model: ContactModel, gap: WeightedGap, held: Flags, clamped: Flags
) -> Extension | None:
    """None if nothing is to be done on any rank. Collective."""
    if not model.augmented:  # a clamped node's penalty does not grow
        held, clamped = held & ~clamped, np.zeros_like(held)
    if not model.comm.allreduce(bool(np.any(held)), op=MPI.LOR):
        return None
    return Extension(gap.slave, gap.operator.row_node, held, clamped)


def _held_on_both_sides(
    model: ContactModel, gap: WeightedGap, slave: PETSc.Vec, master: PETSc.Vec | None
) -> Flags:
    """Components of the slave's node and its partner that are held, shape (rows, gdim)."""
    own = slave.array_r[gap.slave.node_dofs - slave.owner_range[0]] != 0
    tool = as_tool(gap.master)
    driven = tool is not None and tool.driven is not None
    if driven or not model.comm.allreduce(bool(np.any(own)), op=MPI.LOR):
        return np.zeros((len(gap.operator.row_node), gap.slave.gdim), dtype=bool)
    at_nodes = _at_nodes(model, gap)
    if tool is None:
        own &= _held_partner(gap, at_nodes, master)
    held = np.zeros_like(own)
    held[gap.operator.row_node] = own[gap.operator.row_node]
    at = held[at_nodes.operator.row_node]
    components = at if gap.law.jump else _along_normal(at_nodes, at)
    model.held_nodes.append(HeldNodes(gap, at_nodes, components))
    return held[gap.operator.row_node]


def _at_nodes(model: ContactModel, gap: WeightedGap) -> WeightedGap:
    """The pass as it were with each node against its projection alone. Collective."""
    sampling = Sampling("nodal", 1, model.settings.sampling.normals, "none")
    points = pair(gap.slave, gap.master, sampling, False, model.paired.search_radius)
    return WeightedGap(gap.slave, gap.master, points, gap.law, 1.0, rows="cover", augmented=False)


def _held_partner(gap: WeightedGap, at_nodes: WeightedGap, master: PETSc.Vec | None) -> Flags:
    """Components that are held where the slave's nodes are projected, shape (nodes, gdim)."""
    out = np.zeros((len(gap.slave.node_area), gap.slave.gdim), dtype=bool)
    none = gap.slave.create_vec()
    # Where a node's normal leads past the master: whether any of it is held beside the node.
    for p, part in ((gap, _NONE), (at_nodes, MOST)):
        out[p.operator.row_node] = -p.jump_operator().apply(none.handle, handle_of(master)) > part
    none.destroy()
    return out


def _along_normal(gap: WeightedGap, held: Flags) -> Flags:
    """Rows along whose node's normal there is no free component, shape (rows, 1)."""
    normal = gap.slave.node_normal[gap.operator.row_node, : gap.slave.gdim]
    return np.asarray(np.all(held | (np.abs(normal) <= _NONE), axis=1, keepdims=True))


def check_held(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Warn if conditions press held nodes into each other, or tear ties apart. Collective.

    Once for each contact.

    Args:
        model: The contact, solved.
        slave: Unknowns of the slave's body as contact sees them.
        master: The same of the master's.
    """
    here = [h for h in model.held_nodes if h.gap in model.gaps]
    if model.held_warned or not here:
        return
    local = max(_prescribed_gap(model, h, (slave, master)) for h in here)
    depth = float(model.comm.allreduce(local, op=MPI.MAX))
    if depth <= MEANT * model.paired.facet_size:
        return
    model.held_warned = True
    what = (
        "move tied nodes apart"
        if model.law.jump
        else "press contact nodes that they hold on both sides into each other"
    )
    warn(
        f"bcs: Dirichlet conditions {what} by {depth:.3g}, which contact cannot change: its force "
        "at these nodes means nothing; prescribe the same on both sides, hold one of them alone, "
        "or leave these nodes out of the contact surfaces",
        ContactWarning,
    )


def _prescribed_gap(
    model: ContactModel, held: HeldNodes, u: tuple[PETSc.Vec, PETSc.Vec | None]
) -> float:
    """Largest gap (length) of held nodes on this rank. Collective."""
    p, motion = held.at_nodes, held.gap.master.motion
    p.state.scale = held.gap.state.scale
    if motion is not None:
        p.state.shift = p.change(motion)
    if model.offset is not None:
        first, second = model.ordered(held.gap, model.offset)
        p.state.offset = p.operator.apply(handle_of(first), handle_of(second))
    allowed = np.asarray(held.gap.rows.on_nodes(held.gap.state.allowance, 0.0), dtype=np.float64)
    p.allow(allowed[p.operator.row_node])
    p.evaluate(model.ordered(held.gap, u))
    gaps = np.abs(p.state.values) if model.law.jump else p.state.values
    return float(np.max(gaps[np.broadcast_to(held.components, gaps.shape)], initial=0.0))
