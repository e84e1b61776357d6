"""Passes of contacts with their constraints, and what an evaluation finds of all of them."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated

Array = npt.NDArray[np.float64]


class Pass(typing.NamedTuple):
    """One pass of a contact and its constraints.

    Attributes:
        model: The contact.
        bodies: Of the side with multipliers and of the other one; None of a rigid tool.
        rows: Its constraints.
        tool: Number of the driven tool that it presses on; None if there is none.
    """

    model: ContactModel
    bodies: tuple[int | None, int | None]
    rows: ConstraintRows
    tool: int | None

    @property
    def gap(self) -> WeightedGap:
        """The pass itself."""
        return self.rows.gap

    @property
    def slip(self) -> Slip | None:
        """Its slip; None without friction."""
        return self.rows.slip


class State(typing.NamedTuple):
    """What the last evaluation has found.

    Attributes:
        z: Unknowns of this rank.
        bulk: Residual of the bulk forms with conditions, owned unknowns.
        contact: Forces of contact on the owned unknowns, with reactions of conditions.
        passes: Constraints of each pass.
        constraints: R_λ and R_τ of all passes: where gaps follow the bodies, the points of another
            evaluation are others.
        tools: Σ (∂ḡ/∂s · S λ + ∂g/∂s · S τ) − force of each driven tool (force).
    """

    z: Array
    bulk: Array
    contact: Array
    passes: list[Evaluated]
    constraints: Array
    tools: Array
