"""Check the arguments of a contact surface, and find its facets."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la, mesh

from qsdolfinx.base.checks import TAGS, Kind, check, require
from qsdolfinx.compat import coordinate_element, num_entity_dofs

#: Number of vertices of a facet, for each type of cell.
FACET_VERTICES = {
    mesh.CellType.triangle: 2,
    mesh.CellType.quadrilateral: 2,
    mesh.CellType.tetrahedron: 3,
    mesh.CellType.hexahedron: 4,
}

TAG = Kind(
    "the number of the contact facets' tag",
    lambda tag: isinstance(tag, (int, np.integer)) and not isinstance(tag, bool),
    TypeError,
)


def check_space(V: fem.FunctionSpace, axisymmetric: bool) -> None:
    """Refuse a space that contact surfaces do not support."""
    real = not np.issubdtype(PETSc.ScalarType, np.complexfloating)
    require(real, "PETSc is complex: contact needs PETSc (petsc4py) with real scalars", TypeError)
    cell, gdim, x = V.mesh.topology.cell_type, V.mesh.geometry.dim, V.mesh.geometry.x
    require(
        cell in FACET_VERTICES and V.mesh.topology.dim == gdim,
        "V: contact needs a mesh of triangles or quadrilaterals in 2D, of tetrahedra or "
        f"hexahedra in 3D, not {cell.name} cells in {gdim}D",
    )
    geometry = coordinate_element(V.mesh).degree
    require(geometry <= 2, f"V: contact needs mesh geometry of degree 1 or 2, not {geometry}")
    require(x.dtype == np.float64, "V: contact needs a mesh in double precision")
    fits = not axisymmetric or (gdim == 2 and x[:, 0].min(initial=0.0) >= -1e-10)
    require(fits, "axisymmetric: needs a 2D mesh with coordinates (r, z), r ≥ 0")
    block = V.dofmap.dof_layout.block_size
    require(
        (V.num_sub_spaces == gdim and block == gdim) or (V.num_sub_spaces == 0 and block == 1),
        f"V: contact needs a blocked vector space with {gdim} components, such as "
        f'functionspace(mesh, ("Lagrange", 1, ({gdim},))), or a scalar space, such as that of a '
        "temperature",
    )
    require(
        trace_degree(V) is not None,
        "V: the trace of the space on the facets must be continuous Lagrange of degree 1 or 2 "
        "(or P1 with a cell bubble)",
    )


def trace_degree(V: fem.FunctionSpace) -> int | None:
    """Degree of the trace of a Lagrange space on facets, 1 or 2; None if it is anything else."""
    tdim = V.mesh.topology.dim
    per_entity = [num_entity_dofs(V, d) for d in range(tdim)]
    if per_entity[0] != 1:
        return None
    if not any(per_entity[1:]):
        return 1
    simplex = V.mesh.topology.cell_type in (mesh.CellType.triangle, mesh.CellType.tetrahedron)
    quadratic = [1, 1] if tdim == 2 else [1, 1, 0 if simplex else 1]
    return 2 if per_entity == quadratic else None


def given_facets(
    msh: mesh.Mesh,
    facet_tags: mesh.MeshTags | None,
    tag: int | None,
    facets: npt.ArrayLike | None,
) -> npt.NDArray[np.int32]:
    """Local indices of the facets that the user gave on this rank."""
    one = (facets is None) != (facet_tags is None)
    require(one, "give either facet_tags with tag, or facets", TypeError)
    fdim = msh.topology.dim - 1
    if facet_tags is not None:
        check(TAGS, facet_tags=facet_tags)
        check(TAG, tag=tag)
        dim, ours = facet_tags.dim, is_of(facet_tags, msh)
        require(dim == fdim, f"facet_tags: must be of dimension {fdim}, not {dim}")
        require(ours, "facet_tags: must be tags of the mesh of V")
        return np.asarray(facet_tags.find(tag), dtype=np.int32)
    found = np.atleast_1d(np.asarray(facets))
    integers = not found.size or np.issubdtype(found.dtype, np.integer)
    require(integers, "facets: must hold integers, the local indices of facets")
    index_map = msh.topology.index_map(fdim)
    count = index_map.size_local + index_map.num_ghosts
    fits = found.ndim == 1 and np.all((found >= 0) & (found < count))
    require(fits, f"facets: must be a 1D array of local facet indices below {count}")
    return np.unique(found).astype(np.int32)


def is_of(tags: mesh.MeshTags, msh: mesh.Mesh) -> bool:
    """Whether tags belong to this mesh."""
    return _cpp_of(tags.topology) is _cpp_of(msh.topology)


def is_same(msh: mesh.Mesh, other: mesh.Mesh) -> bool:
    """Whether two objects are the same mesh."""
    return _cpp_of(msh.topology) is _cpp_of(other.topology)


def _cpp_of(wrapper: typing.Any) -> typing.Any:
    """DOLFINx's C++ object; in some versions of DOLFINx, objects come without a wrapper."""
    return getattr(wrapper, "_cpp_object", wrapper)


def _mark(msh: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Flags of this rank's facets, with ghosts, set if any rank gives the facet."""
    marker = la.vector(msh.topology.index_map(msh.topology.dim - 1), 1, dtype=np.float64)
    marker.array[:] = 0
    marker.array[facets] = 1
    marker.scatter_reverse(la.InsertMode.add)
    marker.scatter_forward()
    return np.asarray(marker.array > 0)


def facets_of_owned_cells(msh: mesh.Mesh, given: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The given facets whose cell this rank owns, whichever rank gave them."""
    tdim = msh.topology.dim
    named = _mark(msh, given)
    exterior = _mark(msh, mesh.exterior_facet_indices(msh.topology))
    counts = np.array([given.size, np.count_nonzero(named & ~exterior)])
    msh.comm.Allreduce(MPI.IN_PLACE, counts, op=MPI.SUM)
    total, inner = counts
    require(total, "the contact surface is empty: no facet has this tag or is in facets")
    require(not inner, f"{inner} of the facets named are not on the boundary of the mesh")
    facets = np.flatnonzero(named).astype(np.int32)
    cells = cell_of(msh, facets)
    return facets[cells < msh.topology.index_map(tdim).size_local]


def cell_of(msh: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The one cell of each boundary facet."""
    connectivity = msh.topology.connectivity(msh.topology.dim - 1, msh.topology.dim)
    return np.asarray(connectivity.array[connectivity.offsets[facets]], dtype=np.int32)
