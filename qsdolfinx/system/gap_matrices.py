"""Derivatives of forces that gaps make themselves, by all unknowns of the equations."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.extension import Extension
from qsdolfinx.surface.surface import Surface
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.entries import (
    Entries,
    global_entries,
    joined,
    local_entries,
    matrix_of,
)
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import Tangential
from qsdolfinx.system.normal_rows import Normal

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
#: By what moves the bodies and a driven tool, of which forces are the transposed; and by the
#: unknowns: the same list where that is the same.
Sided = tuple[list[Entries], list[Entries]]


class Moving(typing.NamedTuple):
    """How λ_h moves along facets, in numbers of all unknowns of the equations.

    Attributes:
        rows: Derivative of λ_h at the rows.
        mixed: Σ_p w_p a (p_p − λ_h)/γ ∂N_k; rows are unknowns of the slave that stand for the sides
            of nodes.
    """

    rows: Entries
    mixed: Entries


class GapMatrices:
    """B = γ G + a N, rows being those of the gaps, columns all unknowns of the equations.

    B z is y but for a constant at points, and the gap itself of a law without multipliers. Of the
    potential Σ_p w_p/(2γ) ([y_p]₊² − a λ_h²) the second derivative is Bᵀ W/γ χ B − a Nᵀ W/γ N, χ
    being 1 at closed points; of Σ_k S_k φ(ḡ_k) it is Gᵀ S φ'' G. Of friction at points there
    are three more rows, B_t = γ_t J + N_t, of each, and the derivative is Bᵀ W D B* − Nᵀ W/γ N, D
    having a block for each point, and B* having (1 − γ_t/ε_t) N_t with a penalty. Collective.

    Args:
        rows: The rows.
        friction: Friction at these points; None without.
        gaps: G.
        slips: J, a row for each component; None without friction.
        numbers: Of the unknowns λ of this rank among all, shape (λ,), and of τ.
        num_local: Unknowns of this rank.
        moving: How λ_h moves where gaps follow the bodies; None if it does not. What R_λ and forces
            depend on has that, too; what forces work on has not.
    """

    def __init__(
        self,
        rows: CondensedRows,
        friction: PointFriction | None,
        gaps: Sided,
        slips: Sided | None,
        numbers: tuple[Indices, Indices],
        num_local: int,
        moving: Moving | None = None,
    ) -> None:
        self._rows, self._comm, self._num = rows, rows.model.comm, num_local
        self._friction, self._width = friction, rows.gap.operator.width
        self._size: int = rows.gap.num_rows * self._width
        self._numbers, self._functions = numbers[0], typing.cast("PETSc.Mat | None", None)
        self._all: PETSc.Mat | None
        self._all_left: PETSc.Mat | None
        #: What stays: −a Nᵀ W/γ N, and the patterns of the products.
        self._own: Entries | None = None
        self._products: tuple[PETSc.Mat, ...] = ()
        of_nodes: list[Entries] = []
        self._part = 1.0
        if isinstance(rows, PointConstraints) and rows.has_multipliers:
            of_nodes.append(self._of_nodes(rows.free, numbers[0], rows.extension))
            self._part = rows.part
        functions = [e.scaled(self._part) for e in of_nodes]
        #: Of λ by how its functions move.
        self._mixed: list[Entries] = []
        in_rows: list[Entries] = []
        if moving is not None and isinstance(rows, PointConstraints):
            in_rows = [moving.rows]
            self._mixed = [self._of_moving(moving.mixed, rows, numbers[0])]
        of_slips = []
        if friction is not None:
            first = self._size
            self._size += first * friction.free.shape[2]
            of_slips = self._of_slips(friction, numbers[1], first)
        #: N E of λ and τ, and that without how functions move; None without multipliers.
        self._all = self._all_left = None
        if functions or of_slips:
            self._all = self._all_left = self._matrix([*of_nodes, *of_slips])
            if in_rows:
                self._all = self._matrix([*of_nodes, *of_slips, *in_rows])
        of_gaps = self._stacked(gaps, slips)
        elastic = 0.0 if friction is None else friction.elastic  # of a penalty τ has a compliance
        #: Bᵀ of what forces work on; None if that is B.
        self._left: PETSc.Mat | None = None
        if of_gaps[0] is not of_gaps[1] or in_rows or elastic:
            works_on = self._matrix([*of_gaps[0], *functions, *of_slips])
            self._left = works_on.transpose()  # in place
        of_functions = [e.scaled(self._part) for e in in_rows]
        of_slips = [e.scaled(1 - elastic) for e in of_slips]
        self._right = self._matrix([*of_gaps[1], *of_functions, *functions, *of_slips])

    def functions(self) -> PETSc.Mat:
        """Matrix a N E of λ, which stays this object's. Collective."""
        rows = self._rows
        assert isinstance(rows, PointConstraints)
        if self._functions is None:
            of_nodes = self._of_nodes(rows.free, self._numbers, rows.extension).scaled(self._part)
            num = rows.gap.num_rows * self._width
            self._functions = of_nodes.matrix(num, self._num, self._comm)
        return self._functions

    def _stacked(self, gaps: Sided, slips: Sided | None) -> Sided:
        """γ G, and γ_t J below it."""
        friction, rows = self._friction, self._rows
        same = gaps[0] is gaps[1] and (slips is None or slips[0] is slips[1])
        found, first = [], rows.gap.num_rows * self._width
        for i in range(1 if same else 2):
            found.append([e.scaled(rows.gamma) for e in gaps[i]])
            if slips is not None and friction is not None:
                found[i] += [e.scaled(friction.gamma).below(first) for e in slips[i]]
        return found[0], found[-1]

    def _matrix(self, parts: list[Entries]) -> PETSc.Mat:
        """Of all rows by all unknowns."""
        return matrix_of(parts, self._size, self._num, self._comm)

    def _of_moving(self, mixed: Entries, rows: PointConstraints, numbers: Indices) -> Entries:
        """Of R_λ by the bodies' unknowns, as functions of the sides of nodes move. Collective."""
        extended = self._extended(rows.free, numbers, rows.extension)
        of_sides = PETSc.Mat().create(comm=self._comm)
        sizes = (_layout(rows.gap.slave)[0], PETSc.DETERMINE), (self._num, PETSc.DETERMINE)
        of_sides.setSizes(sizes)
        of_sides.setType(PETSc.Mat.Type.AIJ)
        some = mixed.column >= 0
        # Some are of rows of other ranks.
        _cpp.set_places(of_sides.handle, mixed.row[some], mixed.column[some])
        _cpp.set_values(of_sides.handle, mixed.value[some])
        product = extended.transposeMatMult(of_sides)
        out = global_entries(product)
        for mat in (extended, of_sides, product):
            mat.destroy()
        return out

    def _of_slips(self, friction: PointFriction, numbers: Indices, first: int) -> list[Entries]:
        """N E of τ, a component after the other, at rows from a number on."""
        if not friction.extensions:
            return []
        found, gdim = [], friction.free.shape[2]
        of_free = np.zeros(friction.free.shape, dtype=np.int64)
        of_free[friction.free] = numbers
        for k, extension in enumerate(friction.extensions):
            free = friction.free[:, :, k]
            part = self._of_nodes(free, of_free[:, :, k][free], extension)
            found.append(part._replace(row=first + gdim * part.row + k))
        return found

    def _of_nodes(self, free: Flags, numbers: Indices, extension: Extension | None) -> Entries:
        """N E by the unknowns of these sides of nodes, in rows of this rank."""
        sides, mat = self._of_sides(), self._extended(free, numbers, extension)
        out = sides.matMult(mat)
        found = local_entries(out)
        for thing in (sides, mat, out):
            thing.destroy()
        return found

    def _extended(self, free: Flags, numbers: Indices, extension: Extension | None) -> PETSc.Mat:
        """E: sides of nodes by the unknowns of these, a new matrix. Collective."""
        slave = self._rows.gap.slave
        num_sides, first = _layout(slave)
        dofs = slave.node_dofs[free] - first
        mat = Entries(dofs, numbers, np.ones(len(dofs))).matrix(num_sides, self._num, self._comm)
        if extension is not None:
            at = slave.node_dofs
            row, column, value = extension.entries(at, np.ones(at.shape))
            means = PETSc.Mat().create(comm=self._comm)
            means.setSizes(((num_sides, PETSc.DETERMINE),) * 2)
            means.setType(PETSc.Mat.Type.AIJ)
            _cpp.set_places(means.handle, row, column)  # some are of rows of other ranks
            _cpp.set_values(means.handle, value)
            first_means = means.matMult(mat)
            second = means.matMult(first_means)
            for part in (first_means, second):
                mat.axpy(1.0, part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                part.destroy()
            means.destroy()
        return mat

    def _of_sides(self) -> PETSc.Mat:
        """N by the unknowns of the slave that stand for sides of nodes."""
        rows = self._rows
        offset, unknowns, values = rows.gap.operator.functions
        num_sides = _layout(rows.gap.slave)[0]
        row = np.repeat(np.arange(rows.gap.num_rows, dtype=np.int64), np.diff(offset))
        return Entries(row, unknowns, values).matrix(rows.gap.num_rows, num_sides, self._comm)

    def derivative(self, at: Normal, tangential: Tangential | None) -> Entries:
        """Of the forces, and of R_λ and R_τ, of this rank's rows of all. Collective.

        Args:
            at: The rows.
            tangential: Friction at these points; None without.
        """
        rows, friction = self._rows, self._friction
        weight = rows.gap.weight[:, None] / rows.gamma
        own = (weight / rows.gamma * rows.stiffness(at)).ravel()
        if friction is None or tangential is None:
            weights = _diagonal(self._right, own)
        else:
            weights = self._with_friction(friction, at, tangential, own)
        found = [self._product(weights)]
        weights.destroy()
        if self._own is None and self._all is not None:
            self._own = self._of_multipliers(self._all)
            self._forget_functions()
        if self._own is not None:
            found.append(self._own)
        return joined([*found, *self._mixed])

    def _forget_functions(self) -> None:
        """Free N, which is of points: its product stays. Collective."""
        for mat in {id(m): m for m in (self._all, self._all_left) if m is not None}.values():
            mat.destroy()
        self._all = self._all_left = None

    def _of_multipliers(self, functions: PETSc.Mat) -> Entries:
        """−a Nᵀ W/γ N, which stays. Collective."""
        rows, friction = self._rows, self._friction
        weight = rows.gap.weight[:, None] / rows.gamma
        values = np.repeat(-self._part * weight, self._width)
        if friction is not None:
            gdim = friction.free.shape[2]
            of_slips = np.repeat(-rows.gap.weight / friction.gamma, gdim)
            values = np.concatenate([values, of_slips])
        weights = _diagonal(functions, values)
        scaled = weights.matMult(functions)
        assert self._all_left is not None
        product = self._all_left.transposeMatMult(scaled)
        out = global_entries(product)
        for mat in (weights, scaled, product):
            mat.destroy()
        return out

    def _product(self, weights: PETSc.Mat) -> Entries:
        """Bᵀ D B*; patterns stay. Collective."""
        if self._left is None:
            if self._products:
                weights.ptap(self._right, self._products[0])
            else:
                self._products = (weights.ptap(self._right),)
        elif self._products:
            scaled, product = self._products
            weights.matMult(self._right, scaled)
            self._left.matMult(scaled, product)
        else:
            scaled = weights.matMult(self._right)
            self._products = scaled, self._left.matMult(scaled)
        return global_entries(self._products[-1])

    def _with_friction(
        self, friction: PointFriction, at: Normal, tangential: Tangential, own: Array
    ) -> PETSc.Mat:
        """W D, D with the blocks of points, as a new matrix. Collective."""
        num, gdim = len(own), friction.free.shape[2]
        weight, gamma = self._rows.gap.weight, friction.gamma
        blocks = (weight / gamma**2)[:, None, None] * friction.by_slip(tangential)
        slope = np.where(at.pressure[:, 0] > 0, self._rows.stiffness(at)[:, 0], 0.0)
        change = (weight * slope / (self._rows.gamma * gamma))[:, None]
        coupling = change * friction.by_pressure(tangential)
        normal = np.arange(num, dtype=np.int64)
        rows = num + np.arange(num * gdim, dtype=np.int64).reshape(num, gdim)
        first = self._right.getOwnershipRange()[0]
        parts = [
            Entries(normal, first + normal, own),
            Entries(rows.ravel(), first + np.repeat(normal, gdim), coupling.ravel()),
            Entries(
                np.repeat(rows[:, :, None], gdim, axis=2).ravel(),
                first + np.repeat(rows[:, None, :], gdim, axis=1).ravel(),
                blocks.ravel(),
            ),
        ]
        return joined(parts).matrix(self._size, self._size, self._comm)

    def pressures(self, at: Normal) -> Entries:
        """Derivatives of the pressures of rows of nodes, which friction knows there."""
        slope = self._rows.stiffness(at)[:, 0] / self._rows.gamma
        return self._times(np.where(at.pressure[:, 0] > 0, slope, 0.0))

    def trials(self) -> Entries:
        """The same of y_n."""
        return self._times(self._rows.by_trial())

    def _times(self, factor: Array) -> Entries:
        """B times a factor of each row, numbers in rows being those of this rank."""
        found = local_entries(self._right)
        return found._replace(value=factor[found.row] * found.value)

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self._forget_functions()
        for mat in (self._left, self._right, self._functions, *self._products):
            if mat is not None:
                mat.destroy()


def _layout(slave: Surface) -> tuple[int, int]:
    """Unknowns of the slave's body on this rank, and the first of them."""
    vec = slave.create_vec()
    out = vec.getLocalSize(), vec.owner_range[0]
    vec.destroy()
    return out


def _diagonal(like: PETSc.Mat, values: Array) -> PETSc.Mat:
    """New diagonal matrix of the rows of another. Collective."""
    vec = like.createVecLeft()
    vec.array[:] = values
    size = like.getSizes()[0]
    csr = np.arange(len(values) + 1, dtype=np.int32), np.arange(*vec.owner_range, dtype=np.int32)
    out = PETSc.Mat().createAIJ((size, size), csr=(*csr, values), comm=like.comm)
    vec.destroy()
    return out
