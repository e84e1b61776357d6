"""Energy that friction takes in a step, the work of its forces, and the slip of each row."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.laws import Friction, Response, Rows

Array = npt.NDArray[np.float64]

#: Stiffness of stick, in that of the rows, for rows that leave: all of their way is slip.
RIGID = 1e6

#: Least part of a step for which a row that leaves has been in contact: its rate is slip over that.
LEAST_PART = 1e-6


class Evaluated(typing.NamedTuple):
    """The rows of a slip at an evaluation.

    Attributes:
        rows: What the law was told.
        response: What it answered.
        leaving: Rows that slipped when the step began and are open, but for those that have lost
            their friction, (rows,). Rows that stuck slip when next to no pressure is left.
        gap: Mean gap of each row (length), negative where it is open, (rows,).
        compliance: Gap (length) that a pressure closes, over it: of the penalty and of the bodies.
        means: Whether multipliers are means over the step, as stresses of a velocity are.
        until_closed: Tangential part of what the jump changed in the step before the row closed
            (length), (rows, gdim).
        same: Whether all rows in contact, now or when the step began, are covered by as much as
            then: not where an edge slides over them.
        arc: Way along surfaces over the slip, which is its chord where they turn, (rows,).
    """

    rows: Rows
    response: Response
    leaving: npt.NDArray[np.bool_]
    gap: Array
    compliance: float
    means: bool
    until_closed: Array
    same: bool
    arc: Array | float = 1.0


def slip_and_energy(law: Friction, step: Evaluated) -> tuple[Array, Array]:
    """Slip (length) and energy per area that friction took in a step, (rows, gdim) and (rows,).

    The energy is the work of the friction forces on the relative displacement of the step, less
    what a penalty's elastic stick stores of it.

    Multipliers that are means over the step, as those of bodies in velocities, work on all of the
    step's displacement: so they do in the equilibrium. The others work on the slip, which begins
    where a row closes, with the mean of the limit along it: it goes from the pressure at the start
    of the step to that at its end, which makes the energy one of second order in Δt. Rows that
    leave had λ_0 at the start, and are open by −ḡ at the end. At a constant rate they are in
    contact for λ_0 C / (λ_0 C − ḡ) of the step, C being the compliance.

    Where an edge slides over rows, what they bear goes over from one to the next, and their
    pressures at the start and at the end are those of unlike areas: there the forces at the end
    count alone, which are all of the friction on what is in contact.
    """
    rows, response = step.rows, step.response
    closed = rows.closed[:, None]
    slip = np.where(closed, np.reshape(step.arc, (-1, 1)) * response.dissipative, 0.0)
    if step.means:
        way = np.where(closed, slip + step.until_closed, 0.0)
        return slip, np.sum(response.traction * way, axis=1)
    energy = np.sum(response.traction * slip, axis=1)
    if not step.same:
        return slip, energy
    energy = law.growth(rows) * energy
    leaving = step.leaving
    if leaving.any():
        way, work = _of_leaving(law, step)
        slip = np.where(leaving[:, None], way, slip)
        energy = np.where(leaving, work, energy)
    return slip, energy


def _of_leaving(law: Friction, step: Evaluated) -> tuple[Array, Array]:
    """The same of rows that leave, until they do so."""
    rows, leaving = step.rows, step.leaving
    closing = rows.pressed * step.compliance
    opening = np.maximum(-step.gap, 0.0)
    part = np.divide(closing, closing + opening, np.zeros_like(closing), where=closing > 0)
    part = np.maximum(part, LEAST_PART)
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
