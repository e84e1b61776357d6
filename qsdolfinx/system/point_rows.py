"""Constraints of a pass whose law is asked at points, and whose multipliers belong to nodes."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.extension import Extension
from qsdolfinx.gap.laws import Unilateral
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.constraint_rows import Evaluated, Multipliers
from qsdolfinx.system.law_rows import CondensedRows

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Part of the area of a side of a node below which what covers it determines no multiplier.
LEAST_COVER = 0.1

#: Part of the diagonal by which the inexact derivative is softer: where sides of a node are pressed
#: flat, their multipliers are more than there are motions.
PROXIMAL = 1e-8

#: Closed part of what a node covers from which on points beside it begin closed.
MOST = 0.5


class PointConstraints(CondensedRows):
    """Rows of λ and τ of a pass whose gaps are those of points.

    With λ_h = Σ_k N_k λ_k, γ the penalty, and w_p the weights of the points,

        y_p = λ_h + γ g_p,   p_p = [y_p]₊,   (R_λ)_k = Σ_p w_p N_k (p_p − λ_h)/γ,

    and forces are Σ_p w_p p_p ∂g_p/∂u: the derivatives of Σ_p w_p/(2γ) ([y_p]₊² − λ_h²). Without
    multipliers, of a penalty, y_p = ε g_p. A user's law has p_p = φ'(y_p/γ). A node has a
    multiplier for each of its smooth sides; what conditions hold on both sides or points hardly
    cover has the mean of its neighbours, λ = E λ_free, and R_λ is of λ_free. Friction is at nodes,
    its pressure the mean of p_p.

    Args:
        model: The contact.
        gap: The pass; its rows are points.
        slip: Its slip; None without friction.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        super().__init__(model, gap, slip)
        assert isinstance(gap.rows, PointRows)
        self._points: PointRows = gap.rows
        self._share = gap.share
        #: Σ_p w_p N_k of owned nodes, shape (nodes,).
        self.cover: Array = gap.rows.cover
        self._is_unilateral = type(gap.law) is Unilateral
        #: γ, stress per length.
        self.gamma: float = model.eps
        covered = self._points.covered
        #: E; None where λ_free is all of λ.
        self.extension: Extension | None = self._extended(gap.extension)
        none = np.zeros_like(covered)
        held = none if self.extension is None else self.extension.held
        #: Sides of owned nodes whose multipliers are unknowns, (nodes, block).
        self.free: Flags = covered & ~held
        if not model.augmented:
            self.free = none

    def _extended(self, held: Extension | None) -> Extension | None:
        """Of what is held and of what is hardly covered beside something that is more. Collective.

        Args:
            held: Of what conditions hold on both sides.
        """
        points = self._points
        hardly = points.covered & (points.cover_of_sides < LEAST_COVER * points.area_of_sides)
        found = points.extension(hardly, hardly, held)
        if found is None or found is held:
            return held
        hardly = hardly & found.filled
        return points.extension(hardly, hardly, held)

    def soften(self, part: float) -> None:
        """Take this part of the penalty for γ, if there are multipliers: λ means the same."""
        if self.model.augmented:
            self.gamma = part * self.model.eps

    @property
    def num_multipliers(self) -> int:
        """Unknowns λ on this rank."""
        return int(np.count_nonzero(self.free))

    def on_sides(self, normal: Array) -> Array:
        """E λ_free at all sides of owned nodes, (nodes, block). Collective."""
        out = np.zeros(self.free.shape)
        out[self.free] = normal[:, 0]
        return out if self.extension is None else self.extension.fill(out)

    def gathered(self, values: Array) -> Array:
        """Eᵀ Nᵀ W of values of the points, of the shape of λ_free. Collective."""
        sums = self._share * self._points.sums(values)
        if self.extension is not None:
            sums = self.extension.gather(sums)
        return np.asarray(sums[self.free][:, None])

    @property
    def areas(self) -> Array:
        """Area of each of λ_free, of its shape. Collective."""
        return self.gathered(np.ones(self.num_rows))

    # --- Evaluation

    def first(self) -> Multipliers:
        """What is known of λ and τ."""
        normal = self.gap.state.augmented[self.free][:, None]
        if self.slip is None:
            return Multipliers(normal, None)
        return Multipliers(normal, self.slip.turned(self.slip.state.augmented))

    def seen(self, normal: Array) -> Array:
        """λ_h at the points, (points, 1). Collective."""
        if not self.model.augmented:
            return np.zeros((self.num_rows, 1))
        return self._points.from_sides(self.on_sides(normal))[:, None]

    def _normal(self, at: Multipliers, first: bool) -> tuple[Array, Array, Flags]:
        """Gaps and y of the points, and which are closed. Collective."""
        gap = self.gap.state.values
        trial = self.seen(at.normal) + self.gamma * gap
        if not self._is_unilateral:
            return gap, trial, self._slope(trial) > 0
        active = trial[:, 0] > 0
        if first:
            active |= trial[:, 0] >= -self.gamma * self.model.paired.touching
            active = self._kept_closed(active, trial[:, 0])
        return gap, trial, active

    def _kept_closed(self, active: Flags, trial: Array) -> Flags:
        """With points that were closed by the most, and one at least of each such node.

        Collective.
        """
        known = self.gap.state.closed
        if known is None:
            return active
        active = active | (self._points.from_sides(known) > MOST)
        none = self._points.sums(active.astype(np.float64)) <= 0
        lost = (known > 0) & none & self._points.covered
        if not self.model.comm.allreduce(bool(lost.any()), op=MPI.LOR):
            return active
        deepest = self._points.largest_of_sides(trial)
        level = self._points.least_from_sides(np.where(lost, deepest, np.inf))
        return np.asarray(active | (trial >= level))

    def _pressure(self, at: Multipliers, trial: Array, active: Flags) -> Array:
        """P of the points, (points, 1); what is closed for once may pull. Collective."""
        if not self._is_unilateral:
            with collective_errors(self.model.comm):  # it is the user's
                shifted = np.asarray(trial / self.gamma, dtype=np.float64)
                trial = self.gap.law.multiplier(shifted, self._eps)
        return np.where(active[:, None], trial, 0.0)

    def _slope(self, trial: Array) -> Array:
        """φ'' of the user's law (stress per length), (points,). Collective."""
        with collective_errors(self.model.comm):
            touching = self.model.paired.touching
            shifted = np.asarray(trial / self.gamma, dtype=np.float64)
            return self.gap.law.slope(shifted, self._eps, touching)

    def _normal_residual(self, at: Evaluated) -> Array:
        """R_λ. Collective."""
        change = at.pressure - self.seen(at.multipliers.normal)
        return np.asarray(self.gathered(change[:, 0]) / self.gamma)

    def _normal_in_forces(self) -> Array:
        """γ."""
        return np.full(self.num_multipliers, self.gamma)

    def _of_gaps(self, at: Evaluated, forces: Array) -> Array:
        """Stress of forces by which complementarity of pressure and gap is violated."""
        factor = max(float(np.max(self._stiffest, initial=0.0)) / self.gamma, 1.0)
        return factor * forces / self.areas

    def open_gap(self, at: Evaluated) -> float:
        """Gap (length) that multipliers are to close: the largest mean on this rank. Collective."""
        return float(np.max(np.abs(self._normal_residual(at) / self.areas), initial=0.0))

    def keep(self, at: Evaluated) -> None:
        """Let the pass know λ, and what of each side is closed. Collective."""
        state = self.gap.state
        if self.model.augmented:
            state.augmented = self.on_sides(at.multipliers.normal)
        closed = self._points.sums(at.active.astype(np.float64))
        cover = self._points.cover_of_sides
        state.closed = np.divide(closed, cover, out=np.zeros_like(cover), where=cover > 0)

    # --- Derivative

    def stiffness(self, at: Evaluated) -> Array:
        """γ where points are closed. Collective."""
        if not self._is_unilateral:
            return np.asarray(np.where(at.active, self._slope(at.trial), 0.0)[:, None])
        return np.asarray(self.gamma * at.active[:, None])

    def _normal_softened(self, at: Evaluated) -> Array:
        return np.asarray((-PROXIMAL / self.gamma * self.areas).ravel())
