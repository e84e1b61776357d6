"""The velocity block of the linear solver ``"schur"``."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix

from qsdolfinx.compat import collapse
from qsdolfinx.surface.geometry import Cartesian
from qsdolfinx.surface.unknowns import owned_vertices
from qsdolfinx.system.body import Body
from qsdolfinx.system.rigid_modes import displacement_space, set_modes

Array = npt.NDArray[np.float64]


class VelocityBlock:
    """PETSc's PCPYTHON for the velocities and displacements of all bodies.

    Bubbles, which see their own cell alone, are eliminated exactly. Multigrid is for what this
    leaves at the vertices, with the rigid modes of all bodies in contact. Rows are multiplied by
    the displacement per unknown: columns of bodies in velocities are, and with displacements in
    contact with velocities multigrid would have neither symmetry nor a scale.

    Args:
        bodies: The bodies.
        pressures: For each body its owned unknowns that are pressures.
        scales: Displacement per unknown of each body.
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        pressures: typing.Sequence[npt.NDArray[np.int64]],
        scales: typing.Sequence[float],
    ) -> None:
        self._comm = bodies[0].comm
        self._gdim = bodies[0].V.mesh.geometry.dim
        modes, vertices, rows = [], [], []
        for body, dofs, scale in zip(bodies, pressures, scales, strict=True):
            others = np.setdiff1d(np.arange(body.num_owned), dofs)
            values, with_modes = velocity_modes(body)
            modes.append(values[:, others] / scale)
            vertices.append(with_modes[others])
            rows.append(np.full(others.size, scale))
        self._vertices = np.concatenate(vertices)
        self._modes = np.hstack(modes)[:, self._vertices]
        self._rows = np.concatenate(rows)[self._vertices]
        self._has_bubbles = self._comm.allreduce(int((~self._vertices).sum())) > 0
        self._made = False
        self._S: PETSc.Mat | None = None
        self._bv: PETSc.Mat | None = None
        self._vb: PETSc.Mat | None = None
        self._bb: PETSc.Mat | None = None
        self._inverse: PETSc.Mat | None = None
        self._half: PETSc.Mat | None = None
        self._product: PETSc.Mat | None = None

    def setUp(self, pc: PETSc.PC) -> None:
        """Eliminate the bubbles of a new matrix. Collective."""
        matrix = pc.getOperators()[1]
        if not self._made:
            self._create(pc, matrix)
        S = self._S = matrix.createSubMatrix(*[self._is_v] * 2, submat=self._S)
        if self._has_bubbles:
            bv = self._bv = matrix.createSubMatrix(self._is_b, self._is_v, submat=self._bv)
            vb = self._vb = matrix.createSubMatrix(self._is_v, self._is_b, submat=self._vb)
            half = self._half = self._inverted(matrix).matMult(bv, self._half)
            self._product = vb.matMult(half, self._product)
            S.axpy(-1.0, self._product, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        S.diagonalScale(self._scale, None)
        if not self._made:
            S.setBlockSize(self._gdim)
            set_modes(S, self._modes)
            self._solver.setOperators(S, S)
            self._made = True
        self._solver.setUp()

    def _create(self, pc: PETSc.PC, matrix: PETSc.Mat) -> None:
        """Index sets, vectors and the solver of the vertices. Collective."""
        first = matrix.getOwnershipRange()[0]
        sets = [
            PETSc.IS().createGeneral((first + np.flatnonzero(chosen)).astype(np.int32), self._comm)
            for chosen in (self._vertices, ~self._vertices)
        ]
        self._is_v, self._is_b = sets
        sizes = (int(self._vertices.sum()), PETSc.DETERMINE)
        self._scale, self._r, self._x, self._w = (
            PETSc.Vec().createMPI(sizes, comm=self._comm) for _ in range(4)
        )
        self._scale.array[:] = self._rows
        sizes = (int((~self._vertices).sum()), PETSc.DETERMINE)
        self._z, self._y = (PETSc.Vec().createMPI(sizes, comm=self._comm) for _ in range(2))
        self._solver = PETSc.PC().create(self._comm)
        self._solver.setOptionsPrefix((pc.getOptionsPrefix() or "") + "vertices_")
        self._solver.setFromOptions()

    def _inverted(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """Inverse of the bubbles' block, which is one of gdim rows for each cell. Collective."""
        bb = self._bb = matrix.createSubMatrix(self._is_b, self._is_b, submat=self._bb)
        first, last = bb.getOwnershipRange()
        pointer, column, value = bb.getDiagonalBlock().getValuesCSR()
        gdim, count = self._gdim, last - first
        row = np.repeat(np.arange(count), np.diff(pointer))
        inside = row // gdim == column // gdim
        row, column, value = row[inside], column[inside], value[inside]
        blocks = np.zeros((count // gdim, gdim, gdim))
        blocks[row // gdim, row % gdim, column % gdim] = value
        block = np.repeat(np.arange(count // gdim), gdim * gdim)
        columns = first + gdim * block + np.tile(np.arange(gdim), count)
        pointer = gdim * np.arange(count + 1)
        csr = pointer.astype(np.int32), columns.astype(np.int32), np.linalg.inv(blocks).ravel()
        if self._inverse is None:
            size = (count, PETSc.DETERMINE)
            self._inverse = PETSc.Mat().createAIJ((size, size), csr=csr, comm=self._comm)
        else:
            self._inverse.setValuesCSR(*csr)
            self._inverse.assemble()
        return self._inverse

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Approximate solution. Collective."""
        v = self._vertices
        values = r.array_r
        self._r.array[:] = values[v]
        if self._inverse is not None and self._vb is not None:
            self._y.array[:] = values[~v]
            self._inverse.mult(self._y, self._z)
            self._vb.mult(self._z, self._w)
            self._r.axpy(-1.0, self._w)
        self._r.pointwiseMult(self._r, self._scale)
        self._solver.apply(self._r, self._x)
        out = x.array
        out[v] = self._x.array_r
        if self._half is not None:
            self._half.mult(self._x, self._y)
            out[~v] = self._z.array_r - self._y.array_r

    def destroy(self, pc: PETSc.PC | None = None) -> None:
        """Free PETSc's objects. Collective."""
        if not self._made:
            return
        for thing in (self._solver, self._is_v, self._is_b):
            thing.destroy()
        for vec in (self._scale, self._r, self._x, self._w, self._y, self._z):
            vec.destroy()
        mats = self._S, self._bv, self._vb, self._bb, self._inverse, self._half, self._product
        for mat in mats:
            if mat is not None:
                mat.destroy()
        self._S = self._bv = self._vb = self._bb = None
        self._inverse = self._half = self._product = None
        self._made = False


def velocity_modes(body: Body) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Translations and rotations, shape (modes, owned unknowns), and where they have values.

    In axisymmetric bodies too: there they are rigid motions only locally, which is what multigrid
    asks for.
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
