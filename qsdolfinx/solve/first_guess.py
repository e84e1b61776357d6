"""First guess for bodies that only contact holds: where their loads press them together."""

from __future__ import annotations

import numpy as np

from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.system.system import ContactSystem

#: No guess is made if contact at the start leaves less than this part of the loads unbalanced.
BALANCED = 0.5

#: Parts of the way that are tried where contact that follows the bodies would lose more than a half
#: of its nodes on it.
PARTS, KEPT = (1.0, 0.5, 0.25, 0.125), 0.5


def guess(system: ContactSystem) -> None:
    """Move ``system.x`` to where rigid bodies would rest on springs, and evaluate. Collective.

    The bulk matrix of a body that only contact holds is singular, and Newton's method would start
    from whatever happens to touch. Left alone if contact balances a good part of the loads already.
    """
    residual = system.residual(system.x.array_r)
    rigid = system.made.rigid
    motions = rigid.free_motions
    if not system.contacts or motions.shape[1] == 0 or min(system.moduli) == 0:
        return
    loads = motions.T @ rigid.work(system.bulk_residuals)
    whole = motions.T @ rigid.work(system.parts(residual))
    if np.linalg.norm(whole) <= BALANCED * np.linalg.norm(loads):
        return
    springs = [
        Springs(p, rigid.gap_changes(p, contact.ordered(p, side)) @ motions, modulus, i)
        for i, (contact, side, modulus) in enumerate(
            zip(system.contacts, system.sides, system.moduli, strict=True)
        )
        for p in contact.gaps
    ]
    coefficients = Foundation(springs, loads).settle()
    if coefficients is None:
        return
    start, paired = system.x.array.copy(), system.num_paired()
    for part in PARTS:
        for i, scale in enumerate(system.scales):
            displacement = part * rigid.displacement(motions @ coefficients, i)
            system.part(system.x.array, i)[:] = system.part(start, i) + displacement / scale
        system.residual(system.x.array_r)
        if system.num_paired() >= KEPT * paired:
            return
    system.x.array[:] = start
    system.residual(start)
