"""Positions, slips and overclosure of contacts of displacements or velocities.

The functions are those of ``model.Physics``; those of scalar fields are in ``contact.conduction``.
"""

from __future__ import annotations

import dataclasses

from petsc4py import PETSc

from qsdolfinx.contact import active_set, overclosed
from qsdolfinx.contact.model import ContactModel, Paired


def begin(model: ContactModel, paired: Paired) -> None:
    """Determine the overclosure of new contact pairs, or what is allowed of it. Collective.

    Raises:
        ValueError: If there is overclosure, and it is to be refused.
    """
    (overclosed.read if model.num_pairings == 0 else overclosed.follow)(model, paired)


def look(model: ContactModel) -> None:
    """Do nothing: no data of a contact of bodies can change without notice."""


def evaluate(model: ContactModel, slave: PETSc.Vec, master: PETSc.Vec | None) -> None:
    """Compute positions and slips after the gaps have been evaluated. Collective."""
    model.placement = model.placement.moved(
        (slave, master), model.kinematics.scale, model.offset or (None, None), model.tool_motion
    )
    cut = model.gaps[0].cut
    if cut is not None:
        # With finite sliding, contact detection is not done at the end position of a tool in
        # each step.
        there = model.placement.master.moved_to(cut.places[1])
        model.placement = dataclasses.replace(model.placement, master=there)
    for slip in model.slips:
        assert model.friction is not None
        gap, penalty, elastic = slip.gap, model.tangential_eps, 0.0
        if gap.rows.are_points:
            penalty, elastic = model.slip_penalty
        slip.evaluate(
            model.ordered(gap, (slave, master)),
            gap.multiplier(model.eps)[:, 0],
            active_set.closed(model, gap),
            penalty,
            model.kinematics.dt,
            model.friction.slow(model.kinematics.dt, model.paired.facet_size),
            model.ordered(gap, model.kinematics.in_displacement),
            gap.state.values[:, 0],
            model.compliance,
            elastic,
        )
