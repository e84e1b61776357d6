"""Rigid motions, and their values at the unknowns of a surface."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.surface import Coordinates, Surface
from qsdolfinx.surface.unknowns import EDGES

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


def rotation_vector(matrix: Array, near: Array | None = None) -> Array:
    """Inverse of :func:`rotation_matrix`: an angle, shape (1,), or a vector (3,).

    Args:
        matrix: The rotation matrix.
        near: Rotation that the result is closest to, which may have made whole turns; by default
            the result is at most π.
    """
    vector = _shortest_rotation(matrix)
    if near is None:
        return vector
    angle, most = float(np.linalg.norm(vector)), float(np.linalg.norm(near))
    if angle == 0 and most == 0:
        return vector
    axis = vector / angle if angle > 0 else near / most
    turns = np.round((float(axis @ near) - angle) / (2 * np.pi))
    return np.asarray(vector + 2 * np.pi * turns * axis)


def _shortest_rotation(matrix: Array) -> Array:
    if len(matrix) == 2:
        return np.array([np.arctan2(matrix[1, 0], matrix[0, 0])])
    twist = np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]]) - [
        matrix[1, 2],
        matrix[2, 0],
        matrix[0, 1],
    ]
    sine, cosine = np.linalg.norm(twist) / 2, (np.trace(matrix) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-6 or cosine > 0:
        return np.asarray(twist / 2 * (angle / sine if sine > 0 else 1.0))
    values, vectors = np.linalg.eigh(matrix + matrix.T)  # near π: axis of eigenvalue 1
    axis = vectors[:, np.argmax(values)]
    return np.asarray(angle * axis * (1.0 if axis @ twist >= 0 else -1.0))


def rotation_about(matrix: Array, center: Array, displacement: Array) -> Affine:
    """Displacement field of a motion: x ↦ (matrix − 1) (x − center) + displacement."""
    A = matrix - np.eye(len(matrix))
    return Affine(A, displacement - A @ center)


def trace_positions(surface: Surface, coordinates: Coordinates | None = None) -> Array:
    """Positions of the trace's nodes on this rank's facets, shape (facets, nodes, 3).

    Args:
        surface: The surface.
        coordinates: Coordinates of its facets, as ``surface.coordinates``; by default the present
            ones.
    """
    x, _, nodes = surface.coordinates if coordinates is None else coordinates
    if surface.degree == 1:
        return x
    if nodes is not None:
        return nodes
    nv = surface.num_facet_vertices
    out = [*x.swapaxes(0, 1), *((x[:, a] + x[:, b]) / 2 for a, b in EDGES[nv])]
    if nv == 4:
        out.append(x.mean(axis=1))
    return np.stack(out, axis=1)


def affine_vec(surface: Surface, field: Affine, x: Array | None = None) -> PETSc.Vec:
    """New vector of the body with the field at the surface's unknowns, zero elsewhere. Collective.

    Exact for traces of any degree, as the field is linear in x.

    Args:
        surface: The surface.
        field: The field.
        x: Positions of the unknowns; by default :func:`trace_positions`.
    """
    x = trace_positions(surface) if x is None else x
    return trace_vec(surface, x[..., : surface.gdim] @ field.A.T + field.b)


def trace_vec(surface: Surface, values: Array) -> PETSc.Vec:
    """New vector of the body with values (facets, nodes, gdim), zero elsewhere. Collective."""
    vec = surface.create_vec()
    dofs = np.asarray(surface.cpp_object.facet_dofs, dtype=PETSc.IntType)
    vec.setValues(dofs.ravel(), values.ravel())
    vec.assemble()
    return vec
