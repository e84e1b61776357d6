"""Prescribed forces and moments of a force-controlled rigid tool."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import Affine, rotation_matrix, rotation_vector, skew

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Driven:
    """A force along a direction, or a moment about an axis, and the corresponding unknown motion.

    Attributes:
        force: Force (in 2D per length), or moment.
        direction: Unit vector of the translation, shape (gdim,), or of the axis through the tool's
            center, (3,), in 2D (1,).
        turns: Whether a moment is prescribed, not a force.
    """

    force: float
    direction: Array
    turns: bool = False

    def moved(self, displacement: Array, rotation: Array, s: float) -> tuple[Array, Array]:
        """Displacement and rotation after a further motion by s, a length or an angle."""
        if not self.turns:
            return displacement + s * self.direction, rotation
        further = rotation_matrix(s * self.direction) @ rotation_matrix(rotation)
        return displacement, rotation_vector(further)

    def missing(self, displacement: Array, rotation: Array) -> tuple[Array, Array]:
        """Components of a displacement and a rotation along the force-controlled motion."""
        along = (rotation if self.turns else displacement) @ self.direction * self.direction
        none = np.zeros_like(displacement), np.zeros_like(rotation)
        return (none[0], along) if self.turns else (along, none[1])

    def field(self, rotation: Array, center: Array) -> Affine:
        """Derivative of the tool's positions by s, after this rotation of the tool."""
        if not self.turns:
            return Affine(np.zeros((len(center),) * 2), self.direction)
        A = skew(self.direction) @ rotation_matrix(rotation)
        return Affine(A, -A @ center)

    def curvature(self, rotation: Array, center: Array) -> Affine | None:
        """Second derivative of the tool's positions by s; None if it is zero."""
        if not self.turns:
            return None
        W = skew(self.direction)
        A = W @ W @ rotation_matrix(rotation)
        return Affine(A, -A @ center)
