"""Multipliers that belong to vertices of a tool, wherever these slide on the slave."""

from __future__ import annotations

import dataclasses
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class FacedVertices(typing.NamedTuple):
    """Vertices of a tool that have multipliers, and those of them that face the slave.

    Attributes:
        every: Owned vertices that have multipliers, ascending, (multipliers,).
        area: Area of each, (multipliers,).
        found: Those that face the slave, (points,).
    """

    every: Indices
    area: Array
    found: Indices

    @property
    def lost(self) -> Indices:
        """Positions in ``every`` of vertices that do not face the slave."""
        return np.flatnonzero(~np.isin(self.every, self.found)).astype(np.int64)


@dataclasses.dataclass(frozen=True)
class OwnRows:
    """Constraints at vertices of a tool, each with a multiplier of its own; not collective.

    Constraints and multipliers are on the rank that owns the vertex. All sharp vertices have them:
    the constraints of those that do not face the slave are inactive.

    Attributes:
        vertex: Owned vertices of the tool that have a multiplier, ascending, (multipliers,).
        place: Number of the multiplier of each constraint, a permutation, (rows,).
        area: Areas of the constraints, (rows,).
    """

    vertex: Indices
    place: Indices
    area: Array

    @classmethod
    def of(cls, vertices: FacedVertices, area: Array) -> OwnRows:
        """Number the constraints of vertices.

        Args:
            vertices: The vertices; constraints of those that face the slave come first.
            area: Areas of the constraints, (rows,).
        """
        found = np.searchsorted(vertices.every, vertices.found)
        return cls(vertices.every, np.concatenate([found, vertices.lost]), area)

    @property
    def num_multipliers(self) -> int:
        """Number of vertices with a multiplier on this rank."""
        return len(self.vertex)

    def at_rows(self, values: Array) -> Array:
        """Values of the multipliers at the constraints, (rows, …)."""
        return np.asarray(values[self.place])

    def from_rows(self, values: npt.NDArray[typing.Any]) -> npt.NDArray[typing.Any]:
        """Values of the constraints in the order of the multipliers, (multipliers, …)."""
        out = np.empty_like(values)
        out[self.place] = values
        return out

    def sums(self, values: Array) -> Array:
        """Areas times values of the constraints, in the order of the multipliers."""
        return np.asarray(self.from_rows((self.area * values.T).T))


class OfVertices(typing.NamedTuple):
    """Multipliers of a tool's vertices, which the same multipliers at nodes show as means.

    Attributes:
        on_nodes: The multipliers at nodes, to which these belong: once they have been replaced,
            nothing is known of the vertices.
        vertex: Owned vertices of the tool, ascending, (n,).
        values: Their multipliers (stress), (n, components).
    """

    on_nodes: Array
    vertex: Indices
    values: Array

    def recognised(self, on_nodes: Array, comm: MPI.Intracomm) -> Array:
        """Multipliers at nodes, or the equal ones to which these belong. Collective."""
        same = comm.allreduce(np.array_equal(on_nodes, self.on_nodes), op=MPI.LAND)
        return self.on_nodes if same else on_nodes

    def at(self, own: OwnRows) -> Array:
        """Multipliers of those vertices, 0 where nothing is known, (multipliers, components)."""
        out = np.zeros((own.num_multipliers, self.values.shape[1]))
        known = np.isin(own.vertex, self.vertex)
        out[known] = self.values[np.searchsorted(self.vertex, own.vertex[known])]
        return out
