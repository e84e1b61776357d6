"""Transfer the history variables of a contact to a contact on other meshes."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import memory, multipliers
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.remeshing.surface_values import SurfaceValues

Array = npt.NDArray[np.float64]

#: Largest factor by which multipliers are corrected where a surface is covered in part. With 1
#: nothing is corrected; with much more, tractions would be those of another area.
LARGEST = 1.5


@dataclasses.dataclass(frozen=True)
class ContactValues:
    """History variables of a contact, at the nodes of its surfaces.

    Attributes:
        of_nodes: History variables of nodes, by name.
        of_contact: History variables of the contact as a whole, by name.
        totals: ∫ λ̂ of each integration side: force on its slave, up to the sign, (columns,).
    """

    of_nodes: dict[str, SurfaceValues]
    of_contact: dict[str, typing.Any]
    totals: list[Array]

    @classmethod
    def of(cls, model: ContactModel) -> ContactValues:
        """Read the values of a contact where its surfaces were read last. Collective."""
        return cls(
            {q.name: SurfaceValues.of(q.slave, q.read()) for q in memory.of_nodes(model)},
            {q.name: q.read() for q in memory.of_contact(model) if not q.of_mesh},
            [integral(gap) for gap in model.gaps],
        )

    def hand_over(self, model: ContactModel) -> None:
        """Write all values to a contact of the same kind on other meshes. Collective."""
        quantities = memory.of_nodes(model)
        found = {q.name: q.fit(self.of_nodes[q.name].on(q.slave)) for q in quantities}
        memory.write(quantities, found)
        multipliers.turn(model.parts)
        for gap, total in zip(model.gaps, self.totals, strict=True):
            _correct(gap, total)
        memory.write((q for q in memory.of_contact(model) if not q.of_mesh), self.of_contact)


def integral(gap: WeightedGap) -> Array:
    """∫ λ̂ of an integration side, shape (columns,). Collective."""
    local = np.sum(gap.multiplier_weight * gap.state.augmented, axis=0)
    return np.asarray(gap.slave.comm.allreduce(local, op=MPI.SUM))


def _correct(part: WeightedGap, total: Array) -> None:
    """Scale the multipliers of a part to this integral, if the factor is moderate. Collective."""
    now = integral(part)
    small = 1e-12 * np.abs(total).max(initial=0.0)
    known = np.abs(now) > small
    factor = np.where(known, total / np.where(known, now, 1.0), 1.0)
    fits = (factor > 1 / LARGEST) & (factor < LARGEST)
    part.state.augmented = part.state.augmented * np.where(fits, factor, 1.0)
