"""Tangent terms of conductances that depend on the state of contact. Collective."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import BlocksOf, ContactModel, Mechanics
from qsdolfinx.gap.laws import Conductance
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]

#: Step of the finite differences of h, relative to the largest value of the changed argument. Near
#: the root of the rounding error, both rounding and curvature change the derivative least.
STEP = 1e-7


class ConductanceCoupling:
    """Parts of ∂q/∂T, ∂q/∂u by derivatives of h, for fluxes q = h(p, g, T_s, T_m) ⟦T⟧ at points.

    The points are those of one contact detection. With J the jump of the field at the points, N the
    functions of multipliers there, and G the gaps of the bodies, the tangent gets Jᵀ W ⟦T⟧ (∂h/∂p N
    λ' G − ∂h/∂g G_p + ∂h/∂T_s J_s − ∂h/∂T_m J_m). Derivatives by u exist if the field is in the
    same mixed unknown as the displacement of the bodies.

    Args:
        model: The contact of the field, after contact detection.
    """

    def __init__(self, model: ContactModel) -> None:
        assert isinstance(model.law, Conductance) and model.mechanics is not None
        self._model, self._law, self._mechanics = model, model.law, model.mechanics
        gap, of = model.gaps[0], self._mechanics.of
        self._surfaces = model.bodies
        self._jump = [_matrix(gap.operator, i, s) for i, s in enumerate(self._surfaces)]
        self._gaps: list[PETSc.Mat] = []
        self._at_points: list[PETSc.Mat] = []
        self._functions: PETSc.Mat | None = None
        if model.with_bodies and self._mechanics.shares_pairs:
            bodies = of.bodies
            of_gap = of.gaps[0]
            self._gaps = [_matrix(of_gap.operator, i, s) for i, s in enumerate(bodies)]
            at_points = self._mechanics.at_points.operator
            self._at_points = [_matrix(at_points, i, s) for i, s in enumerate(bodies)]
            if not of_gap.rows.are_points:
                self._functions = _functions(self._mechanics, of_gap.operator)

    def destroy(self) -> None:
        """Free the matrices, which petsc4py would keep in parallel. Collective."""
        for matrix in (*self._jump, *self._gaps, *self._at_points, self._functions):
            if matrix is not None:
                matrix.destroy()

    def add_to(self, blocks: BlocksOf, pattern: bool) -> None:
        """Add to the blocks; for a pattern, add zeros wherever entries are possible."""
        model = self._model
        count = model.gaps[0].num_rows
        changes = [np.ones(count)] * 4 if pattern else self._changes()
        for b, columns in enumerate(self._columns(changes, pattern)):
            for a, rows in enumerate(self._jump):
                product = rows.transposeMatMult(columns)
                _insert(product, blocks[2 * a + b], self._surfaces[a], pattern)
                product.destroy()
            columns.destroy()

    @property
    def of_bodies(self) -> ContactModel | None:
        """The bodies' contact if its multipliers are unknowns together with those of the field."""
        of = self._mechanics.of
        known = of.augmented or of.has_multipliers_at_points
        return of if self._gaps and known else None

    def by_multipliers(self) -> list[PETSc.Mat]:
        """New derivatives of each side's flow by the bodies' multipliers λ̂. Collective."""
        of, out = self._mechanics.of, []
        gap, slope = of.gaps[0], active_set.slope(of, of.gaps[0])
        pressed = slope / (of.eps * gap.relative_penalty)
        change = self._changes()[0]
        for jump in self._jump:
            scaled = _scaled(jump, change if self._functions is not None else change * pressed)
            product = scaled.transpose(PETSc.Mat())
            if self._functions is not None:
                right = self._functions.createVecRight()
                right.array[:] = pressed
                functions = self._functions.copy()
                functions.diagonalScale(R=right)
                whole = product.matMult(functions)
                for thing in (product, functions, right):
                    thing.destroy()
                product = whole
            out.append(product)
            scaled.destroy()
        return out

    def _changes(self) -> list[Array]:
        """W ⟦T⟧ ∂h for the four arguments of h, at the points."""
        model, law, gap = self._model, self._law, self._model.gaps[0]
        state = list(model.conduction_state)
        factor = gap.weight * gap.state.values[:, 0]
        before, out = law.values(gap.num_rows, state), list[Array]()
        for i, values in enumerate(state):
            step = STEP * max(float(np.max(np.abs(values), initial=0.0)), 1e-300)
            moved = [v + step if j == i else v for j, v in enumerate(state)]
            out.append(np.asarray(factor * (law.values(gap.num_rows, moved) - before) / step))
        return out + [np.zeros(gap.num_rows)] * (4 - len(out))

    def _columns(
        self, changes: typing.Sequence[Array], pattern: bool
    ) -> typing.Iterator[PETSc.Mat]:
        """Derivatives of the points' fluxes by the unknowns of each side."""
        of = self._mechanics.of
        of_p, of_g, of_own, of_other = changes
        num_rows = of.gaps[0].num_rows
        for i, jump in enumerate(self._jump):
            out = _scaled(jump, of_own if i == 0 else -of_other)
            if self._gaps:
                slope = np.ones(num_rows) if pattern else active_set.slope(of, of.gaps[0])
                pressed = _scaled(self._gaps[i], slope)
                if self._functions is not None:
                    of_rows, pressed = pressed, self._functions.matMult(pressed)
                    of_rows.destroy()
                opened = np.ones(len(of_g)) if pattern else self._mechanics.distance() > 0
                for part, weight in ((pressed, of_p), (self._at_points[i], -of_g * opened)):
                    scaled = _scaled(part, weight)
                    different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
                    out.axpy(1.0, scaled, structure=different)
                    scaled.destroy()
                pressed.destroy()
            yield out


def _matrix(operator: _cpp.GapOperator, side: int, surface: Surface) -> PETSc.Mat:
    """Matrix of one side of a scalar operator, without constrained unknowns. Collective."""
    offset, column, coefficients = operator.entries(side)
    unknowns = operator.columns(side)[column]
    kept = unknowns >= 0
    ends = np.concatenate([[0], np.cumsum(np.count_nonzero(kept, axis=1))])[offset]
    vec = surface.create_vec()
    sizes = (operator.num_rows, None), vec.getSizes()
    vec.destroy()
    csr = ends.astype(PETSc.IntType), unknowns[kept].astype(PETSc.IntType), coefficients[kept]
    out: PETSc.Mat = PETSc.Mat().createAIJ(sizes, csr=csr, comm=surface.comm)
    out.assemble()
    return out


def _functions(mechanics: Mechanics, operator: _cpp.GapOperator) -> PETSc.Mat:
    """N_k at the points, with a column for each constraint of the bodies. Collective."""
    comm, points = mechanics.of.comm, mechanics.of.gaps[0].points
    N, count = np.asarray(points.multiplier_values), operator.num_rows
    first = comm.exscan(count) or 0
    of_rows = mechanics.rows_at_points(np.arange(first, first + count, dtype=np.float64) + 1)
    kept = of_rows > 0
    ends = np.concatenate([[0], np.cumsum(np.count_nonzero(kept, axis=1))])
    columns = (of_rows[kept] - 1).astype(PETSc.IntType)
    sizes = (len(N), None), (count, None)
    csr = ends.astype(PETSc.IntType), columns, np.ascontiguousarray(N[kept])
    out: PETSc.Mat = PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
    out.assemble()
    return out


def _scaled(matrix: PETSc.Mat, factor: Array) -> PETSc.Mat:
    """New matrix with rows multiplied by factors. Collective."""
    out, left = matrix.copy(), matrix.createVecLeft()
    left.array[:] = factor
    out.diagonalScale(L=left)
    left.destroy()
    return out


def _insert(product: PETSc.Mat, block: PETSc.Mat | None, surface: Surface, pattern: bool) -> None:
    """Add the rows of a surface's unknowns to a block, without assembling it."""
    assert block is not None
    first = product.getOwnershipRange()[0]
    for row in surface.own_trace + first:
        columns, values = product.getRow(int(row))
        if len(columns):
            values = np.zeros_like(values) if pattern else values
            block.setValues([int(row)], columns, values, addv=PETSc.InsertMode.ADD_VALUES)
