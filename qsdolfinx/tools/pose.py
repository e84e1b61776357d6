"""Position of a rigid tool: rotation and translation from its initial position."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import check_array, check_vector, require
from qsdolfinx.surface.affine import Affine

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Pose:
    """Rigid motion from x₀ to R x₀ + t.

    Attributes:
        R: Rotation, shape (gdim, gdim).
        t: Translation (length), shape (gdim,).
    """

    R: Array
    t: Array

    @classmethod
    def at_rest(cls, gdim: int) -> Pose:
        """The initial position of the tool."""
        return cls(np.eye(gdim), np.zeros(gdim))

    @classmethod
    def from_matrix(cls, value: npt.ArrayLike, gdim: int) -> Pose:
        """The pose [R | t], shape (gdim, gdim + 1).

        Raises:
            ValueError: If the shape is wrong, it is not finite, or R is not a rotation.
        """
        position = check_array("position", value, (gdim, gdim + 1))
        require(np.isfinite(position).all(), "position: must be finite")
        R = position[:, :gdim]
        error = np.abs(R @ R.T - np.eye(gdim)).max()
        is_rotation = error <= 1e-6 and np.linalg.det(R) >= 0
        require(is_rotation, "position: the first columns must be a rotation")
        if error > 1e-14:  # otherwise rounding errors would grow over many steps
            U, _, V = np.linalg.svd(R)
            R = U @ V
        return cls(R.copy(), position[:, gdim].copy())

    @property
    def matrix(self) -> Array:
        """[R | t], shape (gdim, gdim + 1)."""
        return np.column_stack([self.R, self.t])

    def moved(self, motion: Affine) -> Array:
        """[R | t] after a motion, given as a displacement field over the present positions."""
        step = motion.A + np.eye(len(self.t))
        return np.column_stack([step @ self.R, step @ self.t + motion.b])

    def since(self, before: Pose) -> Affine:
        """Motion from another pose to this one, as a displacement field over the other pose."""
        turn = self.R @ before.R.T
        return Affine(turn - np.eye(len(self.t)), self.t - turn @ before.t)

    def __call__(self, x: Array) -> Array:
        """Present position of a point of the tool, shape (gdim,)."""
        return np.asarray(self.R @ x + self.t)

    @property
    def embedded(self) -> tuple[Array, Array]:
        """Rotation and translation in three dimensions."""
        R, gdim = np.eye(3), len(self.t)
        R[:gdim, :gdim] = self.R
        return R, padded(self.t)


def padded(x: Array) -> Array:
    """Coordinates in three dimensions."""
    return np.append(x, np.zeros(3 - len(x)))


def point_of(name: str, value: npt.ArrayLike) -> Array:
    """Coordinates of a point in two or three dimensions.

    Raises:
        ValueError: If the value is not made of two or three finite numbers.
    """
    return check_vector(name, value, 3 if np.size(np.asarray(value, dtype=object)) == 3 else 2)


def unit_vector(name: str, value: npt.ArrayLike | None, size: int) -> Array:
    """Vector of unit length.

    Raises:
        ValueError: If the value is not made of this many finite numbers, or zero.
    """
    vector = check_vector(name, value, size)
    length = float(np.linalg.norm(vector))
    require(length > 0, f"{name}: must not be zero")
    return np.asarray(vector / length)
