"""Forces and moments that drive a rigid tool."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import Affine, rotation_matrix, rotation_vector, skew

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Driven:
    """A force along a direction, or a moment about an axis, and the one motion it finds.

    Attributes:
        force: Force (in 2D per length), or moment.
        direction: Unit vector: of the translation, shape (gdim,), or of the axis through the tool's
            center, (3,), in 2D (1,).
        turns: Whether it is a moment.
    """

    force: float
    direction: Array
    turns: bool = False

    def moved(self, displacement: Array, rotation: Array, s: float) -> tuple[Array, Array]:
        """Displacement and rotation that go on by s, a length or an angle."""
        if not self.turns:
            return displacement + s * self.direction, rotation
        further = rotation_matrix(s * self.direction) @ rotation_matrix(rotation)
        return displacement, rotation_vector(further)

    def missing(self, displacement: Array, rotation: Array) -> tuple[Array, Array]:
        """The parts of a displacement and a rotation along what is driven."""
        along = (rotation if self.turns else displacement) @ self.direction * self.direction
        none = np.zeros_like(displacement), np.zeros_like(rotation)
        return (none[0], along) if self.turns else (along, none[1])

    def field(self, rotation: Array, center: Array) -> Affine:
        """How places of the tool move with s, where the tool has turned by this rotation."""
        if not self.turns:
            return Affine(np.zeros((len(center),) * 2), self.direction)
        A = skew(self.direction) @ rotation_matrix(rotation)
        return Affine(A, -A @ center)

    def curvature(self, rotation: Array, center: Array) -> Affine | None:
        """The second derivative by s; None for 0."""
        if not self.turns:
            return None
        W = skew(self.direction)
        A = W @ W @ rotation_matrix(rotation)
        return Affine(A, -A @ center)
