"""Blocks of the rows of a node in the tangent: what gaps and multipliers do to them."""

from __future__ import annotations

import hashlib
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.terms import Weights
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.condensed_rows import LEAST_PROXIMAL, CondensedRows
from qsdolfinx.system.constraint_rows import Evaluated
from qsdolfinx.system.equations import Equations, Pass, State
from qsdolfinx.system.factors import Entries, joined
from qsdolfinx.system.friction_rows import FrictionRows, Tangential
from qsdolfinx.system.normal_rows import NodalRows, Normal

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class RowBlocks:
    """F, D and C of [K, Lᵀ F; D R, C], see ``linear/saddle.py``, for the rows of all passes.

    F makes forces of multipliers, D and C are the derivatives of the rows by gaps and slips and by
    multipliers. Rows are scaled to forces, those of closed gaps by the usual penalty, so that one
    tolerance is for all. C_γ is C where closed rows have at least the
    compliance of the usual penalty, without what couples nodes that conditions hold.
    At points gaps make forces themselves, F_γ R du, and C_γ is lumped: S is F_γ and what a
    penalty at the points would be.

    On the edge of contact |τ| is what closes the gap: C has nothing of it. There C_γ has |τ| as of
    open rows, and what the row's gap and λ do to τ is left out of C_γ and S.

    Args:
        equations: The equations.
    """

    def __init__(self, equations: Equations) -> None:
        self._passes = equations.passes
        self._of: list[_PassBlocks | _PointBlocks] = []
        self._ends = np.cumsum([0, *(p.rows.num_unknowns for p in self._passes)])
        self._gap_ends = np.cumsum([0, *(p.rows.num_values for p in self._passes)])
        self._is_first = equations.system.comm.rank == 0
        self._tools = len(equations.tools)

    def take(self, at: State) -> None:
        """Those of an evaluation."""
        both = zip(self._passes, at.passes, strict=True)
        self._of = [
            _PassBlocks(p, e) if p.rows.condensed_friction is None else _PointBlocks(p, e)
            for p, e in both
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
        """−C_γ⁻¹ D times gaps and slips, but for slips at points."""
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


class _NodalBlocks:
    """Of rows of λ at nodes."""

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
        #: What the rows are multiplied with.
        self.scale = np.repeat(self._scale, by_gap.shape[1])
        #: What changes from iteration to iteration.
        self.changing: list[Array] = [self._by_gap, self._own]

    def forces(self, multiplier: Array) -> Array:
        """Of multipliers at the rows."""
        return np.asarray(self._weight[:, None] * multiplier)

    def own_forces(self, gap: Array) -> Array:
        """Of gaps."""
        return np.zeros_like(gap)

    def by_gap(self, gap: Array) -> Array:
        """Rows by gaps."""
        return np.asarray(self._by_gap * gap)

    def by_multiplier(self, multiplier: Array) -> Array:
        """Rows by multipliers. Collective."""
        means = self._rows.by_means(self._at, multiplier)
        return np.asarray(self._own * multiplier + self._scale[:, None] * means)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return np.asarray(r / self._regular)

    def condensed(self, gap: Array) -> Array:
        """−C_γ⁻¹ D of gaps."""
        return np.asarray(-self._by_gap * gap / self._regular)

    def pressure(self, gap: Array | None, multiplier: Array | None) -> Array | float:
        """How pressures of friction change, (rows,)."""
        return 0.0 if multiplier is None else multiplier[:, 0]

    def trial(self, gap: Array | None, multiplier: Array | None) -> Array | float:
        """How y_n changes, (rows,)."""
        of_gap, of_multiplier = self._rows.by_trial()
        out: Array | float = 0.0 if gap is None else of_gap * gap[:, 0]
        return out if multiplier is None else out + of_multiplier * multiplier[:, 0]

    def stiffness(self) -> Array:
        """Of S, (rows, width)."""
        return np.asarray(-self._weight[:, None] * self._by_gap / self._regular)


class _CondensedBlocks:
    """Of rows of λ whose gaps make forces themselves.

    With multipliers of points C_γ is lumped, with the compliance 1/γ where points are closed, so
    that S has 2 γ there.
    """

    def __init__(self, rows: CondensedRows, at: Normal) -> None:
        self._rows = rows
        stiffness, areas = rows.stiffness(at), rows.areas
        self._own: Array = rows.gap.weight[:, None] * stiffness
        self._closed: Array = np.asarray(stiffness[:, 0] / rows.gamma, dtype=np.float64)
        self._limiting: Array = np.where(at.pressure[:, 0] > 0, self._closed, 0.0)
        #: Whether C_γ is C.
        self.is_condensed = not rows.has_multipliers
        #: a, and what C_γ has at closed points.
        self._part = rows.part
        compliant = 1 + self._part * (1 - self._part)
        closed, self._soft = rows.gathered(self._closed)[:, :1], rows.proximal * areas
        self._regular: Array = compliant * closed + self._part * np.maximum(areas - closed, 0.0)
        #: What C_γ adds to S, over what gaps have themselves.
        self._more = self._part**2 / compliant if rows.has_multipliers else 0.0
        #: What the rows are multiplied with.
        self.scale = rows.gamma * np.ones(rows.num_multipliers)
        #: What changes from iteration to iteration.
        self.changing: list[Array] = [self._own]

    def forces(self, multiplier: Array) -> Array:
        """Of what the rows see of multipliers."""
        return np.asarray(self._own / self._rows.gamma * self._rows.seen(multiplier))

    def own_forces(self, gap: Array) -> Array:
        """Of gaps."""
        return np.asarray(self._own * gap)

    def by_gap(self, gap: Array) -> Array:
        """Rows by gaps. Collective."""
        return self._rows.gathered(self._closed * self._part * self._rows.gamma * gap[:, 0])

    def by_multiplier(self, multiplier: Array) -> Array:
        """Rows by multipliers. Collective."""
        seen = self._rows.at_points(multiplier)[:, 0]
        change = self._rows.gathered(self._part * (self._part * self._closed - 1.0) * seen)
        return np.asarray(change - self._soft * multiplier)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        return np.asarray(-r / self._regular)

    def condensed(self, gap: Array) -> Array:
        """−C_γ⁻¹ D of gaps. Collective."""
        return np.asarray(self.by_gap(gap) / self._regular)

    def _changes(self, gap: Array | None, multiplier: Array | None) -> Array:
        """How y changes, (rows,). Collective."""
        out = np.zeros(self._rows.gap.num_rows)
        if gap is not None:
            out += self._rows.gamma * gap[:, 0]
        return out if multiplier is None else out + self._rows.seen(multiplier)[:, 0]

    def pressure(self, gap: Array | None, multiplier: Array | None) -> Array:
        """How pressures of friction change, (rows,). Collective."""
        return np.asarray(self._limiting * self._changes(gap, multiplier))

    def trial(self, gap: Array | None, multiplier: Array | None) -> Array:
        """How y_n changes, likewise. Collective."""
        return np.asarray(self._rows.by_trial() * self._changes(gap, multiplier))

    def stiffness(self) -> Array:
        """Of S, (rows, width)."""
        return np.asarray((1 + self._more) * self._own)


class _SlipBlocks:
    """Of rows of τ."""

    def __init__(self, rows: FrictionRows, at: Tangential) -> None:
        by, scale, slip = rows.derivative(at, False), rows.scale(at), rows.slip
        gdim, weight, soft = by.by_slip.shape[1], slip.weight, rows.usual_compliance(at)
        #: What the rows are multiplied with.
        self.scale = np.repeat(scale, gdim)
        self.projector: Array = slip.projector * weight[:, None, None]
        self.by_slip: Array = scale[:, None, None] * (by.by_slip @ slip.projector)
        self.by_own: Array = scale[:, None, None] * by.by_own
        self.by_pressure: Array = scale[:, None] * by.by_pressure
        self.by_trial = None if by.by_trial is None else scale[:, None] * by.by_trial
        edge = np.zeros(len(scale), dtype=bool) if at.filled is None else at.filled.edge
        #: What of that is in C_γ.
        self.known_by_pressure: Array = np.where(edge[:, None], 0.0, self.by_pressure)
        softened = (scale * weight * soft)[:, None, None] * np.eye(gdim)
        if at.filled is not None and edge.any():  # whose scale is c_t
            softened = softened + weight[:, None, None] * at.filled.by_multiplier
        self.inverse: Array = np.asarray(np.linalg.inv(self.by_own - softened))
        #: Whether C_γ is C.
        self.is_condensed = not (bool(np.any(soft)) or bool(edge.any()))
        #: What changes from iteration to iteration.
        self.changing: list[Array] = [self.by_slip, self.by_own, self.by_pressure]
        if self.by_trial is not None:
            self.changing.append(self.by_trial)


class _PointBlocks:
    """Those of a pass with friction at points, where it was evaluated."""

    def __init__(self, p: Pass, at: Evaluated) -> None:
        rows, friction = p.rows.condensed, p.rows.condensed_friction
        assert rows is not None and friction is not None
        assert p.slip is not None and at.tangential is not None
        self._p, self._friction = p, friction
        self._normal = _CondensedBlocks(rows, at.normal)
        self._weight: Array = p.gap.weight
        self._by_slip = friction.by_slip(at.tangential)
        self._by_pressure = friction.by_pressure(at.tangential)
        self._areas = friction.areas

    @property
    def is_condensed(self) -> bool:
        """Whether C_γ is C."""
        return self._normal.is_condensed

    @property
    def scale(self) -> Array:
        """What the rows are multiplied with."""
        own = np.full(self._friction.shape[0], self._friction.gamma)
        return np.concatenate([self._normal.scale, own])

    def add_to(self, digest: typing.Any) -> None:
        """Add all that may change."""
        for array in (*self._normal.changing, self._by_slip, self._by_pressure):
            digest.update(np.ascontiguousarray(array))

    def _of_multipliers(self, m: Array) -> tuple[Array, Array]:
        end = self._p.rows.num_multipliers
        return m[:end, None], m[end:, None]

    def _of_gaps(self, gaps: Array) -> tuple[Array, Array]:
        end = self._p.rows.num_rows
        return gaps[:end, None], gaps[end:].reshape(end, self._p.gap.slave.gdim)

    def _tractions(self, gap: Array, jump: Array) -> Array:
        """How τ_p change with gaps and slips, (points, gdim). Collective."""
        pressure = self._normal.pressure(gap, None)
        return _times(self._by_slip, jump) + self._by_pressure * pressure[:, None]

    def _of_nodes(self, normal: Array, tangential: Array) -> Array:
        """The same with multipliers. Collective."""
        part = (1 - self._friction.elastic) / self._friction.gamma
        seen = part * self._friction.seen(tangential)
        pressure = self._normal.pressure(None, normal)
        return _times(self._by_slip, seen) + self._by_pressure * pressure[:, None]

    def forces(self, m: Array) -> Array:
        """F m. Collective."""
        normal, tangential = self._of_multipliers(m)
        of_slip = self._weight[:, None] * self._of_nodes(normal, tangential)
        return _joined(self._normal.forces(normal), of_slip)

    def own_forces(self, gaps: Array) -> Array:
        """F_γ times gaps and slips. Collective."""
        gap, jump = self._of_gaps(gaps)
        of_slip = self._weight[:, None] * self._tractions(gap, jump)
        return _joined(self._normal.own_forces(gap), of_slip)

    def by_gaps(self, gaps: Array) -> Array:
        """D times gaps and slips. Collective."""
        gap, jump = self._of_gaps(gaps)
        of_slip = self._friction.gathered(self._tractions(gap, jump))
        return _joined(self._normal.by_gap(gap), of_slip)

    def by_multipliers(self, m: Array) -> Array:
        """C m. Collective."""
        normal, tangential = self._of_multipliers(m)
        change = self._of_nodes(normal, tangential) - self._friction.seen(tangential)
        of_slip = self._friction.gathered(change)
        of_slip -= LEAST_PROXIMAL * self._areas * tangential
        return _joined(self._normal.by_multiplier(normal), of_slip)

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        normal, tangential = self._of_multipliers(r)
        return _joined(self._normal.solve(normal), -tangential / self._areas)

    def condensed(self, gaps: Array) -> Array:
        """−C_γ⁻¹ D times gaps; slips make forces themselves. Collective."""
        out = np.zeros(self._p.rows.num_unknowns)
        normal = self._normal.condensed(self._of_gaps(gaps)[0]).ravel()
        out[: len(normal)] = normal
        return out

    def entries(self) -> Entries:
        """Of S, in the numbers of this pass."""
        return _entries_of(self.stiffness(), True)

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        """Of S the blocks of pass and slip."""
        assert self._p.slip is not None
        slope = self._normal.pressure(np.ones((self._p.rows.num_rows, 1)), None)
        coupling = (self._weight * slope)[:, None] * self._by_pressure
        block = self._weight[:, None, None] * self._by_slip
        return [(self._p.gap, self._normal.stiffness()), (self._p.slip, (block, coupling))]


class _PassBlocks:
    """Those of one pass, where it was evaluated."""

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
        """What the rows are multiplied with."""
        return np.concatenate([part.scale for part in self._parts])

    def add_to(self, digest: typing.Any) -> None:
        """Add all that may change."""
        for part in self._parts:
            for array in part.changing:
                digest.update(np.ascontiguousarray(array))

    def _split(self, values: Array, count: int) -> tuple[Array, Array]:
        """Normal parts, of this count, and tangential ones; the latter are empty without."""
        width, friction = self._p.rows.width, self._p.rows.friction
        normal = values[:count].reshape(count // width, width)
        shape = (0, 0) if friction is None else friction.shape
        return normal, values[count:].reshape(shape)

    def _of_multipliers(self, m: Array) -> tuple[Array, Array]:
        return self._split(m, self._p.rows.num_multipliers)

    def _of_gaps(self, gaps: Array) -> tuple[Array, Array]:
        return self._split(gaps, self._p.rows.num_rows * self._p.rows.width)

    def forces(self, m: Array) -> Array:
        """F m."""
        normal, tangential = self._of_multipliers(m)
        of_slip = tangential if self._slip is None else _times(self._slip.projector, tangential)
        return _joined(self._normal.forces(normal), of_slip)

    def own_forces(self, gaps: Array) -> Array:
        """F_γ times gaps and slips."""
        gap, jump = self._of_gaps(gaps)
        return _joined(self._normal.own_forces(gap), np.zeros_like(jump))

    def by_gaps(self, gaps: Array) -> Array:
        """D times gaps and slips. Collective."""
        gap, jump = self._of_gaps(gaps)
        if self._slip is None:
            return _joined(self._normal.by_gap(gap), jump)
        of_slip = _times(self._slip.by_slip, jump) + self._limits(gap, None)
        return _joined(self._normal.by_gap(gap), of_slip)

    def by_multipliers(self, m: Array) -> Array:
        """C m. Collective."""
        normal, tangential = self._of_multipliers(m)
        if self._slip is None:
            return _joined(self._normal.by_multiplier(normal), tangential)
        of_slip = _times(self._slip.by_own, tangential) + self._limits(None, normal)
        return _joined(self._normal.by_multiplier(normal), of_slip)

    def _limits(self, gap: Array | None, multiplier: Array | None) -> Array:
        """How rows of τ change by pressures and y_n. Collective."""
        slip = self._slip
        assert slip is not None
        pressure = self._normal.pressure(gap, multiplier)
        out = slip.by_pressure * np.reshape(pressure, (-1, 1))
        if slip.by_trial is None:
            return np.asarray(out)
        trial = self._normal.trial(gap, multiplier)
        return np.asarray(out + slip.by_trial * np.reshape(trial, (-1, 1)))

    def solve(self, r: Array) -> Array:
        """C_γ⁻¹ r."""
        normal, tangential = self._of_multipliers(r)
        out, slip = self._normal.solve(normal), self._slip
        if slip is None:
            return _joined(out, tangential)
        if isinstance(self._normal, _NodalBlocks):
            tangential = tangential - slip.known_by_pressure * out
        return _joined(out, _times(slip.inverse, tangential))

    def condensed(self, gaps: Array) -> Array:
        """−C_γ⁻¹ D times gaps and slips. Collective."""
        gap, jump = self._of_gaps(gaps)
        out, slip = self._normal.condensed(gap), self._slip
        if slip is None:
            return _joined(out, jump)
        pushing = _times(slip.by_slip, jump)
        if isinstance(self._normal, _NodalBlocks):
            pushing = pushing + slip.known_by_pressure * out
        return _joined(out, -_times(slip.inverse, pushing))

    def entries(self) -> Entries:
        """Of S, in the numbers of this pass."""
        return _entries_of(self.stiffness(), isinstance(self._normal, _NodalBlocks))

    def stiffness(self) -> list[tuple[WeightedGap | Slip, Weights]]:
        """Of S the blocks of pass and slip."""
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


def _entries_of(
    stiffness: typing.Sequence[tuple[WeightedGap | Slip, Weights]], coupled: bool
) -> Entries:
    """Of the blocks of a pass, and of its slip, in the numbers of the pass.

    Args:
        stiffness: The blocks.
        coupled: Whether slips are coupled with gaps.
    """
    own = np.asarray(stiffness[0][1]).ravel()
    normal = np.arange(len(own))
    found = [Entries(normal, normal, own)]
    for _, (block, coupling) in stiffness[1:]:
        num, gdim = block.shape[:2]
        rows = len(own) + np.arange(num * gdim).reshape(num, gdim)
        row, column = (np.repeat(rows[:, :, None], gdim, 2), np.repeat(rows[:, None, :], gdim, 1))
        found.append(Entries(row.ravel(), column.ravel(), block.ravel()))
        if coupled:
            found.append(Entries(rows.ravel(), np.repeat(normal, gdim), coupling.ravel()))
    return joined(found)


def _joined(normal: Array, tangential: Array) -> Array:
    return np.concatenate([normal.ravel(), tangential.ravel()])


def _times(blocks: Array, values: Array) -> Array:
    return np.asarray(np.einsum("rij,rj->ri", blocks, values))


def _unless(held: Flags | None) -> Array | float:
    return 1.0 if held is None else (~held).astype(np.float64)
