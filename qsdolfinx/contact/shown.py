"""Results of a contact: those of the last solve, independent of later changes."""

from __future__ import annotations

import copy

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap


def shown(model: ContactModel) -> ContactModel:
    """The contact in its state after the last evaluation, for results."""
    return model if model.kept is None else model.kept


def keep(model: ContactModel) -> None:
    """Keep the results of the last evaluation until the next evaluation.

    Call it before changing anything on which results depend: contact pairs, multipliers, penalty.
    """
    if model.kept is None and model.is_evaluated:
        model.kept = copy_of(model)


def copy_of(model: ContactModel) -> ContactModel:
    """Copy of the contact with its own parts, which keep the present results.

    Arrays are shared with the contact: they are replaced, but never written into.
    """
    if model.kept is not None:
        return model.kept
    out = copy.copy(model)
    gaps = {id(gap): _copied(gap) for gap in model.gaps}
    slips = tuple(_copied_slip(slip, gaps) for slip in model.slips)
    out.take_parts(tuple(gaps[id(gap)] for gap in model.gaps), slips)
    out.penalty, out.kinematics = copy.copy(model.penalty), copy.copy(model.kinematics)
    if model.friction is not None:
        out.friction = copy.copy(model.friction)
        out.friction.restore(model.friction.state)
    out.catch_up = None  # it refers to the contact itself
    return out


def _copied(gap: WeightedGap) -> WeightedGap:
    out = copy.copy(gap)
    out.state, out.rows = copy.copy(gap.state), copy.copy(gap.rows)
    out.rows.keep_areas()
    return out


def _copied_slip(slip: Slip, gaps: dict[int, WeightedGap]) -> Slip:
    """Copy of a slip, with the copied gap of its integration side."""
    out = copy.copy(slip)
    out.state = copy.copy(slip.state)
    out.gap = gaps[id(slip.gap)]
    return out
