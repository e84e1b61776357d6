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
)
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import Tangential
from qsdolfinx.system.normal_rows import Normal

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class Gaps(typing.NamedTuple):
    """Gaps, slips, or other numbers at the rows, by all unknowns of the equations.

    Attributes:
        operator: Them by the unknowns of the bodies.
        numbers: Of each side's unknowns among all, (columns, block).
        scales: Displacement per unknown of each side.
        of_tool: By the displacement of a driven tool; None without.
        beside: What else they change by, with scales; None for nothing.
    """

    operator: _cpp.GapOperator
    numbers: tuple[Indices, ...]
    scales: tuple[float, ...]
    of_tool: _cpp.CompressedRows | None
    beside: _cpp.CompressedRows | None = None

    @property
    def are_scaled(self) -> bool:
        """Whether unknowns of a body are other than displacements."""
        return any(scale != 1 for scale in self.scales)

    def add_to(
        self, rows: _cpp.StackedRows, factor: float, scaled: bool = True, first: int = 0
    ) -> None:
        """Add them times a factor, in components from the first on.

        Args:
            rows: What takes them.
            factor: The factor.
            scaled: Whether by the unknowns, or by displacements.
            first: The first component.
        """
        for i, (numbers, scale) in enumerate(zip(self.numbers, self.scales, strict=True)):
            by = factor * scale if scaled else factor
            rows.add_gaps(self.operator, i, numbers, by, first)
        if self.of_tool is not None:
            rows.add_rows(self.of_tool, factor, first, self.operator.width)
        if self.beside is not None:
            rows.add_rows(self.beside, factor, first, self.operator.width)


class Moving(typing.NamedTuple):
    """How λ_h, or a component of τ_h, moves along facets, in numbers of all unknowns.

    Attributes:
        rows: Its derivative at the rows.
        mixed: Σ_p w_p a (p_p − λ_h)/γ ∂N_k, or the same of τ; rows are unknowns of the slave that
            stand for the sides of nodes.
    """

    rows: Gaps
    mixed: Entries


class GapMatrices:
    """B = γ G + a N, rows being those of the gaps, columns all unknowns of the equations.

    B z is y but for a constant at points, and the gap itself of a law without multipliers. Of the
    potential Σ_p w_p/(2γ) ([y_p]₊² − a λ_h²) the second derivative is Bᵀ W/γ χ B − a Nᵀ W/γ N, χ
    being 1 at closed points; of Σ_k S_k φ(ḡ_k) it is Gᵀ S φ'' G. Of friction at points there
    are three more rows, B_t = γ_t J + N_t, of each, and the derivative is Bᵀ W D B* − Nᵀ W/γ N, D
    having a block for each point, and B* having (1 − γ_t/ε_t) N_t with a penalty. B is not formed:
    products of points are dense blocks. Collective.

    Args:
        rows: The rows.
        friction: Friction at these points; None without.
        gaps: G that forces are of, and that of what gaps change by.
        slips: What friction works on, and J, a row for each component; None without friction.
        numbers: Of the unknowns λ of this rank among all, shape (λ,), and of τ.
        num_local: Unknowns of this rank.
        moving: How λ_h, then the components of τ_h move where gaps follow the bodies, with the
            number of the component; none if they do not. What R_λ, R_τ and forces depend on has
            that, too; what forces work on has not.
    """

    def __init__(
        self,
        rows: CondensedRows,
        friction: PointFriction | None,
        gaps: tuple[Gaps, Gaps],
        slips: tuple[Gaps, Gaps] | None,
        numbers: tuple[Indices, Indices],
        num_local: int,
        moving: typing.Sequence[tuple[int, Moving]] = (),
    ) -> None:
        self._rows, self._comm, self._num = rows, rows.model.comm, num_local
        self._friction, self._width = friction, rows.gap.operator.width
        self._numbers, self._functions = numbers[0], typing.cast("PETSc.Mat | None", None)
        self._part = 1.0
        of_nodes: list[tuple[int, _cpp.CompressedRows]] = []  # and the component
        if isinstance(rows, PointConstraints) and rows.has_multipliers:
            of_nodes.append((0, self._of_nodes(rows.free, numbers[0], rows.extension)))
            self._part = rows.part
        #: Of λ and τ by how their functions move.
        self.mixed: list[Entries] = [self._of_moving(of, k, numbers) for k, of in moving]
        in_rows = [(k, of.rows) for k, of in moving]
        of_slips = [] if friction is None else self._of_slips(friction, numbers[1])
        elastic = 0.0 if friction is None else friction.elastic  # of a penalty τ has a compliance
        #: Whether there are multipliers at points.
        self._has = bool(of_nodes or of_slips)
        #: Rows of a point: B, then those of N E if there are multipliers.
        self._right = self._stacked(gaps[1], slips, (of_nodes, of_slips), in_rows, 1 - elastic)
        #: The same of what forces work on, and functions stay; the same object if all is.
        self._left = self._right
        differ = gaps[0] is not gaps[1] or (slips is not None and slips[0] is not slips[1])
        scaled = gaps[0].are_scaled or (slips is not None and slips[1].are_scaled)
        if differ or scaled or in_rows or elastic:
            of_forces = None if slips is None else (slips[0], slips[0])
            self._left = self._stacked(gaps[0], of_forces, (of_nodes, of_slips), [], 1.0, False)

    def functions(self) -> PETSc.Mat:
        """Matrix a N E of λ, which stays this object's. Collective."""
        rows = self._rows
        assert isinstance(rows, PointConstraints)
        if self._functions is None:
            self._functions = self._times_sides(rows.free, self._numbers, rows.extension)
            self._functions.scale(self._part)
        return self._functions

    @property
    def _num_of_b(self) -> int:
        """Rows of a point in B, 1 + gdim with friction."""
        return self._width if self._friction is None else 1 + int(self._friction.free.shape[2])

    def _stacked(
        self,
        gaps: Gaps,
        slips: tuple[Gaps, Gaps] | None,
        functions: tuple[list[tuple[int, _cpp.CompressedRows]], ...],
        moving: list[tuple[int, Gaps]],
        of_slips: float,
        scaled: bool = True,
    ) -> _cpp.StackedRows:
        """B, N_t times a factor, and N E where there are multipliers."""
        num, friction = self._num_of_b, self._friction
        out = _cpp.StackedRows(self._rows.gap.num_rows, (1 + self._has) * num)
        gaps.add_to(out, self._rows.gamma, scaled)
        if slips is not None and friction is not None:
            slips[1].add_to(out, friction.gamma, scaled, 1)
        for parts, factor in zip(functions, (self._part, of_slips), strict=True):
            for component, part in parts:
                out.add_rows(part, factor, component, 1)
                out.add_rows(part, 1.0, num + component, 1)
        for component, of in moving:
            of.add_to(out, of_slips if component else self._part, first=component)
            if self._has:
                of.add_to(out, 1.0, first=num + component)
        return out

    def _of_moving(
        self, moving: Moving, component: int, numbers: tuple[Indices, Indices]
    ) -> Entries:
        """Of R_λ or R_τ by the bodies' unknowns, as functions of the nodes move. Collective."""
        rows, friction, mixed = self._rows, self._friction, moving.mixed
        if component == 0:
            assert isinstance(rows, PointConstraints)
            extended = self._extended(rows.free, numbers[0], rows.extension)
        else:
            assert friction is not None
            free, own = self._of_component(friction, component - 1, numbers[1])
            extended = self._extended(free, own, friction.extensions[component - 1])
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

    def _of_slips(
        self, friction: PointFriction, numbers: Indices
    ) -> list[tuple[int, _cpp.CompressedRows]]:
        """N E of each component of τ. Collective."""
        if not friction.extensions:
            return []
        found = []
        for k, extension in enumerate(friction.extensions):
            free, own = self._of_component(friction, k, numbers)
            found.append((1 + k, self._of_nodes(free, own, extension)))
        return found

    @staticmethod
    def _of_component(friction: PointFriction, k: int, numbers: Indices) -> tuple[Flags, Indices]:
        """Sides of nodes that have a component of τ for an unknown, and the numbers of these."""
        of_free = np.zeros(friction.free.shape, dtype=np.int64)
        of_free[friction.free] = numbers
        free = friction.free[:, :, k]
        return free, of_free[:, :, k][free]

    def _of_nodes(
        self, free: Flags, numbers: Indices, extension: Extension | None
    ) -> _cpp.CompressedRows:
        """N E by the unknowns of these sides of nodes. Collective."""
        mat = self._times_sides(free, numbers, extension)
        starts, columns, values = mat.getValuesCSR()
        mat.destroy()
        return _cpp.CompressedRows(
            starts.astype(np.int64), columns.astype(np.int64), np.ascontiguousarray(values)
        )

    def _times_sides(self, free: Flags, numbers: Indices, extension: Extension | None) -> PETSc.Mat:
        """The same as a new matrix. Collective."""
        sides, mat = self._of_sides(), self._extended(free, numbers, extension)
        out = sides.matMult(mat)
        for thing in (sides, mat):
            thing.destroy()
        return out

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

    def add_to(self, sums: _cpp.RowSums, at: Normal, tangential: Tangential | None) -> None:
        """Add the derivative of the forces, and of R_λ and R_τ, but for :attr:`mixed`.

        Args:
            sums: What is added to the matrix by all unknowns of the equations.
            at: The rows.
            tangential: Friction at these points; None without.
        """
        rows, friction = self._rows, self._friction
        num, weight = self._num_of_b, rows.gap.weight[:, None]
        D = weight / rows.gamma**2 * rows.stiffness(at)
        if friction is None or tangential is None:
            D = np.broadcast_to(D, (len(weight), num))
        else:
            D = self._with_friction(friction, at, tangential, D[:, 0])
        if self._has:
            own = np.repeat(-self._part / rows.gamma * weight, num, axis=1)
            if friction is not None:
                own[:, 1:] = -weight / friction.gamma
            D = _beside(D, own)
        _cpp.add_products(sums, self._left, self._right, np.ascontiguousarray(D))

    def _with_friction(
        self, friction: PointFriction, at: Normal, tangential: Tangential, own: Array
    ) -> Array:
        """W D, (points, 1 + gdim, 1 + gdim), with these entries for gaps by gaps."""
        gdim, weight, gamma = friction.free.shape[2], self._rows.gap.weight, friction.gamma
        out = np.zeros((len(own), 1 + gdim, 1 + gdim))
        out[:, 0, 0] = own
        slope = np.where(at.pressure[:, 0] > 0, self._rows.stiffness(at)[:, 0], 0.0)
        change = (weight * slope / (self._rows.gamma * gamma))[:, None]
        out[:, 1:, 0] = change * friction.by_pressure(tangential)
        out[:, 1:, 1:] = (weight / gamma**2)[:, None, None] * friction.by_slip(tangential)
        return out

    def pressures(self, at: Normal) -> Entries:
        """Derivatives of the pressures of rows of nodes, which friction knows there."""
        slope = self._rows.stiffness(at)[:, 0] / self._rows.gamma
        return self._times(np.where(at.pressure[:, 0] > 0, slope, 0.0))

    def trials(self) -> Entries:
        """The same of y_n."""
        return self._times(self._rows.by_trial())

    def _times(self, factor: Array) -> Entries:
        """B times a factor of each row, numbers in rows being those of this rank."""
        row, column, value = self._right.entries()
        row, component = np.divmod(row, self._right.components)
        keep = component < self._num_of_b
        row = row[keep] * self._num_of_b + component[keep]
        return Entries(row, column[keep], factor[row] * value[keep])

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        if self._functions is not None:
            self._functions.destroy()


def _beside(D: Array, own: Array) -> Array:
    """Numbers of rows, or matrices of points, with those of as many rows more beside them."""
    if D.ndim == 2:
        return np.hstack([D, own])
    num = own.shape[1]
    out = np.zeros((len(D), 2 * num, 2 * num))
    out[:, :num, :num] = D
    k = np.arange(num)
    out[:, num + k, num + k] = own
    return out


def _layout(slave: Surface) -> tuple[int, int]:
    """Unknowns of the slave's body on this rank, and the first of them."""
    vec = slave.create_vec()
    out = vec.getLocalSize(), vec.owner_range[0]
    vec.destroy()
    return out
