"""Checks of single arguments."""

from __future__ import annotations

import math
import typing

import numpy as np
import numpy.typing as npt


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


def check_vector(name: str, value: typing.Any, size: int) -> npt.NDArray[np.float64]:
    """A new array with the value's components.

    Raises:
        ValueError: If it is not made of this many finite numbers.
    """
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.zeros((0, 0))
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise ValueError(f"{name}: must have {size} finite components, not {value!r}")
    return vector
