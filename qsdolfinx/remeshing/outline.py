"""Gather a body's boundary and cells on rank 0, independently of the partition."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import mesh

from qsdolfinx.compat import cell_nodes
from qsdolfinx.surface.facets import in_cells

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Outline(typing.NamedTuple):
    """A closed boundary, and the cells within it.

    Attributes:
        x: Coordinates of all nodes of the body, shape (nodes, 3); in 2D the third is 0.
        facets: Nodes of the boundary's facets, outward: counter-clockwise as seen from outside, in
            2D with the body to the left. Shape (facets, gdim).
        tags: Tag of each facet, 0 without one, shape (facets,).
        cells: Nodes of the cells, shape (cells, gdim + 1).
        sizes: Requested cell sizes at the nodes (length), shape (nodes,).
    """

    x: Array
    facets: Indices
    tags: Indices
    cells: Indices
    sizes: Array

    @property
    def gdim(self) -> int:
        """Geometric dimension."""
        return self.facets.shape[1]


def listed(array: npt.NDArray[typing.Any]) -> typing.Any:
    """The array as nested lists of Python numbers, which are faster to access one by one."""
    return array.tolist()


def gather(
    msh: mesh.Mesh, x: Array, sizes: Array, facet_tags: mesh.MeshTags | None
) -> Outline | None:
    """The outline of a mesh of simplices on rank 0, None on others. Collective.

    Args:
        msh: The mesh.
        x: Coordinates of its nodes, shape (geometry nodes, 3).
        sizes: Requested cell sizes at the nodes (length), shape (geometry nodes,).
        facet_tags: Tags of facets; only those of boundary facets are used.
    """
    comm, tdim = msh.comm, msh.topology.dim
    keys = np.asarray(msh.geometry.input_global_indices, dtype=np.int64)
    owned = msh.topology.index_map(tdim).size_local
    cells = keys[cell_nodes(msh)[:owned]]
    parts = comm.gather((keys, x, sizes, cells, *_facets(msh, keys, facet_tags)), root=0)
    if parts is None:
        return None
    every, positions, wanted, cells, facets, tags = (
        np.concatenate([part[i] for part in parts]) for i in range(6)
    )
    unique, first, number = np.unique(every, return_index=True, return_inverse=True)
    points = positions[first]
    least = np.full(len(unique), np.inf)
    np.minimum.at(least, number.ravel(), wanted)
    facets, cells = (np.searchsorted(unique, index) for index in (facets, cells))
    # Sort by the facet's own nodes: with the opposite node, two facets of a cell would be equal.
    order = np.lexsort(np.sort(facets[:, :-1], axis=1).T)
    facets, tags = outward(points, facets[order, :-1], facets[order, -1]), tags[order]
    cells = np.sort(cells, axis=1)
    cells = cells[np.lexsort(cells.T)]
    return Outline(points, facets, tags, cells, least)


def _facets(
    msh: mesh.Mesh, keys: Indices, facet_tags: mesh.MeshTags | None
) -> tuple[Indices, Indices]:
    """Keys of this rank's boundary facet vertices and their opposite vertices, and tags."""
    facets, nodes = boundary_facets(msh)
    of_facet = np.zeros(int(facets.max(initial=-1)) + 1, dtype=np.int64)
    if facet_tags is not None:
        known = facet_tags.indices < len(of_facet)
        of_facet[facet_tags.indices[known]] = facet_tags.values[known]
    return keys[nodes], of_facet[facets]


def boundary_facets(msh: mesh.Mesh) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Boundary facets of this rank, and rows of the mesh geometry at their vertices.

    Returns:
        Facets, and (facets, gdim + 1) rows; the last row is of the opposite vertex in the cell.
    """
    tdim = msh.topology.dim
    msh.topology.create_connectivity(tdim - 1, tdim)
    msh.topology.create_connectivity(tdim, tdim - 1)
    facets = mesh.exterior_facet_indices(msh.topology)
    cells, local = in_cells(msh, facets)
    reference = np.array(basix.topology(getattr(basix.CellType, msh.topology.cell_type.name))[-2])
    nodes = cell_nodes(msh)[cells]
    ends = np.take_along_axis(nodes, reference[local], axis=1)
    # In a simplex, facet i is opposite to vertex i.
    return facets, np.hstack([ends, np.take_along_axis(nodes, local[:, None], axis=1)])


def outward(x: Array, facets: Indices, opposite: Indices) -> Indices:
    """Orient facets outward; each begins with its smallest node.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        facets: Shape (facets, gdim).
        opposite: Opposite node in the cell, shape (facets,).
    """
    facets = np.sort(facets, axis=1)
    edges = x[facets[:, 1:]] - x[facets[:, :1]]
    if facets.shape[1] == 2:
        normal = np.stack([edges[:, 0, 1], -edges[:, 0, 0], 0 * edges[:, 0, 0]], axis=1)
    else:
        normal = np.asarray(np.cross(edges[:, 0], edges[:, 1]), dtype=np.float64)
    inward = np.sum(normal * (x[opposite] - x[facets[:, 0]]), axis=1) > 0
    facets[inward, -2:] = facets[inward, -2:][:, ::-1]
    return facets


def enclosed_volume(x: Array, facets: Indices, axisymmetric: bool = False) -> float:
    """Volume (2D: area) that a closed boundary encloses.

    Args:
        x: Coordinates of the nodes, shape (nodes, 3).
        facets: Outward facets, shape (facets, gdim).
        axisymmetric: Whether coordinates are (r, z): the volume of the whole body of revolution.
    """
    return float(volume_gradient(x, facets, axisymmetric)[1])


def volume_gradient(x: Array, facets: Indices, axisymmetric: bool) -> tuple[Array, float]:
    """Derivatives of the enclosed volume by the coordinates of nodes, (nodes, 3), and the volume.

    Args:
        x: Coordinates of the nodes, shape (nodes, 3).
        facets: Outward facets, shape (facets, gdim).
        axisymmetric: Whether coordinates are (r, z).
    """
    # Far from the origin, sums relative to it lose digits, so coordinates are shifted; radii are
    # not, since they count from the axis.
    shift = x[facets].mean(axis=(0, 1)) if len(facets) else np.zeros(3)
    x = x - (shift * [0.0, 1.0, 1.0] if axisymmetric else shift)
    out, corners = np.zeros_like(x), x[facets]
    if facets.shape[1] == 3:
        for i in range(3):
            a, b = corners[:, (i + 1) % 3], corners[:, (i + 2) % 3]
            np.add.at(out, facets[:, i], np.cross(a, b) / 6)
        volume = float(np.sum(out * x)) / 3
    elif axisymmetric:  # ∮ π r² dz of straight edges
        (r0, z0), (r1, z1) = (corners[:, i, :2].T for i in (0, 1))
        square, rise = (r0 * r0 + r0 * r1 + r1 * r1) / 3, z1 - z0
        volume = float(np.pi * np.sum(square * rise))
        np.add.at(out[:, 0], facets[:, 0], np.pi * (2 * r0 + r1) / 3 * rise)
        np.add.at(out[:, 0], facets[:, 1], np.pi * (2 * r1 + r0) / 3 * rise)
        np.add.at(out[:, 1], facets[:, 0], -np.pi * square)
        np.add.at(out[:, 1], facets[:, 1], np.pi * square)
    else:
        a, b = corners[:, 0], corners[:, 1]
        np.add.at(out, facets[:, 0], np.stack([b[:, 1], -b[:, 0], 0 * b[:, 0]], axis=1) / 2)
        np.add.at(out, facets[:, 1], np.stack([-a[:, 1], a[:, 0], 0 * a[:, 0]], axis=1) / 2)
        volume = float(np.sum(out * x)) / 2
    return out, volume
