"""Stiffness of the bodies at contact surfaces, and automatic penalties computed from it."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.contact import held, terms
from qsdolfinx.contact.findings import look
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.penalty import nodal_stiffness
from qsdolfinx.contact.soft_at_nodes import SPIKES
from qsdolfinx.system.blocks import Sides
from qsdolfinx.system.body import Body
from qsdolfinx.system.matrices import Form


def measure(
    bodies: typing.Sequence[Body],
    contacts: typing.Sequence[ContactModel],
    sides: Sides,
    scales: typing.Sequence[float],
    bulk: typing.Sequence[PETSc.Mat],
    form: Form,
) -> list[float]:
    """Set the stiffness of their bodies, and automatic penalties, in contacts. Collective.

    Args:
        bodies: The bodies.
        contacts: Contacts after contact detection.
        sides: Bodies of each contact.
        scales: Displacement per unknown of each body.
        bulk: Bulk block of each body.
        form: Matrix format for the linear solver.

    Returns:
        Modulus E of each contact (stress), of both sides in series; 0 where neither side has free
        unknowns.
    """
    markers = [body.constrained_marker() for body in bodies]
    moduli = []
    for contact, (s, m) in zip(contacts, sides, strict=True):
        of_sides = markers[s], None if m is None else markers[m]
        terms.constrain(contact, *of_sides)
        held.find(contact, *of_sides)
        measured = [
            nodal_stiffness(surface, bulk[i], markers[i], scales[i])
            for surface, i in zip(contact.bodies, (s, m), strict=False)
            if i is not None
        ]
        stiffness, modulus = (tuple(values) for values in zip(*measured, strict=True))
        together = form is Form.SUM and contact.law.linear and all(body.linear for body in bodies)
        contact.penalty.follow(stiffness, modulus, together)
        look(contact, [SPIKES])
        moduli.append(1 / sum(1 / E for E in modulus) if min(modulus) < np.inf else 0.0)
    for marker in markers:
        marker.destroy()
    return moduli
