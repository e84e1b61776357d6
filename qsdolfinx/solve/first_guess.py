"""First guess for bodies that are supported by contact alone: rigid motion under their loads."""

from __future__ import annotations

import numpy as np

from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.system.system import ContactSystem

#: No guess is made if, at the start, contact leaves less than this part of the loads unbalanced.
BALANCED = 0.5

#: Fractions of the motion that are tried if contact with updated geometry would lose more than half
#: of its nodes in the whole motion.
PARTS, KEPT = (1.0, 0.5, 0.25, 0.125), 0.5


def guess(system: ContactSystem) -> None:
    """Move ``system.x`` to the equilibrium of rigid bodies on springs, and evaluate. Collective.

    The bulk matrix of a body that is supported by contact alone is singular, and Newton's method
    would start from an accidental set of touching points. If contact already balances a good part
    of the loads, the unknowns are not changed.
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
