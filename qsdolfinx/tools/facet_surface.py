"""Facets of a tool, with the interface of a body's facets."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class FacetSurface:
    """Facets of a tool at its present position, with the interface of :class:`qs.Surface`.

    Vertices have fictitious unknowns, which identify them across ranks.

    Attributes:
        comm: Communicator of the tool.
        gdim: Dimension of space.
        cpp_object: The extension's surface.
        coordinates: Coordinates of the vertices, (facets, vertices, 3), and of points behind the
            facets, (facets, 3); facets are affine, so there are no further nodes.
        trace_dofs: Unknowns of the vertices, (facets, vertices, gdim), and their owners.
        local_size: Unknowns of this rank.
        initial: Coordinates of the facets' vertices when the tool was made, of the same shape: they
            identify vertices on any number of ranks.
    """

    comm: MPI.Intracomm
    gdim: int
    cpp_object: _cpp.Surface
    coordinates: tuple[Array, Array, None]
    trace_dofs: tuple[Indices, npt.NDArray[np.int32]]
    local_size: int
    initial: Array

    @property
    def num_facet_vertices(self) -> int:
        """Vertices of a facet."""
        return self.coordinates[0].shape[1]

    @property
    def degree(self) -> int:
        """Degree of the facets: 1, they are flat."""
        return 1

    @property
    def node_dofs(self) -> Indices:
        """Unknowns of the vertices that this rank owns, (vertices, gdim)."""
        return np.asarray(self.cpp_object.node_dofs)

    def initial_vertices(self, owned: Indices) -> Array:
        """Initial coordinates of some of the vertices that this rank owns, by number, (n, 3)."""
        known, first = np.unique(self.trace_dofs[0][:, :, 0], return_index=True)
        at = first[np.searchsorted(known, self.node_dofs[owned, 0])]
        return np.asarray(self.initial.reshape(-1, 3)[at])

    @property
    def node_area(self) -> Array:
        """Nodal areas of the vertices that this rank owns, (vertices,)."""
        return np.asarray(self.cpp_object.node_area)

    def create_vec(self) -> PETSc.Vec:
        """New zero vector with the layout of the unknowns. Collective."""
        return PETSc.Vec().createMPI((self.local_size, PETSc.DETERMINE), comm=self.comm)
