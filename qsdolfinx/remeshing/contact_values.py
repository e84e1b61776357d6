"""Multipliers and history of friction of a contact, handed over to one on other meshes."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.multipliers import (
    num_columns,
    on_nodes,
    pressures_on_nodes,
    set_on_nodes,
    set_pressures_on_nodes,
)
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.remeshing.surface_values import SurfaceValues

Array = npt.NDArray[np.float64]

#: Factor at most by which multipliers are corrected where a surface is covered in part.
LARGEST = 1.5


@dataclasses.dataclass(frozen=True)
class ContactValues:
    """What a contact keeps from step to step, at the nodes of its surfaces.

    Attributes:
        multipliers: λ̂ and τ̂ of each part.
        totals: ∫ λ̂ of each pass: force on its slave, signs apart, (columns,).
        pressures: Of each slip at the start of the step, whether it slipped, its cover, and
            what conditions have moved.
        slipped: Slip of each pass, (nodes, gdim).
        rate: Largest slip rate (length per time); None if it is not known.
        dissipated: Energy that friction has taken.
    """

    multipliers: list[SurfaceValues]
    totals: list[Array]
    pressures: list[SurfaceValues]
    slipped: list[SurfaceValues]
    rate: float | None
    dissipated: float

    @classmethod
    def of(cls, model: ContactModel) -> ContactValues:
        """Read a contact where its surfaces were read last. Collective."""
        parts, slips = model.parts, model.slips
        values = zip(parts, on_nodes(parts), strict=True)
        friction = model.friction
        pressures = zip(slips, pressures_on_nodes(model), strict=True)
        slipped = zip(slips, friction.slipped if friction else [], strict=True)
        return cls(
            [SurfaceValues.of(part.slave, at_nodes) for part, at_nodes in values],
            [integral(gap) for gap in model.gaps],
            [SurfaceValues.of(slip.slave, at_nodes) for slip, at_nodes in pressures],
            [SurfaceValues.of(slip.slave, at_nodes) for slip, at_nodes in slipped],
            friction.rate if friction else None,
            friction.dissipated_energy() if friction else 0.0,
        )

    def hand_over(self, model: ContactModel) -> None:
        """Write all into a contact of the same kind on other meshes. Collective."""
        parts = model.parts
        found = [
            _widened(kept.on(part.slave), num_columns(part), part.slave.gdim)
            for kept, part in zip(self.multipliers, parts, strict=True)
        ]
        set_on_nodes(parts, found)
        for gap, total in zip(model.gaps, self.totals, strict=True):
            _correct(gap, total)
        friction = model.friction
        if friction is None:
            return
        pairs = list(zip(self.pressures, self.slipped, model.slips, strict=True))
        columns = [kept.on(slip.slave) for kept, _, slip in pairs]
        for column in columns:
            column[:, 1] = np.rint(column[:, 1])
            column[:, 3:] = np.rint(column[:, 3:])
        set_pressures_on_nodes(model, columns)
        friction.slipped = [kept.on(slip.slave) for _, kept, slip in pairs]
        friction.continue_with(self.rate)
        friction.dissipated = self.dissipated if model.comm.rank == 0 else 0.0


def integral(gap: WeightedGap) -> Array:
    """∫ λ̂ of a pass, shape (columns,). Collective."""
    local = np.sum(gap.multiplier_weight * gap.state.augmented, axis=0)
    return np.asarray(gap.slave.comm.allreduce(local, op=MPI.SUM))


def _correct(part: WeightedGap, total: Array) -> None:
    """Let the multipliers of a part have this integral, where a factor can do that. Collective."""
    now = integral(part)
    small = 1e-12 * np.abs(total).max(initial=0.0)
    known = np.abs(now) > small
    factor = np.where(known, total / np.where(known, now, 1.0), 1.0)
    fits = (factor > 1 / LARGEST) & (factor < LARGEST)
    part.state.augmented = part.state.augmented * np.where(fits, factor, 1.0)


def _widened(values: Array, columns: int, gdim: int) -> Array:
    """Values by sides of nodes for a part that has none, or the other way round."""
    if values.shape[1] == columns:
        return values
    if values.shape[1] > columns:
        return np.asarray(values.reshape(len(values), gdim, columns).sum(axis=1))
    width = values.shape[1]
    out = np.zeros((len(values), gdim, width))
    out[:, 0] = values
    return out.reshape(len(values), columns)
