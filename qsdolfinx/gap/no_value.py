"""Errors for positions at which contact cannot be evaluated, and checks of what laws return."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class NoValueError(ValueError):
    """Contact cannot be evaluated: usually an iterate of Newton's method is too far off.

    All ranks raise it together.
    """


class NoGapError(NoValueError):
    """Gaps cannot be measured for these positions."""


class NoMultiplierError(NoValueError):
    """A law has returned a number that is not finite."""


def check_finite(
    of_law: str, found: Array, at: typing.Sequence[tuple[str, Array]], contact: str | None
) -> None:
    """Raise an error for results of a law that are not finite, at input that is finite.

    Args:
        of_law: The law and its function.
        found: The result, with a row for each constraint.
        at: Names and values of the input, each with a row for each constraint.
        contact: Name of the contact.

    Raises:
        NoMultiplierError: If there are such results on this rank.
    """
    wrong = ~_finite(found)
    for _, values in at:
        wrong &= _finite(values)
    if not wrong.any():
        return
    i = int(np.argmax(wrong))
    given = ", ".join(f"{name} = {_text(values[i])}" for name, values in at)
    text = f"{of_law} has returned {_text(found[i])}, which is not finite, for {given}"
    raise NoMultiplierError(text if contact is None else f"contact {contact!r}: {text}")


def _finite(values: Array) -> npt.NDArray[np.bool_]:
    """Rows without NaN and infinity."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


def _text(values: Array) -> str:
    """Numbers of a row."""
    numbers = [f"{value:.6g}" for value in np.ravel(values)]
    return numbers[0] if len(numbers) == 1 else f"({', '.join(numbers)})"
