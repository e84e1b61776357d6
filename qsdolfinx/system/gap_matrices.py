"""Derivatives of forces that gaps make themselves, by all unknowns of the equations."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.friction.slip import Slip
from qsdolfinx.surface.surface import Surface
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.factors import Entries
from qsdolfinx.system.normal_rows import Normal

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class GapMatrices:
    """B = γ G + N, rows being those of the gaps, columns all unknowns of the equations.

    B z is y but for a constant at points, and the gap itself of a law without multipliers. Of the
    potential Σ_p w_p/(2γ) ([y_p]₊² − λ_h²) the second derivative is Bᵀ W/γ χ B − Nᵀ W/γ N, χ being
    1 at closed points; of Σ_k S_k φ(ḡ_k) it is Gᵀ S φ'' G. Collective.

    Args:
        rows: The rows.
        slip: Slip whose friction follows their pressure; None without friction.
        gaps: G by what moves the bodies, and a driven tool: forces are its transposed; and by the
            unknowns.
        numbers: Of the unknowns λ of this rank among all, shape (λ,).
        num_local: Unknowns of this rank.
    """

    def __init__(
        self,
        rows: CondensedRows,
        slip: Slip | None,
        gaps: tuple[Entries, Entries],
        numbers: Indices,
        num_local: int,
    ) -> None:
        self._rows, self._comm, self._num = rows, rows.model.comm, num_local
        self._slip, self._width = slip, rows.gap.operator.width
        #: N E; None without multipliers.
        self.functions: PETSc.Mat | None = None
        if isinstance(rows, PointConstraints) and rows.model.augmented:
            self.functions = self._of_nodes(rows, numbers)
        self._left, self._right = (self._sum(entries) for entries in gaps)
        self._pressures: PETSc.Mat | None = None

    def _sum(self, gaps: Entries) -> PETSc.Mat:
        """γ G + N."""
        rows = self._rows
        scaled = gaps._replace(value=rows.gamma * gaps.value)
        mat = scaled.matrix(rows.gap.num_rows * self._width, self._num, self._comm)
        if self.functions is not None:
            mat.axpy(1.0, self.functions, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return mat

    def _of_nodes(self, rows: PointConstraints, numbers: Indices) -> PETSc.Mat:
        """N E by the unknowns λ."""
        slave = rows.gap.slave
        sides = self._of_sides()
        num_sides, first = _layout(slave)
        dofs = slave.node_dofs[rows.free] - first
        free = Entries(dofs, numbers, np.ones(len(dofs))).matrix(num_sides, self._num, self._comm)
        if rows.extension is not None:
            at = slave.node_dofs
            row, column, value = rows.extension.entries(at, np.ones(at.shape))
            means = PETSc.Mat().create(comm=self._comm)
            means.setSizes(((num_sides, PETSc.DETERMINE),) * 2)
            means.setType(PETSc.Mat.Type.AIJ)
            _cpp.set_places(means.handle, row, column)  # some are of rows of other ranks
            _cpp.set_values(means.handle, value)
            first_means = means.matMult(free)
            second = means.matMult(first_means)
            for part in (first_means, second):
                free.axpy(1.0, part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                part.destroy()
            means.destroy()
        out = sides.matMult(free)
        for mat in (sides, free):
            mat.destroy()
        return out

    def _of_sides(self) -> PETSc.Mat:
        """N by the unknowns of the slave that stand for sides of nodes."""
        rows = self._rows
        offset, unknowns, values = rows.gap.operator.functions
        num_sides = _layout(rows.gap.slave)[0]
        row = np.repeat(np.arange(rows.gap.num_rows, dtype=np.int64), np.diff(offset))
        return Entries(row, unknowns, values).matrix(rows.gap.num_rows, num_sides, self._comm)

    def normal(self, at: Normal) -> Entries:
        """Derivative of the forces, and of R_λ, of this rank's rows of all. Collective."""
        rows = self._rows
        weight = rows.gap.weight[:, None] / rows.gamma**2
        found = [_product(self._left, (weight * rows.stiffness(at)).ravel(), self._right)]
        if self.functions is not None:
            of_nodes = np.asarray(-rows.gap.weight / rows.gamma)
            found.append(_product(self.functions, of_nodes, self.functions))
        return Entries(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))

    def pressures(self, at: Normal) -> Entries:
        """Derivatives of the pressures that friction knows at its rows: numbers of these in rows.

        Collective.
        """
        slope = self._rows.stiffness(at)[:, 0] / self._rows.gamma
        return self._at_slip(np.where(at.pressure[:, 0] > 0, slope, 0.0))

    def trials(self, at: Normal) -> Entries:
        """The same of y_n: with points of the largest y beside a node. Collective."""
        rows = self._rows
        if not isinstance(rows, PointConstraints):
            return self._at_slip(rows.by_trial())
        offset, unknowns, _ = rows.gap.operator.functions
        row = np.repeat(np.arange(rows.gap.num_rows, dtype=np.int64), np.diff(offset))
        shares = rows.shares_of_largest(at)
        found = np.flatnonzero(shares)
        sides = Entries(row[found], unknowns[found], shares[found])
        chosen = sides.matrix(rows.gap.num_rows, _layout(rows.gap.slave)[0], self._comm)
        to_rows = self._to_rows(np.ones(self._num_slips))
        picked = chosen.matMult(to_rows)
        out = self._through(picked, np.ones(rows.gap.num_rows))
        for mat in (chosen, to_rows, picked):
            mat.destroy()
        return out

    def _at_slip(self, factor: Array) -> Entries:
        """Means at the rows of the slip of B times a factor of each row. Collective."""
        if self._pressures is None:
            self._pressures = self._means()
        return self._through(self._pressures, factor)

    def _through(self, weights: PETSc.Mat, factor: Array) -> Entries:
        """B times a factor of each row, summed with weights: numbers of the slip's rows in rows."""
        found = _product(weights, factor, self._right)
        return found._replace(row=found.row - weights.getOwnershipRangeColumn()[0])

    @property
    def _num_slips(self) -> int:
        assert self._slip is not None
        return int(self._slip.operator.num_rows)

    def _to_rows(self, factor: Array) -> PETSc.Mat:
        """Sums over the sides of the nodes of the slip's rows, times a factor of these."""
        slave, slip, num = self._rows.gap.slave, self._slip, self._num_slips
        assert slip is not None
        num_sides, first = _layout(slave)
        own = _first(num, self._comm) + np.arange(num, dtype=np.int64)
        dofs = slave.node_dofs[slip.row_node] - first
        columns, values = np.repeat(own, slave.block), np.repeat(factor, slave.block)
        return Entries(dofs.ravel(), columns, values).matrix(num_sides, num, self._comm)

    def _means(self) -> PETSc.Mat:
        """Weights of the rows in the means at the rows of the slip, transposed."""
        rows, slip, num = self._rows, self._slip, self._num_slips
        assert slip is not None
        if not isinstance(rows, PointConstraints):
            own = _first(num, self._comm) + np.arange(num, dtype=np.int64)
            return Entries(np.arange(num), own, np.ones(num)).matrix(num, num, self._comm)
        sides, cover = self._of_sides(), rows.cover[slip.row_node]
        share: Array = np.divide(1.0, cover, out=np.zeros(num), where=cover > 0)
        to_rows = self._to_rows(share)
        out = sides.matMult(to_rows)
        area = _vec(out, rows.gap.operator.row_area)
        out.diagonalScale(area, None)
        for thing in (sides, to_rows, area):
            thing.destroy()
        return out

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        for mat in (self._left, self._right, self.functions, self._pressures):
            if mat is not None:
                mat.destroy()


def _layout(slave: Surface) -> tuple[int, int]:
    """Unknowns of the slave's body on this rank, and the first of them."""
    vec = slave.create_vec()
    out = vec.getLocalSize(), vec.owner_range[0]
    vec.destroy()
    return out


def _first(num: int, comm: MPI.Intracomm) -> int:
    """Number of the first of this rank's. Collective."""
    return int(comm.scan(num, op=MPI.SUM)) - num


def _vec(mat: PETSc.Mat, values: Array) -> PETSc.Vec:
    vec = mat.createVecLeft()
    vec.array[:] = values
    return vec


def _product(left: PETSc.Mat, weight: Array, right: PETSc.Mat) -> Entries:
    """Aᵀ diag(weight) B: entries of this rank's rows, all numbers global. Collective."""
    scaled, factor = right.copy(), _vec(right, weight)
    scaled.diagonalScale(factor, None)
    product = left.transposeMatMult(scaled)
    starts, columns, values = product.getValuesCSR()
    first = product.getOwnershipRange()[0]
    row = first + np.repeat(np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts))
    out = Entries(row, columns.astype(np.int64), values.copy())
    for thing in (scaled, factor, product):
        thing.destroy()
    return out
