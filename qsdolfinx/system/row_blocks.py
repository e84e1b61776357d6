"""Blocks of the multiplier rows in the tangent, for each node or point."""

from __future__ import annotations

import hashlib
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.terms import Weights
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.condensed_rows import CondensedRows
from qsdolfinx.system.consistent_mass import ConsistentMass
from qsdolfinx.system.constraint_rows import Evaluated
from qsdolfinx.system.entries import Entries, joined
from qsdolfinx.system.equations import Equations
from qsdolfinx.system.friction_rows import FrictionRows, Tangential
from qsdolfinx.system.normal_rows import NodalRows, Normal
from qsdolfinx.system.passes import Pass, State

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class RowBlocks:
    """C_γ of the rows of all integration sides, see ``linear/saddle.py``, and their scaling.

    Rows are scaled to forces, those of closed gaps by the usual penalty, so that one tolerance is
    valid for all. C_γ is the derivative of rows by multipliers, with at least the compliance of the
    usual penalty in active constraints, and without the coupling of nodes constrained by
    conditions. At points, forces follow from gaps, and C_γ is lumped.

    On the edge of contact, |τ| is determined by the gap: C does not contain this. There, C_γ treats
    |τ| as for inactive constraints, without the derivative of τ's row by λ.

    The inverse of the lumped blocks at points is corrected, see :class:`ConsistentMass`.

    Args:
        equations: The equations.
    """

    def __init__(self, equations: Equations) -> None:
        self._passes = equations.passes
        self._of: list[_PassBlocks | _PointBlocks] = []
        self._ends = np.cumsum([0, *(p.rows.num_unknowns for p in self._passes)])
        self._comm = equations.system.comm
        self._is_first = self._comm.rank == 0
        self._tools = len(equations.tools)
        self._mass = ConsistentMass(self._passes, self._ends[:-1], self.num_rows, self._comm)
        self._roots: Array = np.zeros(0)

    def take(self, at: State) -> None:
        """Compute the blocks of an evaluation."""
        both = zip(self._passes, at.passes, strict=True)
        self._of = [
            _PassBlocks(p, e) if p.rows.condensed_friction is None else _PointBlocks(p, e)
            for p, e in both
        ]
        self._roots = np.concatenate([np.zeros(0), *(of.roots for of in self._of)])

    @property
    def scale(self) -> Array:
        """Scaling factors of the rows of multipliers, and of tools, on this rank."""
        parts = [of.scale for of in self._of]
        return np.concatenate([*parts, np.ones(self._tools if self._is_first else 0)])

    @property
    def is_condensed(self) -> bool:
        """Whether C_γ is C on this rank: active constraints compliant, none redundant."""
        return all(of.is_condensed for of in self._of)

    @property
    def digest(self) -> bytes:
        """Digest of D and C."""
        out = hashlib.blake2b()
        for of in self._of:
            of.add_to(out)
        return out.digest()

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        """Blocks of S = −F C_γ⁻¹ D for gaps and slips."""
        return [pair for of in self._of if isinstance(of, _PassBlocks) for pair in of.stiffness()]

    @property
    def num_rows(self) -> int:
        """Number of rows of multipliers on this rank."""
        return int(self._ends[-1])

    def inverse(self) -> PETSc.Mat:
        """New matrix C_γ⁻¹ times the scale, as in :meth:`condensed`. Collective."""
        parts, num = [], self.num_rows
        first = self._comm.exscan(num) or 0
        for of, start in zip(self._of, self._ends, strict=False):
            part = of.inverse()
            parts.append(Entries(start + part.row, start + part.column, part.value))
        found = joined(parts)
        scale = np.concatenate([np.zeros(0), *(of.scale for of in self._of)])
        value = found.value * scale[found.column]
        out = Entries(found.row, first + found.column, value).matrix(num, num, self._comm)
        rest = self._mass.scaled(-self._roots, self._roots * scale)
        if rest is not None:
            out.axpy(1.0, rest, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            rest.destroy()
        return out

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r. Collective."""
        pairs = zip(self._of, np.split(r, self._ends[1:-1]), strict=True)
        lumped = np.concatenate([np.zeros(0), *(of.solve(part) for of, part in pairs)])
        return np.asarray(lumped - self._mass.product(self._roots, r))

    def condensed(self, rows: Array) -> Array:
        """Product −C_γ⁻¹ times changes of rows by bodies and tools. Collective."""
        return -self.solve(rows)

    def free(self) -> None:
        """Free PETSc's objects. Collective."""
        self._mass.destroy()


class _NodalBlocks:
    """Blocks of constraints of λ at nodes."""

    def __init__(self, rows: NodalRows, at: Normal) -> None:
        self._rows, self._at = rows, at
        by_gap, own = rows.derivative(at, False)
        self._scale, soft = rows.scale(at), rows.usual_compliance(at)
        self._weight: Array = rows.gap.weight
        self._by_gap: Array = self._scale[:, None] * by_gap
        self._own: Array = self._scale[:, None] * own
        hard = _unless(at.held)
        self._regular: Array = self._own - (self._scale * self._weight * soft)[:, None] * hard
        #: Whether C_γ is C.
        self.is_condensed = at.held is None and not bool(np.any(soft))
        #: Scaling factors of the rows.
        self.scale = np.repeat(self._scale, by_gap.shape[1])
        #: Square roots of the inverse of lumped masses over C_γ: none here.
        self.roots: Array = np.zeros(self._regular.size)
        #: Arrays that change from iteration to iteration.
        self.changing: list[Array] = [self._by_gap, self._own]

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return np.asarray(r / self._regular)

    def inverse(self) -> Entries:
        """C_γ⁻¹."""
        return _diagonal(1 / self._regular)

    def stiffness(self) -> Array:
        """Blocks of S, (rows, width)."""
        return np.asarray(-self._weight[:, None] * self._by_gap / self._regular)


class _CondensedBlocks:
    """Blocks of constraints whose forces follow from gaps.

    With multipliers of points, C_γ is lumped, with the compliance 1/γ at active points.
    """

    def __init__(self, rows: CondensedRows, at: Normal) -> None:
        self._rows = rows
        stiffness, areas = rows.stiffness(at), rows.areas
        self._own: Array = rows.gap.weight[:, None] * stiffness
        #: Whether C_γ is C.
        self.is_condensed = not rows.has_multipliers
        part = rows.part
        compliant = 1 + part * (1 - part)
        closed = rows.gathered(np.asarray(stiffness[:, 0] / rows.gamma))[:, :1]
        self._regular: Array = compliant * closed + part * np.maximum(areas - closed, 0.0)
        #: (−C_γ)^(-1/2).
        self.roots: Array = _roots(self._regular)
        #: Scaling factors of the rows.
        self.scale = rows.gamma * np.ones(rows.num_multipliers)
        #: Arrays that change from iteration to iteration.
        self.changing: list[Array] = [self._own]

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return np.asarray(-r / self._regular)

    def inverse(self) -> Entries:
        """C_γ⁻¹."""
        return _diagonal(-1 / self._regular)

    def stiffness(self) -> Array:
        """Blocks of S, (rows, width)."""
        return self._own


class _SlipBlocks:
    """Blocks of constraints of τ."""

    def __init__(self, rows: FrictionRows, at: Tangential) -> None:
        by, scale, slip = rows.derivative(at, False), rows.scale(at), rows.slip
        gdim, weight, soft = by.by_slip.shape[1], slip.weight, rows.usual_compliance(at)
        #: Scaling factors of the rows.
        self.scale = np.repeat(scale, gdim)
        self.projector: Array = slip.projector * weight[:, None, None]
        self.by_slip: Array = scale[:, None, None] * (by.by_slip @ slip.projector)
        self.by_own: Array = scale[:, None, None] * by.by_own
        self.by_pressure: Array = scale[:, None] * by.by_pressure
        self.by_trial = None if by.by_trial is None else scale[:, None] * by.by_trial
        edge = np.zeros(len(scale), dtype=bool) if at.filled is None else at.filled.edge
        #: Part of the derivative by pressure that is in C_γ.
        self.known_by_pressure: Array = np.where(edge[:, None], 0.0, self.by_pressure)
        softened = (scale * weight * soft)[:, None, None] * np.eye(gdim)
        if at.filled is not None and edge.any():  # their scale is c_t
            softened = softened + weight[:, None, None] * at.filled.by_multiplier
        self.inverse: Array = np.asarray(np.linalg.inv(self.by_own - softened))
        #: Whether C_γ is C.
        self.is_condensed = not (bool(np.any(soft)) or bool(edge.any()))
        #: Arrays that change from iteration to iteration.
        self.changing: list[Array] = [self.by_slip, self.by_own, self.by_pressure]
        if self.by_trial is not None:
            self.changing.append(self.by_trial)


class _PointBlocks:
    """Blocks of an integration side with friction at points, for an evaluation."""

    def __init__(self, p: Pass, at: Evaluated) -> None:
        rows, friction = p.rows.condensed, p.rows.condensed_friction
        assert rows is not None and friction is not None
        assert p.slip is not None and at.tangential is not None
        self._p, self._friction = p, friction
        self._normal = _CondensedBlocks(rows, at.normal)
        self._by_slip = friction.by_slip(at.tangential)
        self._by_pressure = friction.by_pressure(at.tangential)
        self._areas = friction.areas

    @property
    def is_condensed(self) -> bool:
        """Whether C_γ is C."""
        return self._normal.is_condensed

    @property
    def scale(self) -> Array:
        """Scaling factors of the rows."""
        own = np.full(self._friction.shape[0], self._friction.gamma)
        return np.concatenate([self._normal.scale, own])

    @property
    def roots(self) -> Array:
        """(−C_γ)^(-1/2), (multipliers,)."""
        return np.concatenate([self._normal.roots, _roots(self._areas)])

    def add_to(self, digest: typing.Any) -> None:
        """Add all arrays that may change to a digest."""
        for array in (*self._normal.changing, self._by_slip, self._by_pressure):
            digest.update(np.ascontiguousarray(array))

    def _of_multipliers(self, m: Array) -> tuple[Array, Array]:
        end = self._p.rows.num_multipliers
        return m[:end, None], m[end:, None]

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        normal, tangential = self._of_multipliers(r)
        return _joined(self._normal.solve(normal), -tangential / self._areas)

    def inverse(self) -> Entries:
        """Entries of C_γ⁻¹, numbered within this integration side."""
        of_slips = _diagonal(-1 / self._areas)
        first = self._p.rows.num_multipliers
        moved = of_slips._replace(row=first + of_slips.row, column=first + of_slips.column)
        return joined([self._normal.inverse(), moved])


class _PassBlocks:
    """Blocks of one integration side, for an evaluation."""

    def __init__(self, p: Pass, at: Evaluated) -> None:
        self._p, rows = p, p.rows
        self._normal: _NodalBlocks | _CondensedBlocks
        if rows.condensed is not None:
            self._normal = _CondensedBlocks(rows.condensed, at.normal)
        else:
            assert rows.nodal is not None
            self._normal = _NodalBlocks(rows.nodal, at.normal)
        self._slip: _SlipBlocks | None = None
        if rows.nodal_friction is not None and at.tangential is not None:
            self._slip = _SlipBlocks(rows.nodal_friction, at.tangential)

    @property
    def _parts(self) -> list[_NodalBlocks | _CondensedBlocks | _SlipBlocks]:
        return [self._normal] if self._slip is None else [self._normal, self._slip]

    @property
    def is_condensed(self) -> bool:
        """Whether C_γ is C."""
        return all(part.is_condensed for part in self._parts)

    @property
    def scale(self) -> Array:
        """Scaling factors of the rows."""
        return np.concatenate([part.scale for part in self._parts])

    @property
    def roots(self) -> Array:
        """(−C_γ)^(-1/2) of multipliers at points, 0 of others, (multipliers,)."""
        slip = self._slip
        none = np.zeros(0 if slip is None else slip.inverse[:, :, 0].size)
        return np.concatenate([self._normal.roots, none])

    def add_to(self, digest: typing.Any) -> None:
        """Add all arrays that may change to a digest."""
        for part in self._parts:
            for array in part.changing:
                digest.update(np.ascontiguousarray(array))

    def _split(self, values: Array, count: int) -> tuple[Array, Array]:
        """Split values into normal parts, of a given count, and tangential parts (maybe empty)."""
        width, friction = self._p.rows.width, self._p.rows.friction
        normal = values[:count].reshape(count // width, width)
        shape = (0, 0) if friction is None else friction.shape
        return normal, values[count:].reshape(shape)

    def _of_multipliers(self, m: Array) -> tuple[Array, Array]:
        return self._split(m, self._p.rows.num_multipliers)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        normal, tangential = self._of_multipliers(r)
        out, slip = self._normal.solve(normal), self._slip
        if slip is None:
            return _joined(out, tangential)
        if isinstance(self._normal, _NodalBlocks):
            tangential = tangential - slip.known_by_pressure * out
        return _joined(out, _times(slip.inverse, tangential))

    def inverse(self) -> Entries:
        """Entries of C_γ⁻¹, numbered within this integration side."""
        found, slip = [self._normal.inverse()], self._slip
        if slip is None:
            return found[0]
        num, gdim = slip.inverse.shape[:2]
        rows = self._p.rows.num_multipliers + np.arange(num * gdim).reshape(num, gdim)
        row, column = (np.repeat(rows[:, :, None], gdim, 2), np.repeat(rows[:, None, :], gdim, 1))
        found.append(Entries(row.ravel(), column.ravel(), slip.inverse.ravel()))
        if isinstance(self._normal, _NodalBlocks):
            own = found[0]
            coupling = -_times(slip.inverse, slip.known_by_pressure) * own.value[:, None]
            found.append(Entries(rows.ravel(), np.repeat(own.column, gdim), coupling.ravel()))
        return joined(found)

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        """Blocks of S for gap and slip."""
        own, slip = self._normal.stiffness(), self._slip
        found: list[tuple[WeightedGap | Slip, Weights]] = [(self._p.gap, own)]
        if slip is not None:
            assert self._p.slip is not None
            through = -slip.projector @ slip.inverse
            coupling = np.zeros(through.shape[:2])
            if isinstance(self._normal, _NodalBlocks):
                ratio = own / self._p.gap.weight[:, None]
                coupling = _times(through, slip.known_by_pressure * ratio)
            found.append((self._p.slip, (through @ slip.by_slip, coupling)))
        return found


def _roots(values: Array) -> Array:
    """Square roots of the inverse of positive values; 0 for others."""
    out = np.zeros(values.size)
    return np.divide(
        1.0, np.sqrt(np.maximum(values.ravel(), 0.0)), out=out, where=out < values.ravel()
    )


def _diagonal(values: Array) -> Entries:
    every = np.arange(values.size, dtype=np.int64)
    return Entries(every, every, values.ravel())


def _joined(normal: Array, tangential: Array) -> Array:
    return np.concatenate([normal.ravel(), tangential.ravel()])


def _times(blocks: Array, values: Array) -> Array:
    return np.asarray(np.einsum("rij,rj->ri", blocks, values))


def _unless(held: Flags | None) -> Array | float:
    return 1.0 if held is None else (~held).astype(np.float64)
