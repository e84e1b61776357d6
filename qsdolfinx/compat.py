"""Functions for the differences between DOLFINx 0.9, 0.10 and 0.11.

All other names of DOLFINx that this project uses mean the same in the three versions. 0.9 and 0.11
are tested; the code for 0.10 was written from the sources of DOLFINx.
"""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem, io, mesh


def cell_nodes(msh: mesh.Mesh) -> npt.NDArray[np.int32]:
    """Rows of the mesh geometry at the nodes of each cell, shape (cells, nodes)."""
    geometry: typing.Any = msh.geometry
    # 0.11 has one array for each cell type. The mesh of a surface has one cell type.
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def coordinate_element(msh: mesh.Mesh) -> typing.Any:
    """The mesh's ``dolfinx.fem.CoordinateElement``."""
    geometry: typing.Any = msh.geometry
    return geometry.cmaps[0] if hasattr(geometry, "dofmaps") else geometry.cmap


def mesh_of_nodes(
    msh: mesh.Mesh,
    index_map: typing.Any,
    dofmap: npt.NDArray[np.int32],
    x: npt.NDArray[np.float64],
    input_global_indices: npt.NDArray[np.int64],
    domain: typing.Any,
) -> mesh.Mesh:
    """Make a mesh with the topology of a given mesh and its own nodes.

    Arguments are those of ``mesh.create_geometry``, for which the type of the element differs
    between versions.
    """
    cell, degree = msh.topology.cell_type, domain.ufl_coordinate_element().degree
    element = fem.coordinate_element(cell, degree)
    geometry: typing.Any = type(msh.geometry._cpp_object)(
        index_map, np.ascontiguousarray(dofmap), element._cpp_object, x, input_global_indices
    )
    return mesh.Mesh(type(msh._cpp_object)(msh.comm, msh.topology._cpp_object, geometry), domain)


def num_entity_dofs(V: fem.FunctionSpace, dim: int) -> int:
    """Number of unknowns inside one entity of a cell, as ``num_entity_dofs`` before 0.11."""
    return len(V.dofmap.dof_layout.entity_dofs(dim, 0))


def collapse(V: fem.FunctionSpace) -> tuple[fem.FunctionSpace, npt.NDArray[np.int64]]:
    """Collapse a sub-space; returns the new space and its unknowns' indices in the parent."""
    space, places = V.collapse()
    # 0.11 has a list of arrays, one for each cell type.
    return space, np.ravel(places).astype(np.int64)


def is_sub_space(V: fem.FunctionSpace) -> bool:
    """Whether a space is a sub-space of another space."""
    place: typing.Any = V.component  # without types
    return bool(place())


def interpolation_points(V: fem.FunctionSpace) -> npt.NDArray[np.float64]:
    """Interpolation points on the reference cell (in 0.9 the attribute is a method)."""
    points: typing.Any = V.element.interpolation_points
    return points() if callable(points) else points


#: Numbers of gmsh's prisms and pyramids of degree 1 and 2.
_PRISMS_AND_PYRAMIDS = {6, 7, 13, 14, 18, 19}


def _strange_cells(model: typing.Any, gdim: int) -> bool:
    """Whether a gmsh model has prisms or pyramids in physical groups."""
    groups = [group for group in model.getPhysicalGroups() if group[0] == gdim]
    kinds = {
        int(kind)
        for dim, tag in groups
        for entity in model.getEntitiesForPhysicalGroup(dim, tag)
        for kind in model.mesh.getElements(dim, tag=entity)[0]
    }
    return bool(kinds & _PRISMS_AND_PYRAMIDS)


def model_to_mesh(
    model: typing.Any, comm: MPI.Comm, rank: int = 0, gdim: int = 3
) -> tuple[mesh.Mesh, mesh.MeshTags, mesh.MeshTags]:
    """Make a mesh, tags of cells and tags of facets from a gmsh model on one rank.

    It calls ``model_to_mesh`` of ``dolfinx.io.gmshio``, from 0.10 on of ``dolfinx.io.gmsh``.

    Raises:
        ValueError: If there are prisms or pyramids.
    """
    module = io.gmsh if hasattr(io, "gmsh") else io.gmshio
    if comm.bcast(_strange_cells(model, gdim) if comm.rank == rank else 0, root=rank):
        raise ValueError(
            "model: has prisms or pyramids, which DOLFINx does not read from gmsh; contact needs "
            "triangles, quadrilaterals, tetrahedra or hexahedra"
        )
    msh, cell_tags, facet_tags = module.model_to_mesh(model, comm, rank, gdim)[:3]
    return msh, cell_tags, facet_tags
