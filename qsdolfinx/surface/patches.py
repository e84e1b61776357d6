"""Smooth patches of the facets around a node: one, or more at sharp edges.

A patch is represented by an unknown of the node: values of patches are stored in vectors of the
body.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


def patches_of_facets(surface: Surface) -> Indices:
    """Unknowns that represent the patches of the facets' vertices, (facets, vertices)."""
    facets, nv = surface.cpp_object, surface.num_facet_vertices
    sides = np.asarray(facets.vertex_side)[:, :nv, None].astype(np.int64)
    dofs = np.asarray(facets.facet_dofs)[:, :nv]
    return np.asarray(np.take_along_axis(dofs, sides, axis=2)[:, :, 0])


def sums_of_patches(surface: Surface, dofs: Indices, values: Array) -> Array:
    """Sums of values at the patches of owned nodes, (nodes, block). Collective.

    Args:
        surface: The surface.
        dofs: Unknowns that represent the patches, of any rank, (n,).
        values: The values, (n,).
    """
    vec = surface.create_vec()
    vec.setValues(dofs.astype(PETSc.IntType), values, PETSc.InsertMode.ADD_VALUES)
    vec.assemble()
    out: Array = vec.array_r[surface.node_dofs - vec.owner_range[0]].copy()
    vec.destroy()
    return out


def patches_of_nodes(surface: Surface) -> Flags:
    """Which of the possible patches of the owned nodes exist, (nodes, block). Collective."""
    dofs = patches_of_facets(surface).ravel()
    return np.asarray(sums_of_patches(surface, dofs, np.ones(len(dofs))) > 0)


def patch_areas(surface: Surface, x: Array) -> Array:
    """Areas of the patches of owned nodes: equal shares of their facets. Collective.

    Args:
        surface: The surface.
        x: Positions of the facets' vertices, (facets, vertices, 3).

    Returns:
        The areas, of rings on an axisymmetric surface, (nodes, block).
    """
    n = surface.num_facet_vertices
    shares = np.linalg.norm(area_vectors(x), axis=1) * _length_of_rings(surface, x) / n
    return sums_of_patches(surface, patches_of_facets(surface).ravel(), np.repeat(shares, n))


def share_gradients(surface: Surface, x: Array) -> Array:
    """Derivatives of the shares of facets in :func:`patch_areas`, (facets, vertices, 3).

    Args:
        surface: The surface.
        x: Positions of the facets' vertices, (facets, vertices, 3).
    """
    n, out = surface.num_facet_vertices, np.zeros(x.shape)
    s = area_vectors(x)
    area = np.linalg.norm(s, axis=1, keepdims=True)
    normal = s / area
    if n == 2:
        along = (x[:, 1] - x[:, 0]) / area
        out[:, 0], out[:, 1] = -along, along
    else:  # s = d₁ × d₂/2
        (a, b), (c, d) = ((0, 1), (0, 2)) if n == 3 else ((0, 3), (1, 2))
        first = np.cross(x[:, d] - x[:, c], normal) / 2
        second = np.cross(normal, x[:, b] - x[:, a]) / 2
        for vertex, by in ((b, first), (a, -first), (d, second), (c, -second)):
            out[:, vertex] += by
    out *= _length_of_rings(surface, x)[:, None, None]
    if surface.axisymmetric:
        out[:, :, 0] += 2 * np.pi * area / n
    return out / n


def _length_of_rings(surface: Surface, x: Array) -> Array:
    """2π r at the centres of facets on an axisymmetric surface, otherwise 1, (facets,)."""
    return 2 * np.pi * x[:, :, 0].mean(axis=1) if surface.axisymmetric else np.ones(len(x))
