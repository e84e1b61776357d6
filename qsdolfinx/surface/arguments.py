"""What a contact surface can be made of, and the facets that the user named."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la, mesh

from qsdolfinx.base.checks import check_flag
from qsdolfinx.compat import coordinate_element, num_entity_dofs

#: Vertices of a facet of each type of cell.
FACET_VERTICES = {
    mesh.CellType.triangle: 2,
    mesh.CellType.quadrilateral: 2,
    mesh.CellType.tetrahedron: 3,
    mesh.CellType.hexahedron: 4,
}


def check_arguments(
    V: fem.FunctionSpace,
    facet_tags: mesh.MeshTags | None,
    tag: int | None,
    facets: npt.ArrayLike | None,
    axisymmetric: bool,
) -> None:
    """Refuse what a contact surface cannot be made of."""
    if np.issubdtype(PETSc.ScalarType, np.complexfloating):
        raise TypeError("PETSc is complex: contact needs PETSc (petsc4py) with real scalars")
    if (facets is None) == (facet_tags is None):
        raise TypeError("give either facet_tags with tag, or facets")
    check_flag("axisymmetric", axisymmetric)
    if facet_tags is not None:
        if not isinstance(facet_tags, mesh.MeshTags):
            kind = type(facet_tags).__name__
            raise TypeError(f"facet_tags: must be a dolfinx.mesh.MeshTags, not {kind}")
        if not isinstance(tag, (int, np.integer)) or isinstance(tag, bool):
            raise TypeError(f"tag: must be the number of the contact facets' tag, not {tag!r}")
    cell = V.mesh.topology.cell_type
    gdim = V.mesh.geometry.dim
    if cell not in FACET_VERTICES or V.mesh.topology.dim != gdim:
        raise ValueError(
            "V: contact needs a mesh of triangles or quadrilaterals in 2D, of tetrahedra or "
            f"hexahedra in 3D, not {cell.name} cells in {gdim}D"
        )
    if coordinate_element(V.mesh).degree != 1:
        raise ValueError("V: contact facets must be straight-sided: mesh geometry of degree 1")
    if V.mesh.geometry.x.dtype != np.float64:
        raise ValueError("V: contact needs a mesh in double precision")
    if axisymmetric and (gdim != 2 or V.mesh.geometry.x[:, 0].min(initial=0.0) < -1e-10):
        raise ValueError("axisymmetric: needs a 2D mesh with coordinates (r, z), r ≥ 0")
    if V.num_sub_spaces != gdim or V.dofmap.dof_layout.block_size != gdim:
        raise ValueError(
            f"V: contact needs a blocked vector space with {gdim} components, such as "
            f'functionspace(mesh, ("Lagrange", 1, ({gdim},)))'
        )
    if trace_degree(V) is None:
        raise ValueError(
            "V: the trace of the space on the facets must be continuous Lagrange of degree 1 or 2 "
            "(or P1 with a cell bubble)"
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
    """Local indices of the facets that the user named on this rank."""
    fdim = msh.topology.dim - 1
    if facet_tags is not None:
        assert tag is not None
        if facet_tags.dim != fdim:
            raise ValueError(f"facet_tags: must be of dimension {fdim}, not {facet_tags.dim}")
        if _cpp_of(facet_tags.topology) is not _cpp_of(msh.topology):
            raise ValueError("facet_tags: must be tags of the mesh of V")
        return np.asarray(facet_tags.find(tag), dtype=np.int32)
    found = np.atleast_1d(np.asarray(facets))
    if found.size and not np.issubdtype(found.dtype, np.integer):
        raise ValueError("facets: must hold integers, the local indices of facets")
    index_map = msh.topology.index_map(fdim)
    count = index_map.size_local + index_map.num_ghosts
    if found.ndim != 1 or (found.size and (found.min() < 0 or found.max() >= count)):
        raise ValueError(f"facets: must be a 1D array of local facet indices below {count}")
    return np.unique(found).astype(np.int32)


def _cpp_of(wrapper: typing.Any) -> typing.Any:
    """DOLFINx's C++ object; depending on its version some come without a wrapper."""
    return getattr(wrapper, "_cpp_object", wrapper)


def _mark(msh: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Flags over this rank's facets, ghosts included, set where any rank names the facet."""
    marker = la.vector(msh.topology.index_map(msh.topology.dim - 1), 1, dtype=np.float64)
    marker.array[:] = 0
    marker.array[facets] = 1
    marker.scatter_reverse(la.InsertMode.add)
    marker.scatter_forward()
    return np.asarray(marker.array > 0)


def facets_of_owned_cells(msh: mesh.Mesh, given: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The named facets whose cell this rank owns, whichever rank named them."""
    tdim = msh.topology.dim
    if msh.comm.allreduce(given.size, op=MPI.SUM) == 0:
        raise ValueError("the contact surface is empty: no facet has this tag or is in facets")
    named = _mark(msh, given)
    exterior = _mark(msh, mesh.exterior_facet_indices(msh.topology))
    inner = msh.comm.allreduce(int(np.count_nonzero(named & ~exterior)), op=MPI.SUM)
    if inner:
        raise ValueError(f"{inner} of the facets named are not on the boundary of the mesh")
    facets = np.flatnonzero(named).astype(np.int32)
    cells = cell_of(msh, facets)
    return facets[cells < msh.topology.index_map(tdim).size_local]


def cell_of(msh: mesh.Mesh, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The one cell of each boundary facet."""
    connectivity = msh.topology.connectivity(msh.topology.dim - 1, msh.topology.dim)
    return np.asarray(connectivity.array[connectivity.offsets[facets]], dtype=np.int32)
