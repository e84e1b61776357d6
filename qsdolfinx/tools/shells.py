"""Connected shells of a tool's facets, each with its own orientation."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.tools.touching import components
from qsdolfinx.tools.triangulation import Facets

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Shells:
    """Find the connected shell of each vertex of a tool. Collective.

    Facets that share a vertex belong to one shell. A shell's name is the smallest global number of
    its vertices.

    Args:
        comm: Communicator of the tool.
        facets: This rank's facets.
    """

    def __init__(self, comm: MPI.Intracomm, facets: Facets) -> None:
        self._comm, self._facets = comm, facets
        self._ends = np.cumsum([0, *comm.allgather(facets.num_owned)])
        number, cells = np.unique(facets.vertices, return_inverse=True)
        cells = cells.reshape(facets.vertices.shape)
        roots = components(cells, len(number))
        mine: Indices = np.arange(self._ends[comm.rank], self._ends[comm.rank + 1])
        name = number.copy()
        while True:
            lowest = name.copy()
            np.minimum.at(lowest, roots, name)
            found = self._agreed(number, lowest[roots], mine)
            changed = bool(np.any(found != name))
            name = found
            if not comm.allreduce(changed, op=MPI.LOR):
                break
        self._names = mine  # names of owned vertices; lowered by _agreed

    def _agreed(self, number: Indices, name: Indices, owned: Indices) -> Indices:
        """Lower names at the vertices' owners, and return the resulting names. Collective."""
        rank = self._owner(number)
        asked = self._comm.alltoall([number[rank == r] - self._ends[r] for r in self._ranks])
        told = self._comm.alltoall([name[rank == r] for r in self._ranks])
        for vertices, names in zip(asked, told, strict=True):
            np.minimum.at(owned, vertices, names)
        answers = self._comm.alltoall([owned[vertices] for vertices in asked])
        out = np.zeros_like(number)
        for r, answer in zip(self._ranks, answers, strict=True):
            out[rank == r] = answer
        return out

    @property
    def _ranks(self) -> range:
        return range(self._comm.size)

    def _owner(self, number: Indices) -> Indices:
        """Ranks that own vertices."""
        return np.asarray(np.searchsorted(self._ends, number, side="right") - 1)

    def at(self, vertices: Indices) -> Indices:
        """Shells of vertices given by their global numbers, shape (vertices,). Collective."""
        return self._agreed(vertices, vertices, self._names)

    def extent(self, shell: int) -> tuple[int, Array, Array]:
        """Number of facets of a shell, and corners of its initial bounding box. Collective.

        Args:
            shell: Name of the shell, the same on all ranks.
        """
        inside = self.at(self._facets.vertices[:, 0]) == shell
        x = self._facets.x[inside].reshape(-1, self._facets.x.shape[2])
        corners = np.concatenate(
            [np.min(x, axis=0, initial=np.inf), -np.max(x, axis=0, initial=-np.inf)]
        )
        self._comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MIN)
        count = self._comm.allreduce(int(np.count_nonzero(inside)), op=MPI.SUM)
        low, high = np.split(corners, 2)
        return count, low, -high
