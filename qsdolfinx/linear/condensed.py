"""Velocities of one body, with the unknowns inside cells eliminated."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix

from qsdolfinx.compat import collapse
from qsdolfinx.surface.geometry import Cartesian
from qsdolfinx.surface.unknowns import owned_vertices
from qsdolfinx.system.body import Body
from qsdolfinx.system.rigid_modes import displacement_space, orthonormal

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Condensed:
    """Velocities, or displacements, of a body: A = K_vv - K_vb K_bb⁻¹ K_bv.

    Bubbles b couple within their own cell only and are eliminated exactly, cell by cell. The rows
    of A are multiplied by the displacement per unknown. Contact scales the columns in this way, and
    multigrid needs symmetry.

    Args:
        body: The body.
        K: Its bulk block.
        pressures: Owned unknowns that are pressures, ascending.
        scale: Displacement per unknown.
    """

    def __init__(self, body: Body, K: PETSc.Mat, pressures: Indices, scale: float) -> None:
        self._K, self._scale = K, scale
        self._gdim = body.V.mesh.geometry.dim
        modes, has_modes = velocity_modes(body)
        others = np.setdiff1d(np.arange(body.num_owned), pressures)
        #: Owned unknowns of the body that remain, and owned unknowns that are eliminated.
        self.vertices: Indices = others[has_modes[others]]
        self.bubbles: Indices = others[~has_modes[others]]
        first = K.getOwnershipRange()[0]
        self._sets = [_index_set(K, first + dofs) for dofs in (self.vertices, self.bubbles)]
        self._has_bubbles = self._sets[1].getSize() > 0
        #: Whether A is the bulk block itself.
        self.is_whole = self._sets[0].getSize() == K.getSize()[0] and scale == 1
        #: Whether A is constant.
        self.stays = body.linear and self.is_whole
        self._parts: dict[str, PETSc.Mat] = {}
        if self.is_whole:
            self.A: PETSc.Mat = K
        else:
            is_v = self._sets[0]
            self.A = K.createSubMatrix(is_v, is_v)
            self.A.setBlockSize(self._gdim)
        self._x, self._w = self.A.createVecs()
        #: Rigid modes in the remaining unknowns.
        self.modes = [self.A.createVecRight() for _ in modes]
        for vec, values in zip(self.modes, modes[:, self.vertices], strict=True):
            vec.array[:] = values
        orthonormal(self.modes)
        self.update()
        if self._has_bubbles:
            self._y, self._z = (self._parts["vb"].createVecRight() for _ in range(2))

    def update(self) -> None:
        """Update for the present bulk block. Collective."""
        if self.is_whole:
            return
        is_v, is_b = self._sets
        self._K.createSubMatrix(is_v, is_v, submat=self.A)
        if self._has_bubbles:
            self._eliminate(is_v, is_b)
        self.A.scale(self._scale)

    def _eliminate(self, is_v: PETSc.IS, is_b: PETSc.IS) -> None:
        K, parts = self._K, self._parts
        parts["bv"] = K.createSubMatrix(is_b, is_v, submat=parts.get("bv"))
        parts["vb"] = K.createSubMatrix(is_v, is_b, submat=parts.get("vb"))
        parts["bb"] = K.createSubMatrix(is_b, is_b, submat=parts.get("bb"))
        parts["inverse"] = _inverted(parts["bb"], self._gdim, parts.get("inverse"))
        parts["half"] = parts["inverse"].matMult(parts["bv"], parts.get("half"))
        parts["product"] = parts["vb"].matMult(parts["half"], parts.get("product"))
        subset = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        self.A.axpy(-1.0, parts["product"], structure=subset)

    def reduce(self, r: Array) -> Array:
        """Right-hand side of A for a right-hand side of K; call :meth:`expand` next. Collective."""
        self._w.array[:] = r[self.vertices]
        if self._has_bubbles:
            self._y.array[:] = r[self.bubbles]
            self._parts["inverse"].mult(self._y, self._z)
            self._parts["vb"].mult(self._z, self._x)
            self._w.axpy(-1.0, self._x)
        return np.asarray(self._scale * self._w.array_r)

    def expand(self, x: Array, out: Array) -> None:
        """Write the body's unknowns at vertices and bubbles, given x at vertices. Collective."""
        out[self.vertices] = x
        if self._has_bubbles:
            self._x.array[:] = x
            self._parts["half"].mult(self._x, self._y)
            out[self.bubbles] = self._z.array_r - self._y.array_r

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        things = [*self._sets, self._x, self._w, *self.modes, *self._parts.values()]
        if not self.is_whole:
            things.append(self.A)
        if self._has_bubbles:
            things += [self._y, self._z]
        for thing in things:
            thing.destroy()


def _index_set(K: PETSc.Mat, rows: Indices) -> PETSc.IS:
    return PETSc.IS().createGeneral(rows.astype(np.int32), comm=K.comm)


def _inverted(bb: PETSc.Mat, gdim: int, out: PETSc.Mat | None) -> PETSc.Mat:
    """Inverse of the bubbles' block, which has a block of gdim rows for each cell. Collective."""
    first, last = bb.getOwnershipRange()
    pointer, column, value = bb.getDiagonalBlock().getValuesCSR()
    count = last - first
    row = np.repeat(np.arange(count), np.diff(pointer))
    inside = row // gdim == column // gdim
    row, column, value = row[inside], column[inside], value[inside]
    blocks = np.zeros((count // gdim, gdim, gdim))
    blocks[row // gdim, row % gdim, column % gdim] = value
    block = np.repeat(np.arange(count // gdim), gdim * gdim)
    columns = first + gdim * block + np.tile(np.arange(gdim), count)
    pointer = gdim * np.arange(count + 1)
    csr = pointer.astype(np.int32), columns.astype(np.int32), np.linalg.inv(blocks).ravel()
    if out is None:
        size = (count, PETSc.DETERMINE)
        return PETSc.Mat().createAIJ((size, size), csr=csr, comm=bb.comm)
    out.setValuesCSR(*csr)
    out.assemble()
    return out


def velocity_modes(body: Body) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Translations and rotations, shape (modes, owned unknowns), and where they have values.

    They are used for axisymmetric bodies, too: there they are rigid motions only locally, but this
    is what multigrid needs.
    """
    V = body.V
    dofs: npt.NDArray[np.int64] = np.arange(body.num_owned)
    if V.dofmap.index_map_bs != V.mesh.geometry.dim:
        parts = (V.sub(i) for i in range(V.num_sub_spaces))
        V, dofs = collapse(next(part for part in parts if part.num_sub_spaces > 0))
    gdim = V.mesh.geometry.dim
    places: npt.NDArray[np.int32]
    if V.element.basix_element.family == basix.ElementFamily.P:
        x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
        places = np.asarray(dofs[: x.shape[0] * gdim].reshape(-1, gdim), dtype=np.int32)
    else:
        space = displacement_space(body.V)
        assert space is not None
        places, x = owned_vertices(space)
    fields = Cartesian().rigid_fields(x, gdim)
    modes = np.zeros((len(fields), body.num_owned))
    modes[:, places] = fields
    return modes, np.isin(np.arange(body.num_owned), places)
