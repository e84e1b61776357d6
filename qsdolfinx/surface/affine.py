"""Rigid motions, and their values at the unknowns of a surface."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]


class Affine(typing.NamedTuple):
    """The field x ↦ A x + b.

    Attributes:
        A: Shape (gdim, gdim).
        b: Shape (gdim,).
    """

    A: Array
    b: Array


def skew(rotation: Array) -> Array:
    """Matrix of the small rotation x ↦ ω × x; in 2D ω is an angle, shape (1,)."""
    if len(rotation) == 1:
        return np.asarray(rotation[0] * np.array([[0.0, -1.0], [1.0, 0.0]]))
    x, y, z = rotation
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=np.float64)


def rotation_matrix(rotation: Array) -> Array:
    """Finite rotation (Rodrigues' formula) by an angle (1,) or a rotation vector (3,)."""
    W, angle = skew(rotation), float(np.linalg.norm(rotation))
    # sinc(t) = sin(πt)/(πt): no division by a vanishing angle.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / 2 / np.pi) ** 2
    return np.asarray(np.eye(len(W)) + first * W + second * W @ W)


def rotation_about(matrix: Array, center: Array, displacement: Array) -> Affine:
    """Displacement field of a motion: x ↦ (matrix − 1) (x − center) + displacement."""
    A = matrix - np.eye(len(matrix))
    return Affine(A, displacement - A @ center)


def trace_positions(surface: Surface) -> Array:
    """Positions of the trace's nodes on this rank's facets, shape (facets, nodes, 3)."""
    x = np.asarray(surface.cpp_object.facet_x)
    if surface.degree == 1:
        return x
    nodes_x = surface.coordinates[2]
    if nodes_x is not None:
        return nodes_x
    edges = {2: [(0, 1)], 3: [(0, 1), (0, 2), (1, 2)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}
    nv = surface.num_facet_vertices
    nodes = [*x.swapaxes(0, 1), *((x[:, a] + x[:, b]) / 2 for a, b in edges[nv])]
    if nv == 4:
        nodes.append(x.mean(axis=1))
    return np.stack(nodes, axis=1)


def affine_vec(surface: Surface, field: Affine) -> PETSc.Vec:
    """New vector of the body with the field at the surface's unknowns, zero elsewhere. Collective.

    Exact for traces of any degree, as the field is linear in x.
    """
    vec = surface.create_vec()
    x = trace_positions(surface)[..., : surface.gdim]
    dofs = np.asarray(surface.cpp_object.facet_dofs, dtype=PETSc.IntType)
    vec.setValues(dofs.ravel(), (x @ field.A.T + field.b).ravel())
    vec.assemble()
    return vec
