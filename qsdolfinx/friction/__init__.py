"""Friction: laws, slip, and history variables from step to step."""

from qsdolfinx.friction.laws import (
    Coulomb,
    CoulombTresca,
    Friction,
    Limited,
    Norton,
    Parameter,
    Response,
    Rows,
    Slid,
    Sticking,
    Tresca,
)

__all__ = [
    "Coulomb",
    "CoulombTresca",
    "Friction",
    "Limited",
    "Norton",
    "Parameter",
    "Response",
    "Rows",
    "Slid",
    "Sticking",
    "Tresca",
]
