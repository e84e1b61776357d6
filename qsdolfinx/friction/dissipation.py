"""Energy dissipated by friction in a step, and the slip of each constraint."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.friction.laws import Friction, Response, Rows

Array = npt.NDArray[np.float64]

#: Sticking stiffness over the penalty of a constraint, for constraints that open in the step: all
#: of their relative displacement is slip. With 1, a part of it would be elastic, and its energy not
#: dissipated.
RIGID = 1e6


class Evaluated(typing.NamedTuple):
    """Constraints of a slip at an evaluation.

    Attributes:
        rows: Input of the law.
        response: Response of the law.
        leaving: Part of its friction limit that a constraint reached at the start of the step which
            is inactive now, from 0 to 1, (rows,); 0 for other constraints.
        gap: Mean gap of each constraint (length), negative if open, (rows,).
        compliance: Gap (length) that a pressure closes, over this pressure: of the penalty and of
            the bodies.
        means: Whether multipliers are means over the step, as the stresses due to a velocity.
        until_closed: Tangential part of the relative displacement in the step before the constraint
            became active (length), (rows, gdim).
        same: Whether the covered area of all constraints that are active now, or were so at the
            start of the step, is unchanged. It is not where an edge slides over them.
        arc: Arc length along the surfaces over the slip, which is the chord if surfaces turn,
            (rows,).
    """

    rows: Rows
    response: Response
    leaving: Array
    gap: Array
    compliance: float
    means: bool
    until_closed: Array
    same: bool
    arc: Array | float = 1.0


def slip_and_energy(law: Friction, step: Evaluated, begun: float = 1.0) -> tuple[Array, Array]:
    """Slip (length) and dissipated energy per area in a step, (rows, gdim) and (rows,).

    The energy is the work of the friction forces on the relative displacement of the step, without
    the part that elastic sticking stores in a penalty.

    Multipliers that are means over the step, as for velocity-based bodies, do work on the whole
    displacement of the step, as in the equilibrium. Other multipliers do work on the slip, which
    starts when the constraint becomes active, with the mean of the limit along the slip: the
    pressure goes from its value at the start of the step to that at the end. This makes the energy
    second-order accurate in Δt. Constraints that open had λ_0 at the start, and are open by −ḡ at
    the end. At a constant rate they are active during the part λ_0 C / (λ_0 C − ḡ) of the step,
    where C is the compliance. A constraint that sticks with a part a of its friction limit slips
    only when the falling limit reaches its friction: during the last part a of that time, with a
    times the friction of a slipping one. So its slip has the factor a, its energy a². In a step in
    which nothing moves, slipping constraints stay on their limit, and rounding decides whether they
    stick there: slip and energy of the next step must not depend on it.

    Where an edge slides over constraints, force passes from one constraint to the next, and
    pressures at the start and at the end belong to different areas. Then the forces at the end are
    used, which are the whole friction on the part in contact, and all pressures change like the
    normal force of the contact.

    Args:
        law: The law.
        step: The constraints at the end of the step.
        begun: Normal force at the start of the step over that at the end, used if areas change.
    """
    rows, response = step.rows, step.response
    closed = rows.closed[:, None]
    slip = np.where(closed, np.reshape(step.arc, (-1, 1)) * response.dissipative, 0.0)
    if step.means:
        way = np.where(closed, slip + step.until_closed, 0.0)
        return slip, np.sum(response.traction * way, axis=1)
    energy = np.sum(response.traction * slip, axis=1)
    if not step.same:
        return slip, law.growth(rows._replace(pressed=begun * rows.pressure)) * energy
    energy = law.growth(rows) * energy
    leaving = step.leaving > 0
    if leaving.any():
        way, work = _of_leaving(law, step)
        slip = np.where(leaving[:, None], step.leaving[:, None] * way, slip)
        energy = np.where(leaving, step.leaving**2 * work, energy)
    return slip, energy


def _of_leaving(law: Friction, step: Evaluated) -> tuple[Array, Array]:
    """Slip and energy of slipping constraints that open in the step, until they open."""
    rows, leaving = step.rows, step.leaving > 0
    closing = rows.pressed * step.compliance
    opening = np.maximum(-step.gap, 0.0)
    part = np.divide(closing, closing + opening, np.zeros_like(closing), where=closing > 0)
    part = np.maximum(part, SOLVED)  # slip rates are slip over this part of the step
    rows = rows._replace(
        slip=part[:, None] * rows.slip,
        traction=np.zeros_like(rows.traction),
        pressure=rows.pressed,
        pressed=np.zeros_like(rows.pressed),
        closed=leaving,
        unlimited=np.zeros_like(leaving),
        penalty=RIGID * rows.penalty,
        share=part,
    )
    response = law.respond(rows)
    work = np.sum(response.traction * response.dissipative, axis=1)
    return response.dissipative, np.asarray(law.growth(rows) * work)
