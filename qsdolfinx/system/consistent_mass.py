"""Consistent mass of multipliers at contact quadrature points, for preconditioners."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.condensed_rows import PointConstraints
from qsdolfinx.system.entries import Entries, local_entries, matrix_of
from qsdolfinx.system.multiplier_functions import extended, of_sides
from qsdolfinx.system.passes import Pass

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Factor b of :class:`ConsistentMass`. With 0 there are up to twice as many Krylov iterations; 3 to
#: 9 differ little. With a large one, condensation would add too much stiffness to the bodies.
LESS_LUMPED = 5.0


class _Function(typing.NamedTuple):
    """Multipliers of one component of an integration side."""

    gap: WeightedGap
    free: Flags
    numbers: Indices
    extension: Extension | None


class ConsistentMass:
    """Correction of lumped masses A towards M = Σ_p w_p N_p N_pᵀ, of the multipliers of a problem.

    Multipliers that alternate from node to node have down to 1/9 of the lumped mass (quadrilateral
    facets; triangles 1/4, edges 1/3), and so have the gaps that they close. A preconditioner with A
    would give them eigenvalues of 1/81, compared with 1 for smooth ones. With Â = A^(-1/2) M
    A^(-1/2) it has, instead of A⁻¹,

        A^(-1/2) (I + b (I − Â)) A^(-1/2),

    which is A⁻¹ for smooth multipliers. The stiffness that condensation adds to bodies is that of
    A⁻¹ times m² (1 + b (1 − m)), m being an eigenvalue of Â: at most 1.3 for b = 5. A rank has rows
    of its own multipliers only.

    Args:
        passes: The integration sides.
        starts: Number of the first multiplier of each, on this rank.
        count: Number of multipliers on this rank.
        comm: The communicator.
    """

    def __init__(
        self,
        passes: typing.Sequence[Pass],
        starts: Indices,
        count: int,
        comm: MPI.Intracomm,
    ) -> None:
        first = comm.exscan(count) or 0
        found = [
            f
            for p, start in zip(passes, starts, strict=True)
            for f in _functions(p, first + int(start))
        ]
        #: b (I − Â), with zero rows for other multipliers; None if there are no such multipliers.
        self._matrix: PETSc.Mat | None = None
        if not found:
            return
        mass = matrix_of([_mass(f, count) for f in found], count, count, comm)
        self._x, self._y = mass.createVecs()
        starts_, _, values = mass.getValuesCSR()
        sums = np.add.reduceat(np.append(np.abs(values), 0.0), starts_[:-1]) * (
            np.diff(starts_) > 0
        )
        some = sums > 0
        self._x.array[:] = np.divide(1.0, np.sqrt(sums), out=np.zeros(count), where=some)
        mass.diagonalScale(self._x, self._x)
        mass.scale(-LESS_LUMPED)
        diagonal = mass.getDiagonal()
        diagonal.array[some] += LESS_LUMPED
        mass.setDiagonal(diagonal)
        diagonal.destroy()
        self._matrix = mass

    def product(self, roots: Array, r: Array) -> Array:
        """A^(-1/2) b (I − Â) A^(-1/2) r. Collective.

        Args:
            roots: A^(-1/2), 0 for other multipliers, (multipliers,).
            r: This rank's part of a vector of all multipliers.
        """
        if self._matrix is None:
            return np.zeros_like(r)
        self._x.array[:] = roots * r
        self._matrix.mult(self._x, self._y)
        return np.asarray(roots * self._y.array_r)

    def scaled(self, left: Array, right: Array) -> PETSc.Mat | None:
        """New matrix b (I − Â) with factors for rows and columns; None if it is 0. Collective."""
        if self._matrix is None:
            return None
        out: PETSc.Mat = self._matrix.copy()
        self._y.array[:], self._x.array[:] = left, right
        out.diagonalScale(self._y, self._x)
        return out

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        if self._matrix is not None:
            for thing in (self._matrix, self._x, self._y):
                thing.destroy()


def _functions(p: Pass, first: int) -> list[_Function]:
    """Multipliers of an integration side that are functions at points.

    Args:
        p: The integration side.
        first: Number of its first multiplier on this rank, over all ranks.
    """
    rows, friction = p.rows.condensed, p.rows.condensed_friction
    found: list[_Function] = []
    if p.gap.own is not None:  # multipliers of a tool's vertices are no functions
        return found
    if isinstance(rows, PointConstraints) and rows.has_multipliers:
        numbers = first + np.arange(rows.num_multipliers, dtype=np.int64)
        found.append(_Function(rows.gap, rows.free, numbers, rows.extension))
    if friction is not None:
        start = first + p.rows.num_multipliers
        numbers = start + np.arange(friction.shape[0], dtype=np.int64)
        for k, extension in enumerate(friction.extensions):
            found.append(_Function(p.gap, *friction.of_component(k, numbers), extension))
    return found


def _mass(f: _Function, count: int) -> Entries:
    """M of one component. Collective."""
    functions, spread = (
        of_sides(f.gap),
        extended(f.gap.slave, f.free, f.numbers, count, f.extension),
    )
    values = functions.matMult(spread)
    weighted, areas = values.copy(), values.createVecLeft()
    areas.array[:] = f.gap.share * f.gap.operator.row_area
    weighted.diagonalScale(areas)
    mass = values.transposeMatMult(weighted)
    out = local_entries(mass)
    for thing in (functions, spread, values, weighted, areas, mass):
        thing.destroy()
    return out
