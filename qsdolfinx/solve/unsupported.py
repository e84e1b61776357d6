"""Warn of bodies that have rotated where only frictionless contact holds them."""

from __future__ import annotations

import functools

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.findings import Check, look
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Kind of the finding.
UNSUPPORTED = "body that turns freely"

#: Displacement by a rotation, over the size of the body, above which there is a warning. A body
#: that tilts until it is supported stays below, or opens gaps: ``tests/solve/test_unsupported.py``.
NOTICED = 0.02

#: Part of a rigid motion that changes gaps, below which the motion is along the surfaces. With
#: more, rotations that contact resists would give a warning.
ALONG = 0.1


def check_unsupported(system: ContactSystem, start: Array) -> None:
    """Warn, once per contact and on all ranks, of bodies that have rotated freely. Collective.

    Args:
        system: System at the solution.
        start: Unknowns at the start of the solve.
    """
    find = functools.partial(find_unsupported, system, start)
    for contact in system.contacts:
        look(contact, [Check(UNSUPPORTED, find, ContactType.NORMAL)])


def find_unsupported(system: ContactSystem, start: Array, contact: ContactModel) -> str | None:
    """Warning about a body that has rotated freely in a contact, or None. Collective.

    Args:
        system: System at the solution.
        start: Unknowns at the start of the solve.
        contact: One of its contacts.
    """
    if contact.friction is not None or system.made.rigid.free_motions.shape[1] == 0:
        return None
    changes = system.parts(system.x.array_r - start)
    sides = system.sides[system.contacts.index(contact)]
    for body in {side for side in sides if side is not None}:
        turned = _turned_freely(system, contact, body, changes[body])
        if turned > NOTICED:
            return (
                f"u[{body}]: the body has rotated by about {turned:.2g} rad, a motion in which "
                "only frictionless contact supports it; curved surfaces that fit each other do "
                "not resist this motion, so that the result is not unique: hold its rotation "
                "by Dirichlet conditions, or give the contact friction"
            )
    return None


def _turned_freely(system: ContactSystem, contact: ContactModel, body: int, change: Array) -> float:
    """Displacement by a rotation over the size of the body; 0 if it opens or closes gaps."""
    rigid, comm = system.made.rigid, system.comm
    modes = rigid.modes[body]
    num = {3: 2, 6: 3}.get(len(modes), 0)
    sides = system.sides[system.contacts.index(contact)]
    if num == 0 or not all(contact.kinematics.in_displacement):
        return 0.0
    first = sum(len(of_body) for of_body in rigid.modes[:body])
    if np.abs(rigid.free_motions[first + num : first + len(modes)]).max(initial=0.0) < ALONG**4:
        return 0.0
    local = np.array([[a.array_r @ b.array_r for b in modes] for a in modes])
    products = np.array([a.array_r @ change for a in modes])
    gram, work = (comm.allreduce(x, op=MPI.SUM) for x in (local, products))
    coefficients = np.linalg.lstsq(gram, work, rcond=None)[0]
    rotation = sum(c * m.array_r for c, m in zip(coefficients[num:], modes[num:], strict=True))
    whole = rotation + sum(
        c * m.array_r for c, m in zip(coefficients[:num], modes[:num], strict=True)
    )
    space = system.bodies[body].V
    x = space.tabulate_dof_coordinates()
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    corners = np.array([-low, high])
    comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    radius = 0.5 * float(np.max(corners[0] + corners[1]))
    motion = np.zeros(rigid.free_motions.shape[0])
    motion[first : first + len(modes)] = coefficients
    opened = 0.0
    for gap in contact.gaps:
        changed = rigid.gap_changes(gap, contact.ordered(gap, sides)) @ motion
        pressed = gap.multiplier(contact.eps)[:, 0] > 0
        opened = max(opened, float(np.max(np.abs(changed[pressed]), initial=0.0)))
    sizes = np.array([
        opened, np.abs(rotation).max(initial=0.0), np.abs(whole).max(initial=0.0)
    ])  # fmt: skip
    comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
    opened, turned, moved = sizes
    return 0.0 if opened > ALONG * moved else float(turned / radius)
