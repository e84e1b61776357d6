"""Facets of a surface, or of a tool used as a surface, and their sharp edges."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.facets import SHARP
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.unknowns import EDGES
from qsdolfinx.tools.facet_surface import FacetSurface
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: A surface with facets: that of a body, or that of a tool.
Faceted = Surface | FacetSurface


def has_creases(surface: AnySurface, asked: bool) -> bool:
    """Whether a surface has sharp vertices; False if ``asked`` is False. Collective."""
    if not asked or surface.is_analytic:
        return False
    sharp = sharp_nodes(surface.as_facets())
    return bool(surface.comm.allreduce(bool(sharp.any()), op=MPI.LOR))


class SharpNodes(typing.NamedTuple):
    """Sharp vertices of a surface where a contact was created, whatever is done to it afterwards.

    Attributes:
        sharp: See :func:`sharp_nodes`.
        node_size: Mean area of a node.
    """

    sharp: Flags
    node_size: float

    @classmethod
    def of(cls, surface: Faceted) -> SharpNodes:
        """Those of a surface as it is now. Collective."""
        area: Array = np.asarray(surface.node_area, dtype=np.float64)
        whole = surface.comm.allreduce(np.array([area.sum(), len(area)]))
        return cls(sharp_nodes(surface), float(whole[0] / max(whole[1], 1.0)))


def sharp_nodes(surface: Faceted) -> Flags:
    """Owned nodes whose facet normals differ by more than about SHARP. Collective."""
    return corner_nodes(surface, SHARP)


def corner_nodes(surface: Faceted, angle: float) -> Flags:
    """Owned nodes whose facet normals differ by more than about an angle. Collective.

    Args:
        surface: The surface.
        angle: The angle (radians), exact if there are two normals.
    """
    normals = normals_at_vertices(surface).reshape(-1, 3)
    ones = np.ones(len(normals))
    total = np.array([sums(surface, values) for values in (*normals.T, ones)])
    return np.asarray(np.linalg.norm(total[:3], axis=0) < np.cos(angle / 2) * total[3])


def normals_at_vertices(surface: Faceted) -> Array:
    """Outward unit normals of the facets, curved if the mesh is, (facets, vertices, 3)."""
    x, inside, nodes = surface.coordinates
    out = unit_normals(x, nodes)
    outward = x.mean(axis=1) - inside
    return np.asarray(out * np.sign(np.sum(outward[:, None] * out, axis=2))[..., None])


def unit_normals(x: Array, nodes: Array | None = None) -> Array:
    """Unit normals of facets at their vertices, of either sign, (facets, vertices, 3).

    Args:
        x: Positions of the vertices, (facets, vertices, 3).
        nodes: Positions of all nodes of facets of degree 2, (facets, nodes, 3).
    """
    count = x.shape[1]
    tangents: list[list[Array]] = [[] for _ in range(count)]
    for at, (i, j) in enumerate(EDGES[count], start=count):
        middle = (x[:, i] + x[:, j]) / 2 if nodes is None else nodes[:, at]
        tangents[i].append(4 * middle - 3 * x[:, i] - x[:, j])
        tangents[j].append(4 * middle - 3 * x[:, j] - x[:, i])
    out = np.empty_like(x)
    for i, (along, *others) in enumerate(tangents):
        across = others[0] if others else np.broadcast_to([0.0, 0.0, 1.0], along.shape)
        out[:, i] = np.cross(along, across)
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=2), 1e-300)[..., None])


def vertex_dofs(surface: Faceted) -> npt.NDArray[np.int32]:
    """First unknowns of the vertices of the facets, (facets, vertices)."""
    dofs = surface.cpp_object.facet_dofs[:, : surface.num_facet_vertices, 0]
    return np.ascontiguousarray(dofs.astype(PETSc.IntType))


def sums(surface: Faceted, values: Array) -> Array:
    """Sums at owned nodes, over all facets, of values at facet vertices, (facets · vertices,)."""
    vec = surface.create_vec()
    vec.setValues(vertex_dofs(surface).ravel(), values, addv=PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: Array = vec.array_r[surface.node_dofs[:, 0] - vec.owner_range[0]].copy()
    vec.destroy()
    return out


def at_vertices(surface: Faceted, values: Array) -> Array:
    """Values of the owned nodes at the vertices of the facets, (facets, vertices)."""
    return gathered(surface, values, vertex_dofs(surface))


def gathered(surface: Faceted, values: Array, dofs: npt.NDArray[np.integer]) -> Array:
    """Values of the owned nodes at nodes given by their first unknowns. Collective."""
    vec = surface.create_vec()
    vec.array[surface.node_dofs[:, 0] - vec.owner_range[0]] = values
    local = PETSc.Vec().createSeq(dofs.size)
    here = PETSc.IS().createGeneral(dofs.ravel().astype(PETSc.IntType), PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, here, local, None)
    scatter.scatter(vec, local)
    out: Array = local.array_r.reshape(dofs.shape).copy()
    for thing in (vec, local, here, scatter):
        thing.destroy()
    return out


def first_corners(surface: Surface) -> Flags:
    """Flags of facet vertices, set once for each node over all ranks, (facets, vertices).

    Collective.
    """
    dofs = vertex_dofs(surface)
    number = surface.comm.rank + surface.comm.size * np.arange(dofs.size, dtype=np.float64)
    vec, local = surface.create_vec(), PETSc.Vec().createWithArray(number, comm=PETSc.COMM_SELF)
    here = PETSc.IS().createGeneral(dofs.ravel(), PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, here, local, None)
    vec.set(-1.0)
    how = PETSc.InsertMode.MAX_VALUES, PETSc.ScatterMode.REVERSE
    scatter.scatter(local, vec, *how)
    last: Array = np.zeros(dofs.size)
    there = PETSc.Vec().createWithArray(last, comm=PETSc.COMM_SELF)
    scatter.scatter(vec, there)
    out = np.asarray((last == number).reshape(dofs.shape))
    for thing in (vec, local, there, here, scatter):
        thing.destroy()
    return out
