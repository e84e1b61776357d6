"""First guess for bodies that only contact holds: where their loads press them together."""

from __future__ import annotations

import numpy as np

from qsdolfinx.solve.foundation import Foundation, Springs
from qsdolfinx.system.system import ContactSystem

#: No guess is made if contact at the start leaves less than this part of the loads unbalanced.
BALANCED = 0.5


def guess(system: ContactSystem) -> tuple[float, float]:
    """Move ``system.x`` to where rigid bodies would rest on springs, and evaluate. Collective.

    The bulk matrix of a body that only contact holds is singular, and Newton's method would start
    from whatever happens to touch. Left alone if contact balances a good part of the loads already.

    Returns:
        Norm of the residual before; and that over the norm after a guess, at most 1, else 1. A
        stiff penalty magnifies the guess's gaps: what counts are the loads.
    """
    residual = system.residual(system.x.array_r)
    norm, rigid = system.norm(residual), system.made.rigid
    motions = rigid.free_motions
    if not system.contacts or motions.shape[1] == 0 or min(system.moduli) == 0:
        return norm, 1.0
    loads = motions.T @ rigid.work(system.bulk_residuals)
    whole = motions.T @ rigid.work(system.parts(residual))
    if np.linalg.norm(whole) <= BALANCED * np.linalg.norm(loads):
        return norm, 1.0
    springs = [
        Springs(p, rigid.gap_changes(p, contact.ordered(p, side)) @ motions, modulus, i)
        for i, (contact, side, modulus) in enumerate(
            zip(system.contacts, system.sides, system.moduli, strict=True)
        )
        for p in contact.gaps
    ]
    coefficients = Foundation(springs, loads).settle()
    if coefficients is None:
        return norm, 1.0
    for i, scale in enumerate(system.scales):
        displacement = rigid.displacement(motions @ coefficients, i)
        system.part(system.x.array, i)[:] += displacement / scale
    guessed = system.norm(system.residual(system.x.array_r))
    return norm, norm / guessed if 0 < norm < guessed else 1.0
