"""Checks of what limits time steps."""

from __future__ import annotations

import typing

from mpi4py import MPI

from qsdolfinx.base.checks import check_positive, check_vector
from qsdolfinx.base.collective import check_agreement, collective_errors

#: Numbers that must be whole.
_COUNTS = ("num_pairings", "easy")


def check_limits(
    comm: MPI.Intracomm,
    *,
    dt: typing.Any,
    dt_min: typing.Any,
    dt_max: typing.Any,
    theta: typing.Any,
    max_penetration: typing.Any,
    **numbers: typing.Any,
) -> tuple[float, float]:
    """Refuse arguments of a TimeStepper that are out of range or differ between ranks. Collective.

    Returns:
        Smallest and largest Δt.

    Raises:
        ValueError: With the argument's name.
    """
    with collective_errors(comm):
        check_positive("dt", dt)
        numbers["dt_min"] = dt / 1000 if dt_min is None else dt_min
        numbers["dt_max"] = dt if dt_max is None else dt_max
        for name, number in numbers.items():
            check_positive(name, number)
            if name in _COUNTS and number != int(number):
                raise ValueError(f"{name}: must be an integer, not {number!r}")
        if max_penetration is not None:
            check_positive("max_penetration", max_penetration)
        if not numbers["dt_min"] <= dt <= numbers["dt_max"]:
            raise ValueError("dt: must be between dt_min and dt_max")
        number = isinstance(theta, (int, float)) and not isinstance(theta, bool)
        if not number or not 0 <= theta <= 1:
            raise ValueError(f"theta: must be between 0 and 1, not {theta!r}")
        if numbers["growth"] < 1:
            raise ValueError(f"growth: must be at least 1, not {numbers['growth']!r}")
        if numbers["cutback"] >= 1:
            raise ValueError(f"cutback: must be less than 1, not {numbers['cutback']!r}")
    check_agreement(comm, dt=dt, theta=theta, max_penetration=max_penetration, **numbers)
    return float(numbers["dt_min"]), float(numbers["dt_max"])


def check_end(comm: MPI.Intracomm, t_end: typing.Any) -> None:
    """Refuse an end that is no finite time or differs between ranks. Collective.

    Raises:
        ValueError: With the argument's name.
    """
    with collective_errors(comm):
        check_vector("t_end", [t_end], 1)
    check_agreement(comm, t_end=t_end)
