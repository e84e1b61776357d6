"""Make meshes of the jobs' nodes and cells for the drivers that use DOLFINx."""

import numpy as np

import basix.ufl
import ufl
from dolfinx import mesh


def create_mesh(comm, x, cells):
    """Make a mesh of hexahedra. DOLFINx numbers the corners of a cell row by row."""
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    return mesh.create_mesh(comm, cells[:, [0, 1, 3, 2, 4, 5, 7, 6]], x=x, e=ufl.Mesh(element))


def locate(msh, quads):
    """Return facets of a side of a body, given by the nodes of its faces."""
    on_side = np.isin(msh.geometry.input_global_indices, np.unique(quads))
    msh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(msh.topology)
    nodes = mesh.entities_to_geometry(msh, 2, facets)
    return facets[on_side[nodes].all(axis=1)]


def at_nodes(values, V, nodes):
    """Return values of degree 1 in the order of the job's nodes, shape (nodes, 3); one rank.

    Args:
        values: Degrees of freedom.
        V: Function space of the values.
        nodes: Nodes of each cell in the mesh.
    """
    out = np.empty((V.mesh.geometry.x.shape[0], 3))
    rows = V.mesh.geometry.input_global_indices[nodes]
    out[rows.ravel()] = values.reshape(-1, 3)[V.dofmap.list.ravel()]
    return out
