"""Rigid body modes: what holds a body, and the near-nullspace for algebraic multigrid."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.bulk import Body
from qsdolfinx.contact import Contact
from qsdolfinx.unknowns import is_vertex_vector, owned_vertices

Array = npt.NDArray[np.float64]


def displacement_space(V: fem.FunctionSpace) -> fem.FunctionSpace | None:
    """V itself or the first sub-space that is a vector field with unknowns at the vertices."""
    if is_vertex_vector(V):
        return V
    subs = (V.sub(i) for i in range(V.num_sub_spaces))
    return next((sub for sub in subs if is_vertex_vector(sub)), None)


def rigid_modes(body: Body) -> Array:
    """Translations and linearised rotations about the origin, shape (modes, owned unknowns).

    Exact for P1, Q1 and P1 with bubble; unknowns that are not at vertices are zero. There are no
    modes where the body has no displacement space.
    """
    V = displacement_space(body.V)
    if V is None:
        return np.zeros((0, body.num_owned))
    dofs, x = owned_vertices(V)
    gdim = V.mesh.geometry.dim
    rotations = [(0, 1)] if gdim == 2 else [(0, 1), (1, 2), (2, 0)]
    modes = np.zeros((gdim + len(rotations), body.num_owned))
    for i in range(gdim):
        modes[i, dofs[:, i]] = 1
    for mode, (i, j) in zip(modes[gdim:], rotations, strict=True):
        mode[dofs[:, i]] = -x[:, j]
        mode[dofs[:, j]] = x[:, i]
    return modes


class RigidMotion:
    """Rigid modes of all bodies, and whether conditions and closed contacts leave any of them free.

    Args:
        bodies: The bodies. One without a displacement space counts as held.
    """

    def __init__(self, bodies: typing.Sequence[Body]) -> None:
        self._bodies = bodies
        #: Orthonormal modes of each body as vectors; empty where there is no displacement space.
        self.modes: list[list[PETSc.Vec]] = []
        for body in bodies:
            self.modes.append(orthonormal([vector(body, mode) for mode in rigid_modes(body)]))
        self._zero = [body.create_vec() for body in bodies]
        self._offsets = np.cumsum([0, *map(len, self.modes)])
        self._held = np.zeros((self._offsets[-1], self._offsets[-1]))
        for i, body in enumerate(bodies):
            self._add(self._held, [i], [[v.array_r[body.owned_constrained] for v in self.modes[i]]])
        self._held = bodies[0].comm.allreduce(self._held, op=MPI.SUM)

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        for vec in (*self._zero, *(mode for modes in self.modes for mode in modes)):
            vec.destroy()

    def _add(self, gram: Array, parts: list[int], values: list[list[Array]]) -> None:
        """Add the products of the modes' local values, given per body."""
        columns = np.concatenate([np.arange(*self._offsets[i : i + 2]) for i in parts])
        flat = [np.ravel(v) for of_body in values for v in of_body]
        if flat:
            rows = np.array(flat)
            # A body in contact with itself has its modes twice.
            np.add.at(gram, (columns[:, None], columns[None, :]), rows @ rows.T)

    @property
    def all_held(self) -> bool:
        """Whether Dirichlet conditions alone hold every body."""
        return _is_regular(self._held)

    def is_free(
        self, contacts: typing.Sequence[Contact], sides: typing.Sequence[tuple[int, int]]
    ) -> bool:
        """Whether a rigid motion violates no condition and changes no closed gap. Collective."""
        if self.all_held:
            return False
        gram = np.zeros_like(self._held)
        for contact, (s, m) in zip(contacts, sides, strict=True):
            zero = self._zero[s], self._zero[m]
            gaps = [
                [contact.closed_gaps(mode, zero[1]) for mode in self.modes[s]],
                [contact.closed_gaps(zero[0], mode) for mode in self.modes[m]],
            ]
            self._add(gram, [s, m], gaps)
        return not _is_regular(self._held + self._bodies[0].comm.allreduce(gram, op=MPI.SUM))


def _is_regular(gram: Array) -> bool:
    """Whether the products of modes show that every motion is resisted.

    Scaled to a unit diagonal: a small surface holds a large body as well.
    """
    diagonal = np.diag(gram)
    if np.any(diagonal <= 1e-30):
        return len(gram) == 0
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(gram * np.outer(scale, scale))[0] > 1e-12)


def vector(body: Body, values: Array) -> PETSc.Vec:
    """Vector of a body with these owned values. Collective."""
    out = body.create_vec()
    out.array[:] = values
    return out


def orthonormal(vecs: list[PETSc.Vec]) -> list[PETSc.Vec]:
    """Orthonormalise vectors in place (Gram-Schmidt, twice: once leaves rounding errors)."""
    for k, vec in enumerate(vecs):
        for other in (*vecs[:k], *vecs[:k]):
            vec.axpy(-vec.dot(other), other)
        vec.normalize()
    return vecs


def set_near_nullspace(mat: PETSc.Mat, vecs: list[PETSc.Vec]) -> None:
    """Hand orthonormal rigid modes to a matrix. Collective."""
    space = PETSc.NullSpace().create(vectors=vecs, comm=mat.comm)
    mat.setNearNullSpace(space)
    space.destroy()
