"""First guess for bodies that are supported by contact alone: rigid motion under their loads."""

from __future__ import annotations

import numpy as np

from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.system.system import ContactSystem

#: No guess is made, and no tool moved into contact, if contact leaves at most this part of the
#: loads, or of a tool's force, unbalanced at the start. With less, steps of a history would start
#: from a guess; with 1, bodies that hardly touch would not be moved.
BALANCED = 0.5


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
    # Contact with updated geometry could lose most of its nodes in the whole motion.
    for part in (1.0, 0.5, 0.25, 0.125):
        for i, scale in enumerate(system.scales):
            displacement = part * rigid.displacement(motions @ coefficients, i)
            system.part(system.x.array, i)[:] = system.part(start, i) + displacement / scale
        system.residual(system.x.array_r)
        if system.num_paired() >= 0.5 * paired:
            return
    system.x.array[:] = start
    system.residual(start)
