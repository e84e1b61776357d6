"""Blocks of the rows of a node in the tangent: what gaps and multipliers do to them."""

from __future__ import annotations

import hashlib
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.terms import Weights
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.constraint_rows import Derivative, Evaluated
from qsdolfinx.system.equations import Equations, Pass, State
from qsdolfinx.system.factors import Entries, joined
from qsdolfinx.system.law_rows import CondensedRows
from qsdolfinx.system.point_rows import PROXIMAL

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class RowBlocks:
    """F, D and C of [K, Lᵀ F; D R, C], see ``linear/saddle.py``, for the rows of all passes.

    F makes forces of multipliers, D and C are the derivatives of the rows by gaps and slips and by
    multipliers. Rows are scaled to forces, those of closed gaps by the usual penalty, so that one
    tolerance is for all. C_γ is C where closed rows have at least the
    compliance of the usual penalty, without what couples nodes that conditions hold.
    At points gaps make forces themselves, F_γ R du: S is F_γ there, and C_γ diagonal, with what
    each multiplier stands for.

    Args:
        equations: The equations.
    """

    def __init__(self, equations: Equations) -> None:
        self._passes = equations.passes
        self._of: list[_Blocks] = []
        self._ends = np.cumsum([0, *(p.rows.num_unknowns for p in self._passes)])
        self._gap_ends = np.cumsum([0, *(p.rows.num_values for p in self._passes)])
        self._is_first = equations.system.comm.rank == 0
        self._tools = len(equations.tools)

    def take(self, at: State) -> None:
        """Those of an evaluation."""
        self._of = [
            (_CondensedBlocks if isinstance(p.rows, CondensedRows) else _Blocks)(p, e)
            for p, e in zip(self._passes, at.passes, strict=True)
        ]

    @property
    def scale(self) -> Array:
        """What the rows of multipliers, and of tools, on this rank are multiplied with."""
        parts = [of.scale for of in self._of]
        return np.concatenate([*parts, np.ones(self._tools if self._is_first else 0)])

    @property
    def is_condensed(self) -> bool:
        """Whether C_γ is C on this rank: closed rows have a compliance, and none is held."""
        return all(of.is_condensed for of in self._of)

    @property
    def digest(self) -> bytes:
        """Digest of D and C."""
        out = hashlib.blake2b()
        for of in self._of:
            of.add_to(out)
        return out.digest()

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        """Of S = −F C_γ⁻¹ D the blocks of passes and slips."""
        return [pair for of in self._of for pair in of.stiffness()]

    @property
    def num_rows(self) -> int:
        """Gaps and slips on this rank."""
        return int(self._gap_ends[-1])

    def matrix_entries(self, first: int) -> Entries:
        """Of S, with global columns.

        Args:
            first: Number of this rank's first row.
        """
        parts = []
        for of, start in zip(self._of, self._gap_ends, strict=False):
            part = of.entries()
            parts.append(Entries(start + part.row, first + start + part.column, part.value))
        return joined(parts)

    def forces(self, m: Array) -> Array:
        """F m."""
        return self._each("forces", m, self._ends)

    def by_gaps(self, gaps: Array) -> Array:
        """D times gaps and slips."""
        return self._each("by_gaps", gaps, self._gap_ends)

    def by_multipliers(self, m: Array) -> Array:
        """C m. Collective."""
        return self._each("by_multipliers", m, self._ends)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return self._each("solve", r, self._ends)

    def condensed(self, gaps: Array) -> Array:
        """−C_γ⁻¹ D times gaps and slips, but for points."""
        return self._each("condensed", gaps, self._gap_ends)

    def own_forces(self, gaps: Array) -> Array:
        """F_γ times gaps and slips."""
        return self._each("own_forces", gaps, self._gap_ends)

    def resisting(self, gaps: Array) -> Array:
        """S times gaps and slips."""
        return self.forces(self.condensed(gaps)) + self.own_forces(gaps)

    def _each(self, name: str, values: Array, ends: Indices) -> Array:
        """Of each pass what its method of this name makes of its part."""
        pairs = zip(self._of, np.split(values, ends[1:-1]), strict=True)
        return np.concatenate([np.zeros(0), *(getattr(of, name)(part) for of, part in pairs)])


class _Blocks:
    """Those of one pass, where it was evaluated."""

    #: What the rows are multiplied with.
    scale: Array

    def __init__(self, p: Pass, at: Evaluated) -> None:
        self._p, self._at, rows = p, at, p.rows
        by: Derivative = rows.derivative(at, False)
        normal, tangential = rows.scales(at)
        soft = rows.usual_compliances(at)
        if isinstance(rows, CondensedRows):
            soft = np.zeros_like(soft[0]), soft[1]
        #: Whether C_γ is C.
        self.is_condensed = at.held is None and not any(np.any(part) for part in soft)
        self._take_normal(by, normal, soft[0])
        self._has_slip, self._gdim = by.by_slip is not None, p.gap.slave.gdim
        if by.by_slip is None or by.by_tangential is None or by.by_normal is None:
            return
        assert p.slip is not None
        gdim, weight = by.by_slip.shape[1], p.slip.weight
        self.scale = np.concatenate([self.scale, np.repeat(tangential, gdim)])
        scale = tangential[:, None, None]
        self._projector: Array = p.slip.projector * weight[:, None, None]
        self._by_slip: Array = scale * (by.by_slip @ p.slip.projector)
        self._by_tau: Array = scale * by.by_tangential
        self._by_normal: Array = tangential[:, None] * by.by_normal
        softened = (tangential * weight * soft[1])[:, None, None] * np.eye(gdim)
        self._inverse: Array = np.asarray(np.linalg.inv(self._by_tau - softened))

    def _take_normal(self, by: Derivative, normal: Array, soft: Array) -> None:
        """Take the blocks of the rows of λ."""
        weight, width = self._p.gap.weight, self._p.rows.width
        self._weight: Array = weight
        self._by_gap: Array = normal[:, None] * by.normal_by_gap
        self._own: Array = normal[:, None] * by.normal_by_normal
        hard = _unless(self._at.held)
        self._regular: Array = self._own - (normal * weight * soft)[:, None] * hard
        self.scale = np.repeat(normal, width)
        self._normal = normal

    def _that_may_change(self) -> list[Array]:
        return [self._by_gap, self._own]

    def add_to(self, digest: typing.Any) -> None:
        """Add all that may change."""
        parts = self._that_may_change()
        if self._has_slip:
            parts += [self._by_slip, self._by_tau, self._by_normal]
        for part in parts:
            digest.update(np.ascontiguousarray(part))

    def _split(self, values: Array, count: int | None = None) -> tuple[Array, Array]:
        """Normal and tangential parts; the latter is empty without friction.

        Args:
            values: Of the rows.
            count: Normal ones; by default those of the multipliers.
        """
        rows = self._p.rows
        end = rows.num_multipliers if count is None else count
        rest, slip = values[end:], self._p.slip
        num = 0 if slip is None else slip.operator.num_rows
        normal = values[:end].reshape(end // rows.width, rows.width)
        return normal, rest.reshape(num, self._gdim if self._has_slip else 0)

    def _split_gaps(self, gaps: Array) -> tuple[Array, Array]:
        return self._split(gaps, self._p.rows.num_rows * self._p.rows.width)

    def _joined(self, normal: Array, tangential: Array | None) -> Array:
        if tangential is None:
            return np.asarray(normal.ravel())
        return np.concatenate([normal.ravel(), tangential.ravel()])

    def _forces_of_slip(self, tangential: Array) -> Array | None:
        return _times(self._projector, tangential) if self._has_slip else None

    def forces(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        return self._joined(self._weight[:, None] * normal, self._forces_of_slip(tangential))

    def own_forces(self, gaps: Array) -> Array:
        return np.zeros_like(gaps)

    def condensed(self, gaps: Array) -> Array:
        return -self.solve(self.by_gaps(gaps))

    def by_gaps(self, gaps: Array) -> Array:
        gap, jump = self._split_gaps(gaps)
        of_slip = _times(self._by_slip, jump) if self._has_slip else None
        return self._joined(self._by_gap * gap, of_slip)

    def by_multipliers(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        out = self._own * normal + self._normal[:, None] * self._p.rows.by_means(self._at, normal)
        if not self._has_slip:
            return self._joined(out, None)
        of_slip = _times(self._by_tau, tangential) + self._by_normal * normal
        return self._joined(out, of_slip)

    def solve(self, r: Array) -> Array:
        normal, tangential = self._split(r)
        out = normal / self._regular
        if not self._has_slip:
            return self._joined(out, None)
        return self._joined(out, _times(self._inverse, tangential - self._by_normal * out))

    def entries(self) -> Entries:
        """Of S, in the numbers of this pass."""
        stiffness, rows = self.stiffness(), self._p.rows
        end = rows.num_rows * rows.width
        normal = np.arange(end)
        found = [Entries(normal, normal, np.asarray(stiffness[0][1]).ravel())]
        if self._has_slip:
            block, coupling = stiffness[1][1]
            num, gdim = block.shape[:2]
            own = end + np.arange(num * gdim).reshape(num, gdim)
            row, column = (np.repeat(own[:, :, None], gdim, 2), np.repeat(own[:, None, :], gdim, 1))
            found.append(Entries(row.ravel(), column.ravel(), block.ravel()))
            if len(coupling) == len(normal):
                beside = np.repeat(normal, gdim)
                found.append(Entries(own.ravel(), beside, coupling.ravel()))
        return joined(found)

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        ratio = -self._by_gap / self._regular
        found: list[tuple[WeightedGap | Slip, Weights]] = [
            (self._p.gap, self._weight[:, None] * ratio)
        ]
        if self._has_slip:
            assert self._p.slip is not None
            through = -self._projector @ self._inverse
            coupling = _times(through, self._by_normal * ratio)
            found.append((self._p.slip, (through @ self._by_slip, coupling)))
        return found


class _CondensedBlocks(_Blocks):
    """Those of a pass whose gaps make forces themselves."""

    def _take_normal(self, by: Derivative, normal: Array, soft: Array) -> None:
        rows, at = self._p.rows, self._at
        assert isinstance(rows, CondensedRows)
        self._rows = rows
        stiffness = rows.stiffness(at)
        #: Forces of gaps, and of what rows see of multipliers.
        self._own: Array = self._p.gap.weight[:, None] * stiffness
        self._areas = rows.areas
        self.scale = rows.gamma * np.ones(rows.num_multipliers)
        self.is_condensed &= rows.num_multipliers == 0
        #: How friction's limit changes with y of rows.
        self._closed: Array = np.asarray(stiffness[:, 0] / rows.gamma, dtype=np.float64)
        self._limiting: Array = np.where(at.pressure[:, 0] > 0, self._closed, 0.0)

    def _that_may_change(self) -> list[Array]:
        return [self._own]

    def forces(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        pushing = self._own / self._rows.gamma * self._rows.seen(normal)
        return self._joined(pushing, self._forces_of_slip(tangential))

    def own_forces(self, gaps: Array) -> Array:
        gap, jump = self._split_gaps(gaps)
        return self._joined(self._own * gap, np.zeros_like(jump) if self._has_slip else None)

    def condensed(self, gaps: Array) -> Array:
        jump = self._split_gaps(gaps)[1]
        none = np.zeros(self._rows.num_multipliers)
        if not self._has_slip:
            return self._joined(none, None)
        return self._joined(none, -_times(self._inverse, _times(self._by_slip, jump)))

    def _of_pressures(self, changes: Array) -> Array:
        """How friction's limit changes with y of the rows."""
        assert self._p.slip is not None
        pressure = self._p.slip.at_nodes(self._limiting * changes)
        return np.asarray(self._by_normal * pressure[:, None])

    def by_gaps(self, gaps: Array) -> Array:
        gap, jump = self._split_gaps(gaps)
        change = self._rows.gamma * gap[:, 0]
        normal = self._rows.gathered(self._closed * change)
        if not self._has_slip:
            return self._joined(normal, None)
        of_slip = _times(self._by_slip, jump) + self._of_pressures(change)
        return self._joined(normal, of_slip)

    def by_multipliers(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        change = self._rows.seen(normal)[:, 0]
        out = self._rows.gathered((self._closed - 1.0) * change) - PROXIMAL * self._areas * normal
        if not self._has_slip:
            return self._joined(out, None)
        return self._joined(out, _times(self._by_tau, tangential) + self._of_pressures(change))

    def solve(self, r: Array) -> Array:
        normal, tangential = self._split(r)
        out = -normal / self._areas
        if not self._has_slip:
            return self._joined(out, None)
        return self._joined(out, _times(self._inverse, tangential))

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        found: list[tuple[WeightedGap | Slip, Weights]] = [(self._p.gap, self._own)]
        if self._has_slip:
            assert self._p.slip is not None
            block = -self._projector @ self._inverse @ self._by_slip
            found.append((self._p.slip, (block, np.zeros(block.shape[:2]))))
        return found


def _times(blocks: Array, values: Array) -> Array:
    return np.asarray(np.einsum("rij,rj->ri", blocks, values))


def _unless(held: Flags | None) -> Array | float:
    return 1.0 if held is None else (~held).astype(np.float64)
