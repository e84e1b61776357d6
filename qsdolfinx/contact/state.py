"""What a contact shows after a solve, to be put back when the attempts that follow fail."""

from __future__ import annotations

from qsdolfinx.contact.contact import Contact
from qsdolfinx.surface.surface import Surface


class ContactState:
    """Pairing, gaps, multipliers and slip of a contact, as they are when this is made.

    Args:
        contact: The contact.
    """

    def __init__(self, contact: Contact) -> None:
        self._contact = contact
        self._numbers = {
            name: getattr(contact, name)
            for name in ("_touching", "_facet_size", "_radius", "_penalty")
        }
        self._dt = contact.dt
        self._passes = contact.passes
        self._slips = contact.slips
        # Pairing anew makes new objects, and an evaluation new arrays: references will do.
        self._parts = [(part, dict(vars(part))) for part in contact.parts]
        surfaces = [s for s in (contact.slave, contact.master) if isinstance(s, Surface)]
        self._surfaces = [(surface, surface.coordinates) for surface in surfaces]
        self._offset = None
        if contact._offset is not None:
            self._offset = [None if v is None else v.array_r.copy() for v in contact._offset]

    def restore(self) -> None:
        """Put everything back."""
        contact = self._contact
        for surface, coordinates in self._surfaces:
            surface.coordinates = coordinates
        for part, fields in self._parts:
            vars(part).update(fields)
        contact.passes = self._passes
        if contact.tangential is not None:
            contact.tangential.slips = self._slips
        for name, value in self._numbers.items():
            setattr(contact, name, value)
        if self._dt is not None:
            contact._kinematics.dt = self._dt
        self._restore_offset()
        contact.version += 1  # matrices may have been made for another pairing

    def _restore_offset(self) -> None:
        """Write the displacements beside the unknowns' into the vectors that there are now."""
        contact = self._contact
        if self._offset is None:
            for vec in contact._offset or ():
                if vec is not None:
                    vec.destroy()
            contact._offset = None
            return
        for vec, array in zip(contact._offset or (), self._offset, strict=True):
            if vec is not None:
                vec.array[:] = array
