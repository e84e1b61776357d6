"""Common numbering of all bodies' unknowns: on each rank body 0, then body 1, and so on."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Indices = npt.NDArray[np.int64]


class Numbering(typing.NamedTuple):
    """Numbering of the unknowns of one body among those of all bodies.

    Attributes:
        ranges: The body's first number on every rank, and its size.
        shifts: Shift of the body's numbers on every rank.
    """

    ranges: Indices
    shifts: Indices

    def __call__(self, unknowns: Indices) -> Indices:
        """Convert global unknowns of the body to numbers among all bodies; -1 stays -1."""
        owner = np.searchsorted(self.ranges, unknowns, side="right") - 1
        return np.where(unknowns < 0, -1, unknowns + self.shifts[owner])


def numbering(matrices: typing.Sequence[PETSc.Mat]) -> list[Numbering]:
    """Numbering of each body, from its matrix. Collective."""
    ranges = [matrix.getOwnershipRanges().astype(np.int64) for matrix in matrices]
    sizes = np.array([np.diff(r) for r in ranges])
    starts = np.append(0, np.cumsum(sizes.sum(axis=0)))[:-1]
    first = starts + np.cumsum(sizes, axis=0) - sizes
    return [Numbering(r, f - r[:-1]) for f, r in zip(first, ranges, strict=True)]
