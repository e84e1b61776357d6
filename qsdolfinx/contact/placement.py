"""Positions of the surfaces of a contact at the last evaluation."""

from __future__ import annotations

import dataclasses
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.affine import Affine
from qsdolfinx.surface.deformed import deformed_positions, deformed_surface, trace_values
from qsdolfinx.surface.surface import Coordinates, Surface
from qsdolfinx.tools.pose import Pose
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

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

    def moved(self, x: PETSc.Vec, scale: float, offset: PETSc.Vec | None) -> Place:
        """Position for given unknowns of the body. Collective at first."""
        u = scale * trace_values(self.surface, x)
        if offset is not None:
            u = u + trace_values(self.surface, offset)
        return dataclasses.replace(self, displacement=u, solved_on=self.surface.present_vertices)

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
    def now(self) -> Array:
        """Its position after the motion."""
        if self.motion is None:
            return self.position
        return Pose.from_matrix(self.position, self.tool.gdim).moved(self.motion)

    @property
    def centers(self) -> tuple[Array, Array]:
        """The tool's centre at contact detection, and after the motion, each of shape (gdim,)."""
        return self.tool.center_at(self.position), self.tool.center_at(self.now)

    def moved_to(self, position: Array) -> ToolPlace:
        """The place with the motion that leads to a position."""
        d = len(position)
        turn = position[:, :d] @ self.position[:, :d].T
        motion = Affine(turn - np.eye(d), position[:, d] - turn @ self.position[:, d])
        return dataclasses.replace(self, motion=motion)

    def facets(self) -> _cpp.Surface:
        """The tool's facets after the motion. Collective."""
        return self.tool.facets_at(self.now)


@dataclasses.dataclass(frozen=True)
class Placement:
    """Positions of both sides: an immutable object, replaced whenever they may have moved.

    Attributes:
        slave: The slave.
        master: The other side.
    """

    slave: Place
    master: Place | ToolPlace

    @classmethod
    def at_pairing(cls, slave: Surface, master: AnySurface) -> Placement:
        """Present positions, at contact detection."""
        tool = as_tool(master)
        if tool is not None:
            return cls(Place(slave, slave.coordinates), ToolPlace(tool, tool.position))
        assert isinstance(master, Surface)
        return cls(Place(slave, slave.coordinates), Place(master, master.coordinates))

    def moved(
        self,
        unknowns: tuple[PETSc.Vec, PETSc.Vec | None],
        scale: tuple[float, float],
        offset: tuple[PETSc.Vec | None, PETSc.Vec | None],
        motion: Affine | None,
    ) -> Placement:
        """Positions for given unknowns and added displacements. Collective at first."""
        slave, master = self.slave.moved(unknowns[0], scale[0], offset[0]), self.master
        if isinstance(master, ToolPlace):
            return Placement(slave, dataclasses.replace(master, motion=motion))
        assert unknowns[1] is not None
        return Placement(slave, master.moved(unknowns[1], scale[1], offset[1]))

    @property
    def as_paired(self) -> Placement:
        """Positions of both sides at contact detection."""
        master = self.master
        if isinstance(master, ToolPlace):
            paired: Place | ToolPlace = dataclasses.replace(master, motion=None)
        else:
            paired = dataclasses.replace(master, displacement=None)
        return Placement(dataclasses.replace(self.slave, displacement=None), paired)

    @property
    def centers(self) -> tuple[Array, Array]:
        """Centres of a rigid master, see :attr:`ToolPlace.centers`."""
        assert isinstance(self.master, ToolPlace)
        return self.master.centers

    def place(self, side: str) -> Place | ToolPlace:
        """Position of one side."""
        return typing.cast(Place | ToolPlace, getattr(self, side))


def is_analytic(place: Place | ToolPlace) -> typing.TypeGuard[ToolPlace]:
    """Whether a side is a tool whose shape is known in closed form."""
    return isinstance(place, ToolPlace) and place.tool.is_analytic
