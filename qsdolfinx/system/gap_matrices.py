"""Derivatives of forces that follow from gaps, by all unknowns of the equations."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.following import Destination, PointState
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.entries import (
    Entries,
    global_entries,
)
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import Tangential
from qsdolfinx.system.multiplier_functions import extended, layout, of_sides
from qsdolfinx.system.normal_rows import Normal

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class Gaps(typing.NamedTuple):
    """Gaps, slips or other values of constraints as functions of all unknowns.

    Attributes:
        operator: Operator from the unknowns of the bodies to these values.
        numbers: Numbers of each side's unknowns among all unknowns, (columns, block).
        scales: Displacement per unknown of each side.
        of_tool: Derivative by the displacement of a force-controlled tool; None without.
        beside: Further derivatives of these values, with scales; None if there are none.
    """

    operator: _cpp.GapOperator
    numbers: tuple[Indices, ...]
    scales: tuple[float, ...]
    of_tool: _cpp.CompressedRows | None
    beside: _cpp.CompressedRows | None = None

    @property
    def are_scaled(self) -> bool:
        """Whether the unknowns of a body are not displacements."""
        return any(scale != 1 for scale in self.scales)

    def add_to(
        self, rows: _cpp.StackedRows, factor: float, scaled: bool = True, first: int = 0
    ) -> None:
        """Add the values times a factor, in components starting at ``first``.

        Args:
            rows: The rows to which they are added.
            factor: The factor.
            scaled: Whether as functions of the unknowns, or else of displacements.
            first: The first component.
        """
        for i, (numbers, scale) in enumerate(zip(self.numbers, self.scales, strict=True)):
            by = factor * scale if scaled else factor
            rows.add_gaps(self.operator, i, numbers, by, first)
        if self.of_tool is not None:
            rows.add_rows(self.of_tool, factor, first, self.operator.width)
        if self.beside is not None:
            rows.add_rows(self.beside, factor, first, self.operator.width)


class GapMatrices:
    """B = γ G + a N, with a row for each constraint, and columns for all unknowns.

    At points, B z is y except for a constant; for a law without multipliers it is the gap itself.
    The second derivative of the potential Σ_p w_p/(2γ) ([y_p]₊² − a λ_h²) is Bᵀ W/γ χ B − a Nᵀ W/γ
    N, where χ is 1 at active points. That of Σ_k S_k φ(ḡ_k) is Gᵀ S φ'' G. With friction, each
    point has three more rows, B_t = γ_t J + N_t, and the derivative is Bᵀ W D B* − Nᵀ W/γ N. D has
    a block for each point, and B* has (1 − γ_t/ε_t) N_t with a penalty. B is not assembled:
    products of points are dense blocks. Collective.

    Args:
        rows: The constraints.
        friction: Friction at these points; None without.
        gaps: G; None for points of segments, which move on the facets.
        slips: The operator for the work of friction, and J, with a row for each component; None
            without friction or at points of segments.
        numbers: Numbers of this rank's unknowns λ among all unknowns, shape (λ,), and of τ.
        num_local: Number of unknowns of this rank.
        mixed: Derivatives of R_λ and R_τ as areas and tangent planes change with the facets, each
            with the number of the component. Rows are unknowns of the slave that represent smooth
            patches of nodes, or constraints at vertices of a tool.
    """

    def __init__(
        self,
        rows: CondensedRows,
        friction: PointFriction | None,
        gaps: Gaps | None,
        slips: tuple[Gaps, Gaps] | None,
        numbers: tuple[Indices, Indices],
        num_local: int,
        mixed: typing.Sequence[tuple[int, Entries]] = (),
    ) -> None:
        self._rows, self._comm, self._num = rows, rows.model.comm, num_local
        self._friction, self._width = friction, rows.gap.operator.width
        self._numbers, self._functions = numbers, typing.cast("PETSc.Mat | None", None)
        has_normal = isinstance(rows, PointConstraints) and rows.has_multipliers
        self._part = rows.part if has_normal else 1.0
        #: Factor of N in the slips of the trials: τ has a compliance by a penalty.
        self._of_slips = 1.0 if friction is None else 1 - friction.elastic
        #: Whether there are multipliers at points.
        self._has = has_normal or (friction is not None and bool(friction.extensions))
        #: Derivatives of R_λ and R_τ at constant r_p.
        self.mixed: list[Entries] = [self._of_mixed(of, k, numbers) for k, of in mixed]
        if gaps is None:
            return
        of_nodes = [(c, self._of_nodes(*found)) for c, found in self._functions_of_components()]
        #: Rows of a point: those of B, then those of N E if there are multipliers.
        self._right = self._stacked(gaps, slips and slips[1], of_nodes, self._of_slips)
        #: These rows for the work of forces, with constant functions; the same object if all are
        #: equal.
        self._left = self._right
        differ = slips is not None and slips[0] is not slips[1]
        scaled = gaps.are_scaled or (slips is not None and slips[1].are_scaled)
        if differ or scaled or self._of_slips != 1:
            self._left = self._stacked(gaps, slips and slips[0], of_nodes, 1.0, False)

    def _functions_of_components(
        self,
    ) -> list[tuple[int, tuple[Flags, Indices, Extension | None]]]:
        """Components with multipliers: patches of nodes, numbers of the unknowns, and E."""
        rows, friction = self._rows, self._friction
        found: list[tuple[int, tuple[Flags, Indices, Extension | None]]] = []
        if isinstance(rows, PointConstraints) and rows.has_multipliers:
            found.append((0, (rows.free, self._numbers[0], rows.extension)))
        for k, extension in enumerate([] if friction is None else friction.extensions):
            assert friction is not None
            found.append((1 + k, (*friction.of_component(k, self._numbers[1]), extension)))
        return found

    def functions(self) -> PETSc.Mat:
        """Matrix a N E of λ, owned by this object. Collective."""
        rows = self._rows
        assert isinstance(rows, PointConstraints)
        if self._functions is None:
            self._functions = self._times_sides(rows.free, self._numbers[0], rows.extension)
            self._functions.scale(self._part)
        return self._functions

    @property
    def _num_of_b(self) -> int:
        """Number of rows of a point in B, 1 + gdim with friction."""
        return self._width if self._friction is None else 1 + int(self._friction.free.shape[2])

    def _stacked(
        self,
        gaps: Gaps,
        slips: Gaps | None,
        functions: list[tuple[int, _cpp.CompressedRows]],
        of_slips: float,
        scaled: bool = True,
    ) -> _cpp.StackedRows:
        """Rows of B, with N_t times a factor, and of N E if there are multipliers."""
        num, friction = self._num_of_b, self._friction
        out = _cpp.StackedRows(self._rows.gap.num_rows, (1 + self._has) * num)
        gaps.add_to(out, self._rows.gamma, scaled)
        if slips is not None and friction is not None:
            slips.add_to(out, friction.gamma, scaled, 1)
        for component, part in functions:
            out.add_rows(part, of_slips if component else self._part, component, 1)
            out.add_rows(part, 1.0, num + component, 1)
        return out

    def _of_mixed(
        self, mixed: Entries, component: int, numbers: tuple[Indices, Indices]
    ) -> Entries:
        """Derivative of R_λ or R_τ at constant r_p. Collective."""
        rows, friction = self._rows, self._friction
        if component == 0:
            assert isinstance(rows, PointConstraints)
            mat = self._extended(rows.free, numbers[0], rows.extension)
        else:
            assert friction is not None
            free, own = friction.of_component(component - 1, numbers[1])
            mat = self._extended(free, own, friction.extensions[component - 1])
        on_sides = PETSc.Mat().create(comm=self._comm)
        sizes = (layout(rows.gap.slave)[0], PETSc.DETERMINE), (self._num, PETSc.DETERMINE)
        on_sides.setSizes(sizes)
        on_sides.setType(PETSc.Mat.Type.AIJ)
        on_sides.setUp()
        sums = _cpp.RowSums(on_sides.handle)
        sums.add_entries(*mixed)  # some are in rows of other ranks
        sums.insert()
        product = mat.transposeMatMult(on_sides)
        out = global_entries(product)
        for thing in (mat, on_sides, product):
            thing.destroy()
        return out

    def _of_nodes(
        self, free: Flags, numbers: Indices, extension: Extension | None
    ) -> _cpp.CompressedRows:
        """Rows N E on the unknowns of these patches of nodes. Collective."""
        mat = self._times_sides(free, numbers, extension)
        starts, columns, values = mat.getValuesCSR()
        mat.destroy()
        return _cpp.CompressedRows(
            starts.astype(np.int64), columns.astype(np.int64), np.ascontiguousarray(values)
        )

    def _times_sides(self, free: Flags, numbers: Indices, extension: Extension | None) -> PETSc.Mat:
        """N E as a new matrix. Collective."""
        place = None if self._rows.gap.own is None else self._rows.gap.own.place
        if place is not None:
            row, column = np.arange(len(place), dtype=np.int64), _number_of(free, numbers)[place]
            own = Entries(row, column, np.ones(len(place)))
            return own.matrix(len(place), self._num, self._comm)
        sides, mat = of_sides(self._rows.gap), self._extended(free, numbers, extension)
        out = sides.matMult(mat)
        for thing in (sides, mat):
            thing.destroy()
        return out

    def _extended(self, free: Flags, numbers: Indices, extension: Extension | None) -> PETSc.Mat:
        """New matrix E from free unknowns to all patches of nodes. Collective."""
        return extended(self._rows.gap.slave, free, numbers, self._num, extension)

    def add_to(self, sums: _cpp.RowSums, at: Normal, tangential: Tangential | None) -> None:
        """Add the derivative of the forces, and of R_λ and R_τ, without :attr:`mixed`.

        Args:
            sums: Accumulates terms of the matrix on all unknowns of the equations.
            at: The evaluated constraints.
            tangential: Friction at these points; None without.
        """
        D = self._by_trial(at, tangential)
        if self._has:
            D = _beside(D, self._by_own())
        _cpp.add_products(sums, self._left, self._right, np.ascontiguousarray(D))

    def add_at_segments(self, to: Destination, at: Normal, tangential: Tangential | None) -> None:
        """Add the same derivative at points of segments, with the curvature of gaps. Collective.

        Args:
            to: Destination.
            at: The evaluated constraints.
            tangential: Friction at these points; None without.
        """
        rows, friction, num = self._rows, self._friction, self._num_of_b
        assert isinstance(rows, PointConstraints)
        D = self._by_trial(at, tangential)
        D = D if D.ndim == 3 else D[:, :, None] * np.eye(num)
        fields: list[Array | None] = [None]
        rest, gamma = np.zeros((len(D), num)), np.full(num, rows.gamma)
        leaning, kept, slip, traction, turning = None, None, None, None, None
        if rows.has_multipliers:
            fields, rest[:, 0] = [rows.on_sides(at.multiplier)], rows.rest(at)
        if friction is not None and tangential is not None:
            gamma[1:], slip = friction.gamma, friction.slip.at_points
            fields += friction.fields(tangential)
            if friction.has_unknowns:
                rest[:, 1:] = friction.rest(tangential)
            leaning, traction = friction.leaning(tangential), tangential.traction
            kept = friction.kept()
            turning = friction.turning(tangential)
        in_work, part = (np.full(num, factor) for factor in (1.0, self._of_slips))
        in_work[0] = part[0] = self._part
        function_rows, functions = self._function_rows()
        state = PointState(
            (gamma, part, in_work),
            D,
            self._by_own() if self._has else np.zeros((0, num)),
            rows.constant_pressure(at),
            traction,
            rest,
            turning,
            leaning,
            kept,
            fields,
            slip,
            rows.moves,
            not rows.far,
            function_rows,
            functions,
        )
        rows.gap.add_point_forces(state, to)

    def _function_rows(self) -> tuple[Indices, list[_cpp.CompressedRows]]:
        """Rows of E for the functions of the segments, and for each component. Collective."""
        gap, found = self._rows.gap, dict(self._functions_of_components())
        assert gap.following is not None and gap.cut is not None
        sides: Indices = np.zeros(0, dtype=np.int64)
        if gap.own is not None:
            place = gap.own.place
        else:
            sides, place = np.unique(gap.following.function_sides(gap.cut), return_inverse=True)
        out = []
        for component in range(self._num_of_b):
            if component not in found:
                none = np.zeros(0, dtype=np.int64)
                every = np.zeros((len(sides) if gap.own is None else len(place)) + 1, np.int64)
                out.append(_cpp.CompressedRows(every, none, np.zeros(0)))
                continue
            free, numbers, extension = found[component]
            if gap.own is not None:
                of_vertices = _number_of(free, numbers)
                every = np.arange(len(of_vertices) + 1, dtype=np.int64)
                out.append(_cpp.CompressedRows(every, of_vertices, np.ones(len(of_vertices))))
                continue
            one = Entries(np.arange(len(sides), dtype=np.int64), sides, np.ones(len(sides)))
            chosen = one.matrix(len(sides), layout(gap.slave)[0], self._comm)
            out.append(self._rows_of(chosen, self._extended(free, numbers, extension)))
        return np.ascontiguousarray(place, dtype=np.int64), out

    @staticmethod
    def _rows_of(first: PETSc.Mat, second: PETSc.Mat) -> _cpp.CompressedRows:
        """Rows of the product of two matrices, which are destroyed. Collective."""
        product = first.matMult(second)
        starts, columns, values = product.getValuesCSR()
        for mat in (first, second, product):
            mat.destroy()
        return _cpp.CompressedRows(
            starts.astype(np.int64), columns.astype(np.int64), np.ascontiguousarray(values)
        )

    def _by_trial(self, at: Normal, tangential: Tangential | None) -> Array:
        """W D: numbers for the rows of points, (points, n), or matrices, (points, n, n)."""
        rows, friction, weight = self._rows, self._friction, self._rows.gap.weight[:, None]
        D = weight / rows.gamma**2 * rows.stiffness(at)
        if friction is None or tangential is None:
            return np.broadcast_to(D, (len(weight), self._num_of_b))
        return self._with_friction(friction, at, tangential, D[:, 0])

    def _by_own(self) -> Array:
        """Factors of products of N E, (points, components)."""
        weight, num = self._rows.gap.weight[:, None], self._num_of_b
        own = np.repeat(-self._part / self._rows.gamma * weight, num, axis=1)
        if self._friction is not None:
            own[:, 1:] = -weight / self._friction.gamma
        return own

    def _with_friction(
        self, friction: PointFriction, at: Normal, tangential: Tangential, own: Array
    ) -> Array:
        """Blocks W D, (points, 1 + gdim, 1 + gdim), with given entries for gaps by gaps."""
        gdim, weight, gamma = friction.free.shape[2], self._rows.gap.weight, friction.gamma
        out = np.zeros((len(own), 1 + gdim, 1 + gdim))
        out[:, 0, 0] = own
        slope = np.where(at.pressure[:, 0] > 0, self._rows.stiffness(at)[:, 0], 0.0)
        change = (weight * slope / (self._rows.gamma * gamma))[:, None]
        out[:, 1:, 0] = change * friction.by_pressure(tangential)
        out[:, 1:, 1:] = (weight / gamma**2)[:, None, None] * friction.by_slip(tangential)
        return out

    def pressures(self, at: Normal) -> Entries:
        """Derivatives of the pressures of nodal constraints, for friction at nodes."""
        slope = self._rows.stiffness(at)[:, 0] / self._rows.gamma
        return self._times(np.where(at.pressure[:, 0] > 0, slope, 0.0))

    def trials(self) -> Entries:
        """Derivatives of y_n, for friction at nodes."""
        return self._times(self._rows.by_trial())

    def _times(self, factor: Array) -> Entries:
        """B times a factor for each row; rows are numbered on this rank."""
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
    """Extend the factors of rows, or the matrices of points, by those of as many further rows."""
    if D.ndim == 2:
        return np.hstack([D, own])
    num = own.shape[1]
    out = np.zeros((len(D), 2 * num, 2 * num))
    out[:, :num, :num] = D
    k = np.arange(num)
    out[:, num + k, num + k] = own
    return out


def _number_of(free: Flags, numbers: Indices) -> Indices:
    """Numbers of the multipliers of a tool's vertices, −1 for those that are no unknowns."""
    out = np.full(free.size, -1, dtype=np.int64)
    out[free.ravel()] = numbers
    return out
