"""The ring of the ring compression test."""

from mpi4py import MPI

import numpy as np

from dolfinx import mesh

from common.bodies import facets_at
from forming_bodies import NortonHoff

OUTER, INNER, HEIGHT = 15.0, 7.5, 10.0  # mm
K, M = 50.0, 0.15  # MPa sᵐ, -


class Ring(NortonHoff):
    """Half a section of the ring, with its surfaces.

    Args:
        comm: Communicator.
        cells: Cells across the wall.
        slow: Strain rate below which the viscosity is regularised.
    """

    def __init__(self, comm, cells, slow):
        rows = 2 * round(cells * HEIGHT / (OUTER - INNER) / 2)  # even: nodes at mid height
        corners, crossed = [[INNER, 0], [OUTER, HEIGHT]], mesh.DiagonalType.crossed
        msh = mesh.create_rectangle(comm, corners, [cells, rows], diagonal=crossed)
        super().__init__(msh, K, M, slow)
        self.lower, self.upper = (self.surface(facets_at(msh, 1, z)) for z in (0.0, HEIGHT))
        #: Surface that may fold on to a die: inner and outer side without the facets next to the
        #: faces. With these facets the edges would have more area than is in contact with the die.
        self.sides = self.surface(
            mesh.locate_entities_boundary(msh, 1, lambda x: (x[1] > 1e-6) & (x[1] < HEIGHT - 1e-6))
        )
        r, z, _ = msh.geometry.x.T
        middle = np.isclose(z, HEIGHT / 2)
        self._middle = [np.flatnonzero(middle & np.isclose(r, radius)) for radius in (INNER, OUTER)]

    def radii(self):
        """Return inner and outer radius at mid height over their initial values. Collective."""
        local = [self.mesh.geometry.x[nodes, 0].max(initial=0.0) for nodes in self._middle]
        inner, outer = (self.mesh.comm.allreduce(radius, op=MPI.MAX) for radius in local)
        return inner / INNER, outer / OUTER
