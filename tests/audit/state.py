"""Read bodies and contact surfaces of a solved scene as plain arrays, the same on every rank.

Uses DOLFINx only. In 2D all vectors have a third component of 0, which is held.
"""

import dataclasses

import numpy as np

import basix
from dolfinx import fem, la


@dataclasses.dataclass
class BodyState:
    """State of a body; nodes have DOLFINx's global numbers.

    Attributes:
        x: Undeformed nodes, shape (nodes, 3).
        u: Displacements of the nodes.
        force: Assembled F: internal forces less loads, which equal the forces of contact and
            conditions on the body, shape (nodes, 3).
        held: Components with Dirichlet conditions, shape (nodes, 3).
    """

    x: np.ndarray
    u: np.ndarray
    force: np.ndarray
    held: np.ndarray


@dataclasses.dataclass
class SurfaceState:
    """State of a contact surface; node numbers are those of its body.

    Attributes:
        facets: Vertices of the facets, shape (facets, 2, 3 or 4).
        pieces: Intervals or triangles into which facets are divided, with all nodes among their
            corners; shape (pieces, gdim).
        sign: Sign of each piece; the normal in the order of its corners times this sign points
            outwards.
        parent: Facet of each piece.
        nodes: All nodes on the surface, sorted.
        vertices: Vertices among these nodes, sorted.
        hat: Values of the vertices' P1 or Q1 functions at all nodes, shape (vertices, nodes).
    """

    facets: np.ndarray
    pieces: np.ndarray
    sign: np.ndarray
    parent: np.ndarray
    nodes: np.ndarray
    vertices: np.ndarray
    hat: np.ndarray


def everywhere(comm, values):
    """Gather the rows of all ranks, in their order, on every rank. Collective."""
    return np.concatenate(comm.allgather(np.ascontiguousarray(values)))


def padded(values):
    """Add a third component."""
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


def read_body(F, u, bcs):
    """Read the state of a body from its UFL residual, unknown and conditions. Collective."""
    V = u.function_space
    comm, index_map, bs = V.mesh.comm, V.dofmap.index_map, V.dofmap.bs
    owned = index_map.size_local
    u.x.scatter_forward()
    b = fem.assemble_vector(fem.form(F))
    b.scatter_reverse(la.InsertMode.add)
    held = np.zeros(len(u.x.array), dtype=bool)
    for bc in bcs:
        held[bc.dof_indices()[0]] = True
    held = np.pad(held.reshape(-1, bs)[:owned], ((0, 0), (0, 3 - bs)), constant_values=True)
    return BodyState(
        everywhere(comm, V.tabulate_dof_coordinates()[:owned]),
        everywhere(comm, padded(u.x.array.reshape(-1, bs)[:owned])),
        everywhere(comm, padded(b.array.reshape(-1, bs)[:owned])),
        everywhere(comm, held),
    )


def read_surface(V, facets, x):
    """Read the state of a contact surface from its facets on this rank. Collective.

    Args:
        V: Space of the displacements, of degree 1 or 2.
        facets: Exterior facets on this rank, including facets that other ranks have as well.
        x: Nodes of the body, shape (nodes, 3).
    """
    msh, layout = V.mesh, V.dofmap.dof_layout
    tdim, gdim = msh.topology.dim, msh.geometry.dim
    msh.topology.create_connectivity(tdim - 1, tdim)
    msh.topology.create_connectivity(tdim, tdim - 1)
    to_cell = msh.topology.connectivity(tdim - 1, tdim)
    to_facet = msh.topology.connectivity(tdim, tdim - 1)
    num_vertices = len(basix.topology(msh.basix_cell())[0])
    corners = [layout.entity_dofs(0, v)[0] for v in range(num_vertices)]
    found = []
    for facet in facets:
        cell = to_cell.links(facet)[0]
        if cell >= msh.topology.index_map(tdim).size_local:
            continue
        local = int(np.flatnonzero(to_facet.links(cell) == facet)[0])
        closure = layout.entity_closure_dofs(tdim - 1, local)
        order = [d for d in corners if d in closure]
        order += [d for d in closure if d not in corners]
        cells = V.dofmap.cell_dofs(cell)
        inner = next(d for d in corners if d not in closure)
        found.append(V.dofmap.index_map.local_to_global(cells[[*order, inner]].astype(np.int32)))
    num = 4 if num_vertices == 8 else tdim  # of one facet
    width = len(layout.entity_closure_dofs(tdim - 1, 0)) + 1
    rows = everywhere(msh.comm, np.array(found, dtype=np.int64).reshape(-1, width))
    return assemble_surface(rows[:, :-1], rows[:, -1], num, gdim, x)


def assemble_surface(rows, inner, num, gdim, x):
    """Make a surface from the nodes of its facets, vertices first, and a node off each facet."""
    facets, nodes = rows[:, :num], np.unique(rows)
    vertices = np.unique(facets)
    hat = np.zeros((len(vertices), len(nodes)))
    pieces, off, parent = [], [], []
    for number, (row, beyond) in enumerate(zip(rows, inner, strict=True)):
        weights = np.array([corner_weights(x[row[:num]], x[node]) for node in row])
        hat[np.ix_(np.searchsorted(vertices, row[:num]), np.searchsorted(nodes, row))] = weights.T
        cut = cut_facet(weights)
        pieces += [row[list(piece)] for piece in cut]
        off += [beyond] * len(cut)
        parent += [number] * len(cut)
    pieces = np.array(pieces, dtype=np.int64).reshape(-1, gdim)
    outwards = np.sum(cross_product(x[pieces]) * (x[pieces[:, 0]] - x[off]), axis=1)
    parent = np.array(parent, dtype=np.int64)
    return SurfaceState(facets, pieces, np.sign(outwards), parent, nodes, vertices, hat)


def corner_weights(corners, point):
    """Return shape functions of the corners at a corner, a mid-side point or the centre."""
    size = np.ptp(corners, axis=0).max()
    count = len(corners)
    sets = [(i,) for i in range(count)]
    sets += [(i, j) for i in range(count) for j in range(i) if count < 4 or i + j != 3]
    sets += [tuple(range(count))]
    for chosen in sets:
        if np.linalg.norm(corners[list(chosen)].mean(axis=0) - point) < 1e-8 * size:
            out = np.zeros(count)
            out[list(chosen)] = 1 / len(chosen)
            return out
    raise ValueError("a node is not where one of degree 2 would be")


def cut_facet(weights):
    """Return triangles, or intervals, between the nodes of a facet.

    Args:
        weights: Shape functions of the corners at the nodes, shape (nodes, corners).
    """
    at = {tuple(np.flatnonzero(row)): i for i, row in enumerate(weights)}
    count = weights.shape[1]
    middle = {pair: at[pair] for pair in at if len(pair) == 2}
    if count == 2:
        return [(0, 1)] if not middle else [(0, middle[0, 1]), (middle[0, 1], 1)]
    if count == 3:
        if not middle:
            return [(0, 1, 2)]
        a, b, c = middle[1, 2], middle[0, 2], middle[0, 1]
        return [(0, c, b), (c, 1, a), (b, a, 2), (a, b, c)]
    if not middle:
        return [(0, 1, 3), (0, 3, 2)]
    m = at[0, 1, 2, 3]
    ring = [0, middle[0, 1], 1, middle[1, 3], 3, middle[2, 3], 2, middle[0, 2]]
    return [(m, a, b) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]


def cross_product(corners):
    """Return normals of intervals or triangles, with their length or twice their area as norm."""
    if corners.shape[1] == 2:
        t = corners[:, 1] - corners[:, 0]
        return np.stack([t[:, 1], -t[:, 0], 0 * t[:, 0]], axis=1)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
