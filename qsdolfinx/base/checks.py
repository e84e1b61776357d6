"""Checks of single arguments."""

from __future__ import annotations

import math
import pathlib
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
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name}: must be one of {', '.join(choices)}, not {value!r}")


def check_type(name: str, value: typing.Any, kind: typing.Any, what: str) -> None:
    """Refuse what is not of a type.

    Args:
        name: Of the argument.
        value: Its value.
        kind: The type, or a tuple of types.
        what: The type in words.

    Raises:
        TypeError: With the argument's name.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name}: must be {what}, not {type(value).__name__}")


def check_flag(name: str, value: typing.Any) -> None:
    """Refuse what is neither True nor False.

    Raises:
        TypeError: With the argument's name.
    """
    check_type(name, value, (bool, np.bool_), "True or False")


def check_callable(name: str, value: typing.Any) -> None:
    """Refuse what is neither None nor can be called.

    Raises:
        TypeError: With the argument's name.
    """
    if value is not None and not callable(value):
        raise TypeError(f"{name}: must be a function, or None, not {value!r}")


def check_vector(name: str, value: typing.Any, size: int) -> npt.NDArray[np.float64]:
    """A new array with the value's components.

    Raises:
        ValueError: If it is not made of this many finite numbers.
    """
    try:
        given = np.array(value)
        vector = given.astype(np.float64) if given.dtype.kind in "fiu" else np.zeros((0, 0))
    except (TypeError, ValueError):
        vector = np.zeros((0, 0))
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise ValueError(f"{name}: must have {size} finite components, not {value!r}")
    return vector


def check_array(
    name: str, value: typing.Any, shape: tuple[int | None, ...]
) -> npt.NDArray[np.float64]:
    """The value as an array, not copied if it is one.

    Args:
        name: Of the argument.
        value: Its value.
        shape: Its shape, None for any length.

    Raises:
        ValueError: If it is not made of numbers, or of another shape.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.array("ragged")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: must be numbers, not {value!r}")
    fits = len(shape) == array.ndim and all(
        n is None or n == m for n, m in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name}: must be of the shape {shape}, not {array.shape}")
    return array.astype(np.float64, copy=False)


def check_file(name: str, value: typing.Any) -> pathlib.Path:
    """The path of a file that is going to be written.

    Raises:
        TypeError: If it is no path.
        FileNotFoundError: If its folder is missing.
    """
    path = check_path(name, value)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{name}: there is no folder {path.parent}")
    return path


def check_path(name: str, value: typing.Any) -> pathlib.Path:
    """The path.

    Raises:
        TypeError: If it is none.
    """
    check_type(name, value, (str, pathlib.Path), "a path")
    return pathlib.Path(value)
