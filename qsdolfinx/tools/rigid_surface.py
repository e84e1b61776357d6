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
from qsdolfinx.tools.shapes import Plane, Round, ToolShape
from qsdolfinx.tools.shells import Shells
from qsdolfinx.tools.stl import read_stl
from qsdolfinx.tools.triangulation import Facets

Array = npt.NDArray[np.float64]

COMMUNICATOR = instance(MPI.Intracomm, "a communicator of mpi4py")


#: Attributes that are listed by ``dir`` and tab completion.
PUBLIC = (
    "advance",
    "center",
    "comm",
    "cylinder",
    "displacement",
    "distance",
    "drive",
    "drive_moment",
    "driven",
    "from_mesh",
    "from_stl",
    "gdim",
    "plane",
    "position",
    "release",
    "rotation",
    "sphere",
    "triangulated",
    "version",
)


class ToolState(typing.NamedTuple):
    """Position of a tool, and its prescribed motion in the next step.

    Attributes:
        pose: Position of the tool.
        version: Number of this position.
        displacement: Translation over the coming step.
        rotation: Rotation over the coming step.
        driven: The prescribed force or moment, None if there is none.
        made: Rotation of the coming step that ``go_ahead`` has made already.
    """

    pose: Pose
    version: int
    displacement: Array
    rotation: Array
    driven: Driven | None
    made: Array


class RigidSurface:
    """Surface of a rigid tool, the master of a contact.

    A tool has no unknowns and adds none to the matrix. Make a tool with :meth:`plane`,
    :meth:`cylinder`, :meth:`sphere`, :meth:`triangulated`, :meth:`from_stl` or :meth:`from_mesh`.

    :attr:`displacement` and :attr:`rotation` prescribe the motion of the tool in the next solve:
    contact is evaluated with the tool displaced by x ↦ displacement + (R − 1)(x − center), where R
    is the finite rotation. With small sliding, contact quadrature points and normals stay those of
    the last contact detection. :meth:`advance` makes the motion permanent; ``contact.update()`` has
    to follow.

    With :meth:`drive`, the tool is force-controlled in one direction: a force is prescribed instead
    of the displacement.

    A tool may be part of several contacts. Set its motion, position and force on all ranks, to the
    same values; an error on any rank is raised on all ranks.

    Attributes:
        version: Number of the present position of the tool; every new position has a new number.
    """

    def __init__(self, comm: MPI.Intracomm, center: Array, shape: ToolShape | Facets) -> None:
        self._comm = comm
        self._center = np.asarray(center, dtype=np.float64)
        self._pose = Pose.at_rest(len(self._center))
        self._displacement: Array = np.zeros(self.gdim)
        self._rotation: Array = np.zeros(1 if self.gdim == 2 else 3)
        self._made: Array = np.zeros_like(self._rotation)
        self._driven: Driven | None = None
        self.version = 0
        self._num_positions = 0
        self._shape = shape
        self._surface: tuple[tuple[int, bool], _cpp.Surface] | None = None
        self._shells: Shells | None = None

    def __dir__(self) -> list[str]:
        """Attributes for users; the others are for the library: docs/api/extending.md."""
        return list(PUBLIC)

    # --- Shapes

    @classmethod
    def plane(
        cls, comm: MPI.Intracomm, point: npt.ArrayLike, normal: npt.ArrayLike
    ) -> RigidSurface:
        """Make a tool that is bounded by a plane (2D: a line). Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            point: A point of the plane, shape (gdim,), gdim 2 or 3.
            normal: Normal that points from the tool to the workpiece, shape (gdim,), of any length.

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
        """Make an infinitely long circular cylinder; in 2D a circle. Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            point: A point of the axis, shape (gdim,), gdim 2 or 3.
            axis: Direction of the axis, shape (3,), of any length; ignored in 2D.
            radius: Radius (length).
            inside: Whether the workpiece is inside the cylinder; the tool is then everything
                outside of it.

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
        """Make a sphere; in 2D a circle. Collective.

        Args:
            comm: Communicator of the bodies' meshes.
            center: Centre, shape (gdim,), gdim 2 or 3.
            radius: Radius (length).
            inside: Whether the workpiece is inside the sphere; the tool is then everything outside
                of it.

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
        """Make a tool with a surface of triangles (2D: line segments). Collective.

        The arrays of rank 0 are used: other ranks pass the same arrays, or None. Facets are
        distributed over the ranks.

        Args:
            comm: Communicator of the bodies' meshes.
            x: Vertices, shape (vertices, gdim), gdim 2 or 3 (length).
            triangles: Indices of the vertices of each facet, shape (facets, gdim),
                counter-clockwise as seen from the workpiece; in 2D, the tool is to the left of a
                segment.
            center: Centre of rotation of the tool, shape (gdim,); by default the mean vertex.

        Raises:
            ValueError: If an array has another shape, is not finite, differs between ranks, or an
                index is out of range, or a facet has no area, or neighbouring facets have opposite
                orientations.
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
        """Make a tool from an STL file, ASCII or binary, read by rank 0. Collective.

        Vertices with equal coordinates are merged. The order of the vertices gives the orientation;
        normals in the file are ignored. All solids of a file form one tool; they may share edges
        and walls. Triangles without area are left out.

        Args:
            comm: Communicator of the bodies' meshes.
            filename: The file.
            center: Centre of rotation of the tool, shape (3,); by default the mean vertex.

        Raises:
            TypeError: If ``filename`` is not a path.
            ValueError: If the file cannot be read, is not an STL file or is truncated; or as
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
        """Make a tool from a surface mesh; its cells stay on the ranks that own them. Collective.

        Args:
            msh: Mesh of first order and of topological dimension gdim − 1. Its communicator is that
                of the bodies' meshes.
            inside: A point inside the tool, shape (gdim,): all cells are oriented away from it, so
                all cells must show their back to this point. By default cells must be oriented as
                in :meth:`triangulated`. This is not the case for a sub-mesh of facets.
            center: Centre of rotation of the tool, shape (gdim,); by default the mean vertex.

        Raises:
            TypeError: If ``msh`` is not a mesh.
            ValueError: If the mesh has another dimension or order, is not finite, a cell has no
                area, or neighbouring cells have opposite orientations.
        """
        check(MESH, msh=msh)
        facets, middle = triangulation.of_mesh(msh, inside, center)
        return cls(msh.comm, middle, facets)

    @property
    def bodies(self) -> tuple[()]:
        """Empty: surfaces with unknowns on this side of a contact, see :class:`qs.Surface`."""
        return ()

    @property
    def tools(self) -> tuple[RigidSurface, ...]:
        """The tool itself: rigid tools on this side of a contact."""
        return (self,)

    @property
    def V(self) -> None:
        """None: a rigid tool has no function space."""
        return None

    @property
    def cpp_object(self) -> None:
        """None: the C++ extension has no surface with unknowns for a rigid tool."""
        return None

    @property
    def degree(self) -> int:
        """Degree of the trace of the displacement: 0, since a tool has no unknowns."""
        return 0

    @property
    def is_analytic(self) -> bool:
        """Whether the shape is known in closed form; otherwise the tool consists of facets."""
        return isinstance(self._shape, ToolShape)

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
        """Signed distances of points from the tool, and the outward normals of the tool there.

        Args:
            x: Points, shape (n, 3).
            position: Position of the tool, in the form of :attr:`position`; by default the present
                position.

        Returns:
            Distances, positive outside of the tool, shape (n,), and unit normals, shape (n, 3).

        Raises:
            ValueError: If the shape is not analytic.
        """
        if not isinstance(self._shape, ToolShape):
            raise ValueError("distance: is known in closed form for analytic shapes only")
        R, t = self._pose_of(position).embedded
        points = check_array("x", x, (None, 3))
        distance, normal = self._shape.distance((points - t) @ R)
        return distance, normal @ R.T

    def curvature(self, x: npt.ArrayLike, position: npt.ArrayLike | None = None) -> Array:
        """Derivatives of the normals of :meth:`distance` by the points, shape (n, 3, 3)."""
        if not isinstance(self._shape, ToolShape):
            raise ValueError("curvature: is known in closed form for analytic shapes only")
        R, t = self._pose_of(position).embedded
        points = check_array("x", x, (None, 3))
        return np.asarray(R @ self._shape.curvature((points - t) @ R) @ R.T)

    def facets(self, axisymmetric: bool = False) -> _cpp.Surface:
        """Surface of the C++ extension at the present position. Collective after a position change.

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
        """Facets at the present position, in the form of a body's. Collective after a motion.

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
            facets.x,
        )

    def twin(self, axisymmetric: bool) -> _cpp.Surface:
        """New independent object of the C++ extension with the tool's facets. Collective.

        Args:
            axisymmetric: Whether facets stand for rings.

        Raises:
            ValueError: If the shape is analytic.
        """
        R, t = self._pose.embedded
        return self._facets.surface(self.comm, self.gdim, R, t, axisymmetric)

    def facet_positions(self, position: npt.ArrayLike) -> Array:
        """Vertices of this rank's facets at another position, shape (facets, vertices, 3).

        Args:
            position: Position of the tool, in the form of :attr:`position`.
        """
        R, t = self._pose_of(position).embedded
        return np.asarray(self._facets.x @ R.T + t)

    def facets_at(self, position: npt.ArrayLike) -> _cpp.Surface:
        """Surface of the C++ extension at another position, see :attr:`position`. Collective.

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
        """Centre of rotation of the tool at its present position, shape (gdim,)."""
        return self._pose(self._center)

    def center_at(self, position: npt.ArrayLike) -> Array:
        """Centre of rotation with the tool at a given :attr:`position`."""
        return self._pose_of(position)(self._center)

    @property
    def motion(self) -> Affine:
        """Displacement field of the coming step."""
        R = rotation_matrix(self._rotation)
        return rotation_about(R, self.center, self._displacement)

    def advance(self) -> None:
        """Make the motion permanent: move the tool, set displacement and rotation to zero.

        Call ``contact.update()`` next to update the contact pairs. A tie needs no update.
        """
        self._place(Pose.from_matrix(self._pose.moved(self.motion), self.gdim))
        self._displacement = np.zeros_like(self._displacement)
        self._rotation = np.zeros_like(self._rotation)
        self._made = np.zeros_like(self._rotation)

    def go_ahead(self, displacement: Array, rotation: Array) -> None:
        """Make a part of the motion permanent; :attr:`displacement`, :attr:`rotation` are the rest.

        Args:
            displacement: Translation (length), shape (gdim,).
            rotation: Rotation about :attr:`center`, as :attr:`rotation`.
        """
        d, whole = self._displacement, self._rotation
        self._displacement, self._rotation = displacement, rotation
        self._place(Pose.from_matrix(self._pose.moved(self.motion), self.gdim))
        self._displacement = d - displacement
        left = rotation_matrix(whole) @ rotation_matrix(rotation).T
        self._rotation = rotation_vector(left, whole - rotation)
        self._made = self._made + rotation

    @property
    def rotation_of_step(self) -> Array:
        """Rotation over the whole coming step, as :attr:`rotation`, with parts made already.

        It is exact if all parts have the same axis; otherwise it is near the rotation.
        """
        return self._made + self._rotation

    @property
    def position(self) -> Array:
        """Position of the tool: [R | t], shape (gdim, gdim + 1); x₀ has moved to R x₀ + t.

        It can be set, for example to continue from a checkpoint; ``contact.update()`` has to
        follow.
        """
        return self._pose.matrix

    @position.setter
    def position(self, value: npt.ArrayLike) -> None:
        with checked_once(self.comm) as same:
            pose = Pose.from_matrix(value, self.gdim)
            same(position=pose.matrix)
        self._place(pose)
        self._made = np.zeros_like(self._rotation)

    def _place(self, pose: Pose) -> None:
        self._pose = pose
        self._num_positions += 1
        self.version = self._num_positions

    @property
    def state(self) -> ToolState:
        """Variable state of the tool, for :meth:`restore`."""
        motion = self._displacement.copy(), self._rotation.copy()
        return ToolState(self._pose, self.version, *motion, self._driven, self._made)

    def restore(self, state: ToolState) -> None:
        """Restore a :attr:`state`; contacts that were paired in this state need no update."""
        self._pose, self.version = state.pose, state.version
        self._displacement, self._rotation = state.displacement.copy(), state.rotation.copy()
        self._driven, self._made = state.driven, state.made

    # --- Force

    def drive(self, force: float, direction: npt.ArrayLike) -> None:
        """Drive the tool by a force, instead of a prescribed displacement, in the next solves.

        A solve finds the displacement along the direction for which the contact forces balance the
        given force: ``contact.force("master") @ direction == -force``, to 1e-8 of the force.
        :attr:`displacement` contains it afterwards; the other components stay prescribed.

        Args:
            force: Force, in 2D per length; a negative force pulls the tool, which only tied contact
                can balance.
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
        """Drive the tool by a moment, instead of a prescribed rotation, in the next solves.

        A solve finds the angle about the axis through :attr:`center` for which the virtual work of
        the contact forces balances that of the moment, to 1e-8. The forces act at the positions of
        the last contact detection: for small angles
        ``contact.moment("master", tool.center) @ axis`` is minus the moment, up to the change of
        the lever arms in the step. :attr:`rotation` contains the angle afterwards; the displacement
        stays prescribed. A moment replaces an earlier force.

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
        """Prescribe the whole displacement and rotation again, without a force or moment."""
        self._driven = None

    @property
    def driven(self) -> Driven | None:
        """Prescribed force or moment of the tool, None if its motion is prescribed."""
        return self._driven

    @property
    def driven_motion(self) -> Affine:
        """Displacement field of the tool per unit of its unknown, a length or an angle."""
        assert self._driven is not None
        return self._driven.field(self._rotation, self.center)

    @property
    def driven_curvature(self) -> Affine | None:
        """Second derivative of the displacement by the unknown; None if it is 0."""
        assert self._driven is not None
        return self._driven.curvature(self._rotation, self.center)

    def move_driven(self, start: tuple[Array, Array], s: float) -> None:
        """Move by a length or an angle from a given displacement and rotation."""
        assert self._driven is not None
        self._displacement, self._rotation = self._driven.moved(*start, s)

    # --- For contacts

    def create_vec(self) -> None:
        """None: a rigid tool has no unknowns."""
        return None

    @property
    def linear(self) -> RigidSurface:
        """The tool itself: its facets are flat, see :class:`qs.Surface`."""
        return self

    @property
    def heights(self) -> None:
        """None: the facets of a tool are flat, see :class:`qs.Surface`."""
        return None

    def shape_degree(self, order: int) -> int:
        """Total polynomial degree of Lagrange functions of this order on its facets; 0 without."""
        if self.is_analytic:
            return 0
        return order * (2 if self.num_facet_vertices == 4 else 1)

    def search_object(self, slave: Surface) -> _cpp.Surface:
        """Facets for contact detection from a slave: rings if the slave is axisymmetric."""
        return self.facets(slave.axisymmetric)

    def shells(self) -> Shells:
        """Connected shells of the facets. The first call is collective.

        Raises:
            ValueError: If the shape is analytic.
        """
        if self._shells is None:
            self._shells = Shells(self.comm, self._facets)
        return self._shells

    def check_state(self) -> None:
        """Check that the motion and the force are finite and the same on all ranks. Collective.

        Raises:
            ValueError: With the name of the wrong argument.
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
            raise ValueError("a rigid tool with an analytic shape has no facets")
        return self._shape


#: Either side of a contact: both classes answer the same questions, see docs/design.md.
AnySurface = Surface | RigidSurface


def is_rigid(surface: AnySurface) -> typing.TypeGuard[RigidSurface]:
    """Whether a surface is a rigid tool, where contact treats tools by other rules than bodies."""
    return isinstance(surface, RigidSurface)


def is_shape(surface: AnySurface) -> typing.TypeGuard[RigidSurface]:
    """Whether a surface is a rigid tool whose shape is known in closed form."""
    return surface.is_analytic
