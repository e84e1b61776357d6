"""Coordinate systems of bodies: Cartesian in 2D or 3D, or axisymmetric, (r, z)."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import ufl

Array = npt.NDArray[np.float64]


class Cartesian:
    """Coordinates (x, y) or (x, y, z)."""

    def rigid_fields(self, x: Array, gdim: int) -> Array:
        """Translations, and linearised rotations about the origin, shape (motions, points, gdim).

        Args:
            x: Points, shape (points, 3).
            gdim: Geometric dimension, 2 or 3.
        """
        pairs = [(0, 1)] if gdim == 2 else [(0, 1), (1, 2), (2, 0)]
        fields = np.zeros((gdim + len(pairs), len(x), gdim))
        for i in range(gdim):
            fields[i, :, i] = 1
        for k, (i, j) in enumerate(pairs, start=gdim):
            fields[k, :, i] = -x[:, j]
            fields[k, :, j] = x[:, i]
        return fields

    def volume_preserving(self, x: typing.Any, gdim: int) -> list[typing.Any]:
        """UFL velocity fields with constant volume-preserving strain rates of norm 1."""
        fields = [self._stretch(x)] if gdim == 2 else []
        if gdim == 3:
            fields.append(_vector(x, (1.0, -1.0, 0.0), np.sqrt(2.0)))
            fields.append(_vector(x, (1.0, 1.0, -2.0), np.sqrt(6.0)))
        for i, j in [(1, 0)] if gdim == 2 else [(0, 1), (1, 2), (2, 0)]:
            shear = [0.0 * x[0]] * gdim
            shear[i] = np.sqrt(2.0) * x[j]
            fields.append(ufl.as_vector(shear))
        return fields

    def _stretch(self, x: typing.Any) -> typing.Any:
        return _vector(x, (1.0, -1.0), np.sqrt(2.0))


class Axisymmetric(Cartesian):
    """Coordinates (r, z), r ≥ 0: bodies are rings; the only rigid motion is along the axis."""

    def rigid_fields(self, x: Array, gdim: int) -> Array:
        """Translation along the axis, shape (1, points, 2)."""
        return super().rigid_fields(x, gdim)[1:2]

    def _stretch(self, x: typing.Any) -> typing.Any:
        return _vector(x, (1.0, -2.0), np.sqrt(6.0))


def _vector(x: typing.Any, factors: tuple[float, ...], norm: float) -> typing.Any:
    return ufl.as_vector([factor * x[i] / norm for i, factor in enumerate(factors)])
