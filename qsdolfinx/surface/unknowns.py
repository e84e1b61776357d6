"""Unknowns of a space at mesh vertices; works for blocked spaces and sub-spaces."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, mesh

from qsdolfinx.compat import cell_nodes, coordinate_element, num_entity_dofs

Indices = npt.NDArray[np.int32]

#: Edges of facets, by the number of vertices, in the order of a trace's nodes.
EDGES = {2: [(0, 1)], 3: [(0, 1), (0, 2), (1, 2)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}

#: Reference coordinates of the vertices of facets, by their number of vertices.
CORNERS = {
    2: np.array([[0.0], [1.0]]),
    3: np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    4: np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
}

#: Number of vertices of cells.
NUM_CELL_VERTICES = {
    mesh.CellType.triangle: 3,
    mesh.CellType.quadrilateral: 4,
    mesh.CellType.tetrahedron: 4,
    mesh.CellType.hexahedron: 8,
}


def block_of(V: fem.FunctionSpace) -> int:
    """Number of unknowns of a node: the components of a blocked vector space, or 1."""
    return V.mesh.geometry.dim if V.num_sub_spaces else 1


def dofs_at(V: fem.FunctionSpace, cells: Indices, places: Indices) -> Indices:
    """Local unknowns (not blocks) at given positions in a cell's dof layout, shape (..., block).

    Args:
        V: Blocked vector space, scalar space, or such a sub-space.
        cells: Local cell indices, broadcast against ``places``.
        places: Positions in the layout of the cells' blocks.
    """
    block = block_of(V)
    component = np.arange(block)
    if V.dofmap.bs == block:
        return np.asarray(
            V.dofmap.list[cells, places][..., None] * block + component, dtype=np.int32
        )
    # The dofmap of a sub-space lists single unknowns.
    dofs = V.dofmap.list[np.asarray(cells)[..., None], places[..., None] * block + component]
    return np.asarray(dofs, dtype=np.int32)


def vertex_dofs(V: fem.FunctionSpace, cells: Indices, vertices: Indices) -> Indices:
    """Local unknowns (not blocks) of cell vertices, shape (..., block).

    Args:
        V: Blocked vector space with one block per vertex, scalar space, or such a sub-space.
        cells: Local cell indices, broadcast against ``vertices``.
        vertices: Local vertex numbers within the cells.
    """
    count = NUM_CELL_VERTICES[V.mesh.topology.cell_type]
    places = np.array([V.dofmap.dof_layout.entity_dofs(0, v)[0] for v in range(count)])
    return dofs_at(V, cells, places[vertices])


def is_lagrange(V: fem.FunctionSpace, degree: int) -> bool:
    """Whether the space is continuous Lagrange, scalar or not, of a degree from 1 to this one."""
    element = V.element.basix_element if not V.num_sub_spaces else V.sub(0).element.basix_element
    lagrange = element.family == basix.ElementFamily.P and 1 <= element.degree <= degree
    return bool(lagrange) and not bool(element.discontinuous)


def first_vertex_unknowns(V: fem.FunctionSpace, Q: fem.FunctionSpace) -> Indices:
    """Map the first local unknown of V at each vertex to the first local unknown of Q there.

    Shape (local unknowns of V,); −1 for all other unknowns.

    Args:
        V: Blocked vector space, scalar space, or such a sub-space, with unknowns at the vertices.
        Q: Another such space on the same mesh.
    """
    topology = V.mesh.topology
    index_map, dofs = topology.index_map(topology.dim), V.dofmap.index_map
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)[:, None]
    vertices = np.arange(NUM_CELL_VERTICES[topology.cell_type], dtype=np.int32)[None, :]
    size = (dofs.size_local + dofs.num_ghosts) * V.dofmap.index_map_bs
    out = np.full(size, -1, dtype=np.int32)
    out[vertex_dofs(V, cells, vertices)[..., 0]] = vertex_dofs(Q, cells, vertices)[..., 0]
    return out


def facet_places(V: fem.FunctionSpace, degree: int) -> Indices:
    """Positions of the trace's nodes in a cell's dof layout, for each facet, shape (facets, nodes).

    Vertices come first. For degree 2, then come the edges in the order of the reference facet, and
    the interior of quadrilaterals. This is the order of trace_functions in cpp/geometry/facet.h.
    """
    return layout_places(V.dofmap.dof_layout, V.mesh, degree)


def layout_places(layout: typing.Any, msh: mesh.Mesh, degree: int) -> Indices:
    """As :func:`facet_places`, for any layout of nodes in cells, such as the mesh geometry's."""
    cell = getattr(basix.CellType, msh.topology.cell_type.name)
    topology = basix.topology(cell)
    tdim = len(topology) - 1
    places = []
    for f, vertices in enumerate(topology[tdim - 1]):
        nodes = [layout.entity_dofs(0, v)[0] for v in vertices]
        if degree == 2:
            if tdim == 3:
                pairs = EDGES[len(vertices)]
                edges = [tuple(sorted((vertices[a], vertices[b]))) for a, b in pairs]
                numbers = {tuple(sorted(e)): i for i, e in enumerate(topology[1])}
                nodes += [layout.entity_dofs(1, numbers[edge])[0] for edge in edges]
            nodes += layout.entity_dofs(tdim - 1, f)
        places.append(nodes)
    return np.array(places, dtype=np.int32)


def vertex_points(msh: mesh.Mesh, cells: Indices, vertices: Indices) -> Indices:
    """Rows of the mesh geometry at cell vertices."""
    layout = coordinate_element(msh).create_dof_layout()
    count = NUM_CELL_VERTICES[msh.topology.cell_type]
    place = np.array([layout.entity_dofs(0, v)[0] for v in range(count)])[vertices]
    return np.asarray(cell_nodes(msh)[cells, place], dtype=np.int32)


def vertex_x(msh: mesh.Mesh, cells: Indices, vertices: Indices) -> npt.NDArray[np.float64]:
    """Coordinates of cell vertices, shape (..., 3)."""
    return np.asarray(msh.geometry.x[vertex_points(msh, cells, vertices)], dtype=np.float64)


def owned_vertices(V: fem.FunctionSpace) -> tuple[Indices, npt.NDArray[np.float64]]:
    """Unknowns, (n, block), and coordinates, (n, 3), of vertices with unknowns of this rank."""
    topology = V.mesh.topology
    index_map = topology.index_map(topology.dim)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)[:, None]
    vertices = np.arange(NUM_CELL_VERTICES[topology.cell_type], dtype=np.int32)[None, :]
    dofs = vertex_dofs(V, cells, vertices).reshape(-1, block_of(V))
    x = vertex_x(V.mesh, cells, vertices).reshape(-1, 3)
    _, first = np.unique(dofs[:, 0], return_index=True)
    first = first[dofs[first, 0] < V.dofmap.index_map.size_local * V.dofmap.index_map_bs]
    return dofs[first], x[first]


def is_vertex_scalar(V: fem.FunctionSpace) -> bool:
    """Whether V is a scalar space with unknowns at the vertices."""
    return bool(
        V.mesh.topology.cell_type in NUM_CELL_VERTICES
        and V.num_sub_spaces == 0
        and V.dofmap.dof_layout.block_size == 1
        and num_entity_dofs(V, 0) == 1
    )


def is_vertex_vector(V: fem.FunctionSpace) -> bool:
    """Whether V is a blocked vector space with unknowns at the vertices."""
    gdim, layout = V.mesh.geometry.dim, V.dofmap.dof_layout
    return bool(
        V.mesh.topology.cell_type in NUM_CELL_VERTICES
        and V.num_sub_spaces == gdim
        and layout.block_size == gdim
        and num_entity_dofs(V, 0) == 1
    )
