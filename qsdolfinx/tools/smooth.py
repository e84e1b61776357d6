"""Smooth surfaces that the facets of a contact surface approximate."""

from __future__ import annotations

import abc
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import POSITIVE, check, instance, number, require
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools import shapes
from qsdolfinx.tools.heights import check_near
from qsdolfinx.tools.pose import padded, point_of, unit_vector

Array = npt.NDArray[np.float64]
Made = typing.TypeVar("Made", bound="Smooth")

ACUTE = number("an angle between 0 and π/2", lambda x: 0 < x < np.pi / 2)


class Smooth(abc.ABC):
    """Base class of smooth surfaces that facets approximate: ``shape`` of :func:`qs.elevate`.

    A smooth surface has no inside: use the same surface for the facets of a pin and of its hole.
    """

    def __init__(self, shape: shapes.Shape, parameters: dict[str, typing.Any]) -> None:
        self._shape, self._parameters = shape, parameters

    @property
    def shape(self) -> shapes.Shape:
        """Shape that gives the exact distance."""
        return self._shape

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={_plain(value)!r}" for name, value in self._parameters.items())
        return f"{type(self).__name__}({given})"

    @classmethod
    def fit(cls: type[Made], surface: Surface) -> Made:
        """Fit a surface of this kind to the vertices of a surface, by least squares. Collective.

        Args:
            surface: Surface with vertices on the unknown smooth surface.

        Raises:
            TypeError: If ``surface`` is not a Surface.
            ValueError: If vertices are off the smooth surface by more than a tenth of the facets'
                chord error, or this kind exists in 3D only and the surface is in 2D.
        """
        check(instance(Surface, "a qsdolfinx.Surface"), surface=surface)
        found = cls._fitted(_Cloud(surface))
        check_near(found.shape, cls.__name__, surface.cpp_object, surface.comm)
        return found

    @classmethod
    @abc.abstractmethod
    def _fitted(cls: type[Made], cloud: _Cloud) -> Made:
        """Estimate from sums over points and normals, and improve by the Gauss-Newton method."""


class Plane(Smooth):
    """A plane; in 2D a line.

    Args:
        point: A point of the plane, shape (gdim,), gdim 2 or 3.
        normal: Normal of any length and of either sign, shape (gdim,).

    Raises:
        ValueError: If an argument has another shape or is not finite, or the normal is zero.
    """

    def __init__(self, point: npt.ArrayLike, normal: npt.ArrayLike) -> None:
        x = point_of("point", point)
        n = unit_vector("normal", normal, len(x))
        super().__init__(shapes.Plane(padded(x), padded(n)), {"point": x, "normal": n})

    @classmethod
    def _fitted(cls, cloud: _Cloud) -> Plane:
        middle = cloud.sum(cloud.x) / cloud.count
        off = cloud.x - middle
        return cls(middle, _axis_of(cloud.sum(off[:, :, None] * off[:, None])))


class Sphere(Smooth):
    """A sphere; in 2D a circle.

    Args:
        center: Centre, shape (gdim,), gdim 2 or 3.
        radius: Radius (length).

    Raises:
        ValueError: If an argument has another shape or is not finite, or the radius is not
            positive.
    """

    def __init__(self, center: npt.ArrayLike, radius: float) -> None:
        x = point_of("center", center)
        check(POSITIVE, radius=radius)
        shape = shapes.Round(padded(x), float(radius), inside=False)
        super().__init__(shape, {"center": x, "radius": float(radius)})

    @classmethod
    def _fitted(cls, cloud: _Cloud) -> Sphere:
        start = np.append(*cloud.circle(cloud.x))
        gdim = cloud.x.shape[1]
        found = cloud.improved(start, "l" * (gdim + 1), lambda p: cls(p[:gdim], p[gdim]))
        return cls(found[:gdim], found[gdim])


class Cylinder(Smooth):
    """A circular cylinder of any length; in 2D a circle.

    Args:
        point: A point of the axis, shape (gdim,), gdim 2 or 3.
        axis: Direction of the axis, shape (3,), of any length; ignored in 2D.
        radius: Its radius (length).

    Raises:
        ValueError: If an argument has another shape or is not finite, the axis is zero, or the
            radius is not positive.
    """

    def __init__(self, point: npt.ArrayLike, axis: npt.ArrayLike | None, radius: float) -> None:
        x = point_of("point", point)
        a = None if len(x) == 2 else unit_vector("axis", axis, 3)
        check(POSITIVE, radius=radius)
        shape = shapes.Round(padded(x), float(radius), False, a)
        super().__init__(shape, {"point": x, "axis": a, "radius": float(radius)})

    @classmethod
    def _fitted(cls, cloud: _Cloud) -> Cylinder:
        if cloud.x.shape[1] == 2:
            circle = typing.cast(shapes.Round, Sphere._fitted(cloud).shape)
            return cls(circle.center[:2], None, circle.radius)
        n = cloud.normal
        axis = _axis_of(cloud.sum(n[:, :, None] * n[:, None]))
        plane = _across(axis)
        center, radius = cloud.circle(cloud.x @ plane)
        start = np.concatenate([plane @ center, axis, [radius]])
        found = cloud.improved(start, "lll111l", lambda p: cls(p[:3], p[3:6], p[6]))
        return cls(found[:3], found[3:6], found[6])


class Cone(Smooth):
    """A circular cone on one side of its apex; in 3D only.

    Args:
        apex: Apex, shape (3,).
        axis: Direction from the apex into the cone, shape (3,), of any length.
        half_angle: Angle between the axis and the cone, radians.

    Raises:
        ValueError: If an argument has another shape or is not finite, the axis is zero, or the
            angle is not between 0 and π/2.
    """

    def __init__(self, apex: npt.ArrayLike, axis: npt.ArrayLike, half_angle: float) -> None:
        x, a = _solid("apex", apex), unit_vector("axis", axis, 3)
        check(ACUTE, half_angle=half_angle)
        shape = shapes.Cone(x, a, float(half_angle))
        super().__init__(shape, {"apex": x, "axis": a, "half_angle": float(half_angle)})

    @classmethod
    def _fitted(cls, cloud: _Cloud) -> Cone:
        cloud.check_solid(cls)
        n, x = cloud.normal, cloud.x
        turned = n - cloud.sum(n) / cloud.count
        axis = _axis_of(cloud.sum(turned[:, :, None] * turned[:, None]))
        apex = cloud.solve(n, np.sum(n * x, axis=1))  # all tangent planes contain the apex
        axis = axis * np.sign(cloud.sum((x - apex) @ axis) or 1.0)
        _, away, along = shapes.around(x - apex, axis)
        angle = cloud.sum(np.arctan2(away, along)) / cloud.count
        start = np.concatenate([apex, axis, [np.clip(angle, 0.01, 1.56)]])
        found = cloud.improved(start, "lll1111", lambda p: cls(p[:3], p[3:6], p[6]))
        return cls(found[:3], found[3:6], found[6])


class Torus(Smooth):
    """A torus: a circular tube around an axis; in 3D only.

    Args:
        center: Centre, shape (3,).
        axis: Direction of the axis, shape (3,), of any length.
        radius: Radius of the circle in the middle of the tube (length).
        tube: Radius of the tube (length).

    Raises:
        ValueError: If an argument has another shape or is not finite, the axis is zero, or a radius
            is not positive.
    """

    def __init__(
        self, center: npt.ArrayLike, axis: npt.ArrayLike, radius: float, tube: float
    ) -> None:
        x, a = _solid("center", center), unit_vector("axis", axis, 3)
        check(POSITIVE, radius=radius, tube=tube)
        shape = shapes.Torus(x, a, float(radius), float(tube))
        radii = {"radius": float(radius), "tube": float(tube)}
        super().__init__(shape, {"center": x, "axis": a} | radii)

    @classmethod
    def _fitted(cls, cloud: _Cloud) -> Torus:
        cloud.check_solid(cls)
        point, axis = cloud.axis_of_revolution()
        _, away, along = shapes.around(cloud.x - point, axis)
        (radius, height), tube = cloud.circle(np.column_stack([away, along]))
        start = np.concatenate([point + height * axis, axis, [radius, tube]])
        found = cloud.improved(start, "lll111ll", lambda p: cls(p[:3], p[3:6], p[6], p[7]))
        return cls(found[:3], found[3:6], found[6], found[7])


class _Cloud:
    """Vertices of a surface and their normals, shape (n, gdim); only sums over them are needed."""

    def __init__(self, surface: Surface) -> None:
        self.comm = surface.comm
        self.x = surface.node_x[:, : surface.gdim]
        self.normal = surface.node_normal[:, : surface.gdim]
        self.count = int(self.comm.allreduce(len(self.x), op=MPI.SUM))
        #: Largest distance of a vertex from the mean (length).
        middle = self.sum(self.x) / self.count
        largest = np.max(np.linalg.norm(self.x - middle, axis=1), initial=0.0)
        self.size = float(self.comm.allreduce(largest, op=MPI.MAX))
        self._middle = middle

    def check_solid(self, kind: type[Smooth]) -> None:
        """Raise an error for 3D shapes if the surface is in 2D."""
        require(self.x.shape[1] == 3, f"surface: a {kind.__name__} needs a surface in 3D")

    def sum(self, values: Array) -> Array:
        """Sum over the points of all ranks. Collective."""
        total = np.atleast_1d(np.sum(values, axis=0))
        self.comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
        return total if values.ndim > 1 else total[0]

    def solve(self, rows: Array, right: Array) -> Array:
        """Least squares of rows · p = right. Collective."""
        matrix = self.sum(rows[:, :, None] * rows[:, None])
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix * np.outer(scale, scale)
        # Parameters that the points do not determine, such as the position of a cylinder along its
        # axis, are not changed.
        found = np.linalg.lstsq(scaled, scale * self.sum(rows * right[:, None]), rcond=1e-12)[0]
        return np.asarray(scale * found)

    def circle(self, x: Array) -> tuple[Array, float]:
        """Centre and radius of the circle or sphere with |x|² = 2 c·x + r² − |c|². Collective."""
        middle = self.sum(x) / self.count
        y = (x - middle) / self.size
        found = self.solve(np.column_stack([2 * y, np.ones(len(y))]), np.sum(y**2, axis=1))
        center = found[:-1]
        square = max(float(found[-1] + center @ center), 1e-20)
        return middle + self.size * center, self.size * float(np.sqrt(square))

    def axis_of_revolution(self) -> tuple[Array, Array]:
        """A point and the direction of the line that is closest to all normals. Collective."""
        x, n = (self.x - self._middle) / self.size, self.normal
        rows = np.column_stack([np.cross(x, n), n])  # times (a, p × a)
        matrix = self.sum(rows[:, :, None] * rows[:, None])
        inverse = np.linalg.pinv(matrix[3:, 3:])
        axis = _axis_of(matrix[:3, :3] - matrix[:3, 3:] @ inverse @ matrix[3:, :3])
        moment = -inverse @ matrix[3:, :3] @ axis
        return self._middle + self.size * np.cross(axis, moment), axis

    def improved(self, start: Array, units: str, made: typing.Callable[[Array], Smooth]) -> Array:
        """Parameters with the least sum of squared distances, by Gauss-Newton. Collective.

        Args:
            start: Initial parameters.
            units: Unit of each parameter: "l" is a length, "1" has no unit.
            made: Creates the shape with given parameters.
        """
        x = np.zeros((len(self.x), 3))
        x[:, : self.x.shape[1]] = self.x
        lengths = np.array([self.size if unit == "l" else 1.0 for unit in units])
        best, least = start, np.inf
        p = start
        for _ in range(ITERATIONS):
            try:
                distance = made(p).shape.distance(x)[0]
            except ValueError:  # a negative radius, say
                break
            square = float(self.sum(distance**2))
            if not square < least:
                break
            best, least = p, square
            p = p - self.solve(_derivative(p, lengths, made, x), distance)
        return np.asarray(self.comm.bcast(best))


#: Largest number of iterations of the Gauss-Newton method, which ends when the sum of squares no
#: longer decreases. With few, shapes are not those of the vertices.
ITERATIONS = 30


def _derivative(
    p: Array, lengths: Array, made: typing.Callable[[Array], Smooth], x: Array
) -> Array:
    """Derivatives of the distances from a shape by its parameters, by central differences."""
    columns = []
    for i, length in enumerate(lengths):
        step = np.zeros_like(p)
        step[i] = 1e-6 * length
        ends = [made(p + sign * step).shape.distance(x)[0] for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2e-6 * length))
    return np.stack(columns, axis=1)


def _axis_of(matrix: Array) -> Array:
    """Eigenvector of the smallest eigenvalue of a symmetric matrix."""
    return np.asarray(np.linalg.eigh(matrix)[1][:, 0])


def _across(axis: Array) -> Array:
    """Two unit vectors orthogonal to an axis and to each other, shape (3, 2)."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


def _solid(name: str, value: npt.ArrayLike) -> Array:
    x = point_of(name, value)
    require(len(x) == 3, f"{name}: must be of the shape (3,), not ({len(x)},)")
    return x


def _plain(value: typing.Any) -> typing.Any:
    return value.tolist() if isinstance(value, np.ndarray) else value
