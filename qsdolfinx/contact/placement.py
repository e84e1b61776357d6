"""Where the surfaces of a contact are at the last evaluation."""

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
    """Where a deformable surface is.

    Attributes:
        surface: The surface.
        coordinates: Of its facets, as they were paired.
        displacement: From there (length), see ``trace_values``; None for none.
        mesh: Coordinates of the mesh that a body in velocities is solved for on, if contact has
            been paired elsewhere in a time step.
    """

    surface: Surface
    coordinates: Coordinates
    displacement: Array | None = None
    mesh: Coordinates | None = None

    @property
    def of_mesh(self) -> Place:
        """The place of the mesh that the body is in equilibrium on."""
        return Place(self.surface, self.mesh or self.coordinates)

    def moved(self, x: PETSc.Vec, scale: float, offset: PETSc.Vec | None) -> Place:
        """The place for unknowns of the body. Collective at first."""
        u = scale * trace_values(self.surface, x)
        if offset is not None:
            u = u + trace_values(self.surface, offset)
        return dataclasses.replace(self, displacement=u)

    def vec(self) -> PETSc.Vec:
        """The displacement as a new vector of the body, zero off the surface. Collective."""
        out = self.surface.create_vec()
        if self.displacement is not None:
            out.array[self.surface.own_trace] = self.displacement
        return out

    def positions(self) -> Array:
        """Of the trace's nodes, shape (facets, nodes, 3). Collective."""
        return deformed_positions(self.surface, self.coordinates, self.displacement)

    def facets(self) -> _cpp.Surface:
        """The surface there. Collective.

        Raises:
            DegenerateFacetsError: If a facet has no area.
        """
        return deformed_surface(self.surface, self.coordinates, self.displacement)


@dataclasses.dataclass(frozen=True)
class ToolPlace:
    """Where a rigid tool is.

    Attributes:
        tool: The tool.
        position: Its position when it was paired, see ``RigidSurface.position``.
        motion: What it has moved from there; None for nothing.
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
        """The tool's centre when it was paired, and after the motion, each of shape (gdim,)."""
        return self.tool.center_at(self.position), self.tool.center_at(self.now)

    def moved_to(self, position: Array) -> ToolPlace:
        """The place with the motion that leads to a position."""
        d = len(position)
        turn = position[:, :d] @ self.position[:, :d].T
        motion = Affine(turn - np.eye(d), position[:, d] - turn @ self.position[:, d])
        return dataclasses.replace(self, motion=motion)

    def facets(self) -> _cpp.Surface:
        """The tool's facets there. Collective."""
        return self.tool.facets_at(self.now)


@dataclasses.dataclass(frozen=True)
class Placement:
    """Where both sides are. It is replaced, never changed, whenever they may have moved.

    Attributes:
        slave: The slave.
        master: The other side.
    """

    slave: Place
    master: Place | ToolPlace

    @classmethod
    def at_pairing(cls, slave: Surface, master: AnySurface) -> Placement:
        """Where they are paired now."""
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
        """Where they are for these unknowns and displacements on top. Collective at first."""
        slave, master = self.slave.moved(unknowns[0], scale[0], offset[0]), self.master
        if isinstance(master, ToolPlace):
            return Placement(slave, dataclasses.replace(master, motion=motion))
        assert unknowns[1] is not None
        return Placement(slave, master.moved(unknowns[1], scale[1], offset[1]))

    def solved_on(self, on_mesh: tuple[bool, bool]) -> Placement:
        """With meshes as they are now, of the sides that are in equilibrium on them. Collective.

        Args:
            on_mesh: Whether that is so of the slave and the master.
        """
        sides: list[Place | ToolPlace] = [self.slave, self.master]
        for i, (side, wanted) in enumerate(zip(sides, on_mesh, strict=True)):
            if wanted and isinstance(side, Place):
                sides[i] = dataclasses.replace(side, mesh=side.surface.read_coordinates())
        slave, master = sides
        assert isinstance(slave, Place)
        return Placement(slave, master)

    @property
    def as_paired(self) -> Placement:
        """Where both were when they were paired."""
        master = self.master
        if isinstance(master, ToolPlace):
            paired: Place | ToolPlace = dataclasses.replace(master, motion=None)
        else:
            paired = dataclasses.replace(master, displacement=None)
        return Placement(dataclasses.replace(self.slave, displacement=None), paired)

    @property
    def centers(self) -> tuple[Array, Array]:
        """Of a rigid master, see :attr:`ToolPlace.centers`."""
        assert isinstance(self.master, ToolPlace)
        return self.master.centers

    def place(self, side: str) -> Place | ToolPlace:
        """Of one side."""
        return typing.cast(Place | ToolPlace, getattr(self, side))


def is_analytic(place: Place | ToolPlace) -> typing.TypeGuard[ToolPlace]:
    """Whether a side is a tool whose shape is known in closed form."""
    return isinstance(place, ToolPlace) and place.tool.is_analytic
