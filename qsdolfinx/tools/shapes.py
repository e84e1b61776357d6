"""Analytic shapes of rigid tools and of smoothed surfaces, with exact distances and normals."""

from __future__ import annotations

import abc
import dataclasses

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Shape(abc.ABC):
    """Shape whose distance from any point is known in closed form."""

    @abc.abstractmethod
    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distances from the tool, positive outside of it, and its outward unit normals.

        Args:
            x: Points, shape (n, 3).

        Returns:
            Arrays of the shapes (n,) and (n, 3).
        """


class ToolShape(Shape):
    """Shape of a rigid tool, whose normals have known derivatives."""

    @abc.abstractmethod
    def curvature(self, x: Array) -> Array:
        """Derivatives of the normals by the points, shape (n, 3, 3), symmetric."""


@dataclasses.dataclass(frozen=True)
class Plane(ToolShape):
    """The half-space below a plane.

    Attributes:
        point: A point of the plane, shape (3,).
        normal: Unit normal, out of the tool, shape (3,).
    """

    point: Array
    normal: Array

    def distance(self, x: Array) -> tuple[Array, Array]:
        """See :meth:`Shape.distance`."""
        return (x - self.point) @ self.normal, np.tile(self.normal, (len(x), 1))

    def curvature(self, x: Array) -> Array:
        """See :meth:`ToolShape.curvature`."""
        return np.zeros((len(x), 3, 3))


@dataclasses.dataclass(frozen=True)
class Round(ToolShape):
    """A ball, a circular cylinder, or the complement of one of these.

    Attributes:
        center: Centre, or a point of the axis, shape (3,).
        radius: Radius (length).
        inside: Whether the workpiece is inside.
        axis: Unit vector along the axis of a cylinder, shape (3,); None for a ball or a circle.
    """

    center: Array
    radius: float
    inside: bool
    axis: Array | None = None

    def distance(self, x: Array) -> tuple[Array, Array]:
        """See :meth:`Shape.distance`. At the centre, any normal is valid."""
        length, out = self._out(x)
        sign = -1.0 if self.inside else 1.0
        return sign * (length - self.radius), sign * out

    def curvature(self, x: Array) -> Array:
        """See :meth:`ToolShape.curvature`. For a circle, components along z have no meaning."""
        length, out = self._out(x)
        across = np.eye(3) - out[:, :, None] * out[:, None, :]
        if self.axis is not None:
            across = across - np.outer(self.axis, self.axis)
        sign = -1.0 if self.inside else 1.0
        return np.asarray(sign * across / np.maximum(length, 1e-300)[:, None, None])

    def _out(self, x: Array) -> tuple[Array, Array]:
        """Distances from the middle, and unit vectors away from it."""
        ray = x - self.center
        if self.axis is not None:
            ray = ray - np.outer(ray @ self.axis, self.axis)
        length = np.linalg.norm(ray, axis=1)
        return length, ray / np.maximum(length, 1e-300)[:, None]


@dataclasses.dataclass(frozen=True)
class Torus(Shape):
    """A circular tube around an axis.

    Attributes:
        center: Middle, shape (3,).
        axis: Unit vector along the axis, shape (3,).
        radius: Radius of the circle in the middle of the tube (length).
        tube: Radius of the tube (length).
    """

    center: Array
    axis: Array
    radius: float
    tube: float

    def distance(self, x: Array) -> tuple[Array, Array]:
        """See :meth:`Shape.distance`."""
        length, _, part, across = self._out(x)
        return length - self.tube, part[:, :1] * across + part[:, 1:] * self.axis

    def _out(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Distances from the tube's centre line and the axis; unit vectors, see :func:`around`.

        The first unit vectors point away from the tube's centre line, in components away from and
        along the axis.
        """
        across, away, along = around(x - self.center, self.axis)
        out = away - self.radius
        length = np.hypot(out, along)
        part = np.column_stack([out, along]) / np.maximum(length, 1e-300)[:, None]
        return length, np.maximum(away, 1e-300), part, across


@dataclasses.dataclass(frozen=True)
class Cone(Shape):
    """A circular cone, to one side of its apex.

    Attributes:
        apex: Apex of the cone, shape (3,).
        axis: Unit vector from the apex into the cone, shape (3,).
        half_angle: Angle between the axis and the cone, radians.
    """

    apex: Array
    axis: Array
    half_angle: float

    def distance(self, x: Array) -> tuple[Array, Array]:
        """See :meth:`Shape.distance`, for points that are nearer to the side than to the apex."""
        across, away, along = around(x - self.apex, self.axis)
        c, s = np.cos(self.half_angle), np.sin(self.half_angle)
        return c * away - s * along, c * across - s * self.axis


def around(ray: Array, axis: Array) -> tuple[Array, Array, Array]:
    """Unit vectors away from an axis, and coordinates across and along it."""
    along = ray @ axis
    across = ray - np.outer(along, axis)
    away = np.linalg.norm(across, axis=1)
    return across / np.maximum(away, 1e-300)[:, None], away, along
