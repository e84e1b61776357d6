"""Evaluate functions at points and along surfaces, with the same result on all ranks."""

import numpy as np


def at_node(u, point):
    """Return the value of a function of degree 1 or 2 at the node at a point. Collective."""
    V = u.function_space
    size, bs = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
    x = V.tabulate_dof_coordinates()[:size, : len(point)]
    found = np.flatnonzero(np.all(np.isclose(x, point, rtol=1e-9, atol=1e-9), axis=1))
    values = u.x.array.reshape(-1, bs)[found[:1]]
    return np.concatenate(V.mesh.comm.allgather(values))[0]


def along(surface, *values):
    """Return positions of all nodes of a surface and values there, sorted by x and then by y.

    Args:
        surface: The surface.
        values: Of this rank's nodes, in the order of ``surface.node_x``.

    Returns:
        List of arrays, whose first axes are the nodes. Collective.
    """
    everywhere = [
        np.concatenate(surface.comm.allgather(array)) for array in (surface.node_x, *values)
    ]
    order = np.lexsort(np.round(everywhere[0].T[::-1], 12))
    return [array[order] for array in everywhere]
