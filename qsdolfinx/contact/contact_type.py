"""Types of contacts, by what their constraints measure."""

from __future__ import annotations

import enum


class ContactType(enum.Flag):
    """What the constraints of a contact measure; a check states for which types it is meant."""

    #: Normal gaps between two surfaces.
    NORMAL = enum.auto()
    #: Normal gaps of a surface to itself (self-contact).
    ITSELF = enum.auto()
    #: Relative displacements of two surfaces: a tie.
    TIE = enum.auto()
    #: Jumps of a scalar field, such as a temperature, which causes no motion.
    FIELD = enum.auto()
    #: All contacts with normal gaps.
    GAPS = NORMAL | ITSELF
    #: All contacts of displacements or velocities.
    BODIES = GAPS | TIE
