"""Updates of augmented multipliers: Uzawa's method with Anderson acceleration."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]

#: Earlier updates that are combined.
DEPTH = 40


class Augmentation:
    """Fixed-point iteration λ̂ ↦ λ(λ̂), λ = [λ̂ + ε ḡ]₊ being that of the solution for λ̂.

    With friction τ̂ ↦ τ(τ̂) goes with it.

    While the active set stays and bodies are linear, the map is affine, and the combination of
    earlier updates with the least residual λ − λ̂ (Anderson, 1965) converges like GMRES: a moderate
    ε needs few updates. When the active set changes, it starts again.

    Args:
        contacts: Contacts with an augmented Lagrangian.
    """

    def __init__(self, contacts: typing.Sequence[ContactModel]) -> None:
        self._parts = [(contact, part) for contact in contacts for part in contact.parts]
        self._contacts = contacts
        self._comm = contacts[0].comm
        self._residuals: list[Array] = []
        self._images: list[Array] = []
        self._active: list[bytes] = []

    def update(self) -> None:
        """Set λ̂ for the next solve. Collective."""
        images = [_multiplier(contact, part) for contact, part in self._parts]
        old = np.concatenate([part.state.augmented.ravel() for _, part in self._parts])
        image = np.concatenate([i.ravel() for i in images])
        active = [active_set.active_state(contact) for contact in self._contacts]
        if self._comm.allreduce(active != self._active, op=MPI.LOR):
            self._residuals, self._images = [], []
        self._active = active
        self._residuals = [*self._residuals, image - old][-DEPTH:]
        self._images = [*self._images, image][-DEPTH:]
        combined = sum(a * i for a, i in zip(self._coefficients(), self._images, strict=True))
        sizes = np.cumsum([part.state.augmented.size for _, part in self._parts])
        for (_, part), values in zip(self._parts, np.split(combined, sizes[:-1]), strict=True):
            values = values.reshape(part.state.augmented.shape)
            part.state.augmented = values if isinstance(part, Slip) else part.admissible(values)

    def _coefficients(self) -> Array:
        """Of the combination with the least residual; they sum to 1. Collective."""
        weight = np.concatenate([_weight(part).ravel() for _, part in self._parts])
        last = self._residuals[-1]
        count = len(self._residuals) - 1
        differences = np.array([r - last for r in self._residuals[:-1]])
        differences = differences.reshape(count, len(last))  # there may be no rows on this rank
        local = (differences * weight) @ np.vstack([differences, last]).T
        products = self._comm.allreduce(local, op=MPI.SUM)
        scale = np.sqrt(np.maximum(np.diag(products), 1e-300))
        gram = products[:, :-1] / np.outer(scale, scale)
        earlier = np.linalg.lstsq(gram, -products[:, -1] / scale, rcond=1e-12)[0] / scale
        return np.append(earlier, 1 - earlier.sum())


def _weight(part: WeightedGap | Slip) -> Array:
    """Area of each multiplier."""
    if isinstance(part, Slip):
        return np.repeat(part.weight, part.slave.gdim)
    return part.multiplier_weight


def _multiplier(contact: ContactModel, part: WeightedGap | Slip) -> Array:
    """λ̂ or τ̂ as the last evaluation asks for it. Collective."""
    if isinstance(part, Slip):
        return part.image()
    return part.image(contact.eps, contact.paired.touching)
