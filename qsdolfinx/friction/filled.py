"""The filled graph of friction that jumps where rows open: part of it on the edge of contact."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.laws import Friction, Limited, Response

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: a of ``fill``. With c_n of 1e-2 penalties it lets gaps weigh what slips do, c_t being a penalty.
#: Solutions do not depend on it. From 1 to 100 blocks in 2D are found; with less, rows whose slip
#: turns seem to be on the edge, and with more, rows open and close without getting there.
OF_PRESSURE = 100.0


#: Pressures that friction is at points at most: of laws whose limit does not vanish with the
#: pressure it does so below a third of it. It is as a coefficient of friction at the edge of
#: contact: large ones have no unique solution, and with 5 and 10 sets of points cycle
#: (tests/friction/test_friction.py, Tresca).
STEEP = 3.0


class Filled(typing.NamedTuple):
    """What friction is, the edge of contact included.

    Attributes:
        response: The law's answer; scaled down on the edge, and 0 where rows are open.
        edge: Rows on the edge: they have part of the friction of closed ones, (rows,).
        closed: Rows that have all of it, (rows,).
        by_trial: ∂τ/∂y_n of rows on the edge, (rows, gdim); 0 of others.
        by_multiplier: ∂τ/∂τ with the law's answer held, (rows, gdim, gdim); likewise.
    """

    response: Response
    edge: Flags
    closed: Flags
    by_trial: Array
    by_multiplier: Array


def fill(response: Response, multiplier: Array, trial: Array, whole: Flags, none: Flags) -> Filled:
    """Let friction be any part of the law's answer where rows are on the edge of contact.

    A law T whose limit does not vanish with the pressure leaves a row that is about to open no
    state: with T it opens, and without any friction it closes. The graph of friction over
    pressure and gap has a jump there, which is filled: a row is

        closed, λ > 0 = ḡ*, τ = T;   on the edge, λ = ḡ* = 0, τ = θ T, 0 ≤ θ ≤ 1;
        or open, λ = 0 > ḡ*, τ = 0.

    With d = T/|T| and y_n = λ + c_n ḡ*, which has the sign of λ or of ḡ*, all three are

        τ = b d,   b = min(max(τ·d + a y_n, 0), |T|)

    for any a > 0: where 0 < b < |T| it says y_n = 0. The right-hand side is continuous.

    Args:
        response: What the law answers if all rows are closed: T.
        multiplier: τ (stress), (rows, gdim).
        trial: y_n (stress), (rows,).
        whole: Rows that have T whatever y_n is.
        none: Rows that have none.
    """
    size = np.linalg.norm(response.traction, axis=1)
    divisor = np.where(size > 0, size, 1.0)
    d = response.traction / divisor[:, None]
    bound = np.sum(multiplier * d, axis=1) + OF_PRESSURE * trial
    closed = (whole | (bound >= size)) & ~none
    edge = (bound > 0) & ~closed & ~none
    bound = np.where(edge, bound, 0.0)
    # b d, d changing with T, and b with d.
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
    """The law's answer where |τ| is known of rows on the edge.

    Args:
        law: The law.
        response: What it answers.
        bound: |τ| (stress) of rows on the edge, infinite of others, (rows,).
        penalty: ε of each row in tangential direction (stress per length), (rows,).
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
    """The law's answer with |τ| at most a bound that goes with the pressure.

    Args:
        law: The law.
        response: What it answers.
        bound: Of |τ| (stress), (rows,).
        slope: Its derivative by the pressure.
        penalty: ε of each row in tangential direction (stress per length), (rows,).
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
