"""Rigid body modes: free rigid motions, and the near-nullspace for algebraic multigrid."""

from __future__ import annotations

import functools
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.handles import handle_of
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.unknowns import is_vertex_scalar, is_vertex_vector
from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]


def displacement_space(V: fem.FunctionSpace) -> fem.FunctionSpace | None:
    """V itself, or the first sub-space that is a vector field with unknowns at the vertices.

    The result is also V if V is a scalar space.
    """
    if is_vertex_vector(V) or is_vertex_scalar(V):
        return V
    subs = (V.sub(i) for i in range(V.num_sub_spaces))
    return next((sub for sub in subs if is_vertex_vector(sub)), None)


def rigid_modes(body: Body) -> Array:
    """Translations and linearised rotations about the origin, shape (modes, owned unknowns).

    For a scalar field, the only mode is 1 everywhere.

    Modes are exact at all nodes: also on edges, and for the bubbles of enriched elements, since
    they are interpolated unless unknowns are values at nodes. A body without a displacement space
    has no modes.
    """
    V, gdim, u = body.V, body.V.mesh.geometry.dim, fem.Function(body.V)
    if is_vertex_scalar(V):
        u.interpolate(lambda x: np.ones(x.shape[1]))
        return u.x.array[None, : body.num_owned].copy()
    parts = [u] if is_vertex_vector(V) else [u.sub(i) for i in range(V.num_sub_spaces)]
    part = next((part for part in parts if is_vertex_vector(part.function_space)), None)
    if part is None:
        return np.zeros((0, body.num_owned))
    count = len(body.geometry.rigid_fields(np.zeros((1, 3)), gdim))
    if part is u and V.ufl_element().basix_element.interpolation_is_identity:
        x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
        return body.geometry.rigid_fields(x, gdim).reshape(count, body.num_owned)
    modes = np.zeros((count, body.num_owned))
    fields: list[Array] = []  # at the interpolation points, computed once for all modes

    def field(x: Array, k: int) -> Array:
        if not fields:
            fields.extend(body.geometry.rigid_fields(x.T, gdim))
        return fields[k].T

    for k in range(count):
        part.interpolate(functools.partial(field, k=k))
        modes[k] = u.x.array[: body.num_owned]
    return modes


class RigidMotion:
    """Rigid modes of all bodies, and the motions that Dirichlet conditions leave free.

    Args:
        bodies: The bodies. A body without a displacement space counts as constrained.
    """

    def __init__(self, bodies: typing.Sequence[Body]) -> None:
        self._comm = bodies[0].comm
        #: Orthonormal modes of each body as vectors; empty where there is no displacement space.
        self.modes: list[list[PETSc.Vec]] = []
        for body in bodies:
            self.modes.append(orthonormal([vector(body, mode) for mode in rigid_modes(body)]))
        self._zero = [body.create_vec() for body in bodies]
        self._offsets = np.cumsum([0, *map(len, self.modes)])
        held = np.zeros((self._offsets[-1], self._offsets[-1]))
        for i, body in enumerate(bodies):
            at_conditions = [v.array_r[body.owned_constrained] for v in self.modes[i]]
            if at_conditions:
                rows = np.array(at_conditions)
                part = slice(*self._offsets[i : i + 2])
                held[part, part] = rows @ rows.T
        #: Basis of the motions that no condition resists, shape (modes of all bodies, motions).
        self.free_motions: Array = _null_space(self._comm.allreduce(held, op=MPI.SUM))

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        for vec in (*self._zero, *(mode for modes in self.modes for mode in modes)):
            vec.destroy()

    def work(self, residuals: typing.Sequence[Array]) -> Array:
        """Products of the modes of all bodies with owned values of each body. Collective."""
        local = [
            float(mode.array_r @ r)
            for modes, r in zip(self.modes, residuals, strict=True)
            for mode in modes
        ]
        return np.asarray(self._comm.allreduce(np.array(local), op=MPI.SUM))

    def gap_changes(self, weighted_gap: WeightedGap, sides: tuple[int | None, ...]) -> Array:
        """Changes of weighted gaps by the modes, shape (values of the gaps, modes). Collective.

        Args:
            weighted_gap: Gap of an integration side of a contact.
            sides: Bodies of its slave and its master; None for a rigid tool.
        """
        out = np.zeros((weighted_gap.state.values.size, self._offsets[-1]))
        for body in {side for side in sides if side is not None}:
            for j, mode in enumerate(self.modes[body]):
                u = [mode if side == body else self._zero_of(side) for side in sides]
                slave, master = map(handle_of, u)
                change = weighted_gap.operator.apply(slave, master)
                out[:, self._offsets[body] + j] = change.ravel()
        return out

    def _zero_of(self, body: int | None) -> PETSc.Vec | None:
        return None if body is None else self._zero[body]

    def displacement(self, coefficients: Array, body: int) -> Array:
        """Owned values of one body's part of a motion, given by coefficients of all modes."""
        out = np.zeros(len(self._zero[body].array_r))
        for c, mode in zip(coefficients[self._offsets[body] :], self.modes[body], strict=False):
            out += c * mode.array_r
        return out


def _null_space(gram: Array) -> Array:
    """Basis of the null space of a Gram matrix of modes: motions with zero products.

    The Gram matrix is scaled to a unit diagonal, since a small surface constrains a large body,
        too.
    """
    diagonal = np.diag(gram)
    scale = np.where(diagonal > 1e-30, 1 / np.sqrt(np.maximum(diagonal, 1e-30)), 1.0)
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    basis = scale[:, None] * vectors[:, values <= 1e-12]
    return np.asarray(basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-300))


def vector(body: Body, values: Array) -> PETSc.Vec:
    """New vector of a body with given owned values. Collective."""
    out = body.create_vec()
    out.array[:] = values
    return out


def orthonormal(vecs: list[PETSc.Vec]) -> list[PETSc.Vec]:
    """Orthonormalise vectors in place by the Gram-Schmidt method, applied twice.

    A single application, as in ``dolfinx.la.orthonormalize``, leaves rounding errors far from the
    origin. That function also fails for rotations of a body of some nanometres, given in metres.
    """
    for k, vec in enumerate(vecs):
        for other in (*vecs[:k], *vecs[:k]):
            vec.axpy(-vec.dot(other), other)
        vec.normalize()
    return vecs


def set_near_nullspace(mat: PETSc.Mat, vecs: list[PETSc.Vec]) -> None:
    """Set orthonormal rigid modes as near-nullspace of a matrix. Collective."""
    space = PETSc.NullSpace().create(vectors=vecs, comm=mat.comm)
    mat.setNearNullSpace(space)
    space.destroy()


def set_modes(mat: PETSc.Mat, modes: Array) -> None:
    """Orthonormalise and set rigid modes of a matrix, (modes, owned unknowns). Collective."""
    vecs = [mat.createVecRight() for _ in modes]
    for vec, mode in zip(vecs, modes, strict=True):
        vec.array[:] = mode
    set_near_nullspace(mat, orthonormal(vecs))
    for vec in vecs:
        vec.destroy()
