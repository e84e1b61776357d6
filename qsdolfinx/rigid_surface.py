"""Rigid tools: surfaces without unknowns that deformable bodies are pressed against."""

from __future__ import annotations

import os
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from qsdolfinx import _cpp, triangulation
from qsdolfinx.checks import check_positive, check_vector
from qsdolfinx.collective import check_agreement, collective_errors
from qsdolfinx.motion import Affine, rotation_about, rotation_matrix
from qsdolfinx.shapes import Plane, Round, Shape
from qsdolfinx.triangulation import Facets

Array = npt.NDArray[np.float64]


class Driven(typing.NamedTuple):
    """A force that drives a tool.

    Attributes:
        force: Force (in 2D per length) with which the tool is pushed along the direction.
        direction: Unit vector, shape (gdim,).
    """

    force: float
    direction: Array


class RigidSurface:
    """Surface of a rigid tool, the master of a contact.

    A tool has no unknowns and adds none to the matrix. Make one with :meth:`plane`,
    :meth:`cylinder`, :meth:`sphere`, :meth:`triangulated`, :meth:`from_stl` or :meth:`from_mesh`.

    What it does in the next solve is said by :attr:`displacement` and :attr:`rotation`: contact
    sees the tool displaced by x ↦ displacement + (R − 1)(x − center), R being the finite rotation,
    while points and normals stay as they were paired (small sliding). :meth:`advance` moves the
    tool there for good; ``contact.update()`` has to follow.

    With :meth:`drive`, a force takes the place of the displacement in one direction.

    A tool may be part of several contacts. All its state must be the same on all ranks.
    """

    def __init__(self, comm: MPI.Intracomm, center: Array, shape: Shape | Facets) -> None:
        self._comm = comm
        self._center = np.asarray(center, dtype=np.float64)
        self._shape = shape
        gdim = len(self._center)
        self._matrix: Array = np.eye(gdim)
        self._shift: Array = np.zeros(gdim)
        self._displacement: Array = np.zeros(gdim)
        self._rotation: Array = np.zeros(1 if gdim == 2 else 3)
        self._driven: Driven | None = None
        self._surface: _cpp.Surface | None = None
        #: Counts the positions that the tool has had.
        self.version = 0

    # --- Shapes

    @classmethod
    def plane(
        cls, comm: MPI.Intracomm, point: npt.ArrayLike, normal: npt.ArrayLike
    ) -> RigidSurface:
        """A tool that ends in a plane (2D: a line). Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            point: A point of the plane, shape (gdim,), gdim 2 or 3.
            normal: From the tool to the workpiece, shape (gdim,), of any length.

        Raises:
            ValueError: If an argument has another shape, is not finite or differs between ranks, or
                the normal is zero.
        """
        with collective_errors(comm):
            x = _point("point", point)
            n = _unit("normal", normal, len(x))
        check_agreement(comm, point=x.tolist(), normal=n.tolist())
        return cls(comm, x, Plane(_padded(x), _padded(n)))

    @classmethod
    def cylinder(
        cls,
        comm: MPI.Intracomm,
        point: npt.ArrayLike,
        axis: npt.ArrayLike | None,
        radius: float,
        inside: bool = False,
    ) -> RigidSurface:
        """A circular cylinder of any length; in 2D a circle. Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            point: A point of the axis, shape (gdim,), gdim 2 or 3.
            axis: Direction of the axis, shape (3,), of any length; not looked at in 2D.
            radius: Radius (length).
            inside: Whether the workpiece is inside of it; the tool is then all that is outside.

        Raises:
            ValueError: If an argument has another shape, is not finite or differs between ranks, or
                the axis is zero, or the radius is not positive.
        """
        with collective_errors(comm):
            x = _point("point", point)
            check_positive("radius", radius)
            a = None if len(x) == 2 else _unit("axis", axis, 3)
        axis_list = None if a is None else a.tolist()
        check_agreement(comm, point=x.tolist(), axis=axis_list, radius=radius, inside=inside)
        return cls(comm, x, Round(_padded(x), float(radius), bool(inside), a))

    @classmethod
    def sphere(
        cls, comm: MPI.Intracomm, center: npt.ArrayLike, radius: float, inside: bool = False
    ) -> RigidSurface:
        """A ball; in 2D a circle. Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            center: Centre, shape (gdim,), gdim 2 or 3.
            radius: Radius (length).
            inside: Whether the workpiece is inside of it; the tool is then all that is outside.

        Raises:
            ValueError: If an argument has another shape, is not finite or differs between ranks, or
                the radius is not positive.
        """
        with collective_errors(comm):
            x = _point("center", center)
            check_positive("radius", radius)
        check_agreement(comm, center=x.tolist(), radius=radius, inside=inside)
        return cls(comm, x, Round(_padded(x), float(radius), bool(inside)))

    @classmethod
    def triangulated(
        cls,
        comm: MPI.Intracomm,
        x: npt.ArrayLike | None,
        triangles: npt.ArrayLike | None,
        center: npt.ArrayLike | None = None,
    ) -> RigidSurface:
        """A tool with a surface of triangles (2D: line segments). Collective.

        Rank 0's arrays count: others pass the same, or None. Facets are spread over the ranks.

        Args:
            comm: Communicator of the bodies' meshes.
            x: Vertices, shape (vertices, gdim), gdim 2 or 3 (length).
            triangles: Indices of the vertices of each facet, shape (facets, gdim). Seen from the
                workpiece they run counter-clockwise; in 2D, the tool is to the left of a segment.
            center: What the tool is rotated about, shape (gdim,); by default the mean vertex.

        Raises:
            ValueError: If an array has another shape, is not finite, differs between ranks, or an
                index is out of range, or a facet has no area, or neighbours are oriented in
                opposite ways.
        """
        facets, mean = triangulation.scatter(comm, x, triangles)
        return cls(comm, _center(comm, center, mean), facets)

    @classmethod
    def from_stl(
        cls,
        comm: MPI.Intracomm,
        filename: str | os.PathLike[str],
        center: npt.ArrayLike | None = None,
    ) -> RigidSurface:
        """A tool from an STL file, ASCII or binary, read by rank 0. Collective.

        Vertices with equal coordinates are one. Orientation is that of the vertices; normals in the
        file are not looked at.

        Args:
            comm: Communicator of the bodies' meshes.
            filename: The file.
            center: What the tool is rotated about, shape (3,); by default the mean vertex.

        Raises:
            ValueError: If the file cannot be read or is no STL file, or as :meth:`triangulated`.
        """
        x, triangles = None, None
        with collective_errors(comm):
            if comm.rank == 0:
                x, triangles = triangulation.read_stl(filename)
        return cls.triangulated(comm, x, triangles, center)

    @classmethod
    def from_mesh(
        cls,
        msh: mesh.Mesh,
        inside: npt.ArrayLike | None = None,
        center: npt.ArrayLike | None = None,
    ) -> RigidSurface:
        """A tool from a surface mesh, whose cells stay on the ranks that own them. Collective.

        Args:
            msh: Mesh of first order and of topological dimension gdim − 1. Its communicator is that
                of the bodies' meshes.
            inside: A point of the tool, shape (gdim,), that all cells are turned away from; it must
                see all of them from behind. By default the cells are oriented as in
                :meth:`triangulated`, which those of a sub-mesh of facets are not.
            center: What the tool is rotated about, shape (gdim,); by default the mean vertex.

        Raises:
            TypeError: If it is no mesh.
            ValueError: If the mesh has another dimension or order, is not finite, a cell has no
                area, or neighbours are oriented in opposite ways.
        """
        if not isinstance(msh, mesh.Mesh):
            raise TypeError(f"msh: must be a dolfinx.mesh.Mesh, not {type(msh).__name__}")
        facets, mean = triangulation.of_mesh(msh, inside)
        return cls(msh.comm, _center(msh.comm, center, mean), facets)

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the tool."""
        return self._comm

    @property
    def gdim(self) -> int:
        """Geometric dimension, 2 or 3."""
        return len(self._center)

    @property
    def is_analytic(self) -> bool:
        """Whether the shape is known in closed form; else it is made of facets."""
        return isinstance(self._shape, Shape)

    @property
    def num_facet_vertices(self) -> int:
        """Vertices of a facet.

        Raises:
            ValueError: If the shape is analytic.
        """
        return int(self._facets.x.shape[1])

    @property
    def facet_size_range(self) -> tuple[float, float]:
        """Smallest and largest facet size. Collective.

        Raises:
            ValueError: If the shape is analytic.
        """
        low, high = self._cpp_object.facet_size_range
        return float(low), float(high)

    def distance(self, x: npt.ArrayLike) -> tuple[Array, Array]:
        """Signed distances from the tool where it is now, and its outward normals there.

        Args:
            x: Points, shape (n, 3).

        Returns:
            Distances, positive outside of the tool, shape (n,), and unit normals, shape (n, 3).

        Raises:
            ValueError: If the shape is not analytic.
        """
        if not isinstance(self._shape, Shape):
            raise ValueError("distance: is known in closed form for analytic shapes only")
        R, t = self._embedded
        distance, normal = self._shape.distance((np.asarray(x, dtype=np.float64) - t) @ R)
        return distance, normal @ R.T

    # --- Motion

    @property
    def displacement(self) -> Array:
        """Translation over the coming step (length), shape (gdim,)."""
        return self._displacement

    @displacement.setter
    def displacement(self, value: npt.ArrayLike) -> None:
        self._displacement = check_vector("displacement", value, self.gdim)

    @property
    def rotation(self) -> Array:
        """Rotation about :attr:`center` over the coming step, radians.

        In 2D an angle, counter-clockwise, shape (1,); in 3D a rotation vector, shape (3,).
        """
        return self._rotation

    @rotation.setter
    def rotation(self, value: npt.ArrayLike) -> None:
        value = np.atleast_1d(np.asarray(value, dtype=np.float64))
        self._rotation = check_vector("rotation", value, len(self._rotation))

    @property
    def center(self) -> Array:
        """The point of the tool that it is rotated about, where it is now, shape (gdim,)."""
        return np.asarray(self._matrix @ self._center + self._shift)

    @property
    def motion(self) -> Affine:
        """Displacement field of the coming step."""
        R = rotation_matrix(self._rotation)
        return rotation_about(R, self.center, self._displacement)

    def advance(self) -> None:
        """Move the tool for good by its displacement and rotation, and set these to zero.

        Call ``contact.update()`` next: it pairs with the new position.
        """
        A, b = self.motion
        step = A + np.eye(self.gdim)
        self.position = np.column_stack([step @ self._matrix, step @ self._shift + b])
        self._displacement = np.zeros_like(self._displacement)
        self._rotation = np.zeros_like(self._rotation)

    @property
    def position(self) -> Array:
        """Where the tool is: [R | t], shape (gdim, gdim + 1); x₀ has gone to R x₀ + t.

        It can be set, to go on from a checkpoint; ``contact.update()`` has to follow.
        """
        return np.column_stack([self._matrix, self._shift])

    @position.setter
    def position(self, value: npt.ArrayLike) -> None:
        d = self.gdim
        position = np.array(value, dtype=np.float64)
        if position.shape != (d, d + 1) or not np.isfinite(position).all():
            raise ValueError(f"position: must be finite, of shape ({d}, {d + 1})")
        R = position[:, :d]
        if np.abs(R @ R.T - np.eye(d)).max() > 1e-6 or np.linalg.det(R) < 0:
            raise ValueError("position: the first columns must be a rotation")
        U, _, V = np.linalg.svd(R)  # many steps would let rounding errors grow
        self._matrix, self._shift = U @ V, position[:, d].copy()
        self._surface = None
        self.version += 1

    # --- Force

    def drive(self, force: float, direction: npt.ArrayLike) -> None:
        """Push the tool with a force, instead of a prescribed displacement, in the next solves.

        A solve finds the displacement along the direction for which the contact forces balance
        this one: ``contact.force("master") @ direction == -force``, to 1e-8 of the force.
        :attr:`displacement` holds it afterwards; the other components stay prescribed.

        Args:
            force: Force, in 2D per length; negative values pull, which only tied contact can hold.
            direction: Vector of any length, shape (gdim,).

        Raises:
            ValueError: If the force is zero or not finite, or the direction is zero or has another
                shape.
        """
        number = float(check_vector("force", [force], 1)[0])
        if number == 0:
            raise ValueError("force: must not be zero; use a tool that is not in contact instead")
        self._driven = Driven(number, _unit("direction", direction, self.gdim))

    def release(self) -> None:
        """Prescribe all of the displacement again."""
        self._driven = None

    @property
    def driven(self) -> Driven | None:
        """The force that drives the tool, None if its displacement is prescribed."""
        return self._driven

    # --- For contacts

    def check_state(self) -> None:
        """Refuse a motion or force that is not finite or differs between ranks. Collective.

        Raises:
            ValueError: With the name of what is wrong.
        """
        with collective_errors(self.comm):
            self.displacement = self._displacement
            self.rotation = self._rotation
        force, direction = (None, None) if self._driven is None else self._driven
        check_agreement(
            self.comm,
            displacement=self._displacement.tolist(),
            rotation=self._rotation.tolist(),
            position=self.position.tolist(),
            force=force,
            direction=None if direction is None else direction.tolist(),
        )

    @property
    def _cpp_object(self) -> _cpp.Surface:
        """The facets where they are now. Collective after a change of position."""
        if self._surface is None:
            R, t = self._embedded
            self._surface = self._facets.surface(self.comm, self.gdim, R, t)
        return self._surface

    @property
    def _facets(self) -> Facets:
        if not isinstance(self._shape, Facets):
            raise ValueError("an analytic shape has no facets")
        return self._shape

    @property
    def _embedded(self) -> tuple[Array, Array]:
        """Rotation and translation of the position, in three dimensions."""
        R = np.eye(3)
        R[: self.gdim, : self.gdim] = self._matrix
        return R, _padded(self._shift)


def _padded(x: Array) -> Array:
    return np.append(x, np.zeros(3 - len(x)))


def _point(name: str, value: npt.ArrayLike) -> Array:
    return check_vector(name, value, 3 if np.size(np.asarray(value, dtype=object)) == 3 else 2)


def _unit(name: str, value: npt.ArrayLike | None, size: int) -> Array:
    vector = check_vector(name, value, size)
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise ValueError(f"{name}: must not be zero")
    return np.asarray(vector / length)


def _center(comm: MPI.Intracomm, given: npt.ArrayLike | None, mean: Array) -> Array:
    with collective_errors(comm):
        center = mean if given is None else check_vector("center", given, len(mean))
    check_agreement(comm, center=center.tolist())
    return center
