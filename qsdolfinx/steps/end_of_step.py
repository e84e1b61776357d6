"""Where a time step has left the bodies of a contact, for whoever pairs it there."""

from __future__ import annotations

import contextlib
import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.motion import pair_anew, set_offset, set_start, show
from qsdolfinx.steps.mesh_motion import MeshMotion

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a body is.

    Attributes:
        motion: How its mesh moves.
        unknowns: Total displacements (length), ghosts included; zero of a body in velocities, whose
            mesh has moved.
    """

    motion: MeshMotion
    unknowns: Array

    @classmethod
    def of(cls, motion: MeshMotion, flows: bool) -> Place:
        """Where the unknowns of a body put it now."""
        x = motion.u.x.array
        return cls(motion, np.zeros_like(x) if flows else x.copy())

    def displacements(self) -> fem.Function:
        """The displacements as a function."""
        return self._function(self.unknowns)

    def offset(self) -> fem.Function:
        """What does not count of displacements, as the mesh that contact was paired on has it."""
        return self._function(-self.motion.carried(self.unknowns))

    def _function(self, values: Array) -> fem.Function:
        out = fem.Function(self.motion.u.function_space)
        out.x.array[:] = values
        return out


def pair_at(model: ContactModel, slave: Place, master: Place | None) -> None:
    """Pair a contact where its bodies are; displacements and slip count from there. Collective.

    Meshes are left where they were.

    Args:
        model: The contact.
        slave: Where the body of the slave is.
        master: The same of the master's, None for a rigid tool.

    Raises:
        ValueError: If coordinates are not finite or a facet has no area.
    """
    places = [slave] if master is None or master.motion is slave.motion else [slave, master]
    with moved(places):
        pair_anew(model)
    set_offset(model, slave.offset(), None if master is None else master.offset())
    set_start(model, slave.displacements(), None if master is None else master.displacements())


def show_at(model: ContactModel, slave: Place, master: Place | None) -> None:
    """Let a contact that was paired there show gaps and forces where its bodies are. Collective."""
    if model.penalty.value is not None:  # else nothing has been solved yet
        show(model, slave.displacements(), None if master is None else master.displacements())


@contextlib.contextmanager
def moved(places: typing.Sequence[Place]) -> typing.Iterator[None]:
    """Meshes moved by the displacements inside the block."""
    meshes = [place.motion.mesh.geometry for place in places]
    before = [geometry.x.copy() for geometry in meshes]
    for place, geometry in zip(places, meshes, strict=True):
        geometry.x[:] += place.motion.values(place.unknowns)
    try:
        yield
    finally:
        for geometry, x in zip(meshes, before, strict=True):
            geometry.x[:] = x
