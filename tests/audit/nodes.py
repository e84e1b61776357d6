"""Nodes of a body whose mesh may move and whose unknown may include pressures."""

import numpy as np
from audit.state import everywhere, padded

import basix
from dolfinx import fem, la

import qsdolfinx as qs


class Nodes:
    """Nodes of the displacements or velocities of a body.

    Args:
        u: Unknown; of a mixed space the first field is used.
        mixed: Whether it is in a mixed space.
    """

    def __init__(self, u, mixed=False):
        W = u.function_space
        self.V, dofs = qs.compat.collapse(W.sub(0)) if mixed else (W, None)
        self.u, self.comm, self.gdim = u, W.mesh.comm, W.mesh.geometry.dim
        self.dofs = np.arange(len(u.x.array)) if dofs is None else np.array(dofs)
        self.owned = self.V.dofmap.index_map.size_local
        layout, topology = self.V.dofmap.dof_layout, basix.topology(W.mesh.basix_cell())
        corners = [layout.entity_dofs(0, v)[0] for v in range(len(topology[0]))]
        #: Indices of the vertices within a cell.
        self.corners = corners
        #: Nodes within a cell that are not vertices: their number and the vertices around.
        self._others = [
            (d, [corners[v] for v in vertices])
            for dim in range(1, len(topology))
            for entity, vertices in enumerate(topology[dim])
            for d in layout.entity_dofs(dim, entity)
        ]

    def places(self):
        """Return the node positions on the present straight mesh; (nodes on this rank, 3)."""
        cells, geometry = self.V.dofmap.list, self.V.mesh.geometry
        index_map = self.V.dofmap.index_map
        x = np.zeros((self.owned + index_map.num_ghosts, 3))
        x[cells[:, self.corners]] = geometry.x[geometry.dofmap]
        return self.straight(x)

    def straight(self, x):
        """Return positions with non-vertex nodes moved to the mean of the surrounding vertices."""
        x, cells = x.copy(), self.V.dofmap.list
        for d, around in self._others:
            x[cells[:, d]] = x[cells[:, around]].mean(axis=1)
        return x

    def values(self, array):
        """Return the field in an array of all unknowns, shape (nodes on this rank, 3)."""
        return padded(array[self.dofs].reshape(-1, self.gdim))

    def set(self, f, values):
        """Set a function of the collapsed space to values at the nodes."""
        f.x.array[:] = values[:, : self.gdim].ravel()

    def gather(self, values):
        """Gather the values of all ranks on every rank. Collective."""
        return everywhere(self.comm, values[: self.owned])

    def residual(self, F):
        """Assemble F: at the nodes, shape (nodes, 3), and at other unknowns. Collective."""
        self.u.x.scatter_forward()
        b = fem.assemble_vector(F)
        b.scatter_reverse(la.InsertMode.add)
        W = self.u.function_space
        rest = np.ones(len(b.array), dtype=bool)
        rest[self.dofs] = False
        rest[W.dofmap.index_map.size_local * W.dofmap.bs :] = False
        return self.gather(self.values(b.array)), everywhere(self.comm, b.array[rest])

    def held(self, bcs):
        """Return components with conditions, also those that do not exist in 2D. Collective."""
        held = np.zeros(len(self.u.x.array), dtype=bool)
        for bc in bcs:
            held[bc.dof_indices()[0]] = True
        held = held[self.dofs].reshape(-1, self.gdim)
        return self.gather(np.pad(held, ((0, 0), (0, 3 - self.gdim)), constant_values=True))
