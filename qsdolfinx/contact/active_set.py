"""The active set: which rows of a contact are closed, and which of them slip."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]


def slope(model: ContactModel, gap: WeightedGap) -> Array:
    """∂λ/∂ḡ at the rows of a pass at the last evaluation, positive where they are closed."""
    return gap.slope(model.eps, model.paired.touching)


def closed(model: ContactModel, gap: WeightedGap) -> npt.NDArray[np.bool_]:
    """Closed rows of a pass."""
    return slope(model, gap) > 0


def num_closed(model: ContactModel) -> int:
    """Closed rows on this rank, of all passes."""
    return sum(int(np.count_nonzero(closed(model, gap))) for gap in model.gaps)


def active_state(model: ContactModel) -> bytes:
    """Which rows of this rank are closed, and which of them slip."""
    if model.law.linear:
        return b""
    rows = [closed(model, gap).tobytes() for gap in model.gaps]
    return b"".join(rows + [slip.slipping_state() for slip in model.slips])


def tangent_state(model: ContactModel) -> bytes:
    """What the tangent of linear bodies depends on besides ε."""
    conductances = [gap.state.conductance for gap in model.gaps]
    states = [h.tobytes() for h in conductances if h is not None]
    states += [slip.tangent_state() for slip in model.slips]
    return active_state(model) + b"".join(states)
