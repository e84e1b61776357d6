"""Traction recovered from contact forces."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc as fem_petsc

from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


def facet_measure(surface: Surface) -> ufl.Measure:
    """Measure of the surface's facets. Collective."""
    facets, msh = np.sort(surface.facets), surface.mesh
    tags = mesh.meshtags(msh, msh.topology.dim - 1, facets, np.ones_like(facets))
    return ufl.Measure("ds", domain=msh, subdomain_data=tags)(1)


def nodal_forces(surface: Surface, force: PETSc.Vec) -> Array:
    """Forces on the contact nodes of ``surface.linear``, shape (nodes, block). Collective.

    For a trace of degree 2, forces are transferred to the vertices so that they do the same work in
    displacements of degree 1.

    Args:
        surface: The surface.
        force: Forces on the unknowns of its body.
    """
    linear = surface.linear
    if linear is surface:
        return _at_nodes(surface, force)
    moments, local = linear.create_vec(), surface.collapsed_vec(force)
    matrix = fem_petsc.interpolation_matrix(linear.V, surface.collapsed_space)
    matrix.assemble()
    matrix.multTranspose(local, moments)
    out = _at_nodes(linear, moments)
    for thing in (moments, local, matrix):
        thing.destroy()
    return out


def _at_nodes(surface: Surface, vec: PETSc.Vec) -> Array:
    values = vec.array_r[surface.node_dofs - vec.owner_range[0]]
    return np.asarray(values, dtype=np.float64).reshape(-1, surface.block)


def recover(surface: Surface, force: PETSc.Vec, area: Array | None = None) -> fem.Function:
    """Traction t_k = f_k / S_k of given contact forces, see Contact.traction. Collective.

    Args:
        surface: The surface.
        force: Forces on the unknowns of its body.
        area: S_k of the nodes of ``surface.linear``; by default of the surface as it was last read.
    """
    f, linear = nodal_forces(surface, force), surface.linear
    values = f / (linear.node_area if area is None else area)[:, None]
    return linear.vertex_function(values[:, 0] if surface.is_scalar else values)
