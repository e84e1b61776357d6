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

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


class RowBlocks:
    """F, D and C of [K, Lᵀ F; D R, C], see ``linear/saddle.py``, for the rows of all passes.

    F makes forces of multipliers, D and C are the derivatives of the rows by gaps and slips and by
    multipliers. Rows are scaled to forces, those of closed gaps by the usual penalty, so that one
    tolerance is for all. C_γ is C where closed rows have at least the
    compliance of the usual penalty, without what couples nodes that conditions hold. On the edge
    of contact |τ| is what closes the gap: C has nothing of it. There C_γ has |τ| as of open rows,
    and what the row's gap and λ do to τ is left out of C_γ and S.

    Args:
        equations: The equations.
    """

    def __init__(self, equations: Equations) -> None:
        self._passes = equations.passes
        self._of: list[_Blocks] = []
        self._ends = np.cumsum([0, *(p.rows.num_unknowns for p in self._passes)])
        self._is_first = equations.system.comm.rank == 0
        self._tools = len(equations.tools)

    def take(self, at: State) -> None:
        """Those of an evaluation."""
        self._of = [_Blocks(p, e) for p, e in zip(self._passes, at.passes, strict=True)]

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
        """Rows of multipliers on this rank."""
        return int(self._ends[-1])

    def matrix_entries(self, first: int) -> Entries:
        """Of S, with global columns.

        Args:
            first: Number of this rank's first row.
        """
        parts = []
        for of, start in zip(self._of, self._ends, strict=False):
            part = of.entries()
            parts.append(Entries(start + part.row, first + start + part.column, part.value))
        return joined(parts)

    def forces(self, m: Array) -> Array:
        """F m."""
        return self._each(_Blocks.forces, m)

    def by_gaps(self, gaps: Array) -> Array:
        """D times gaps and slips."""
        return self._each(_Blocks.by_gaps, gaps)

    def by_multipliers(self, m: Array) -> Array:
        """C m. Collective."""
        return self._each(_Blocks.by_multipliers, m)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return self._each(_Blocks.solve, r)

    def condensed(self, gaps: Array) -> Array:
        """−C_γ⁻¹ D times gaps and slips."""
        return self._each(_Blocks.condensed, gaps)

    def _each(self, function: typing.Callable[[_Blocks, Array], Array], values: Array) -> Array:
        pairs = zip(self._of, np.split(values, self._ends[1:-1]), strict=True)
        return np.concatenate([np.zeros(0), *(function(of, part) for of, part in pairs)])


class _Blocks:
    """Those of one pass, where it was evaluated."""

    def __init__(self, p: Pass, at: Evaluated) -> None:
        self._p, self._at, rows = p, at, p.rows
        by: Derivative = rows.derivative(at, False)
        normal, tangential = rows.scales(at)
        soft = rows.usual_compliances(at)
        weight, width = p.gap.weight, rows.width
        self._shape = p.rows.num_rows, width
        self._weight: Array = weight
        self._by_gap: Array = normal[:, None] * by.normal_by_gap
        self._own: Array = normal[:, None] * by.normal_by_normal
        self._regular: Array = self._own - (normal * weight * soft[0])[:, None] * _unless(at.held)
        #: Whether C_γ is C.
        on_edge = at.filled is not None and bool(at.filled.edge.any())
        self.is_condensed = at.held is None and not on_edge and not any(map(np.any, soft))
        #: What the rows are multiplied with.
        self.scale: Array = np.repeat(normal, width)
        self._normal = normal
        self._has_slip, self._gdim = by.by_slip is not None, p.gap.slave.gdim
        if by.by_slip is None or by.by_tangential is None or by.by_normal is None:
            return
        assert p.slip is not None
        gdim = by.by_slip.shape[1]
        self.scale = np.concatenate([self.scale, np.repeat(tangential, gdim)])
        scale = tangential[:, None, None]
        self._projector: Array = p.slip.projector * weight[:, None, None]
        self._by_slip: Array = scale * (by.by_slip @ p.slip.projector)
        self._by_tau: Array = scale * by.by_tangential
        self._by_normal: Array = tangential[:, None] * by.by_normal
        #: What is left out: of the rows of τ on the edge of contact by gaps and by λ.
        self._on_edge: tuple[Array, Array] | None = None
        softened = (tangential * weight * soft[1])[:, None, None] * np.eye(gdim)
        if on_edge and by.by_gap is not None and at.filled is not None:
            edge = at.filled.edge[:, None]
            self._on_edge = tangential[:, None] * by.by_gap, np.where(edge, self._by_normal, 0.0)
            self._by_normal = np.where(edge, 0.0, self._by_normal)
            # Their scale is c_t.
            softened = softened + weight[:, None, None] * at.filled.by_multiplier
        self._inverse: Array = np.asarray(np.linalg.inv(self._by_tau - softened))

    def add_to(self, digest: typing.Any) -> None:
        """Add all that may change."""
        parts = [self._by_gap, self._own]
        if self._has_slip:
            parts += [self._by_slip, self._by_tau, self._by_normal]
            parts += [*(self._on_edge or ())]
        for part in parts:
            digest.update(np.ascontiguousarray(part))

    def _split(self, values: Array) -> tuple[Array, Array]:
        """Normal and tangential parts; the latter is empty without friction."""
        end = self._shape[0] * self._shape[1]
        normal, rest = values[:end].reshape(self._shape), values[end:]
        return normal, rest.reshape(self._shape[0], self._gdim if self._has_slip else 0)

    def _joined(self, normal: Array, tangential: Array | None) -> Array:
        if tangential is None:
            return np.asarray(normal.ravel())
        return np.concatenate([normal.ravel(), tangential.ravel()])

    def forces(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        of_slip = _times(self._projector, tangential) if self._has_slip else None
        return self._joined(self._weight[:, None] * normal, of_slip)

    def by_gaps(self, gaps: Array, with_edge: bool = True) -> Array:
        gap, jump = self._split(gaps)
        of_slip = _times(self._by_slip, jump) if self._has_slip else None
        if of_slip is not None and with_edge and self._on_edge is not None:
            of_slip += self._on_edge[0] * gap
        return self._joined(self._by_gap * gap, of_slip)

    def by_multipliers(self, m: Array) -> Array:
        normal, tangential = self._split(m)
        out = self._own * normal + self._normal[:, None] * self._p.rows.by_means(self._at, normal)
        if not self._has_slip:
            return self._joined(out, None)
        of_slip = _times(self._by_tau, tangential) + self._by_normal * normal
        if self._on_edge is not None:
            of_slip += self._on_edge[1] * normal
        return self._joined(out, of_slip)

    def condensed(self, gaps: Array) -> Array:
        return -self.solve(self.by_gaps(gaps, with_edge=False))

    def solve(self, r: Array) -> Array:
        normal, tangential = self._split(r)
        out = normal / self._regular
        if not self._has_slip:
            return self._joined(out, None)
        return self._joined(out, _times(self._inverse, tangential - self._by_normal * out))

    def entries(self) -> Entries:
        """Of S, in the numbers of this pass."""
        stiffness, (num, width) = self.stiffness(), self._shape
        normal, end = np.arange(num * width), num * width
        found = [Entries(normal, normal, np.asarray(stiffness[0][1]).ravel())]
        if self._has_slip:
            block, coupling = stiffness[1][1]
            gdim = block.shape[1]
            own = end + np.arange(num * gdim).reshape(num, gdim)
            row, column = (np.repeat(own[:, :, None], gdim, 2), np.repeat(own[:, None, :], gdim, 1))
            found.append(Entries(row.ravel(), column.ravel(), block.ravel()))
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


def _times(blocks: Array, values: Array) -> Array:
    return np.asarray(np.einsum("rij,rj->ri", blocks, values))


def _unless(held: Flags | None) -> Array | float:
    return 1.0 if held is None else (~held).astype(np.float64)
