"""Two elastic blocks pressed together, one on the other: for bench/solvers.py and scaling.py."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
PRESS = -0.02


def box(cell, n, low, high):
    """Mesh the unit square × [low, high], or in 2D [0, 1] × [low, high], with n cells along x."""
    kind = mesh.CellType[cell]
    dim = 2 if kind in (mesh.CellType.triangle, mesh.CellType.quadrilateral) else 3
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    corners = [[0.0] * (dim - 1) + [low], [1.0] * (dim - 1) + [high]]
    return create(COMM, corners, [n] * (dim - 1) + [round(n * (high - low))], kind)


def facets_at(msh, height):
    """Return facets of the boundary at a height."""
    axis = msh.topology.dim - 1
    return mesh.locate_entities_boundary(msh, axis, lambda x: np.isclose(x[axis], height))


def residual(u, v, modulus):
    """Return the virtual work of linear elasticity, ν = 0.3; on cells of boxes it is exact."""
    V, dx = u.function_space, ufl.dx
    if V.mesh.topology.cell_type in (mesh.CellType.quadrilateral, mesh.CellType.hexahedron):
        dx = ufl.dx(degree=2 * V.ufl_element().embedded_superdegree + 1)
    return ufl.inner(qs.materials.linear_elastic(u, modulus, 0.3), ufl.grad(v)) * dx


def clamp(V, height, press):
    """Prescribe the nodes at a height: zero displacement across, press upwards."""
    dim = V.mesh.geometry.dim
    dofs = fem.locate_dofs_topological(V, dim - 1, facets_at(V.mesh, height))
    return fem.dirichletbc(np.append(np.zeros(dim - 1), press), dofs, V)


def two_bodies(meshes, moduli):
    """Return forms, displacements, conditions and contact surfaces of the lower and upper block.

    Args:
        meshes: [0, 1]² × [0, 1] and [0, 1]² × [1, 2], or the same in 2D.
        moduli: Young's moduli.
    """
    forms, u, bcs, surfaces = [], [], [], []
    for i, (msh, modulus) in enumerate(zip(meshes, moduli, strict=True)):
        V = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
        u.append(fem.Function(V))
        forms.append(residual(u[-1], ufl.TestFunction(V), modulus))
        bcs.append([clamp(V, 2.0 * i, i * PRESS)])
        surfaces.append(qs.Surface(V, facets=facets_at(msh, 1.0)))
    return forms, u, bcs, surfaces
