"""Rigid tools: surfaces without unknowns that deformable bodies are pressed against."""

from __future__ import annotations

import dataclasses
import os
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import (
    FINITE,
    FLAG,
    MESH,
    PATH,
    POSITIVE,
    check,
    check_array,
    check_vector,
    instance,
    require,
)
from qsdolfinx.base.collective import checked, checked_once
from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.surface.affine import Affine, rotation_about, rotation_matrix, rotation_vector
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools import triangulation
from qsdolfinx.tools.driven import Driven
from qsdolfinx.tools.facet_surface import FacetSurface
from qsdolfinx.tools.pose import Pose, padded, point_of, unit_vector
from qsdolfinx.tools.shapes import Plane, Round, Shape
from qsdolfinx.tools.shells import Shells
from qsdolfinx.tools.stl import read_stl
from qsdolfinx.tools.triangulation import Facets

Array = npt.NDArray[np.float64]

COMMUNICATOR = instance(MPI.Intracomm, "a communicator of mpi4py")


class ToolState(typing.NamedTuple):
    """Where a tool is, and what it is to do next.

    Attributes:
        pose: Where it is.
        version: Number of this position.
        displacement: Translation over the coming step.
        rotation: Rotation over the coming step.
        driven: The force that drives it.
    """

    pose: Pose
    version: int
    displacement: Array
    rotation: Array
    driven: Driven | None


class RigidSurface:
    """Surface of a rigid tool, the master of a contact.

    A tool has no unknowns and adds none to the matrix. Make one with :meth:`plane`,
    :meth:`cylinder`, :meth:`sphere`, :meth:`triangulated`, :meth:`from_stl` or :meth:`from_mesh`.

    What it does in the next solve is set by :attr:`displacement` and :attr:`rotation`: contact
    sees the tool displaced by x ↦ displacement + (R − 1)(x − center), R being the finite rotation,
    while points and normals stay as they were paired (small sliding). :meth:`advance` makes the
    motion permanent; ``contact.update()`` has to follow.

    With :meth:`drive`, a force takes the place of the displacement in one direction.

    A tool may be part of several contacts. Its motion, position and force are set on all ranks, to
    the same values; what any rank finds wrong is raised on all of them.

    Attributes:
        version: Number of the position that the tool is at; a new one has a number that none has
            had.
    """

    def __init__(self, comm: MPI.Intracomm, center: Array, shape: Shape | Facets) -> None:
        self._comm = comm
        self._center = np.asarray(center, dtype=np.float64)
        self._pose = Pose.at_rest(len(self._center))
        self._displacement: Array = np.zeros(self.gdim)
        self._rotation: Array = np.zeros(1 if self.gdim == 2 else 3)
        self._driven: Driven | None = None
        self.version = 0
        self._num_positions = 0
        self._shape = shape
        self._surface: tuple[tuple[int, bool], _cpp.Surface] | None = None
        self._shells: Shells | None = None

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
        check(COMMUNICATOR, comm=comm)
        with checked(comm) as same:
            x = point_of("point", point)
            n = unit_vector("normal", normal, len(x))
            same(point=x, normal=n)
        return cls(comm, x, Plane(padded(x), padded(n)))

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
            axis: Direction of the axis, shape (3,), of any length; ignored in 2D.
            radius: Radius (length).
            inside: Whether the workpiece is inside of it; the tool is then all that is outside.

        Raises:
            ValueError: If an argument has another shape, is not finite or differs between ranks, or
                the axis is zero, or the radius is not positive.
        """
        check(COMMUNICATOR, comm=comm)
        with checked(comm) as same:
            x = point_of("point", point)
            a = None if len(x) == 2 else unit_vector("axis", axis, 3)
            same(point=x, axis=a)
            same(POSITIVE, radius=radius)
            same(FLAG, inside=inside)
        return cls(comm, x, Round(padded(x), float(radius), bool(inside), a))

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
        check(COMMUNICATOR, comm=comm)
        with checked(comm) as same:
            x = point_of("center", center)
            same(center=x)
            same(POSITIVE, radius=radius)
            same(FLAG, inside=inside)
        return cls(comm, x, Round(padded(x), float(radius), bool(inside)))

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
        check(COMMUNICATOR, comm=comm)
        facets, middle = triangulation.scatter(comm, x, triangles, center)
        return cls(comm, middle, facets)

    @classmethod
    def from_stl(
        cls,
        comm: MPI.Intracomm,
        filename: str | os.PathLike[str],
        center: npt.ArrayLike | None = None,
    ) -> RigidSurface:
        """A tool from an STL file, ASCII or binary, read by rank 0. Collective.

        Vertices with equal coordinates are one. Orientation is that of the vertices; normals in the
        file are ignored. All solids of a file are one tool; they may share edges and walls.
        Triangles without area are left out.

        Args:
            comm: Communicator of the bodies' meshes.
            filename: The file.
            center: What the tool is rotated about, shape (3,); by default the mean vertex.

        Raises:
            TypeError: If it is no path.
            ValueError: If the file cannot be read, is no STL file or truncated, or as
                :meth:`triangulated`.

        Warns:
            ContactWarning: If triangles without area are left out.
        """
        stl = None
        check(COMMUNICATOR, comm=comm)
        with checked(comm):
            if comm.rank == 0:
                check(PATH, filename=filename)
                stl = read_stl(filename)
        advice = comm.bcast("" if stl is None else stl.advice, root=0)
        if advice:
            warn(advice, ContactWarning)
        x, triangles = (None, None) if stl is None else (stl.x, stl.triangles)
        name = f"filename: {os.fspath(filename)!r}"
        facets, middle = triangulation.scatter(comm, x, triangles, center, name)
        return cls(comm, middle, facets)

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
        check(MESH, msh=msh)
        facets, middle = triangulation.of_mesh(msh, inside, center)
        return cls(msh.comm, middle, facets)

    @property
    def V(self) -> None:
        """There is no space of unknowns."""
        return None

    @property
    def cpp_object(self) -> None:
        """The extension has no surface with unknowns for it."""
        return None

    @property
    def degree(self) -> int:
        """Degree of the trace of its displacement: 0, as there is none."""
        return 0

    @property
    def is_analytic(self) -> bool:
        """Whether the shape is known in closed form; else it is made of facets."""
        return isinstance(self._shape, Shape)

    @property
    def is_plane(self) -> bool:
        """Whether the shape is a plane in closed form."""
        return isinstance(self._shape, Plane)

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
        low, high = self.facets().facet_size_range
        return float(low), float(high)

    def distance(
        self, x: npt.ArrayLike, position: npt.ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Signed distances from the tool, and its outward normals there.

        Args:
            x: Points, shape (n, 3).
            position: Where the tool is, as :attr:`position`, which is the default.

        Returns:
            Distances, positive outside of the tool, shape (n,), and unit normals, shape (n, 3).

        Raises:
            ValueError: If the shape is not analytic.
        """
        if not isinstance(self._shape, Shape):
            raise ValueError("distance: is known in closed form for analytic shapes only")
        R, t = self._pose_of(position).embedded
        points = check_array("x", x, (None, 3))
        distance, normal = self._shape.distance((points - t) @ R)
        return distance, normal @ R.T

    def curvature(self, x: npt.ArrayLike, position: npt.ArrayLike | None = None) -> Array:
        """Derivatives of its normals by the points, shape (n, 3, 3), as :meth:`distance`."""
        if not isinstance(self._shape, Shape):
            raise ValueError("curvature: is known in closed form for analytic shapes only")
        R, t = self._pose_of(position).embedded
        points = check_array("x", x, (None, 3))
        return np.asarray(R @ self._shape.curvature((points - t) @ R) @ R.T)

    def facets(self, axisymmetric: bool = False) -> _cpp.Surface:
        """The extension's surface where it is now. Collective after a change of position.

        Args:
            axisymmetric: Whether facets stand for rings.

        Raises:
            ValueError: If the shape is analytic.
        """
        state = self.version, axisymmetric
        if self._surface is None or self._surface[0] != state:
            R, t = self._pose.embedded
            surface = self._facets.surface(self.comm, self.gdim, R, t, axisymmetric)
            self._surface = state, surface
        return self._surface[1]

    def as_facets(self, axisymmetric: bool = False) -> FacetSurface:
        """Its facets where it is now, read as those of a body. Collective if its position changed.

        Args:
            axisymmetric: Whether facets stand for rings.

        Raises:
            ValueError: If the shape is analytic.
        """
        surface, facets = self.facets(axisymmetric), self._facets
        x = np.asarray(surface.facet_x)
        return FacetSurface(
            self.comm,
            self.gdim,
            surface,
            (x, facets.behind(x), None),
            (facets.dofs(self.gdim), facets.owner),
            facets.num_owned * self.gdim,
        )

    def twin(self, axisymmetric: bool) -> _cpp.Surface:
        """New object of the extension with the tool's facets, to be moved by itself. Collective.

        Args:
            axisymmetric: Whether facets stand for rings.

        Raises:
            ValueError: If the shape is analytic.
        """
        R, t = self._pose.embedded
        return self._facets.surface(self.comm, self.gdim, R, t, axisymmetric)

    def facet_positions(self, position: npt.ArrayLike) -> Array:
        """Vertices of this rank's facets with the tool elsewhere, shape (facets, vertices, 3).

        Args:
            position: As :attr:`position`.
        """
        R, t = self._pose_of(position).embedded
        return np.asarray(self._facets.x @ R.T + t)

    def facets_at(self, position: npt.ArrayLike) -> _cpp.Surface:
        """The extension's surface with the tool elsewhere, as :attr:`position`. Collective.

        Raises:
            ValueError: If the shape is analytic.
        """
        R, t = self._pose_of(position).embedded
        return self._facets.surface(self.comm, self.gdim, R, t, False)

    def _pose_of(self, position: npt.ArrayLike | None) -> Pose:
        return self._pose if position is None else Pose.from_matrix(position, self.gdim)

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the tool."""
        return self._comm

    @property
    def gdim(self) -> int:
        """Geometric dimension, 2 or 3."""
        return len(self._center)

    # --- Motion

    @property
    def displacement(self) -> Array:
        """Translation over the coming step (length), shape (gdim,)."""
        return self._displacement

    @displacement.setter
    def displacement(self, value: npt.ArrayLike) -> None:
        with checked_once(self.comm) as same:
            displacement = check_vector("displacement", value, self.gdim)
            same(displacement=displacement)
        self._displacement = displacement

    @property
    def rotation(self) -> Array:
        """Rotation about :attr:`center` over the coming step, radians.

        In 2D an angle, counter-clockwise, shape (1,); in 3D a rotation vector, shape (3,).
        """
        return self._rotation

    @rotation.setter
    def rotation(self, value: npt.ArrayLike) -> None:
        size = len(self._rotation)
        with checked_once(self.comm) as same:
            vector = [value] if np.isscalar(value) else value
            rotation = check_vector("rotation", vector, size)
            same(rotation=rotation)
        self._rotation = rotation

    @property
    def center(self) -> Array:
        """The point of the tool that it is rotated about, where it is now, shape (gdim,)."""
        return self._pose(self._center)

    def center_at(self, position: npt.ArrayLike) -> Array:
        """The same where the tool is at this :attr:`position`."""
        return self._pose_of(position)(self._center)

    @property
    def motion(self) -> Affine:
        """Displacement field of the coming step."""
        R = rotation_matrix(self._rotation)
        return rotation_about(R, self.center, self._displacement)

    def advance(self) -> None:
        """Make displacement and rotation permanent: move the tool, and set them to zero.

        Call ``contact.update()`` next: it pairs with the new position. A tie needs no update.
        """
        self._place(Pose.from_matrix(self._pose.moved(self.motion), self.gdim))
        self._displacement = np.zeros_like(self._displacement)
        self._rotation = np.zeros_like(self._rotation)

    def go_ahead(self, displacement: Array, rotation: Array) -> None:
        """Make a motion permanent; :attr:`displacement` and :attr:`rotation` are what is left.

        Args:
            displacement: Translation (length), shape (gdim,).
            rotation: Rotation about :attr:`center`, as :attr:`rotation`.
        """
        d, R = self._displacement, rotation_matrix(self._rotation)
        self._displacement, self._rotation = displacement, rotation
        self._place(Pose.from_matrix(self._pose.moved(self.motion), self.gdim))
        self._displacement = d - displacement
        self._rotation = rotation_vector(R @ rotation_matrix(rotation).T)

    @property
    def position(self) -> Array:
        """Where the tool is: [R | t], shape (gdim, gdim + 1); x₀ has gone to R x₀ + t.

        It can be set, to continue from a checkpoint; ``contact.update()`` has to follow.
        """
        return self._pose.matrix

    @position.setter
    def position(self, value: npt.ArrayLike) -> None:
        with checked_once(self.comm) as same:
            pose = Pose.from_matrix(value, self.gdim)
            same(position=pose.matrix)
        self._place(pose)

    def _place(self, pose: Pose) -> None:
        self._pose = pose
        self._num_positions += 1
        self.version = self._num_positions

    @property
    def state(self) -> ToolState:
        """All that changes, to be put back by :meth:`restore`."""
        motion = self._displacement.copy(), self._rotation.copy()
        return ToolState(self._pose, self.version, *motion, self._driven)

    def restore(self, state: ToolState) -> None:
        """Put back what :attr:`state` gave: contacts that were paired there still are."""
        self._pose, self.version = state.pose, state.version
        self._displacement, self._rotation = state.displacement.copy(), state.rotation.copy()
        self._driven = state.driven

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
        with checked_once(self.comm) as same:
            check(FINITE, force=force)
            require(force, "force: must not be zero; use a tool that is not in contact instead")
            driven = Driven(float(force), unit_vector("direction", direction, self.gdim))
            same(force=driven.force, direction=driven.direction)
        self._driven = driven

    def drive_moment(self, moment: float, axis: npt.ArrayLike | None = None) -> None:
        """Turn the tool with a moment, instead of a prescribed rotation, in the next solves.

        A solve finds the angle about the axis through :attr:`center` for which the contact forces
        do as much work as the moment, to 1e-8. They act where contact has paired: for small angles
        ``contact.moment("master", tool.center) @ axis`` is minus the moment, up to what arms change
        in the step. :attr:`rotation` holds the angle afterwards; the displacement stays prescribed.
        It takes the place of a force.

        Args:
            moment: Moment, in 2D per length and counter-clockwise.
            axis: Vector of any length, shape (3,); None in 2D.

        Raises:
            ValueError: If the moment is zero or not finite, or the axis is zero or has another
                shape, or is given in 2D.
        """
        with checked_once(self.comm) as same:
            check(FINITE, moment=moment)
            require(moment, "moment: must not be zero; use release to prescribe the rotation")
            require(self.gdim == 3 or axis is None, "axis: there is one alone in 2D: give None")
            along = np.ones(1) if self.gdim == 2 else unit_vector("axis", axis, 3)
            driven = Driven(float(moment), along, turns=True)
            same(moment=driven.force, axis=driven.direction)
        self._driven = driven

    def release(self) -> None:
        """Prescribe all of the displacement and rotation again."""
        self._driven = None

    @property
    def driven(self) -> Driven | None:
        """The force or moment that drives the tool, None if its motion is prescribed."""
        return self._driven

    @property
    def driven_motion(self) -> Affine:
        """How places of the tool move with what is driven: a length, or an angle."""
        assert self._driven is not None
        return self._driven.field(self._rotation, self.center)

    @property
    def driven_curvature(self) -> Affine | None:
        """The second derivative; None for 0."""
        assert self._driven is not None
        return self._driven.curvature(self._rotation, self.center)

    def move_driven(self, start: tuple[Array, Array], s: float) -> None:
        """Go on by a length or an angle from a displacement and a rotation."""
        assert self._driven is not None
        self._displacement, self._rotation = self._driven.moved(*start, s)

    # --- For contacts

    def create_vec(self) -> None:
        """There are no unknowns."""
        return None

    def shape_degree(self, order: int) -> int:
        """Total polynomial degree of Lagrange functions of this order on its facets; 0 without."""
        if self.is_analytic:
            return 0
        return order * (2 if self.num_facet_vertices == 4 else 1)

    def search_object(self, slave: Surface) -> _cpp.Surface:
        """Its facets as pairing from a slave sees them: rings where the slave's are."""
        return self.facets(slave.axisymmetric)

    def shells(self) -> Shells:
        """Connected shells of its facets. Collective at first.

        Raises:
            ValueError: If the shape is analytic.
        """
        if self._shells is None:
            self._shells = Shells(self.comm, self._facets)
        return self._shells

    def check_state(self) -> None:
        """Refuse a motion or force that is not finite or differs between ranks. Collective.

        Raises:
            ValueError: With the name of what is wrong.
        """
        driven = None if self._driven is None else dataclasses.astuple(self._driven)
        force, direction, turns = driven or (None, None, None)
        with checked(self.comm) as same:
            check_vector("displacement", self._displacement, self.gdim)
            check_vector("rotation", self._rotation, len(self._rotation))
            same(displacement=self._displacement, rotation=self._rotation, position=self.position)
            same(force=force, direction=direction, turns=turns)

    @property
    def _facets(self) -> Facets:
        if not isinstance(self._shape, Facets):
            raise ValueError("an analytic shape has no facets")
        return self._shape


#: Either side of a contact.
AnySurface = Surface | RigidSurface


def as_tool(surface: AnySurface) -> RigidSurface | None:
    """The surface if it is a rigid tool."""
    return surface if isinstance(surface, RigidSurface) else None


def deformable(surface: AnySurface) -> Surface | None:
    """The surface if it has unknowns."""
    return surface if isinstance(surface, Surface) else None
