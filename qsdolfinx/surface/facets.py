"""Layout of the facets of a surface, found once, and coordinates, read whenever they move."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.compat import cell_nodes, coordinate_element
from qsdolfinx.surface.arguments import FACET_VERTICES, cell_of, trace_degree
from qsdolfinx.surface.unknowns import block_of, dofs_at, facet_places, layout_places, vertex_points

Array = npt.NDArray[np.float64]

#: Least angle (radians) between the normals of neighbouring facets at a sharp edge, as in
#: cpp/surface/curvature.h. Smooth surfaces with twelve and more facets around turn by less; with a
#: much larger angle, the points of facets beside a sharp edge would see its normals averaged.
SHARP = np.pi / 6


class FacetLayout(typing.NamedTuple):
    """This rank's facets, their vertices and trace in reference order.

    Attributes:
        points: Rows of the mesh geometry at the vertices, shape (facets, vertices).
        cell_points: Rows of the mesh geometry at all points of the facets' cells, shape (facets,
            points).
        dofs: Global unknowns of the trace, shape (facets, nodes, block).
        owner: Ranks that own these unknowns, shape (facets, nodes).
        nodes: Rows of a mesh geometry of degree 2 at the facets' nodes, shape (facets, nodes), in
            the order of trace_functions in cpp/geometry/facet.h; None for straight facets.
    """

    points: npt.NDArray[np.int32]
    cell_points: npt.NDArray[np.int32]
    dofs: npt.NDArray[np.int64]
    owner: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32] | None

    @classmethod
    def of(cls, V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> FacetLayout:
        """Layout of facets of owned cells."""
        msh, tdim = V.mesh, V.mesh.topology.dim
        nv, n = FACET_VERTICES[msh.topology.cell_type], len(facets)
        cells, local = in_cells(msh, facets)
        cell_type = getattr(basix.CellType, msh.topology.cell_type.name)
        reference = np.array(basix.topology(cell_type)[tdim - 1])
        points = vertex_points(msh, cells[:, None], reference[local].reshape(n, nv))
        degree = trace_degree(V)
        assert degree is not None
        places = facet_places(V, degree)[local]
        dofs = dofs_at(V, cells[:, None], places)
        dofs = dofs.reshape(n, places.shape[1], block_of(V))
        cell_points = np.ascontiguousarray(cell_nodes(msh)[cells], dtype=np.int32)
        nodes = None
        if coordinate_element(msh).degree == 2:
            layout = coordinate_element(msh).create_dof_layout()
            places = layout_places(layout, msh, 2)[local]
            nodes = cell_points[np.arange(n)[:, None], places].reshape(n, places.shape[1])
        return cls(points.reshape(n, nv), cell_points, *_global_numbers(V, dofs), nodes)

    def checked_coordinates(self, msh: mesh.Mesh) -> tuple[Array, Array, Array | None]:
        """Read the present coordinates, and check them.

        Returns:
            Vertices, (facets, vertices, 3); a point in the cell behind each facet, (facets, 3); and
            nodes of curved facets, (facets, nodes, 3), None for straight facets.

        Raises:
            ValueError: If coordinates are not finite, or a facet has no area.
        """
        geometry = np.ascontiguousarray(msh.geometry.x, dtype=np.float64)
        x = np.take(geometry, self.points, axis=0)
        inside = _cpp.mean_of_rows(geometry, self.cell_points)
        if not (np.isfinite(x).all() and np.isfinite(inside).all()):
            raise ValueError(
                "V: coordinates of cells at contact facets are not finite (NaN, infinity)"
            )
        if flat := _cpp.count_degenerate(x.shape[1], x):
            raise ValueError(f"V: {flat} contact facets are degenerate (zero area, or not convex)")
        return x, inside, None if self.nodes is None else np.take(geometry, self.nodes, axis=0)


def in_cells(
    msh: mesh.Mesh, facets: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """The one cell of each boundary facet, and the facet's number in it."""
    cells, tdim = cell_of(msh, facets), msh.topology.dim
    cell_type = getattr(basix.CellType, msh.topology.cell_type.name)
    count = len(basix.topology(cell_type)[tdim - 1])
    per_cell = msh.topology.connectivity(tdim, tdim - 1).array.reshape(-1, count)
    return cells, np.argmax(per_cell[cells] == facets[:, None], axis=1)


def area_vectors(x: Array) -> Array:
    """Area vectors at the centres of facets, signed by their orientation, shape (facets, 3).

    Args:
        x: Vertex coordinates in reference order, shape (facets, 2 to 4, 3).
    """
    if x.shape[1] == 2:
        along = x[:, 1] - x[:, 0]
        return np.stack([along[:, 1], -along[:, 0], 0 * along[:, 0]], axis=1)
    if x.shape[1] == 3:
        return np.asarray(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) / 2)
    return np.asarray(np.cross(x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]) / 2)


def _global_numbers(
    V: fem.FunctionSpace, dofs: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """Global unknowns, of the given shape, and the ranks that own them, with one axis less."""
    index_map, bs = V.dofmap.index_map, V.dofmap.index_map_bs
    block = (dofs // bs).astype(np.int32)
    numbers = index_map.local_to_global(block.ravel()).reshape(dofs.shape) * bs + dofs % bs
    first = block[..., 0]
    owner = np.full(first.shape, V.mesh.comm.rank, dtype=np.int32)
    ghost = first >= index_map.size_local
    owner[ghost] = index_map.owners[first[ghost] - index_map.size_local]
    return np.ascontiguousarray(numbers, dtype=np.int64), owner
