"""A tool's facets read as those of a body."""

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
    """A tool's facets where it is, as a :class:`qs.Surface` has its own.

    Vertices have unknowns that nobody has: they name them across ranks.

    Attributes:
        comm: Communicator of the tool.
        gdim: Of space.
        cpp_object: The extension's surface.
        coordinates: Of the vertices, (facets, vertices, 3), and of points behind the facets,
            (facets, 3); facets are affine, so that there are no nodes between.
        trace_dofs: Unknowns of the vertices, (facets, vertices, gdim), and their owners.
        local_size: Unknowns of this rank.
    """

    comm: MPI.Intracomm
    gdim: int
    cpp_object: _cpp.Surface
    coordinates: tuple[Array, Array, None]
    trace_dofs: tuple[Indices, npt.NDArray[np.int32]]
    local_size: int

    @property
    def num_facet_vertices(self) -> int:
        """Vertices of a facet."""
        return self.coordinates[0].shape[1]

    @property
    def node_dofs(self) -> Indices:
        """Unknowns of the vertices this rank owns, (vertices, gdim)."""
        return np.asarray(self.cpp_object.node_dofs)

    @property
    def node_area(self) -> Array:
        """Their areas, (vertices,)."""
        return np.asarray(self.cpp_object.node_area)

    def create_vec(self) -> PETSc.Vec:
        """New zero vector with the layout of the unknowns. Collective."""
        return PETSc.Vec().createMPI((self.local_size, PETSc.DETERMINE), comm=self.comm)
