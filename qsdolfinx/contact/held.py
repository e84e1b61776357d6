"""Condense multipliers that Dirichlet conditions on both sides make redundant (cross points)."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.rounding import NOTICED, ROUNDING, SOLVED
from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel, HeldNodes, HeldSlip
from qsdolfinx.friction.laws import Sticking
from qsdolfinx.friction.slip import Held
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.rows import NodeRows, PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.pair import Sampling, pair
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Kind of the warnings of this module.
HELD = "conditions on both sides"

#: Least part of the master's unknowns, opposite to a slave node, that must be constrained by
#: conditions. It is less than 1 because of nodes next to a plane in which both surfaces end, where
#: the normal of a curved slave points away from this plane.
MOST = 0.9


def find(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Find redundant multipliers, and set them for all integration sides and slips. Collective.

    Where conditions constrain a node and the opposite point, as where a symmetry plane crosses the
    contact, the two cannot move relative to each other. A multiplier there could close only the
    gaps of the surrounding nodes, which have their own multipliers. Such a multiplier is redundant:
    it would lock the remaining unknowns, or would not be determined.

    Two sides with a constrained component may still move relative to each other, as prescribed by
    the conditions. For friction, :func:`begin_solve` decides this.

    Args:
        model: The contact.
        slave: Nonzero at the unknowns of the slave's body with Dirichlet conditions.
        master: The same of the master's.
    """
    model.held_nodes, model.held_slips, alone = [], [], [False, False]
    for each in model.slips:
        each.may_be_held, each.held = False, None
        each.hold(None)
    if model.with_itself or (model.is_scalar and not model.augmented):
        return
    for i, gap in enumerate(model.gaps):
        gap.extension, slip = None, model.slips[i] if model.slips else None
        vecs, sides = model.ordered(gap, (slave, master)), model.ordered(gap, (0, 1))
        of_slave = np.any(_read(gap.slave, vecs[0]) != 0, axis=0)
        model.comm.Allreduce(MPI.IN_PLACE, of_slave, op=MPI.LOR)
        alone[sides[1]] |= _is_held(gap, vecs[1], ~of_slave)
        if not of_slave.any():
            continue
        by_node = gap.by_node()
        held = _held_on_both_sides(model, gap, by_node, *vecs)
        own = _read(gap.slave, vecs[0])[by_node.operator.row_node] != 0
        alone[sides[0]] |= bool(np.any(own & ~held))
        pressed, of_gap = _along_normal(by_node, held), _of_gap(by_node, held)
        gap.extension = _extension(model, gap, by_node, of_gap, of_gap & pressed)
        if slip is not None and model.comm.allreduce(bool(held.any()), op=MPI.LOR):
            slip.may_be_held = True
            of_master = None if vecs[1] is None else np.array(vecs[1].array_r)
            at_nodes = model.held_nodes[-1].at_nodes
            of_slip = HeldSlip(slip, by_node, held, held & pressed, at_nodes, of_master)
            model.held_slips.append(of_slip)
    model.held_alone = tuple(model.comm.allreduce(flag, op=MPI.LOR) for flag in alone)


def begin_solve(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Set the slip components that conditions constrain without relative motion. Collective.

    Where conditions constrain a node and the opposite point without moving them relative to each
    other, as on a symmetry plane, there is no slip, and no friction is assigned to this node. Nodes
    that conditions have moved in this step, or in an earlier step since they came into contact,
    slip or stick like all other nodes: friction acts between the two sides, also if both are
    prescribed.

    Args:
        model: The contact.
        slave: Unknowns of the slave's body with the conditions' values in place.
        master: The same of the master's.

    Warns:
        ContactWarning: If conditions prescribe a relative motion of nodes that cannot slip.
    """
    for held in model.held_slips:
        slip = held.slip
        way = np.where(held.held, np.abs(_relative_way(model, held, slave, master)), 0.0)
        moves = way > ROUNDING * model.paired.facet_size
        if model.augmented and isinstance(slip.friction, Sticking):
            _warn_of_stick(model, float(way.max(initial=0.0)))
            moves = np.zeros_like(moves)
        row_node, on_nodes = held.by_node.operator.row_node, held.by_node.rows.on_nodes
        moves |= held.held & (slip.state.moved[row_node] > 0)
        slip.state.moved = on_nodes(moves, False).astype(np.float64)
        redundant = held.held & ~moves
        same = held.redundant is not None and np.array_equal(redundant, held.redundant)
        if model.comm.allreduce(same, op=MPI.LAND):
            continue
        held.redundant = redundant
        clamped = held.clamped & redundant
        if slip.gap.rows.are_points:  # points slip beside the plane, and do not stick at any
            both = (on_nodes(flags, False).astype(bool) for flags in (redundant, clamped))
            slip.held = Held(*both)
        else:
            slip.hold(redundant & ~clamped)


def _relative_way(
    model: ContactModel, held: HeldSlip, slave: PETSc.Vec, master: PETSc.Vec | None
) -> Array:
    """Relative displacement of constrained nodes and opposite points (length), (rows, block).

    It is that since the step began, by conditions and by the motion of a rigid tool. Collective.
    """
    slip, gap = held.slip, held.by_node
    start, ways = slip.state.at_start, []
    kept, scale = (
        model.ordered(gap, both)
        for both in (model.kinematics.in_displacement, model.kinematics.scale)
    )
    for i, vec in enumerate(model.ordered(gap, (slave, master))):
        if vec is None:
            continue
        way = vec.copy()
        if kept[i] and start is not None:
            way.array[:] -= start.unknowns[i]
        way.scale(scale[i])
        ways.append(way)
    own = _read(gap.slave, ways[0])[gap.operator.row_node]
    if held.of_master is None:
        of_partner = _way_of_tool(held)
    else:
        ways[1].array[:] *= held.of_master
        of_partner = _way_of_partner(held, ways[1])
    for way in ways:
        way.destroy()
    return np.asarray(own - of_partner)


def _way_of_tool(held: HeldSlip) -> Array:
    """Displacement of a rigid tool since the step began (length), (rows, gdim)."""
    slip, gap = held.slip, held.slip.gap
    start, row_node = slip.state.at_start, held.by_node.operator.row_node
    if gap.state.base is None:
        shift = slip.state.shift if start is None else slip.state.shift - start.tool
        way = -shift / slip.cover[:, None]
        if gap.rows.are_points:
            way = gap.rows.on_nodes(way, 0.0)[row_node].astype(np.float64)
        return np.asarray(way)
    gdim = gap.slave.gdim
    now = Pose.from_matrix(gap.state.base[1], gdim)
    field = now.since(now if start is None else Pose.from_matrix(start.tool, gdim))
    x = gap.slave.node_x[row_node, :gdim]
    return np.asarray(x @ field.A.T + field.b)


def _way_of_partner(held: HeldSlip, way: PETSc.Vec) -> Array:
    """Mean displacement of the constrained master unknowns opposite to each node. Collective.

    Args:
        held: The constrained nodes.
        way: Displacement of the unknowns of the master's body; 0 at unconstrained unknowns.
    """
    gap, at_nodes = held.by_node, held.at_nodes
    row_node, linear, rows = gap.operator.row_node, at_nodes.slave, at_nodes.operator.row_node
    marker = way.duplicate()
    marker.array[:] = held.of_master
    made = [_at_vertices(gap.master, vec) for vec in (way, marker)]
    of_vertices, found = (np.zeros((len(linear.node_area), linear.block)) for _ in range(2))
    of_vertices[rows] = _ratio(*(_part_of_master(at_nodes, vec) for vec in made))
    found[rows] = 1.0
    made.append(gap.slave.nodal_vec(of_vertices))
    at_rows = _read(gap.slave, made[-1])[row_node]
    beside = _ratio(*(_part_of_master(gap, vec) for vec in (way, marker)))
    for vec in (*made, marker):
        if vec is not None:
            vec.destroy()
    is_found = _of_vertices(gap.slave, found > 0)[row_node] & ~_in_corner(gap)[:, None]
    return np.where(is_found, at_rows, beside)


def _ratio(sums: Array, weights: Array) -> Array:
    """Weighted means; 0 where nothing has a weight."""
    some = np.abs(weights) > SOLVED
    return np.divide(sums, weights, out=np.zeros_like(sums), where=some)


def _warn_of_stick(model: ContactModel, way: float) -> None:
    """Warn once that conditions move nodes that a law without a limit makes stick. Collective."""
    way = float(model.comm.allreduce(way, op=MPI.MAX))
    if way <= NOTICED * model.paired.facet_size:
        return
    tell(
        model,
        HELD,
        f"bcs: Dirichlet conditions move contact nodes that they hold on both sides by {way:.3g} "
        "against each other, which friction=Sticking() does not allow: no force acts there; take "
        "a law with a limit, such as Coulomb, or prescribe the same motion on both sides",
    )


def _extension(
    model: ContactModel, gap: WeightedGap, by_node: WeightedGap, held: Flags, clamped: Flags
) -> Extension | None:
    """Condensation of redundant multipliers, or None if no rank has any. Collective.

    Args:
        model: The contact.
        gap: The integration side.
        by_node: The integration side with one constraint for each node.
        held: Components of these constraints that conditions constrain on both sides.
        clamped: Those components that belong to fully constrained nodes.
    """
    if not model.augmented:  # the penalty of a clamped node does not grow
        held, clamped = held & ~clamped, np.zeros_like(held)
    if not model.comm.allreduce(bool(np.any(held)), op=MPI.LOR):
        return None
    slave = gap.slave
    if isinstance(gap.rows, NodeRows):
        return Extension(slave, *gap.rows.dofs(held.shape[1]), held, clamped)
    assert isinstance(gap.rows, PointRows)
    held, clamped = (
        np.asarray(by_node.rows.on_nodes(flags, False), dtype=bool) for flags in (held, clamped)
    )
    return gap.rows.extension(held, clamped, everywhere=gap.own is not None)


def _held_on_both_sides(
    model: ContactModel,
    gap: WeightedGap,
    by_node: WeightedGap,
    slave: PETSc.Vec | None,
    master: PETSc.Vec | None,
) -> Flags:
    """Components constrained at a slave node and opposite to it, shape (nodes, block).

    Collective. The nodes are stored in ``model.held_nodes``; arguments as for :func:`_extension`.
    """
    row_node = by_node.operator.row_node
    of_force = np.zeros(gap.slave.block, dtype=bool)
    for tool in gap.master.tools:
        if tool.driven is not None:  # it moves to the equilibrium of its force
            every = gap.law.jump or tool.driven.turns
            of_force |= every or np.abs(tool.driven.direction) > SOLVED
    own = (_read(gap.slave, slave) != 0) & ~of_force
    at_nodes = _at_nodes(model, gap)
    linear = at_nodes.slave
    held, found = np.zeros((2, len(linear.node_area), linear.block), dtype=bool)
    with _linear(gap, (slave, master)) as of_vertices:
        at = at_nodes.operator.row_node
        held[at] = np.abs(_read(linear, of_vertices[0])[at]) > SOLVED  # rounding marks no unknown
        held[at] &= ~of_force
        if of_vertices[1] is not None:
            held[at] &= _part_of_master(at_nodes, of_vertices[1]) > MOST
        found[at] = True
    model.held_nodes.append(HeldNodes(gap, at_nodes, _of_gap(at_nodes, held[at])))
    # Where the normal of a node misses the master: whether the master is constrained beside the
    # node.
    beside = own[row_node]
    if master is not None:
        least = np.where(_in_corner(by_node), MOST, SOLVED)[:, None]
        beside &= _part_of_master(by_node, master) > least
    is_held, is_found = (_of_vertices(gap.slave, flags)[row_node] for flags in (held, found))
    is_held &= own[row_node]  # also for nodes between constrained nodes
    return np.where(is_found & ~_in_corner(by_node)[:, None], is_held, beside)


def _in_corner(gap: WeightedGap) -> Flags:
    """Whether each constraint is one of several at its node, each with its own opposite point."""
    rows = gap.rows
    return rows.in_corner if isinstance(rows, NodeRows) else np.zeros(gap.num_rows, dtype=bool)


def _at_nodes(model: ContactModel, gap: WeightedGap) -> WeightedGap:
    """The integration side with a gap of each vertex to its own projection. Collective."""
    both = gap.slave.linear, gap.master.linear
    sampling = Sampling("nodal", 1, model.settings.sampling.normals)
    points = pair(*both, sampling, False, model.paired.radius)
    return WeightedGap(*both, points, gap.law, 1.0, rows="cover", augmented=False)


def _part_of_master(gap: WeightedGap, marker: PETSc.Vec | None) -> Array:
    """Part of the master's displacement in each constraint that is prescribed, (rows, block)."""
    none = gap.slave.create_vec()
    out = -gap.jump_operator().apply(none.handle, handle_of(marker))
    none.destroy()
    return np.asarray(out)


def _is_held(gap: WeightedGap, marker: PETSc.Vec | None, components: Flags) -> bool:
    """Whether a deformable master has these components constrained on this rank. Collective."""
    if marker is None or not components.any():
        return False
    return bool(np.any(np.abs(_part_of_master(gap, marker)[:, components]) > SOLVED))


@contextlib.contextmanager
def _linear(
    gap: WeightedGap, vecs: tuple[PETSc.Vec | None, PETSc.Vec | None]
) -> typing.Iterator[tuple[PETSc.Vec | None, PETSc.Vec | None]]:
    """Vectors of the two bodies for ``Surface.linear``: values at vertices. Collective."""
    surfaces = gap.slave, gap.master
    made = [_at_vertices(*both) for both in zip(surfaces, vecs, strict=True)]
    try:
        yield made[0], made[1]
    finally:
        for vec in made:
            if vec is not None:
                vec.destroy()


def _at_vertices(side: AnySurface, vec: PETSc.Vec | None) -> PETSc.Vec | None:
    """New vector of the body for ``Surface.linear``, with the values at vertices. Collective."""
    if vec is None or side.degree == 1:
        return None if vec is None else vec.copy()
    (surface,) = side.bodies
    collapsed = surface.collapsed_vec(vec)
    full, linear = fem.Function(surface.collapsed_space), fem.Function(surface.linear.V)
    full.x.array[: len(collapsed.array_r)] = collapsed.array_r
    full.x.scatter_forward()
    linear.interpolate(full)
    collapsed.destroy()
    of_vertices = surface.linear.create_vec()
    of_vertices.array[:] = linear.x.array[: len(of_vertices.array_r)]
    return of_vertices


def _of_vertices(surface: Surface, flags: Flags) -> Flags:
    """Flags at the nodes of a surface from flags at those of ``surface.linear``. Collective.

    Nodes between vertices have a flag if all of these vertices have it.
    """
    vec = surface.nodal_vec(flags.astype(np.float64))
    out = _read(surface, vec) > 1 - SOLVED
    vec.destroy()
    return np.asarray(out)


def _read(surface: Surface, vec: PETSc.Vec | None) -> Array:
    """Values at the owned contact nodes, shape (nodes, block)."""
    assert vec is not None
    return np.asarray(vec.array_r[surface.node_dofs - vec.owner_range[0]], dtype=np.float64)


def _of_gap(gap: WeightedGap, held: Flags) -> Flags:
    """Constrained components of gaps, or of relative displacements, (rows, width)."""
    return held if gap.law.jump else _along_normal(gap, held)


def _along_normal(gap: WeightedGap, held: Flags) -> Flags:
    """Constraints without a free component along the normal of their node, shape (rows, 1)."""
    normal = gap.slave.node_normal[gap.operator.row_node, : gap.slave.gdim]
    at = _in_corner(gap)
    if at.any():
        of_sides = gap.operator.slave_sum[at]
        normal[at] = of_sides / np.linalg.norm(of_sides, axis=1, keepdims=True)
    return np.asarray(np.all(held | (np.abs(normal) <= SOLVED), axis=1, keepdims=True))


def check_held(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Warn if conditions prescribe penetration, or a gap of tied nodes. Collective.

    The warning is given once for each contact.

    Args:
        model: The contact, solved.
        slave: Unknowns of the slave's body as used by contact.
        master: The same of the master's.
    """
    here = [h for h in model.held_nodes if h.gap in model.gaps]
    if HELD in model.told or not here:
        return
    local = max(_prescribed_gap(model, h, (slave, master)) for h in here)
    depth = float(model.comm.allreduce(local, op=MPI.MAX))
    if depth <= NOTICED * model.paired.facet_size:
        return
    what = (
        "move tied nodes apart"
        if model.law.jump
        else "press contact nodes that they hold on both sides into each other"
    )
    tell(
        model,
        HELD,
        f"bcs: Dirichlet conditions {what} by {depth:.3g}, which contact cannot change: contact "
        "forces at these nodes have no meaning; prescribe the same motion on both sides, prescribe "
        "it on one side only, or leave these nodes out of the contact surfaces",
    )


def _prescribed_gap(
    model: ContactModel, held: HeldNodes, u: tuple[PETSc.Vec | None, PETSc.Vec | None]
) -> float:
    """Largest gap (length) of constrained nodes on this rank. Collective."""
    p, gap, motion = held.at_nodes, held.gap, held.gap.master.motion
    p.state.scale = gap.state.scale
    if motion is not None:
        p.state.shift = p.change(motion)
    if model.offset is not None:
        with _linear(gap, model.ordered(gap, model.offset)) as offset:
            p.state.offset = p.operator.apply(handle_of(offset[0]), handle_of(offset[1]))
    allowance = gap.slave.create_vec()
    at = gap.slave.node_dofs[:, 0] - allowance.owner_range[0]
    allowance.array[at] = gap.rows.on_nodes(gap.allowance, 0.0)
    with _linear(gap, (allowance, None)) as allowed:
        p.allow(_read(p.slave, allowed[0])[p.operator.row_node, 0])
    allowance.destroy()
    with _linear(gap, model.ordered(gap, u)) as (slave, master):
        assert slave is not None
        p.evaluate((slave, master))
    return float(np.max(p.violation[held.components], initial=0.0))
