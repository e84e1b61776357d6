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

MASSES = ("lumped", "consistent")


def facet_measure(surface: Surface) -> ufl.Measure:
    """Measure of the surface's facets. Collective."""
    facets, msh = np.sort(surface.facets), surface.mesh
    tags = mesh.meshtags(msh, msh.topology.dim - 1, facets, np.ones_like(facets))
    return ufl.Measure("ds", domain=msh, subdomain_data=tags)(1)


def nodal_forces(surface: Surface, force: PETSc.Vec) -> Array:
    """Forces on the contact nodes of ``surface.linear``, shape (nodes, gdim). Collective.

    Those on unknowns of a trace of degree 2 are carried over to the vertices, so that they do the
    same work in displacements of degree 1.

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
    return np.asarray(values, dtype=np.float64).reshape(-1, surface.gdim)


def recover(surface: Surface, force: PETSc.Vec, mass: str) -> fem.Function:
    """Traction with the virtual work of given contact forces. Collective.

    Args:
        surface: The surface.
        force: Forces on the unknowns of its body.
        mass: ``"lumped"`` or ``"consistent"``.

    Returns:
        Function of degree 1, see Contact.traction.
    """
    f, linear = nodal_forces(surface, force), surface.linear
    out = linear.function(f / linear.node_area[:, None])
    if mass == "consistent":
        _solve_mass(linear, f, out)
    return out


def _solve_mass(surface: Surface, force: Array, t: fem.Function) -> None:
    """Solve ∫ t·v ds = f(v) on the surface, from a first guess t. Collective."""
    V, ds = t.function_space, facet_measure(surface)
    product = ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V))
    nothing = (
        fem.Constant(V.mesh, np.float64(0)) * product * ufl.dx
    )  # for the diagonal off the surface
    ring = 2 * np.pi * ufl.SpatialCoordinate(V.mesh)[0] if surface.axisymmetric else 1
    form = fem.form(ring * product * ds + nothing)
    matrix = fem_petsc.assemble_matrix(form)
    matrix.assemble()
    diagonal = matrix.getDiagonal()
    diagonal.array[diagonal.array_r == 0] = 1.0  # off the surface: t = 0
    matrix.setDiagonal(diagonal)
    b, x = matrix.createVecs()
    right = surface.function(force)  # forces in the place of values
    b.array[:] = right.x.array[: len(b.array_r)]
    x.array[:] = t.x.array[: len(x.array_r)]
    ksp = PETSc.KSP().create(V.mesh.comm)
    ksp.setOperators(matrix)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.getPC().setType(PETSc.PC.Type.JACOBI)
    ksp.setTolerances(rtol=1e-13, atol=0.0)
    ksp.setInitialGuessNonzero(True)
    ksp.solve(b, x)
    t.x.array[: len(x.array_r)] = x.array_r
    t.x.scatter_forward()
    for thing in (ksp, matrix, diagonal, b, x):
        thing.destroy()
