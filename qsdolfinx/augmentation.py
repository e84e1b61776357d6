"""Updates of augmented multipliers: Uzawa's method with Anderson acceleration."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import Contact

Array = npt.NDArray[np.float64]

#: Earlier updates that are combined.
DEPTH = 40


class Augmentation:
    """Fixed-point iteration λ̂ ↦ λ(λ̂), λ = [λ̂ + ε ḡ]₊ being that of the solution for λ̂.

    While the active set stays and bodies are linear, the map is affine, and the combination of
    earlier updates with the least residual λ − λ̂ (Anderson, 1965) converges like GMRES: a moderate
    ε does with few updates. When the active set changes, it starts anew.

    Args:
        contacts: Contacts with an augmented Lagrangian.
    """

    def __init__(self, contacts: typing.Sequence[Contact]) -> None:
        self._passes = [p for contact in contacts for p in contact.passes]
        self._eps = [contact.eps for contact in contacts for _ in contact.passes]
        self._contacts = contacts
        self._comm = contacts[0].comm
        self._residuals: list[Array] = []
        self._images: list[Array] = []
        self._active: list[bytes] = []

    def update(self) -> None:
        """Set λ̂ for the next solve. Collective."""
        images = [p.multiplier(eps) for p, eps in zip(self._passes, self._eps, strict=True)]
        old = np.concatenate([p.augmented.ravel() for p in self._passes])
        image = np.concatenate([i.ravel() for i in images])
        active = [contact.active_state() for contact in self._contacts]
        if self._comm.allreduce(active != self._active, op=MPI.LOR):
            self._residuals, self._images = [], []
        self._active = active
        self._residuals = [*self._residuals, image - old][-DEPTH:]
        self._images = [*self._images, image][-DEPTH:]
        combined = sum(a * i for a, i in zip(self._coefficients(), self._images, strict=True))
        parts = np.split(combined, np.cumsum([p.augmented.size for p in self._passes])[:-1])
        for p, part in zip(self._passes, parts, strict=True):
            p.augmented = p.law.admissible(part.reshape(p.augmented.shape))

    def _coefficients(self) -> Array:
        """Of the combination with the least residual; they sum to 1. Collective."""
        weight = np.concatenate([np.repeat(p.weight, p.augmented.shape[1]) for p in self._passes])
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
