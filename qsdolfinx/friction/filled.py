"""Set-valued friction at the edge of contact, for laws that jump when a constraint opens."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.laws import Friction, Limited, Response

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Factor a of ``fill``, and c_t over c_n: c_t is one penalty, and gaps then have the same weight as
#: slips. Solutions do not depend on a. With a from 1 to 100, solutions of blocks in 2D are found.
#: With less, constraints whose slip direction changes seem to be on the edge; with more,
#: constraints open and close without reaching the edge. With small sliding c_n has no influence
#: over eight decades; where contact pairs change, a tenth of a penalty sometimes fails.
OF_PRESSURE = 100.0


#: Largest friction at points over the pressure, for laws whose limit does not vanish with the
#: pressure: for pressures below a third of the limit, the friction vanishes with the pressure. The
#: factor acts as a coefficient of friction at the edge of contact. With large values solutions are
#: not unique, and with 5 and 10 active sets cycle (tests/friction/test_friction.py, Tresca).
STEEP = 3.0


class Filled(typing.NamedTuple):
    """Friction with constraints on the edge of contact.

    Attributes:
        response: Response of the law; scaled down on the edge, and 0 for inactive constraints.
        edge: Constraints on the edge, which have a part of the friction T, (rows,).
        closed: Constraints with the full friction T, (rows,).
        by_trial: ∂τ/∂y_n for constraints on the edge, (rows, gdim); 0 for others.
        by_multiplier: ∂τ/∂τ for a fixed response of the law, for constraints on the edge, (rows,
            gdim, gdim); 0 for others.
    """

    response: Response
    edge: Flags
    closed: Flags
    by_trial: Array
    by_multiplier: Array


def fill(response: Response, multiplier: Array, trial: Array, whole: Flags, none: Flags) -> Filled:
    """Allow any part of the friction of a law for constraints on the edge of contact.

    With a law T whose limit does not vanish with the pressure, a constraint that is about to open
    may have no solution: with T it opens, and without friction it closes. The graph of friction
    over pressure and gap has a jump there, which is filled: a constraint is

        closed, λ > 0 = ḡ*, τ = T;   on the edge, λ = ḡ* = 0, τ = θ T, 0 ≤ θ ≤ 1;
        or open, λ = 0 > ḡ*, τ = 0.

    With d = T/|T| and y_n = λ + c_n ḡ*, which has the sign of λ or of ḡ*, all three states are

        τ = b d,   b = min(max(τ·d + a y_n, 0), |T|)

    for any a > 0: for 0 < b < |T| it requires y_n = 0. The right-hand side is continuous.

    Args:
        response: Response T of the law if all constraints are active.
        multiplier: τ (stress), (rows, gdim).
        trial: y_n (stress), (rows,).
        whole: Constraints with the full T for any y_n.
        none: Constraints without friction.
    """
    size = np.linalg.norm(response.traction, axis=1)
    divisor = np.where(size > 0, size, 1.0)
    d = response.traction / divisor[:, None]
    bound = np.sum(multiplier * d, axis=1) + OF_PRESSURE * trial
    closed = (whole | (bound >= size)) & ~none
    edge = (bound > 0) & ~closed & ~none
    bound = np.where(edge, bound, 0.0)
    # Derivative of b d: d changes with T, and b changes with d.
    part = np.where(edge, bound / divisor, closed.astype(np.float64))
    along = np.where(edge[:, None], d, 0.0)
    change = bound[:, None, None] * np.eye(d.shape[1]) + along[:, :, None] * multiplier[:, None, :]
    turning = change - np.sum(change * along[:, None, :], axis=2)[:, :, None] * along[:, None, :]
    slope = np.where(closed[:, None, None], np.eye(d.shape[1]), turning / divisor[:, None, None])
    return Filled(
        response._replace(
            traction=part[:, None] * response.traction,
            stiffness=slope @ response.stiffness,
            coupling=np.einsum("rij,rj->ri", slope, response.coupling),
            slipping=(response.slipping & closed) | edge,
            secant=part * response.secant,
        ),
        edge,
        closed,
        OF_PRESSURE * along,
        along[:, :, None] * along[:, None, :],
    )


def limited(law: Friction, response: Response, bound: Array, penalty: Array) -> Response:
    """Response of the law with given |τ| for constraints on the edge.

    Args:
        law: The law.
        response: Response of the law.
        bound: |τ| (stress) for constraints on the edge, infinite for others, (rows,).
        penalty: ε of each constraint in tangential direction (stress per length), (rows,).
    """
    size = np.linalg.norm(response.traction, axis=1)
    edge = bound < size
    if not edge.any():
        return response
    part = np.where(edge, bound / np.where(edge, size, 1.0), 1.0)
    traction = part[:, None] * response.traction
    dissipative = response.dissipative
    if isinstance(law, Limited):  # the rest is elastic
        dissipative = dissipative + (response.traction - traction) / penalty[:, None]
    return response._replace(
        traction=traction,
        stiffness=part[:, None, None] * response.stiffness,
        slipping=response.slipping | edge,
        dissipative=dissipative,
        secant=part * response.secant,
    )


def bounded(
    law: Friction, response: Response, bound: Array, slope: float, penalty: Array
) -> Response:
    """Response of the law with |τ| limited by a bound that is proportional to the pressure.

    Args:
        law: The law.
        response: Response of the law.
        bound: Bound of |τ| (stress), (rows,).
        slope: Derivative of the bound with respect to the pressure.
        penalty: ε of each constraint in tangential direction (stress per length), (rows,).
    """
    size = np.linalg.norm(response.traction, axis=1)
    out = limited(law, response, bound, penalty)
    over = bound < size
    if not over.any():
        return out
    d = np.where(over[:, None], response.traction / np.where(over, size, 1.0)[:, None], 0.0)
    across = np.eye(d.shape[1]) - d[:, :, None] * d[:, None, :]
    coupling = np.einsum("rij,rj->ri", across, out.coupling)
    return out._replace(
        stiffness=np.where(over[:, None, None], across @ out.stiffness, out.stiffness),
        coupling=np.where(over[:, None], coupling + slope * d, out.coupling),
    )
