"""History variables of laws, as functions of the slave's nodes."""

from __future__ import annotations

import contextlib
import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require
from qsdolfinx.gap.rows import Rows

Array = npt.NDArray[np.float64]


class Remembering(typing.Protocol):
    """A law of gaps or of friction: ``memory`` names history variables and initial values."""

    @property
    def memory(self) -> typing.Mapping[str, float]:
        """Initial values of the history variables by name; empty for a law without any."""


@dataclasses.dataclass(frozen=True, eq=False)
class LawMemory:
    """History variables of a law on one integration side. Arrays are never written into.

    Each variable is a function on the slave's surface: one value for each owned node, or with
    constraints at points one for each smooth patch of a node. The law gets the values of these
    functions at its constraints. They belong to the slave: when contact pairs are updated, or
    points move, nothing is transferred. Beside a steep front, a function of the nodes exceeds the
    values from which it was projected: the law gets nothing beyond the values that it has returned.

    Attributes:
        first: Initial values by name.
        limits: Least and largest value that the law has returned so far, for each name.
        start: Values at the start of the step, (nodes, patches) for each name.
        end: Values at the end of the last step, until the next step begins; None otherwise.
        known: Values of ``start`` at the constraints of the last evaluation, (rows,) for each name.
        rows: The constraints of ``known``; None if ``start`` has changed since.
    """

    first: typing.Mapping[str, float] = dataclasses.field(default_factory=dict)
    limits: typing.Mapping[str, list[float]] = dataclasses.field(default_factory=dict)
    start: dict[str, Array] = dataclasses.field(default_factory=dict)
    end: dict[str, Array] | None = None
    known: dict[str, Array] = dataclasses.field(default_factory=dict)
    rows: Rows | None = None

    @classmethod
    def of(cls, law: Remembering, rows: Rows) -> LawMemory:
        """Initial values of the history variables of a law."""
        first = {name: float(value) for name, value in law.memory.items()}
        shape = len(rows.slave.node_area), rows.num_patches
        start, known = dict[str, Array](), dict[str, Array]()
        for name, value in first.items():
            start[name] = np.full(shape, value)
            known[name] = np.full(rows.operator.num_rows, value)
        limits = {name: [value, value] for name, value in first.items()}
        return cls(first, limits, start, None, _locked(known))

    @property
    def latest(self) -> dict[str, Array]:
        """Values after the last step, (nodes, patches) for each name."""
        return self.start if self.end is None else self.end

    def begun(self) -> LawMemory:
        """The history variables at the start of the next step."""
        return self if self.end is None else self.with_values(self.end)

    def with_values(self, values: dict[str, Array]) -> LawMemory:
        """The history variables with other values at the start of the step."""
        return dataclasses.replace(self, start=values, end=None, rows=None)

    def with_limits(self, limits: typing.Mapping[str, list[float]]) -> LawMemory:
        """The history variables with other limits."""
        return dataclasses.replace(self, limits=limits, rows=None)

    def forgotten(self) -> LawMemory:
        """The history variables with their initial values."""
        first = {name: np.full_like(x, self.first[name]) for name, x in self.start.items()}
        limits = {name: [value, value] for name, value in self.first.items()}
        return self.with_values(first).with_limits(limits)

    def at(self, rows: Rows) -> LawMemory:
        """The history variables, known at these constraints. Collective."""
        if not self.first or self.rows is rows:
            return self
        known = {}
        for name, values in self.start.items():
            low, high = self.limits[name]
            known[name] = np.clip(rows.from_patches(values), low, high)
        return dataclasses.replace(self, known=_locked(known), rows=rows)

    def after(self, rows: Rows, found: typing.Mapping[str, Array]) -> LawMemory:
        """The history variables at the end of a step. Collective.

        Args:
            rows: The constraints.
            found: Values at the constraints at the end of the step, by name, (rows,).
        """
        end = {
            name: rows.advanced(values, self.known[name], found[name])
            for name, values in self.start.items()
        }
        ends = [(-x.min(initial=np.inf), x.max(initial=-np.inf)) for x in found.values()]
        most = np.array(ends)
        rows.slave.comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)
        limits = {
            name: [min(self.limits[name][0], float(-low)), max(self.limits[name][1], float(high))]
            for name, (low, high) in zip(found, most, strict=True)
        }
        return dataclasses.replace(self, end=end, limits=limits)


def _locked(values: dict[str, Array]) -> dict[str, Array]:
    """The same arrays, made read-only: a user's law has to return new arrays."""
    for array in values.values():
        array.flags.writeable = False
    return values


def committed(law: Remembering, what: str, found: typing.Any, num_rows: int) -> dict[str, Array]:
    """Result of ``commit`` of a user's law as arrays.

    Args:
        law: The law.
        what: The argument of :class:`qs.Contact` that the law is.
        found: Result of its ``commit``.
        num_rows: Number of constraints on this rank.

    Raises:
        ValueError: If there is not a finite number for each name and constraint.
    """
    called, names = f"{what}: {type(law).__name__}.commit must return", sorted(law.memory)
    text = f"{called} a dict of its memory, {names}"
    require(isinstance(found, typing.Mapping), f"{text}, not {type(found).__name__}")
    require(set(found) == set(names), f"{text}, not {list(found)}")
    out = {}
    for name in names:
        values = np.asarray(found[name], dtype=np.float64)
        fits = values.shape == (num_rows,) and bool(np.isfinite(values).all())
        require(fits, f"{called} finite {name!r} for each constraint, of shape ({num_rows},)")
        out[name] = values
    return out


@contextlib.contextmanager
def named_keys(law: Remembering, what: str) -> typing.Iterator[None]:
    """Say which history variables a law has, if it raises a KeyError inside the block.

    Args:
        law: The law.
        what: The argument of :class:`qs.Contact` that the law is.

    Raises:
        ValueError: In place of a KeyError of such a law.
    """
    try:
        yield
    except KeyError as error:
        if not law.memory:
            raise
        text = f"{what}: {type(law).__name__} has raised KeyError({error}); if that is meant to be"
        raise ValueError(
            f"{text} a history variable: its memory is {sorted(law.memory)}, and its commit must "
            "return these names"
        ) from error
