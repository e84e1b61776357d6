"""Positions of the surfaces of a contact at the last evaluation."""

from __future__ import annotations

import dataclasses
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.affine import Affine, rotation_vector
from qsdolfinx.surface.deformed import deformed_positions, deformed_surface, trace_values
from qsdolfinx.surface.rigid_path import RigidPath
from qsdolfinx.surface.surface import Coordinates, Surface
from qsdolfinx.tools.pose import Pose, padded
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Place:
    """Position of a deformable surface.

    Attributes:
        surface: The surface.
        coordinates: Coordinates of its facets at contact detection.
        displacement: Displacement from these coordinates (length), see ``trace_values``; None for
            zero.
        solved_on: Vertices of the facets, (facets, vertices, 3), in the mesh of the last solve:
            meshes of velocity-based bodies are moved afterwards. None before any solve.
    """

    surface: Surface
    coordinates: Coordinates
    displacement: Array | None = None
    solved_on: Array | None = None

    @property
    def bodies(self) -> tuple[Place, ...]:
        """The place itself: the places of bodies on this side."""
        return (self,)

    @property
    def motion(self) -> None:
        """None: only the unknowns of the body move it, see :class:`ToolPlace`."""
        return None

    def moved(
        self, x: PETSc.Vec | None, scale: float, offset: PETSc.Vec | None, motion: Affine | None
    ) -> Place:
        """Position for given unknowns of the body. Collective at first."""
        u = scale * trace_values(self.surface, x)
        if offset is not None:
            u = u + trace_values(self.surface, offset)
        return dataclasses.replace(self, displacement=u, solved_on=self.surface.present_vertices)

    @property
    def as_paired(self) -> Place:
        """Position at contact detection."""
        return dataclasses.replace(self, displacement=None)

    @property
    def as_given(self) -> Place:
        """The place itself: only the unknowns of the body move it."""
        return self

    def moved_to(self, position: Array) -> Place:
        """The place itself, which is known from the unknowns."""
        return self

    def carried(self, x: Array, before: AnyPlace) -> Array:
        """The points themselves, see :class:`ToolPlace`."""
        return x

    def path(self, before: AnyPlace) -> RigidPath:
        """Rigid motion closest to that of the vertices since an earlier place. Collective."""
        ends = before.vertices(), self.vertices()
        return RigidPath.closest(self.surface.comm, *ends, self.surface.gdim)

    def frame(self, before: AnyPlace) -> RigidPath:
        """No motion: what touches a body is seen from outside, see :class:`ToolPlace`."""
        return RigidPath.at_rest()

    @property
    def centers(self) -> tuple[Array, Array]:
        """Twice the origin, shape (gdim,) each."""
        return self.surface.center, self.surface.center

    def vec(self) -> PETSc.Vec:
        """The displacement as a new vector of the body, zero off the surface. Collective."""
        out = self.surface.create_vec()
        if self.displacement is not None:
            out.array[self.surface.own_trace] = self.displacement
        return out

    def positions(self) -> Array:
        """Positions of the trace's nodes, shape (facets, nodes, 3). Collective."""
        return deformed_positions(self.surface, self.coordinates, self.displacement)

    def vertices(self) -> Array:
        """Positions of the facets' vertices, shape (facets, vertices, 3). Collective."""
        return self.positions()[:, : self.surface.num_facet_vertices]

    def vertices_of_mesh(self) -> Array:
        """Vertices of the facets in the mesh of the last solve, or else at contact detection."""
        return self.coordinates[0] if self.solved_on is None else self.solved_on

    def facets(self) -> _cpp.Surface:
        """The surface at this position. Collective.

        Raises:
            DegenerateFacetsError: If a facet has no area.
        """
        return deformed_surface(self.surface, self.coordinates, self.displacement)


@dataclasses.dataclass(frozen=True)
class ToolPlace:
    """Position of a rigid tool.

    Attributes:
        tool: The tool.
        position: Its position at contact detection, see ``RigidSurface.position``.
        motion: Its motion since contact detection; None for no motion.
    """

    tool: RigidSurface
    position: Array
    motion: Affine | None = None

    @property
    def bodies(self) -> tuple[()]:
        """Empty: the places of bodies on this side."""
        return ()

    def moved(
        self, x: PETSc.Vec | None, scale: float, offset: PETSc.Vec | None, motion: Affine | None
    ) -> ToolPlace:
        """Position after a motion of the tool; there are no unknowns."""
        return dataclasses.replace(self, motion=motion)

    @property
    def as_paired(self) -> ToolPlace:
        """Position at contact detection."""
        return dataclasses.replace(self, motion=None)

    @property
    def as_given(self) -> ToolPlace:
        """Position that the tool has now: the user may have moved it since contact detection."""
        return ToolPlace(self.tool, self.tool.position)

    def vec(self) -> None:
        """None: a tool has no unknowns."""
        return None

    def positions(self) -> Array:
        """Its position after the motion, in the form of :attr:`position`."""
        if self.motion is None:
            return self.position
        return Pose.from_matrix(self.position, self.tool.gdim).moved(self.motion)

    def vertices(self) -> Array:
        """Positions of the facets' vertices after the motion, shape (facets, vertices, 3)."""
        return self.tool.facet_positions(self.positions())

    def carried(self, x: Array, before: AnyPlace) -> Array:
        """Points, (..., 3), after a motion with the tool from an earlier place."""
        d, first, last, out = self.tool.gdim, before.positions(), self.positions(), x.copy()
        R = last[:, :d] @ first[:, :d].T
        out[..., :d] = x[..., :d] @ R.T + (last[:, d] - R @ first[:, d])
        return out

    def path(self, before: AnyPlace) -> RigidPath:
        """Motion since an earlier place: a rotation about the centre, which moves straight."""
        d, first, last = self.tool.gdim, before.positions(), self.positions()
        turned = rotation_vector(last[:, :d] @ first[:, :d].T, self.tool.rotation_of_step)
        center, end = (padded(self.tool.center_at(position)) for position in (first, last))
        rotation = turned if d == 3 else np.array([0.0, 0.0, turned[0]])
        return RigidPath(center, end - center, rotation)

    def frame(self, before: AnyPlace) -> RigidPath:
        """Motion of the frame from which the other side is seen: that of the tool."""
        return self.path(before)

    @property
    def centers(self) -> tuple[Array, Array]:
        """The tool's centre at contact detection, and after the motion, each of shape (gdim,)."""
        return self.tool.center_at(self.position), self.tool.center_at(self.positions())

    def moved_to(self, position: Array) -> ToolPlace:
        """The place with the motion that leads to a position."""
        d = len(position)
        turn = position[:, :d] @ self.position[:, :d].T
        motion = Affine(turn - np.eye(d), position[:, d] - turn @ self.position[:, d])
        return dataclasses.replace(self, motion=motion)

    def facets(self) -> _cpp.Surface:
        """The tool's facets after the motion. Collective."""
        return self.tool.facets_at(self.positions())


#: Position of either side: both classes answer the same questions.
AnyPlace = Place | ToolPlace


@dataclasses.dataclass(frozen=True)
class Placement:
    """Positions of both sides: an immutable object, replaced whenever they may have moved.

    Attributes:
        slave: The slave.
        master: The other side.
    """

    slave: Place
    master: AnyPlace

    @classmethod
    def at_pairing(cls, slave: Surface, master: AnySurface) -> Placement:
        """Present positions, at contact detection."""
        here, *there = (Place(body, body.coordinates) for body in (slave, *master.bodies))
        return cls(here, *there, *(ToolPlace(tool, tool.position) for tool in master.tools))

    @property
    def bodies(self) -> tuple[Place, ...]:
        """Positions of the bodies: the slave's, and the master's unless it is a rigid tool."""
        return self.slave, *self.master.bodies

    def moved(
        self,
        unknowns: tuple[PETSc.Vec, PETSc.Vec | None],
        scale: tuple[float, float],
        offset: tuple[PETSc.Vec | None, PETSc.Vec | None],
        motion: Affine | None,
    ) -> Placement:
        """Positions for given unknowns and added displacements. Collective at first."""
        return Placement(
            self.slave.moved(unknowns[0], scale[0], offset[0], motion),
            self.master.moved(unknowns[1], scale[1], offset[1], motion),
        )

    @property
    def as_paired(self) -> Placement:
        """Positions of both sides at contact detection."""
        return Placement(self.slave.as_paired, self.master.as_paired)

    @property
    def as_given(self) -> Placement:
        """The same bodies, with a tool at the position that it has now."""
        master = self.master.as_given
        return self if master is self.master else Placement(self.slave, master)

    def place(self, side: str) -> AnyPlace:
        """Position of one side."""
        return typing.cast(AnyPlace, getattr(self, side))


def is_analytic(place: AnyPlace) -> typing.TypeGuard[ToolPlace]:
    """Whether a side is a tool whose shape is known in closed form."""
    return isinstance(place, ToolPlace) and place.tool.is_analytic
