"""What can be read from a contact: the last solve, whatever has been changed since."""

from __future__ import annotations

import copy

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap


def shown(model: ContactModel) -> ContactModel:
    """The contact as the last evaluation left it, to be read."""
    return model if model.kept is None else model.kept


def keep(model: ContactModel) -> None:
    """Let readings stay those of the last evaluation until the next one.

    To be called before anything is changed that they are functions of: pairs, multipliers, penalty.
    """
    if model.kept is None and model.is_evaluated:
        model.kept = copy_of(model)


def copy_of(model: ContactModel) -> ContactModel:
    """The contact with parts of its own, which show what it shows now whatever happens to it.

    Arrays are those of the contact, which are replaced and never written into.
    """
    if model.kept is not None:
        return model.kept
    out = copy.copy(model)
    gaps = {id(gap): _copied(gap) for gap in model.gaps}
    slips = tuple(_copied_slip(slip, gaps) for slip in model.slips)
    out.take_parts(tuple(gaps[id(gap)] for gap in model.gaps), slips)
    out.penalty, out.kinematics = copy.copy(model.penalty), copy.copy(model.kinematics)
    out.catch_up = None  # which refers to the contact itself
    return out


def _copied(gap: WeightedGap) -> WeightedGap:
    out = copy.copy(gap)
    out.state, out.rows = copy.copy(gap.state), copy.copy(gap.rows)
    out.rows.keep_areas()
    return out


def _copied_slip(slip: Slip, gaps: dict[int, WeightedGap]) -> Slip:
    """A slip whose pass is one of these copies."""
    out = copy.copy(slip)
    out.state = copy.copy(slip.state)
    out.gap = gaps[id(slip.gap)]
    return out
