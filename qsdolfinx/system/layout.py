"""Positions of the unknowns of bodies, multipliers and tools in z, and their numbers."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Layout:
    """Parts of z: bodies, multipliers of integration sides, and tools on the first rank.

    Args:
        comm: The communicator.
        num_bodies: Number of bodies, which are the first parts.
        sizes: Number of unknowns of each part on this rank.

    Attributes:
        ends: Start of each part of this rank, and its number of unknowns.
        first: Number of the first unknown of each part on every rank, (ranks, parts + 1).
        num_local: Number of unknowns of this rank.
        start: Global number of the first unknown of this rank.
        size: Number of unknowns of all ranks.
    """

    def __init__(self, comm: MPI.Comm, num_bodies: int, sizes: typing.Sequence[int]) -> None:
        self._rank, self.num_bodies = comm.rank, num_bodies
        self.ends: Indices = np.cumsum([0, *sizes])
        every = np.array(comm.allgather(self.ends), dtype=np.int64).reshape(comm.size, -1)
        first = np.append(0, np.cumsum(every[:, -1]))
        self.first: Indices = first[:-1, None] + every
        #: For each body: the first of its own numbers on every rank, and its size.
        self._ranges = [
            np.append(0, np.cumsum(np.diff(every, axis=1)[:, i])) for i in range(num_bodies)
        ]
        self.num_local, self.start = int(self.ends[-1]), int(first[comm.rank])
        self.size = int(first[-1])

    def part(self, z: Array, i: int) -> Array:
        """Part i of this rank's unknowns."""
        return z[self.ends[i] : self.ends[i + 1]]

    def numbers(self, i: int, unknowns: Indices) -> Indices:
        """Numbers in z of global unknowns of body i; −1 stays −1."""
        ranges = self._ranges[i]
        owner = np.clip(np.searchsorted(ranges, unknowns, side="right") - 1, 0, len(ranges) - 2)
        return np.where(unknowns < 0, -1, unknowns - ranges[owner] + self.first[owner, i])

    def first_of_body(self, i: int) -> int:
        """First of body i's own numbers on this rank."""
        return int(self._ranges[i][self._rank])

    def first_of_pass(self, k: int) -> int:
        """Number in z of the first multiplier of integration side k on this rank."""
        return int(self.first[self._rank, self.num_bodies + k])

    def of_tool(self, k: int) -> int:
        """Number in z of the displacement of force-controlled tool k."""
        return int(self.first[0, -2]) + k
