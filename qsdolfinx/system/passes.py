"""Integration sides of contacts with their constraints, and the state of an evaluation."""

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
    """One integration side of a contact and its constraints.

    Attributes:
        model: The contact.
        bodies: Body of the side with multipliers, and of the other side; None for a rigid tool.
        rows: Its constraints.
        tool: Number of the force-controlled tool in contact; None if there is none.
    """

    model: ContactModel
    bodies: tuple[int | None, int | None]
    rows: ConstraintRows
    tool: int | None

    @property
    def gap(self) -> WeightedGap:
        """Its weighted gap."""
        return self.rows.gap

    @property
    def slip(self) -> Slip | None:
        """Its slip; None without friction."""
        return self.rows.slip


class State(typing.NamedTuple):
    """Results of the last evaluation.

    Attributes:
        z: Unknowns of this rank.
        bulk: Residual of the bulk forms with conditions, owned unknowns.
        contact: Contact forces on the owned unknowns, including constrained ones (reactions).
        passes: Constraints of each integration side.
        constraints: R_λ and R_τ of all integration sides. They are stored since with updated
            geometry the points change with each evaluation.
        tools: Σ (∂ḡ/∂s · S λ + ∂g/∂s · S τ) − force of each force-controlled tool (force).
    """

    z: Array
    bulk: Array
    contact: Array
    passes: list[Evaluated]
    constraints: Array
    tools: Array
