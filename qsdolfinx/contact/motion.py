"""Motion of the bodies and tools of a contact: contact detection, offsets, starts of steps."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from qsdolfinx.base.checks import FUNCTION, check, either, require
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import memory, multipliers, overclosed, shown, terms
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.model import ContactModel, find_pairs
from qsdolfinx.contact.placement import Placement
from qsdolfinx.friction import carried
from qsdolfinx.surface.affine import Affine, rotation_about, rotation_matrix
from qsdolfinx.surface.surface import update_surfaces
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import RigidSurface

Vecs = tuple[PETSc.Vec | None, PETSc.Vec | None]


def pair_anew(model: ContactModel) -> None:
    """Update the contact pairs at present positions, and keep nodal multipliers. Collective.

    Displacements added to those of the unknowns (offsets) were relative to the earlier positions of
    the meshes; they become zero. Results stay those of the last evaluation.

    Raises:
        ValueError: If coordinates are not finite or a facet has no area.
    """
    first = model.num_pairings == 0
    model.master.check_state()
    shown.keep(model)
    if not first and model.type is ContactType.TIE:
        _follow(model)
        return
    with model.watch.stage("pairing"):
        if not first:
            update_surfaces(*model.bodies)
        kept = {} if first else {q.name: q.read() for q in memory.of_pairs(model)}
        held = memory.held_nodes(model)
        before = () if first else model.slips
        shares = model.mechanics is not None and model.mechanics.shares_pairs
        known = model.mechanics.points() if shares and model.mechanics is not None else None
        paired = find_pairs(model.settings, model.friction, known)
        model.physics.begin(model, paired)
        model.paired = paired
        _continue_step(model)
        if not first:
            memory.write(memory.of_pairs(model), kept)
            multipliers.turn(paired.parts)
            memory.check_held(model, held)
            for old, new in zip(before, paired.slips, strict=True):
                carried.carry(old, new)
        _zero_offset(model)
        set_motion(model)
        model.placement = Placement.at_pairing(model.slave, model.master)
        model.tool_motion = None
        model.num_pairings += 1
        model.catch_up = None
        if not first:
            overclosed.check_sliding(model)


def _follow(model: ContactModel) -> None:
    """Update a tie to present positions; it keeps the contact pairs of its start. Collective."""
    with model.watch.stage("pairing"):
        update_surfaces(*model.bodies)
        _zero_offset(model)
        _carry(model, True)
        set_motion(model)
        model.placement = Placement.at_pairing(model.slave, model.master)
        model.tool_motion = None
        model.num_pairings += 1
        model.catch_up = None


def _carry(model: ContactModel, meshes: bool) -> None:
    """Add the motion of a tool, and of meshes, since the start of a tie to it. Collective."""
    for gap in model.gaps:
        gap.carry(meshes)
    model.paired = dataclasses.replace(model.paired, tool_version=model.master.version)


def _zero_offset(model: ContactModel) -> None:
    for vec in model.offset or ():
        if vec is not None:
            vec.zeroEntries()


def catch_up(model: ContactModel) -> None:
    """Update contact pairs to the positions after a time step, if still pending. Collective.

    Scalar fields use the pairs of their bodies at the last solve of these.
    """
    if model.catch_up is not None:
        model.catch_up()
    if model.mechanics is not None and model.mechanics.is_stale:
        pair_anew(model)


def _continue_step(model: ContactModel) -> None:
    """Measure slip from the present positions of bodies and tool.

    Bodies with total displacements keep their unknowns when contact pairs are updated, unless the
    caller has moved their mesh and sets the unknowns to zero. The next solve finds out at its start
    which of the two is the case.
    """
    for slip in model.slips:
        slip.state.starts_there = True
        if model.master.motion is not None and model.kinematics.in_displacement[0]:
            slip.state.start = slip.change(model.master.motion)


def reset(model: ContactModel) -> None:
    """Delete multipliers and history; slip counts from the present positions. Collective.

    Contact pairs, the penalty, and the results of the last solve stay.
    """
    shown.keep(model)
    memory.reset(model)
    _continue_step(model)


def move_tool(model: ContactModel) -> None:
    """Update gaps and slips for the motion of a rigid tool. Collective.

    Raises:
        ValueError: If it is not finite or differs between ranks.
        RuntimeError: If the tool has another position than at the last contact detection.
    """
    if model.is_scalar:
        return
    if model.follows:
        _move_followed_tool(model)
        return
    if model.paired.tool_version != model.master.version:
        if model.type is not ContactType.TIE:
            raise RuntimeError("the tool has been moved for good: call contact.update()")
        _carry(model, False)
    model.master.check_state()
    if model.master.motion is None:
        return
    with model.watch.stage("gap"):
        for part in model.parts:
            part.state.shift = part.change(model.master.motion)
        # Displacement-based bodies are paired at the end position of the tool; with friction,
        # others move along with it.
        alone = model.friction is None and not model.kinematics.in_displacement[0]
        for tool in model.master.tools:
            if alone and model.has_gaps and tool.rotation.any():
                _turn_in_place(model, tool)
    model.tool_motion = model.master.motion


def _move_followed_tool(model: ContactModel) -> None:
    """Move the tool to the end of its motion in gaps with updated geometry. Collective."""
    model.master.check_state()
    for tool in model.master.tools:
        position = Pose.from_matrix(tool.position, tool.gdim).moved(tool.motion)
        for gap in model.gaps:
            gap.move_tool(position)
        model.tool_motion = tool.motion


def _turn_in_place(model: ContactModel, tool: RigidSurface) -> None:
    """Prevent a tool rotating in place from opening gaps to a resting body. Collective.

    A point of a surface of revolution leaves the tangent plane as the tool rotates, and another
    point takes its place. A rotation R about c counts as rotation in place if ½ (R − Rᵀ)(x − c),
    the displacement along the mean of the normals before and after, opens gaps by less than the
    rest of (R − 1)(x − c) does.
    """
    R, zero = rotation_matrix(tool.rotation), np.zeros_like(tool.displacement)
    turns = R, np.eye(len(R)) + (R - R.T) / 2
    full, along = (rotation_about(turn, tool.center, zero) for turn in turns)
    parts = [(gap.change(full), gap.change(along)) for gap in model.gaps]
    opened = max(np.max(np.abs(odd), initial=0.0) for _, odd in parts)
    rest = max(np.max(np.abs(whole - odd), initial=0.0) for whole, odd in parts)
    opened, rest = (model.comm.allreduce(x, op=MPI.MAX) for x in (opened, rest))
    if opened >= rest:
        return
    for gap, (whole, odd) in zip(model.gaps, parts, strict=True):
        gap.state.shift = gap.state.shift + (odd - whole)


def follow_meshes(model: ContactModel) -> None:
    """Use the present meshes as the reference of gaps with updated geometry. Collective."""
    update_surfaces(*model.bodies)
    for gap in model.gaps:
        gap.rebase()
    model.paired = dataclasses.replace(model.paired, tool_version=model.master.version)
    model.placement = Placement.at_pairing(model.slave, model.master)


def follow_from(model: ContactModel, slave: fem.Function, master: fem.Function | None) -> None:
    """Let a contact with updated geometry go on from these unknowns of the bodies. Collective.

    What the first contact detection has decided stays: search distance, and smooth patches.

    Args:
        model: The contact.
        slave: Unknowns of the slave's body, relative to its present mesh.
        master: The same for the master.
    """
    free_offset(model)
    follow_meshes(model)
    _continue_step(model)
    vecs = _vecs(model, slave, master)
    for gap in model.gaps:
        gap.evaluate(model.ordered(gap, vecs))
    for slip in model.slips:
        slip.take_operator()
    for vec in vecs:
        if vec is not None:
            vec.destroy()


def begin_to_follow(model: ContactModel, slave: fem.Function, master: fem.Function | None) -> None:
    """Initialise gaps with updated geometry at the positions for these unknowns. Collective."""
    if not model.follows:
        return
    overclosed.follow_bodies(model)
    overclosed.check_sliding(model)
    vecs = _vecs(model, slave, master)
    for gap in model.gaps:
        kept = model.ordered(gap, model.kinematics.in_displacement)
        gap.choose_anew(model.ordered(gap, vecs), kept)
    for vec in vecs:
        if vec is not None:
            vec.destroy()


def set_motion(model: ContactModel) -> None:
    """Pass scales and offsets on to the gaps. Collective."""
    for gap in model.gaps:
        gap.state.scale = model.ordered(gap, model.kinematics.scale)
        if model.offset is not None:
            gap.set_offset(model.ordered(gap, model.offset))


def set_offset(
    model: ContactModel, slave: fem.Function | None, master: fem.Function | None
) -> None:
    """Set displacements added to those of the unknowns, see ``Contact.set_offset``."""
    offset = _vecs(model, slave, master)
    free_offset(model)
    model.offset = offset
    set_motion(model)


def free_offset(model: ContactModel) -> None:
    """Free the vectors of displacements added to those of the unknowns. Collective."""
    for vec in model.offset or ():
        if vec is not None:
            vec.destroy()
    model.offset = None


def set_start(
    model: ContactModel,
    slave: fem.Function | None,
    master: fem.Function | None,
    moved: Affine | None = None,
) -> None:
    """Set the positions at the start of the step, from which slip is measured. Collective.

    Without this call, after an update of the contact pairs, slip is measured from the positions at
    the start of the next solve.

    Args:
        model: The contact.
        slave: Unknowns of the slave's body at the start, as for :meth:`qs.Contact.set_offset`.
        master: The same for the master.
        moved: Motion that a rigid tool has already made in this step, as a field over its present
            positions.
    """
    if not model.slips:
        return
    at_start = _vecs(model, slave, master)
    for slip in model.slips:
        if model.follows:  # its pairs are those at the end of the last step, if any
            kept = model.ordered(slip.gap, model.kinematics.in_displacement)
            slip.begin_at(model.ordered(slip.gap, at_start), kept)
            continue
        tool = np.zeros_like(slip.state.start) if moved is None else -slip.change(moved)
        slip.state.start = slip.jump_of(model.ordered(slip.gap, at_start)) + tool
        slip.state.starts_there = False
        slip.begin_with(model.ordered(slip.gap, at_start), (True, True), tool)
    for vec in at_start:
        if vec is not None:
            vec.destroy()


def begin_slip(model: ContactModel, slave: fem.Function, master: fem.Function | None) -> None:
    """Measure slip from these unknowns, unless the start of the step is known. Collective."""
    if not any(slip.state.starts_there for slip in model.slips):
        return
    at_start = _vecs(model, slave, master)
    for slip in model.slips:
        in_displacement = model.ordered(slip.gap, model.kinematics.in_displacement)
        slip.begin_at(model.ordered(slip.gap, at_start), in_displacement)
    for vec in at_start:
        if vec is not None:
            vec.destroy()


def show(model: ContactModel, slave: fem.Function | None, master: fem.Function | None) -> None:
    """Evaluate gaps and slips for output only; no step begins or ends. Collective.

    Args:
        model: The contact.
        slave: Unknowns of the slave's body, as for :meth:`qs.Contact.set_offset`.
        master: The same for the master.
    """
    first, second = _vecs(model, slave, master)
    terms.evaluate(model, first, second)
    for slip in model.slips:
        slip.state.ended = True
    for vec in (first, second):
        if vec is not None:
            vec.destroy()


def _vecs(model: ContactModel, slave: fem.Function | None, master: fem.Function | None) -> Vecs:
    """Owned values of functions on the bodies' spaces as vectors; None for a rigid tool."""
    vecs = model.slave.create_vec(), model.master.create_vec()
    with checked(model.comm):
        check(either(FUNCTION, None), slave=slave, master=master)
        for name, vec, function in zip(("slave", "master"), vecs, (slave, master), strict=True):
            if function is not None:
                dofmap = function.function_space.dofmap
                owned = dofmap.index_map.size_local * dofmap.index_map_bs
                fits = vec is not None and len(vec.array_r) == owned
                require(fits, f"{name}: the function must be on the space of the body")
                vec.array[:] = function.x.array[:owned]
    return vecs
