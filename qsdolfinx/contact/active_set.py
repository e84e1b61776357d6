"""The active set: active constraints of a contact, and the slipping ones among them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]


def slope(model: ContactModel, gap: WeightedGap) -> Array:
    """Slope ∂λ/∂ḡ of each constraint at the last evaluation, positive where it is active."""
    return gap.slope(model.eps, model.paired.touching)


def closed(model: ContactModel, gap: WeightedGap) -> npt.NDArray[np.bool_]:
    """Active constraints of an integration side."""
    return slope(model, gap) > 0


def num_closed(model: ContactModel) -> int:
    """Number of active constraints on this rank, of all integration sides."""
    return sum(int(np.count_nonzero(closed(model, gap))) for gap in model.gaps)


def active_state(model: ContactModel) -> bytes:
    """Active constraints of this rank, and the slipping ones among them, as bytes."""
    if model.law.linear:
        return b""
    rows = [closed(model, gap).tobytes() for gap in model.gaps]
    return b"".join(rows + [slip.slipping_state() for slip in model.slips])


def tangent_state(model: ContactModel) -> bytes:
    """State that determines the contact tangent of linear bodies besides ε, as bytes."""
    conductances = [gap.state.conductance for gap in model.gaps]
    states = [h.tobytes() for h in conductances if h is not None]
    states += [slip.tangent_state() for slip in model.slips]
    return active_state(model) + b"".join(states)
