"""Check single arguments."""

from __future__ import annotations

import os
import pathlib
import sys
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh


class Kind(typing.NamedTuple):
    """Admissible kind of an argument.

    Attributes:
        text: Description that follows "must be" in messages.
        fits: Whether a value is of this kind.
        error: Exception for a value that is not.
    """

    text: str
    fits: typing.Callable[[typing.Any], bool]
    error: type[Exception] = ValueError


def number(text: str, fits: typing.Callable[[float], bool]) -> Kind:
    """Finite numbers that satisfy a condition; True and False are not numbers."""

    def fitting(value: typing.Any) -> bool:
        known = isinstance(value, (int, float, np.floating, np.integer))
        finite = known and not isinstance(value, bool) and abs(value) <= sys.float_info.max
        return finite and bool(fits(value))

    return Kind(text, fitting)


def one_of(choices: typing.Sequence[str]) -> Kind:
    """One of several names."""
    text = f"one of {', '.join(choices)}"
    return Kind(text, lambda value: isinstance(value, str) and value in choices)


def instance(types: typing.Any, text: str) -> Kind:
    """Objects of one type, or of one of several types."""
    return Kind(text, lambda value: isinstance(value, types), TypeError)


def either(kind: Kind, other: str | None) -> Kind:
    """Values of a kind, or a given name, or None."""

    def fitting(value: typing.Any) -> bool:
        return (isinstance(value, type(other)) and value == other) or kind.fits(value)

    text = "None" if other is None else f'"{other}"'
    return Kind(f"{kind.text}, or {text}", fitting, kind.error)


POSITIVE = number("a positive, finite number", lambda x: x > 0)
FINITE = number("a finite number", lambda x: True)
FRACTION = number("a number from 0 to 1", lambda x: 0 <= x <= 1)
COUNT = number("a positive integer", lambda x: x > 0 and x == int(x))
FLAG = instance((bool, np.bool_), "True or False")
CALLABLE = Kind("a function", callable, TypeError)
MAPPING = instance(typing.Mapping, "a dictionary")
FUNCTION = instance(fem.Function, "a dolfinx.fem.Function")
MESH = instance(mesh.Mesh, "a dolfinx.mesh.Mesh")
TAGS = instance(mesh.MeshTags, "a dolfinx.mesh.MeshTags")
PATH = instance((str, os.PathLike), "a path")


def check(kind: Kind, /, **arguments: typing.Any) -> None:
    """Raise an error for arguments that are not of a kind.

    Args:
        kind: The kind.
        arguments: Values by argument name, for the error message. Raises:
        Exception: The kind's exception, with the argument's name and what it must be.
    """
    for name, value in arguments.items():
        if not kind.fits(value):
            raise kind.error(f"{name}: must be {kind.text}, not {shown(value)}")


def require(holds: object, text: str, error: type[Exception] = ValueError) -> None:
    """Raise an error with this text unless a condition holds, for example between two arguments."""
    if not holds:
        raise error(text)


def shown(value: typing.Any) -> str:
    """Text of a wrong value: as Python prints it, or its type if that is long or an address."""
    text = repr(value)
    return text if len(text) <= 60 and " at 0x" not in text else type(value).__name__


def check_array(
    name: str, value: typing.Any, shape: tuple[int | None, ...]
) -> npt.NDArray[np.float64]:
    """The value as an array; an array is not copied.

    Args:
        name: Name of the argument.
        value: Its value.
        shape: Its shape, None for any length.

    Raises:
        ValueError: If it is not made of numbers, or of another shape.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.array("ragged")
    if array.dtype.kind not in "fiu":  # formatting the value takes longer than the check
        raise ValueError(f"{name}: must be numbers, not {shown(value)}")
    fits = len(shape) == array.ndim and all(
        n is None or n == m for n, m in zip(shape, array.shape, strict=True)
    )
    require(fits, f"{name}: must be of the shape {shape}, not {array.shape}")
    return array.astype(np.float64, copy=False)


def check_vector(name: str, value: typing.Any, size: int) -> npt.NDArray[np.float64]:
    """A new array with the value's components.

    Raises:
        ValueError: If it is not made of this many finite numbers.
    """
    vector = np.array(check_array(name, value, (size,)))
    if not np.isfinite(vector).all():
        raise ValueError(f"{name}: must be finite, not {shown(value)}")
    return vector


def check_file(name: str, value: typing.Any) -> pathlib.Path:
    """Path of a file to be written.

    Raises:
        TypeError: If it is not a path.
        FileNotFoundError: If its folder is missing.
    """
    check(PATH, **{name: value})
    path = pathlib.Path(value)
    require(path.parent.is_dir(), f"{name}: there is no folder {path.parent}", FileNotFoundError)
    return path
