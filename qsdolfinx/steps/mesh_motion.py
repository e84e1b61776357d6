"""Move a body's mesh with its unknowns."""

from __future__ import annotations

import functools
import itertools
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
import ufl
from dolfinx import fem, mesh

from qsdolfinx.base.checks import require
from qsdolfinx.compat import cell_nodes, coordinate_element, num_entity_dofs
from qsdolfinx.materials import axisymmetric_weight
from qsdolfinx.surface.unknowns import NUM_CELL_VERTICES, dofs_at, vertex_dofs
from qsdolfinx.system.rigid_modes import displacement_space

Array = npt.NDArray[np.float64]
Dofs = npt.NDArray[np.int32]

#: Corners of a cell: vertices next to each vertex, in right-handed order.
_CORNERS: dict[mesh.CellType, list[tuple[int, ...]]] = {
    mesh.CellType.triangle: [(0, 1, 2)],
    mesh.CellType.quadrilateral: [(0, 1, 2), (1, 3, 0), (3, 2, 1), (2, 0, 3)],
    mesh.CellType.tetrahedron: [(0, 1, 2, 3)],
    mesh.CellType.hexahedron: [
        (0, 1, 2, 4),
        (1, 3, 0, 5),
        (3, 2, 1, 7),
        (2, 0, 3, 6),
        (4, 6, 5, 0),
        (5, 4, 7, 1),
        (7, 5, 6, 3),
        (6, 7, 4, 2),
    ],
}


class MeshMotion:
    """Move the nodes of a body's mesh by its displacements or velocities.

    Args:
        u: Unknown of the body; of a mixed space the first vector field with unknowns at vertices.
        axisymmetric: Whether coordinates are (r, z), and the mesh represents a body of revolution.

    Raises:
        ValueError: If there is no such field.
    """

    def __init__(self, u: fem.Function, axisymmetric: bool = False) -> None:
        self.u = u
        self.mesh = u.function_space.mesh
        V = displacement_space(u.function_space)
        if V is None:
            raise ValueError("u: has no displacement or velocity with unknowns at the vertices")
        nodes = cell_nodes(self.mesh)
        self._nodes, first = np.unique(nodes.ravel(), return_index=True)
        cells, places = (index.astype(np.int32) for index in np.divmod(first, nodes.shape[1]))
        self._values: Array | None = None
        if coordinate_element(self.mesh).degree == 1:
            self._dofs = vertex_dofs(V, cells, places)
        else:
            values = _at_nodes(V)
            self._values = values[places]
            functions = np.arange(values.shape[1], dtype=np.int32)
            self._dofs = dofs_at(V, cells[:, None], functions[None])
        self._shape = _NodeShapes.of(self.mesh)
        #: Coordinates of the mesh when the object was made, or as :meth:`set_reference` left them.
        self.reference: Array = np.array(self.mesh.geometry.x)
        corners = self._corners(self.reference)
        self._sign = np.sign(corners)
        #: Quality at each cell's corners when the object was made, and for curved cells at nodes.
        self._begun: Array = np.abs(corners)
        self._begun_at_nodes = self._at_nodes_of_cells(self.reference)
        one = fem.Constant(self.mesh, np.float64(1.0))
        weight = axisymmetric_weight(self.mesh) if axisymmetric else one
        self._volume = fem.form(weight * ufl.dx(domain=self.mesh))

    def values(self, x: Array | None = None) -> Array:
        """Unknowns at the mesh's nodes, shape (geometry nodes, 3), in 2D with zeros.

        Values at the edge nodes of a curved mesh are interpolated, exactly if u is of degree 2.

        Args:
            x: All unknowns of this rank; by default the values of u.
        """
        out = np.zeros_like(self.reference)
        x = self.u.x.array if x is None else x
        found = x[self._dofs]
        if self._values is not None:
            found = np.einsum("ni,nid->nd", self._values, found)
        out[self._nodes, : self.mesh.geometry.dim] = found
        return out

    def carried(self, x: Array) -> Array:
        """Part of the unknowns that is contained in a mesh that was moved by them.

        Straight cells stay straight: of a field of degree 2, the mesh contains the linear part
        between vertices. The rest must be added.

        Args:
            x: All unknowns of this rank.
        """
        out = x.copy()
        for dofs, vertices in self._between:
            out[dofs] = x[vertices].mean(axis=1)
        return out

    @functools.cached_property
    def _between(self) -> list[tuple[Dofs, Dofs]]:
        """Unknowns between the vertices of straight cells, (cells, gdim), and at these vertices."""
        V = displacement_space(self.u.function_space)
        if V is None or coordinate_element(self.mesh).degree > 1 or num_entity_dofs(V, 1) == 0:
            return []
        if V.sub(0).element.basix_element.family != basix.ElementFamily.P:
            return []  # unknowns are not nodal values
        topology, layout = basix.topology(self.mesh.basix_cell()), V.dofmap.dof_layout
        cells = np.arange(len(V.dofmap.list), dtype=np.int32)[:, None]
        return [
            (
                dofs_at(V, cells[:, 0], np.array(place, dtype=np.int32)),
                vertex_dofs(V, cells, np.array([vertices], dtype=np.int32)),
            )
            for dim in range(1, len(topology) - 1)
            for entity, vertices in enumerate(topology[dim])
            for place in layout.entity_dofs(dim, entity)
        ]

    def move(self, displacement: Array | float = 0.0) -> None:
        """Move the mesh to the reference coordinates plus a displacement (length)."""
        self.mesh.geometry.x[:] = self.reference + displacement

    def set_reference(self, x: Array) -> None:
        """Set these coordinates as the reference, and move the mesh there."""
        self.reference = x.copy()
        self.move()

    def quality(self, x: Array | None = None) -> float:
        """Quality of the worst cell: 1 is best, 0 flat, negative turned inside out. Collective.

        It is the determinant of the edges at a corner, scaled by the longest edge there; for curved
        cells also the Jacobian at a node, in units of the cell's mean Jacobian.

        Args:
            x: Coordinates, shape (geometry nodes, 3); by default the present ones of the mesh.
        """
        x = np.asarray(self.mesh.geometry.x, dtype=np.float64) if x is None else x
        return self._least(self._corners(x) * self._sign, self._at_nodes_of_cells(x))

    def quality_kept(self, x: Array | None = None) -> float:
        """Least part of its first quality that a cell has kept, 0 flat. Collective.

        The first quality, see :meth:`quality`, is that of the same corner or node when the object
        was made. Cells that are thin without any deformation, as in graded meshes, have kept 1.

        Args:
            x: As for :meth:`quality`.
        """
        x = np.asarray(self.mesh.geometry.x, dtype=np.float64) if x is None else x
        corners, at_nodes = self._corners(x) * self._sign, self._at_nodes_of_cells(x)
        return self._least(
            corners / np.where(self._begun > 0, self._begun, 1.0),
            at_nodes / np.where(self._begun_at_nodes > 0, self._begun_at_nodes, 1.0),
        )

    def _least(self, *values: Array) -> float:
        """Least of these values over all ranks, at most 1; those that are not finite are worst."""
        local = min(float(np.min(np.nan_to_num(v, nan=-np.inf), initial=1.0)) for v in values)
        return float(self.mesh.comm.allreduce(local, op=MPI.MIN))

    def _at_nodes_of_cells(self, x: Array) -> Array:
        """Jacobians of curved cells at their nodes, over the mean of the cell; else no values."""
        if self._shape is None:
            return np.zeros(0)
        return self._shape.ratios(x[cell_nodes(self.mesh)])

    def _corners(self, x: Array) -> Array:
        """Determinant of the edges at each cell's corners, over that of the ideal shape."""
        geometry, kind = self.mesh.geometry, self.mesh.topology.cell_type
        gdim = geometry.dim
        x = x[cell_nodes(self.mesh)][:, : NUM_CELL_VERTICES[kind], :gdim]
        simplex = kind in (mesh.CellType.triangle, mesh.CellType.tetrahedron)
        best = (np.sqrt(3) / 2 if gdim == 2 else np.sqrt(0.5)) if simplex else 1.0
        out = []
        for corner in map(list, _CORNERS[kind]):
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                edges = x[:, corner[1:]] - x[:, [corner[0]]]
                if simplex:
                    pairs = x[:, :, None] - x[:, None, :]
                    longest = np.linalg.norm(pairs, axis=-1).max(axis=(1, 2))
                else:
                    longest = np.linalg.norm(edges, axis=-1).max(axis=1)
                out.append(np.linalg.det(edges) / longest**gdim / best)
        return np.array(out)

    def volume(self) -> float:
        """Present volume of the mesh; area in 2D, volume of the whole ring if axisymmetric.

        Collective.
        """
        local = fem.assemble_scalar(self._volume)
        return float(self.mesh.comm.allreduce(local, op=MPI.SUM))


class _NodeShapes(typing.NamedTuple):
    """Jacobians of curved cells at their nodes.

    Attributes:
        gradients: Gradients of the geometry's shape functions, shape (reference axes, nodes,
            functions).
    """

    gradients: Array

    @classmethod
    def of(cls, msh: mesh.Mesh) -> _NodeShapes | None:
        """Jacobians of a mesh; None if its cells are straight."""
        if coordinate_element(msh).degree == 1:
            return None
        element = _geometry_element(msh)
        return cls(element.tabulate(1, element.points)[1:, :, :, 0])

    def ratios(self, x: Array) -> Array:
        """Jacobians at nodes over their cell mean, (cells, nodes), x (cells, nodes, 3)."""
        gdim = len(self.gradients)
        with np.errstate(all="ignore"):
            J = np.einsum("jni,cid->cndj", self.gradients, x[:, :, :gdim])
            determinants = np.linalg.det(J)
            # Cells may be oriented either way.
            mean = determinants.mean(axis=1)
            return np.asarray(np.sign(mean)[:, None] * determinants / np.abs(mean)[:, None])


def _geometry_element(msh: mesh.Mesh) -> typing.Any:
    """Basix' element of the mesh's geometry."""
    cell = getattr(basix.CellType, msh.topology.cell_type.name)
    degree = coordinate_element(msh).degree
    return basix.create_element(
        basix.ElementFamily.P, cell, degree, basix.LagrangeVariant.gll_warped
    )


def _at_nodes(V: fem.FunctionSpace) -> Array:
    """Values of a space's shape functions at the geometry's nodes, shape (nodes, functions)."""
    element = V.sub(0).element.basix_element
    return np.asarray(element.tabulate(0, _geometry_element(V.mesh).points)[0, :, :, 0])


def check_own_meshes(unknowns: typing.Sequence[fem.Function]) -> None:
    """Raise an error if two unknowns would move the same mesh.

    Raises:
        ValueError: If two unknowns are on the same mesh.
    """
    meshes = [u.function_space.mesh for u in unknowns]
    for (i, first), (j, second) in itertools.combinations(enumerate(meshes), 2):
        # Two Python objects may represent the same mesh.
        same = first is second or np.shares_memory(first.geometry.x, second.geometry.x)
        require(
            not same,
            f"problem: u[{i}] and u[{j}] are on one mesh, which time steps move with each of them; "
            "give every body a mesh of its own, or one unknown to all bodies of a mesh",
        )
