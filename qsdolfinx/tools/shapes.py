"""Analytic shapes of rigid tools: exact distances and normals."""

from __future__ import annotations

import abc
import dataclasses

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Shape(abc.ABC):
    """A tool whose distance from any point is known in closed form."""

    @abc.abstractmethod
    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distances from the tool, positive outside of it, and its outward unit normals.

        Args:
            x: Points, shape (n, 3).

        Returns:
            Arrays of the shapes (n,) and (n, 3).
        """


@dataclasses.dataclass(frozen=True)
class Plane(Shape):
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


@dataclasses.dataclass(frozen=True)
class Round(Shape):
    """A ball, a circular cylinder, or what is left of the space around one.

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
        """See :meth:`Shape.distance`. In the very centre any normal would do."""
        ray = x - self.center
        if self.axis is not None:
            ray = ray - np.outer(ray @ self.axis, self.axis)
        length = np.linalg.norm(ray, axis=1)
        normal = ray / np.maximum(length, 1e-300)[:, None]
        sign = -1.0 if self.inside else 1.0
        return sign * (length - self.radius), sign * normal
