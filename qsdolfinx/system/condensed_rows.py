"""Constraints whose forces follow from gaps: at points, and of laws that give λ for a gap."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.following import Destination, Mixed
from qsdolfinx.gap.laws import Unilateral
from qsdolfinx.gap.own_rows import OfVertices, OwnRows
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.normal_rows import LEAST_PROXIMAL, Normal, Scales

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Part of the diagonal subtracted in the inexact derivative at points, as compliance, far from a
#: solution: where smooth patches of a node are pressed flat, or many edges meet a facet, there are
#: more multipliers than motions, and almost redundant multipliers would be huge. Near a solution it
#: is LEAST_PROXIMAL; a larger compliance takes more iterations.
PROXIMAL = 1e-5


class CondensedRows:
    """Constraints λ = φ'(ḡ) without unknowns: a penalty, a conductance, or a user's law.

    Forces are Gᵀ W λ, and their derivative is Gᵀ W φ'' G, see ``GapMatrices``.

    Args:
        model: The contact.
        gap: The integration side.
    """

    #: γ (stress per length): y = γ ḡ plus the part of multipliers. It is 1 for laws that are not
    #: evaluated by y.
    gamma = 1.0

    #: Part of the diagonal subtracted in the inexact derivative, as compliance.
    proximal = LEAST_PROXIMAL
    #: Whether the inexact derivative is that far from a solution: λ_h then takes the place of p in
    #: the change of forces; see :attr:`moves`.
    far = False

    def __init__(self, model: ContactModel, gap: WeightedGap) -> None:
        self.model, self.gap = model, gap
        self.scales = Scales.of(model, model.eps * gap.relative_penalty)

    @property
    def moves(self) -> bool:
        """Whether points move on their facets in the inexact derivative, except in their gaps.

        Far from a solution, gaps are differentiated with fixed points; without multipliers, all
        terms are.
        """
        return not self.far or self.has_multipliers

    @property
    def _width(self) -> int:
        return int(self.gap.operator.width)

    @property
    def has_multipliers(self) -> bool:
        """Whether there are multipliers on any rank."""
        return False

    @property
    def num_multipliers(self) -> int:
        """None."""
        return 0

    def first(self) -> Array:
        """None."""
        return np.zeros((0, self._width))

    def evaluate(self, multiplier: Array, first: bool, opened: Flags | None) -> Normal:
        """Evaluate gaps and λ, and which constraints have a λ that varies. Collective."""
        gap = self.gap.state.values
        found = self.gap.multiplier(self.model.eps)
        slope = active_set.slope(self.model, self.gap)
        active = slope > 0
        _check_slope(self.model, slope, found)
        if opened is not None:
            active &= ~opened
        pressure = np.where(active[:, None], found, 0.0)
        trial = self.scales.penalty[:, None] * gap
        return Normal(multiplier, gap, trial, pressure, active, pressure)

    def stiffness(self, at: Normal) -> Array:
        """Stiffness φ''(ḡ) of the constraints (stress per length), (rows, width). Collective."""
        slope = active_set.slope(self.model, self.gap)
        out = np.where(at.active, slope, 0.0)[:, None] * np.ones(self._width)
        condensed = self.gap.condensed
        return out if condensed is None else out * ~condensed

    def by_trial(self) -> Array:
        """Derivative of y by the sum of γ ḡ and multipliers acting on constraints, (rows,)."""
        return self.scales.penalty

    @property
    def part(self) -> float:
        """Part of the multipliers that acts on the constraints."""
        return 1.0

    def at_points(self, multiplier: Array) -> Array:
        """Multipliers at the constraints (stress), (rows, width). Collective."""
        return np.zeros((self.gap.num_rows, self._width))

    def seen(self, multiplier: Array) -> Array:
        """Multipliers acting on the constraints (stress), (rows, width). Collective."""
        return self.part * self.at_points(multiplier)

    def gathered(self, values: Array) -> Array:
        """Transposed of :meth:`at_points`, times areas, applied to values (rows,). Collective."""
        return np.zeros((0, self._width))

    @property
    def areas(self) -> Array:
        """Area of each multiplier, in the shape of the multipliers. Collective."""
        return np.zeros((0, self._width))

    def residual(self, at: Normal) -> Array:
        """None."""
        return np.zeros((0, self._width))

    def in_forces(self) -> Array:
        """Of nothing."""
        return np.zeros(0)

    def stress(self, at: Normal, forces: Array) -> Array:
        """Of nothing."""
        return forces

    def open_gap(self, at: Normal) -> float:
        """Zero: multipliers close no gap."""
        return 0.0

    def known(self, multiplier: Array) -> Array:
        """As it is."""
        return self.gap.state.augmented

    def keep(self, at: Normal) -> None:
        """Do nothing: the state is the gap."""

    def softened(self, at: Normal) -> Array:
        """Of nothing."""
        return np.zeros(0)

    def rounding(self) -> float:
        """Largest factor from gaps to stress on this rank."""
        return self.scales.largest()


def _check_slope(model: ContactModel, slope: Array, pressure: Array) -> None:
    """Raise an error for slopes of a history law by which loaded constraints would be inactive.

    Collective.

    Raises:
        ValueError: If there are such slopes on any rank.
    """
    if not model.law.memory:
        return
    lost = ~(slope > 0) & np.any(pressure != 0, axis=1)
    text = (
        "law: slope must be positive where the multiplier is not 0; if that falls or stays "
        "constant as the gap grows, return the secant multiplier/gap"
    )
    with collective_errors(model.comm):
        require(not (lost.any() or np.any(slope < 0)), text)


class PointConstraints(CondensedRows):
    """Unilateral contact at points, with multipliers at nodes.

    With λ_h = Σ_k N_k λ_k, the automatic penalty γ, a = 1, and the weights w_p of the points,

        y_p = a λ_h + γ g_p,   p_p = [y_p]₊,   (R_λ)_k = a Σ_p w_p N_k (p_p − λ_h)/γ,

    and forces are Σ_p w_p p_p ∂g_p/∂u: the derivatives of Σ_p w_p/(2γ) ([y_p]₊² − a λ_h²). A
    penalty ε is the compliance λ_h/ε, y_p = λ_h + γ (g_p − λ_h/ε), so that a = 1 − γ/ε; a penalty
    that is about as soft as the bodies has γ = ε and no multipliers. A user's law has p_p =
    φ'(y_p/γ). A node has a multiplier for each of its smooth patches. Multipliers that are
    redundant because of conditions on both sides, or whose support is hardly covered by points, are
    condensed: they have the mean of their neighbours, λ = E λ_free, and R_λ belongs to λ_free. A
    vertex of a tool has one multiplier: N is then the identity.

    Arguments as for :class:`CondensedRows`; the constraints are at points.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap) -> None:
        super().__init__(model, gap)
        self._is_unilateral = type(gap.law) is Unilateral
        self.gamma: float = model.eps
        self._is_soft = False
        self._has: bool = model.has_multipliers_at_points
        #: E, or None where λ_free is all of λ; and the smooth patches of owned nodes whose
        #: multipliers are unknowns, (nodes, block), or the vertices of a tool, (vertices, 1).
        self.extension: Extension | None
        self.free: Flags
        self.extension, self.free = self._found()
        if gap.following is not None and gap.own is None:
            gap.following.least_cover = self._points.least_cover(self.extension)

    def _found(self) -> tuple[Extension | None, Flags]:
        """E, and the patches with free multipliers, at the last evaluation. Collective."""
        if self.gap.own is not None:
            return None, self._free_vertices(self.gap.own) & self._has
        covered = self._points.covered
        extension = self._points.extended(self.gap.extension)
        held = np.zeros_like(covered) if extension is None else extension.held
        return extension, covered & ~held & self._has

    def _free_vertices(self, own: OwnRows) -> Flags:
        """Vertices of a tool that do not face nodes held on both sides, (vertices, 1). Collective.

        Args:
            own: Multipliers of the vertices.
        """
        return np.asarray(self._held_part(own) < 1 - SOLVED)

    def _held_part(self, own: OwnRows) -> Array:
        """Part of the functions at a tool's vertices of nodes held on both sides. Collective.

        Args:
            own: Multipliers of the vertices.

        Returns:
            The parts, (vertices, 1).
        """
        held, out = self.gap.extension, np.zeros((own.num_multipliers, 1))
        if held is not None:
            of_points = self._points.from_sides(held.held.astype(np.float64))
            out[:, 0] = own.from_rows(of_points)
        return out

    def has_others(self) -> bool:
        """Whether other patches have multipliers after an update of the geometry. Collective.

        Or whether patches in contact have lost so much of their cover that points without a partner
        reduce their multipliers.
        """
        if self.gap.following is None or not self._has:
            return False
        if not np.array_equal(self._found()[1], self.free):
            return True
        if self.gap.own is not None:
            return False
        paired, area = self._points.paired, self._points.area_of_sides
        lost = (paired > ROUNDING * area) & (paired < self.gap.following.least_cover)
        return bool(np.any(lost if self.extension is None else lost & ~self.extension.filled))

    @property
    def _points(self) -> PointRows:
        """The points; with updated geometry they are others at each evaluation."""
        assert isinstance(self.gap.rows, PointRows)
        return self.gap.rows

    @property
    def _penalty(self) -> Array:
        """Penalty ε of the points, as the argument of a user's law."""
        return np.full(self.gap.num_rows, self.model.eps)

    @property
    def can_soften(self) -> bool:
        """Whether the penalty can be a softer one: not with a law of the user."""
        return self._is_unilateral

    def soften(self, part: float) -> None:
        """Use a penalty of this part of the automatic one, if it is softer; 1 ends this.

        With multipliers, γ is a half of this penalty ε, and a is ½: then λ_h is ε times the mean
        gap, for an augmented Lagrangian, too.
        """
        self._is_soft = part < 1
        self.gamma = self.model.eps
        if self._is_soft:
            usual = self.model.penalty.of_points or self.model.eps
            soft = min(self.model.eps, part * usual)
            self.gamma = soft / 2 if self._has else soft

    @property
    def part(self) -> float:
        """The factor a of λ_h in y_p."""
        if self._is_soft:
            return 0.5 if self._has else 0.0
        return 1.0 if self.model.augmented else 1 - self.gamma / self.model.penalty.eps

    @property
    def has_multipliers(self) -> bool:
        """Whether there are multipliers on any rank."""
        return self._has

    @property
    def num_multipliers(self) -> int:
        """Unknowns λ on this rank."""
        return int(np.count_nonzero(self.free))

    def _spread(self, multiplier: Array) -> Array:
        """λ_free, and 0 where λ is no unknown, in the shape of ``free``."""
        out = np.zeros(self.free.shape)
        out[self.free] = multiplier[:, 0]
        return out

    def on_sides(self, multiplier: Array) -> Array:
        """Multipliers E λ_free at all smooth patches of owned nodes, (nodes, block). Collective.

        Those of vertices of a tool are shown by means.
        """
        out, points = self._spread(multiplier), self._points
        if self.gap.own is not None:
            sums, cover = points.sums(self.gap.own.at_rows(out)[:, 0]), points.cover_of_sides
            return np.divide(sums, cover, out=np.zeros_like(sums), where=points.covered)
        return out if self.extension is None else self.extension.fill(out)

    def at_points(self, multiplier: Array) -> Array:
        """Multiplier λ_h at the points, (points, 1). Collective."""
        if not self._has:
            return np.zeros((self.gap.num_rows, 1))
        if self.gap.own is not None:
            return self.gap.own.at_rows(self._spread(multiplier))
        return self._points.from_sides(self.on_sides(multiplier))[:, None]

    def gathered(self, values: Array) -> Array:
        """Eᵀ Nᵀ W applied to values at points, in the shape of λ_free. Collective."""
        if self.gap.own is not None:
            return np.asarray(self.gap.share * self.gap.own.sums(values)[:, None][self.free, None])
        sums = self.gap.share * self._points.sums(values)
        if self.extension is not None:
            sums = self.extension.gather(sums)
        return np.asarray(sums[self.free][:, None])

    @property
    def areas(self) -> Array:
        """Area of each multiplier in λ_free, in the shape of λ_free. Collective."""
        return self.gathered(np.ones(self.gap.num_rows))

    # --- Evaluation

    def first(self) -> Array:
        """First guess of λ, from the last solve. Collective."""
        known = self.gap.state.augmented
        if self.gap.own is not None:
            known = self.gap.own.from_rows(self.gap.augmented_at_rows)
        return np.asarray(known[self.free][:, None] / self.part)

    def evaluate(self, multiplier: Array, first: bool, opened: Flags | None) -> Normal:
        """Evaluate gaps and y at the points, and find the active points. Collective."""
        gap = self.gap.state.values
        trial = self.seen(multiplier) + self.gamma * gap
        pressure, active = trial, trial[:, 0] > 0
        if not self._is_unilateral:
            shifted = np.asarray(trial / self.gamma, dtype=np.float64)
            pressure = self.gap.multiplier_of(shifted, self._penalty)
            slope = self._slope(trial)
            _check_slope(self.model, slope, pressure)
            active = slope > 0
        else:
            if first:
                active |= trial[:, 0] >= -self.gamma * self.model.paired.touching
                active = self._kept_closed(active, trial[:, 0])
            # Nothing is opposite the last points: if they were active, as points of nodes that were
            # covered before, nothing would determine the multipliers of these nodes.
            active[len(active) - self.gap.num_alone :] = False
        if opened is not None:
            active &= ~opened
        pressure = np.where(active[:, None], pressure, 0.0)  # active points may have tension
        return Normal(multiplier, gap, trial, pressure, active, pressure)

    def _slope(self, trial: Array) -> Array:
        """Slope φ'' of the user's law (stress per length), (points,). Collective."""
        shifted = np.asarray(trial / self.gamma, dtype=np.float64)
        return self.gap.slope_of(shifted, self._penalty, self.model.paired.touching)

    def _kept_closed(self, active: Flags, trial: Array) -> Flags:
        """Add points of nodes that were mostly active, and at least one point of each active node.

        Collective.
        """
        known = self.gap.state.closed
        if known is None:
            return active
        # Points start active where most of the covered support of the nodes beside them is active.
        active = active | (self._points.from_sides(known) > 0.5)
        none = self._points.sums(active.astype(np.float64)) <= 0
        lost = (known > 0) & none & self._points.covered
        if not self.model.comm.allreduce(bool(lost.any()), op=MPI.LOR):
            return active
        deepest = self._points.largest_of_sides(trial)
        level = self._points.least_from_sides(np.where(lost, deepest, np.inf))
        return np.asarray(active | (trial >= level))

    def residual(self, at: Normal) -> Array:
        """Residual R_λ. Collective."""
        change = at.pressure - self.at_points(at.multiplier)
        return np.asarray(self.part / self.gamma * self.gathered(change[:, 0]))

    def in_forces(self) -> Array:
        """γ, or more at a tool's vertex that faces nodes held on both sides. Collective.

        To close its gap, the other nodes move by more than the gap: by 1/(1 − the held part) of it.
        """
        out = np.full(self.num_multipliers, self.gamma)
        if self.gap.own is not None:
            out /= (1 - self._held_part(self.gap.own))[self.free]
        return out

    def stress(self, at: Normal, forces: Array) -> Array:
        """Mean stress, or stress of the mean gaps in the stiffest body. Collective."""
        return np.asarray(max(self.scales.largest() / self.gamma, 1.0) * forces / self.areas)

    def open_gap(self, at: Normal) -> float:
        """Largest mean gap on this rank. Collective."""
        return float(np.max(np.abs(self.residual(at) / self.areas), initial=0.0))

    def known(self, multiplier: Array) -> Array:
        """Multipliers of all patches times a, from which the law gives p by γ. Collective."""
        return self.part * self.on_sides(multiplier)

    def keep(self, at: Normal) -> None:
        """Store λ, and the active part of each smooth patch, in the gap. Collective."""
        state, cover = self.gap.state, self._points.cover_of_sides
        if self._has:
            some = self.model.comm.allreduce(bool(at.active.any()), op=MPI.LOR)
            # Where nothing is active, λ is rounding, and the next solve starts without multipliers.
            known = at.multiplier if some else 0.0 * at.multiplier
            state.augmented, own = self.known(known), self.gap.own
            if own is not None:
                values = self.part * self._spread(known)
                state.of_vertices = OfVertices(state.augmented, own.vertex, values)
        closed = self._points.sums(at.active.astype(np.float64))
        state.closed = np.divide(closed, cover, out=np.zeros_like(cover), where=cover > 0)

    # --- Derivative

    def stiffness(self, at: Normal) -> Array:
        """Stiffness γ at active points. Collective."""
        if not self._is_unilateral:
            slope = self._slope(at.trial)
            return np.asarray(np.where(at.active, slope, 0.0)[:, None])
        return np.asarray(self.gamma * at.active[:, None])

    def constant_pressure(self, at: Normal) -> Array:
        """Pressures in the change of forces at constant p_p, (points,). Collective."""
        found = at.pressure[:, 0]
        if self.far and self._has:
            found = np.where(at.active, np.clip(self.at_points(at.multiplier)[:, 0], 0.0, found), 0)
        return found

    def add_curvature(self, at: Normal, to: Destination) -> None:
        """Add the change of forces at constant p_p, for updated geometry. Collective."""
        self.gap.add_curvature_of_points(self.constant_pressure(at), self.moves, to)

    def rest(self, at: Normal) -> Array:
        """r_p of the terms Σ_p w_p N_k r_p of R_λ, (points,). Collective."""
        change = at.pressure - self.at_points(at.multiplier)
        return np.asarray(self.part / self.gamma * change[:, 0])

    def mixed(self, at: Normal) -> Mixed | None:
        """Change of R_λ with the facets at constant r_p; None if constant. Collective.

        Args:
            at: The points, at the last evaluation.
        """
        if not self._has or self.gap.following is None:
            return None
        return self.gap.mixed(self.rest(at))

    def softened(self, at: Normal) -> Array:
        """See ``NormalRows``. Collective.

        The compliance of a tool's vertex that faces almost only held nodes falls with the square of
        the part of the functions that is not held; so does what is subtracted. A constant would be
        larger than the compliance, and an iteration would close 1 % of the gap.
        """
        out = -self.proximal / self.gamma * self.areas
        if self.gap.own is not None:
            out = out * (1 - self._held_part(self.gap.own))[self.free, None] ** 2
        return np.asarray(out.ravel())
