"""Meshes of degree 2 with boundaries on the curved surface that flat facets approximate."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import check, instance, require
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.compat import cell_nodes, coordinate_element, mesh_of_nodes
from qsdolfinx.surface.facets import SHARP, in_cells
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.unknowns import EDGES, facet_places
from qsdolfinx.tools.heights import check_near
from qsdolfinx.tools.smooth import Smooth

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]


def elevate(
    msh: mesh.Mesh,
    facet_tags: mesh.MeshTags | None = None,
    tag: int | None = None,
    *,
    facets: npt.ArrayLike | None = None,
    shape: Smooth | None = None,
) -> mesh.Mesh:
    """Make a mesh of degree 2 with the same cells, and with some facets on a curved surface.

    The flat facets of a circle are chords, off the circle by h²/8R. Where two surfaces are curved
    the same way and their meshes do not match, these chord errors cause gaps, overlaps and wrong
    pressures. Here the nodes in the middle of the facets and of their edges are moved to the curved
    surface, and nodes in the middle of cells with them. Vertices do not move. With displacements of
    degree 2, contact is then between curved facets, also with ``sliding="finite"``.

    The new mesh has the topology of the given mesh: cells, facets and vertices keep their numbers,
    and tags of one mesh are valid for the other. The given mesh may be of degree 2; its other nodes
    do not move, so that several surfaces of different shapes can be curved one after the other.
    Collective.

    Args:
        msh: A mesh of degree 1 or 2 of triangles, quadrilaterals, tetrahedra or hexahedra.
        facet_tags: Tags of its facets.
        tag: The tag of the facets to be curved.
        facets: Instead of ``facet_tags`` and ``tag``, the local indices of these facets.
        shape: Surface from ``qs.smooth`` on which the vertices are. By default it is found from the
            angles between neighbouring facets, exactly on circles. Edges with an angle of more than
            30° stay sharp edges. Flat facets beside a fillet stay flat, and so do the other facets
            of the boundary.

    Returns:
        The new mesh.

    Raises:
        ValueError: If the mesh is of another kind, no facet is named, a facet is not on the
            boundary, vertices are not on the shape, or cells would fold. Cells fold where they are
            thinner than the distance by which their facets are moved.
        TypeError: If an argument is of another type.

    Example:
        >>> msh = qs.elevate(msh, facet_tags, 3)
        >>> V = fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))
        >>> hole = qs.Surface(V, facet_tags, 3)
    """
    check(instance(mesh.Mesh, "a dolfinx.mesh.Mesh"), msh=msh)
    with checked(msh.comm) as same:
        if shape is not None:
            check(instance(Smooth, "a surface of qs.smooth"), shape=shape)
        same(shape=repr(shape))
        double = msh.geometry.x.dtype == np.float64
        require(double, "msh: must be in double precision")
        degree = coordinate_element(msh).degree
        require(degree in (1, 2), f"msh: must be of degree 1 or 2, not {degree}")
    V = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
    surface = Surface(V, facet_tags, tag, facets=facets)
    nodes = _Nodes(msh)
    if shape is None:
        moved = nodes.turned(surface)
    else:
        kind, cpp_object = type(shape).__name__, surface.cpp_object
        check_near(shape.shape, kind, cpp_object, msh.comm)
        moved = nodes.on(surface, shape)
    x = nodes.x + moved
    with collective_errors(msh.comm):
        nodes.check(x)
    return nodes.mesh(x)


class _Nodes:
    """Nodes of degree 2 of a mesh: the nodes of the scalar space of degree 2.

    Attributes:
        x: Coordinates of the nodes, shape (nodes, 3).
    """

    def __init__(self, msh: mesh.Mesh) -> None:
        self._mesh = msh
        self._V = fem.functionspace(msh, ("Lagrange", 2))
        self._dofs: Indices = np.asarray(self._V.dofmap.list, dtype=np.int32)
        self._cell = getattr(basix.CellType, msh.topology.cell_type.name)
        self.x: Array = np.asarray(self._V.tabulate_dof_coordinates(), dtype=np.float64)
        for node, point in self._vertices():
            self.x[node] = msh.geometry.x[point]

    def _vertices(self) -> typing.Iterator[tuple[Indices, Indices]]:
        """Nodes at the vertices of cells, and their rows in the mesh's geometry."""
        layout = coordinate_element(self._mesh).create_dof_layout()
        rows = cell_nodes(self._mesh)
        for vertex in range(len(basix.topology(self._cell)[0])):
            to = self._V.dofmap.dof_layout.entity_dofs(0, vertex)[0]
            yield self._dofs[:, to], rows[:, layout.entity_dofs(0, vertex)[0]]

    # --- Curved facets

    def turned(self, surface: Surface) -> Array:
        """Displacement of nodes due to angles between adjacent facets, (nodes, 3). Collective."""
        x, nv = surface.coordinates[0], surface.num_facet_vertices
        height, weight = np.moveaxis(np.asarray(_cpp.edge_heights(surface.cpp_object)), -1, 0)
        normal = np.asarray(_cpp.flat_normals(surface.cpp_object))[:, -1:]  # in the middle
        terms = np.concatenate(  # facets at an edge: weight, flat midpoint, n nᵀ, n h
            [
                np.ones((*height.shape, 1)),
                np.stack([(x[:, a] + x[:, b]) / 2 for a, b in EDGES[nv]], axis=1),
                np.repeat(normal[..., :, None] * normal[..., None, :], height.shape[1], axis=1)
                .reshape(*height.shape, 9),
                normal * height[..., None],
            ],
            axis=2,
        )  # fmt: skip
        edges = self._of_facets(surface)[:, nv : nv + len(EDGES[nv])]
        terms *= weight[..., None]
        sums = self._summed(edges.ravel(), terms.reshape(-1, 16))
        some = sums[:, 0] > 0
        sums[some] /= sums[some, :1]
        sums[:, 4:13] += self._beside(surface, sums[:, 4:13])
        _, flat, squares, heights = np.split(sums[some], [1, 4, 13], axis=1)
        out = np.zeros_like(self.x)
        out[some] = flat + _raised(squares.reshape(-1, 3, 3), heights) - self.x[some]
        return self._blended(out)

    def _beside(self, surface: Surface, squares: Array) -> Array:
        """Σ n nᵀ of other boundary facets that meet these in a sharp edge, and stay flat.

        Shape (nodes, 9). Collective.

        Args:
            surface: The facets that become curved.
            squares: Σ n nᵀ of these facets at the nodes on their edges, of the same shape.
        """
        out: Array = np.zeros_like(squares)
        if self._mesh.geometry.dim == 2:
            return out
        every = Surface(surface.V, facets=mesh.exterior_facet_indices(self._mesh.topology))
        others = ~np.isin(every.facets, surface.facets)
        nv, ends = every.num_facet_vertices, len(EDGES[every.num_facet_vertices])
        normal = np.asarray(_cpp.flat_normals(every.cpp_object))[others, -1]
        nodes = self._of_facets(every)[others, nv : nv + ends]
        own = squares[nodes].reshape(*nodes.shape, 3, 3)
        size = np.trace(own, axis1=2, axis2=3)
        along = np.einsum("fi,feij,fj->fe", normal, own, normal)
        crease = (size > 0) & (along < np.cos(SHARP) ** 2 * size)
        square = (normal[:, :, None] * normal[:, None, :]).reshape(-1, 1, 9)
        return self._summed(nodes.ravel(), (crease[..., None] * square).reshape(-1, 9))

    def on(self, surface: Surface, shape: Smooth) -> Array:
        """Displacement of facet nodes, except vertices, onto a shape, (nodes, 3). Collective."""
        inner = np.unique(self._of_facets(surface)[:, surface.num_facet_vertices :])
        distance, normal = shape.shape.distance(self.x[inner])
        terms = np.concatenate([-distance[:, None] * normal, np.ones((len(inner), 1))], axis=1)
        sums = self._summed(inner, terms)
        some = sums[:, 3] > 0
        out = np.zeros_like(self.x)
        out[some] = sums[some, :3] / sums[some, 3:]
        return self._blended(out, some)

    def _of_facets(self, surface: Surface) -> Indices:
        """Nodes of a surface's facets, vertices first, (facets, nodes)."""
        cells, local = in_cells(self._mesh, surface.facets)
        return np.asarray(self._dofs[cells[:, None], facet_places(self._V, 2)[local]])

    def _summed(self, nodes: Indices, terms: Array) -> Array:
        """Sums of terms at nodes over all ranks, (nodes, terms). Collective."""
        vector = la.vector(self._V.dofmap.index_map, terms.shape[1], dtype=np.float64)
        sums = vector.array.reshape(-1, terms.shape[1])
        sums[:] = 0.0
        np.add.at(sums, nodes, terms)
        vector.scatter_reverse(la.InsertMode.add)
        vector.scatter_forward()
        return sums.copy()

    # --- Nodes within faces and cells

    def _blended(self, moved: Array, kept: npt.NDArray[np.bool_] | None = None) -> Array:
        """Move midpoints of faces and cells with the edges, by transfinite interpolation.

        Args:
            moved: Displacement of nodes on edges, (nodes, 3).
            kept: Flags of nodes in faces whose given displacement is kept.
        """
        topology, layout = basix.topology(self._cell), self._V.dofmap.dof_layout
        tdim = len(topology) - 1
        out = moved.copy()
        edge = [layout.entity_dofs(1, i)[0] for i in range(len(topology[1]))]
        for dim in range(2, tdim + 1):
            for i in range(len(topology[dim])):
                inside = layout.entity_dofs(dim, i)
                if not len(inside):
                    continue
                of_entity = set(topology[dim][i])
                around = [e for e, ends in zip(edge, topology[1], strict=True)
                          if set(ends) <= of_entity]  # fmt: skip
                total = out[self._dofs[:, around]].sum(axis=1)
                if dim == 2:
                    value = total / 2
                else:
                    faces = [layout.entity_dofs(2, j)[0] for j in range(len(topology[2]))]
                    value = out[self._dofs[:, faces]].sum(axis=1) / 2 - total / 4
                at = self._dofs[:, inside[0]]
                free = np.ones(len(at), dtype=bool) if kept is None or dim == 3 else ~kept[at]
                out[at[free]] = value[free]
        return out

    # --- The mesh

    def check(self, x: Array) -> None:
        """Raise an error for folded cells, whose map is inverted at a node or a point between.

        Raises:
            ValueError: If there are folded cells.
        """
        gdim = self._mesh.geometry.dim
        element = basix.create_element(basix.ElementFamily.P, self._cell, 2)
        points = np.concatenate([element.points, basix.make_quadrature(self._cell, 4)[0]])
        gradients: Array = np.asarray(element.tabulate(1, points))[1:, :, :, 0]
        count = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        dofs = self._dofs[:count]
        bent = np.any(x[dofs] != self.x[dofs], axis=(1, 2))
        jacobians = [
            np.linalg.det(np.einsum("dpj,cji->cpid", gradients, at[dofs[bent]][:, :, :gdim]))
            for at in (self.x, x)
        ]
        sign = np.sign(jacobians[0].mean(axis=1))[:, None]
        folded = int(np.count_nonzero(np.any(jacobians[1] * sign <= 0, axis=1)))
        if folded:
            raise ValueError(
                f"facets: {folded} cells would fold, as they are thinner than their facets bulge: "
                "refine the mesh along these facets"
            )

    def mesh(self, x: Array) -> mesh.Mesh:
        """Create the mesh with its nodes at x; vertices keep their input numbers."""
        msh, index_map = self._mesh, self._V.dofmap.index_map
        gdim, given = msh.geometry.dim, np.asarray(msh.geometry.input_global_indices)
        first = 1 + msh.comm.allreduce(int(np.max(given, initial=-1)), op=MPI.MAX)
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        numbers = first + np.asarray(index_map.local_to_global(local))
        for node, point in self._vertices():
            numbers[node] = given[point]
        cell = msh.topology.cell_type.name
        domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 2, shape=(gdim,)))
        return mesh_of_nodes(msh, index_map, self._dofs, x[:, :gdim], numbers, domain)


def _raised(squares: Array, heights: Array) -> Array:
    """Displacement to given heights above facets that share an edge, (edges, 3).

    For nearly smooth facets it is along their mean normal; at sharp edges both heights are met.

    Args:
        squares: Σ n nᵀ over the facets, (edges, 3, 3).
        heights: Σ n h, (edges, 3).
    """
    values, vectors = np.linalg.eigh(squares)
    # For two unit normals at an angle α, the eigenvalues are 1 + cos α, 1 − cos α and 0.
    crease = np.cos(SHARP)
    large = (1 + crease) * values > (1 - crease) * values[:, -1:]
    inverse = np.where(large, 1 / np.where(large, values, 1.0), 0.0)
    along = np.einsum("eik,ei->ek", vectors, heights)
    return np.asarray(np.einsum("eik,ek->ei", vectors, inverse * along))
