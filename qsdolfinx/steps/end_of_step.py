"""Positions of the bodies of a contact at the end of a time step, for contact detection there."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.motion import follow_from, pair_anew, set_offset, set_start, show
from qsdolfinx.steps.mesh_motion import MeshMotion

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Place:
    """Position of a body.

    Attributes:
        motion: How its mesh moves.
        unknowns: Total displacements (length), including ghosts; zero for a velocity-based body,
            whose mesh has moved.
    """

    motion: MeshMotion
    unknowns: Array

    @classmethod
    def of(cls, motion: MeshMotion, flows: bool) -> Place:
        """Present position of a body."""
        x = motion.u.x.array
        return cls(motion, np.zeros_like(x) if flows else x.copy())

    def displacements(self) -> fem.Function:
        """The displacements as a function."""
        return self._function(self.unknowns)

    def offset(self) -> fem.Function:
        """Part of the displacements already contained in the mesh at contact detection."""
        return self._function(-self.motion.carried(self.unknowns))

    def _function(self, values: Array) -> fem.Function:
        out = fem.Function(self.motion.u.function_space)
        out.x.array[:] = values
        return out


def pair_at(model: ContactModel, slave: Place, master: Place | None) -> None:
    """Update the contact pairs at the bodies' positions; slip counts from there. Collective.

    Displacements count from these positions, too. Meshes are not moved.

    Args:
        model: The contact.
        slave: Position of the slave body.
        master: Position of the master body, None for a rigid tool.

    Raises:
        ValueError: If coordinates are not finite or a facet has no area.
    """
    places = [slave] if master is None or master.motion is slave.motion else [slave, master]
    with moved(places):
        pair_anew(model)
    set_offset(model, slave.offset(), None if master is None else master.offset())
    set_start(model, slave.displacements(), None if master is None else master.displacements())


def go_on_at(model: ContactModel, slave: Place, master: Place | None) -> None:
    """Let a contact go on from the bodies' positions, as after a step to them. Collective.

    Steps of contacts with updated geometry do not repeat contact detection; others do.
    """
    if not model.follows:
        pair_at(model, slave, master)
        return
    follow_from(model, slave.displacements(), None if master is None else master.displacements())
    model.catch_up = functools.partial(pair_at, model, slave, master)


def show_at(model: ContactModel, slave: Place, master: Place | None) -> None:
    """Evaluate gaps and forces of a contact, paired there, at the bodies' positions. Collective."""
    if model.penalty.value is not None:  # else nothing has been solved yet
        show(model, slave.displacements(), None if master is None else master.displacements())


@contextlib.contextmanager
def moved(places: typing.Sequence[Place]) -> typing.Iterator[None]:
    """Move the meshes by the displacements inside the block."""
    meshes = [place.motion.mesh.geometry for place in places]
    before = [geometry.x.copy() for geometry in meshes]
    for place, geometry in zip(places, meshes, strict=True):
        geometry.x[:] += place.motion.values(place.unknowns)
    try:
        yield
    finally:
        for geometry, x in zip(meshes, before, strict=True):
            geometry.x[:] = x
