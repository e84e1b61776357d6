"""Checks of single arguments."""

from __future__ import annotations

import math
import typing

import numpy as np


def check_positive(name: str, value: typing.Any, alternative: str = "") -> None:
    """Refuse what is not a positive, finite number.

    Raises:
        ValueError: With the argument's name and, if given, what else it may be.
    """
    number = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(
        value, bool
    )
    if not (number and math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: must be a positive, finite number{alternative}, not {value!r}")


def check_choice(name: str, value: typing.Any, choices: typing.Sequence[str]) -> None:
    """Refuse what is not one of the choices.

    Raises:
        ValueError: With the argument's name and the choices.
    """
    if value not in choices:
        raise ValueError(f"{name}: must be one of {', '.join(choices)}, not {value!r}")
