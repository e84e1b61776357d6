"""Constraints of λ at nodes: pressure and gap, ties, a user's law."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.filled import OF_PRESSURE
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Compliance of active constraints in the inexact derivative, over that of the stiffest body. With
#: it, redundant multipliers get the smallest change, such as those of a node in two contacts with
#: one plane; with much more, the last iterations converge slowly.
LEAST_PROXIMAL = 1e-10

#: Limits of penalty over the stiffness of the bodies for the factors. Above the first, factors use
#: the first limit times this stiffness in place of the penalty. With an augmented Lagrangian, they
#: use the second limit times this stiffness below the second.
USUAL, LEAST = 100.0, 5.0


class Normal(typing.NamedTuple):
    """Constraints of λ at given unknowns.

    Attributes:
        multiplier: λ, stress, (multipliers, width).
        gap: Gap ḡ* = ḡ − λ/ε (length), (rows, width).
        trial: Trial value y_n = λ + c_n ḡ* (stress), (rows, width).
        image: Value that λ has if the constraints are met: [y_n]₊ (stress), (rows, width).
        active: Constraints with y_n > 0; all constraints for a law of the whole relative
            displacement.
        pressure: Stress from which the forces of the gaps are computed, (rows, width): λ, or at
            points [λ_h + γ g]₊.
        held: Components of λ that conditions constrain on both sides; None if no rank has any.
        means: λ̄ of these components, of the same shape; 0 where they are inactive.
        bears: Active ones of these components, with λ̄ + c_n ḡ > 0, of the same shape.
    """

    multiplier: Array
    gap: Array
    trial: Array
    image: Array
    active: Flags
    pressure: Array
    held: Flags | None = None
    means: Array | None = None
    bears: Flags | None = None


class Scales(typing.NamedTuple):
    """Scaling factors of constraints.

    Attributes:
        penalty: Penalty ε of each constraint (stress per length).
        usual: Ratio of a usual penalty to the given penalty, used in factors if the latter is far
            from usual.
        soft: Such a ratio for the smallest compliance in the matrix of a linear solver.
        stiffest: Factor from gaps to stress of the stiffest body, (rows,).
        compliance: 1/ε; 0 for an augmented Lagrangian, (rows,).
        proximal: Compliance of active constraints in the inexact derivative, (rows,).
    """

    penalty: Array
    usual: float
    soft: float
    stiffest: Array
    compliance: Array
    proximal: Array

    @classmethod
    def of(cls, model: ContactModel, penalty: Array) -> Scales:
        """Scaling factors of the constraints of a contact.

        Args:
            model: The contact.
            penalty: Penalty ε of each constraint.
        """
        exact, ratio = model.augmented, model.stiffness_ratio
        stiffest = max((k for k in model.penalty.stiffness if k < np.inf), default=0.0)
        of_bodies: Array = np.maximum(penalty, stiffest)
        usual = min(1.0, USUAL / ratio) if ratio > 0 else 1.0
        if exact and ratio > 0:  # the result does not depend on the penalty
            usual = max(usual, LEAST / ratio)
        soft = LEAST / ratio if ratio > 0 else 1.0
        soft = soft if exact else min(soft, 1.0)
        compliance: Array = np.full_like(penalty, 0.0 if exact else np.inf)
        if not exact:  # a conductance may be 0
            np.divide(1.0, penalty, out=compliance, where=penalty > 0)
        proximal: Array = np.asarray(exact * LEAST_PROXIMAL / of_bodies)
        return cls(penalty, usual, soft, of_bodies, compliance, proximal)

    @property
    def softness(self) -> Array:
        """Compliance of the usual penalty, (rows,)."""
        return np.asarray(1 / (self.soft * self.penalty))

    def usual_compliance(self, closed: Flags) -> Array:
        """Compliance missing in active constraints compared with the usual penalty, (rows,)."""
        return np.asarray(closed * np.maximum(self.softness - self.compliance, 0.0))

    def largest(self, *factors: Array) -> float:
        """Largest factor from gaps to stress on this rank, among given factors and the bodies."""
        return max(float(np.max(f, initial=0.0)) for f in (self.stiffest, *factors))


class NormalRows(typing.Protocol):
    """Constraints of λ of an integration side: at nodes, or at points.

    Attributes:
        model: The contact.
        gap: The integration side.
        scales: Scaling factors of its constraints.
        num_multipliers: Number of unknowns on this rank.
    """

    model: ContactModel
    gap: WeightedGap
    scales: Scales

    @property
    def num_multipliers(self) -> int:
        """Number of unknowns on this rank."""

    def first(self) -> Array:
        """First guess of the multipliers, in their shape. Collective."""

    def evaluate(self, multiplier: Array, first: bool, opened: Flags | None) -> Normal:
        """Evaluate the constraints for the last evaluation of gaps. Collective.

        Args:
            multiplier: λ.
            first: Whether constraints that were active count as active.
            opened: Constraints that count as inactive; none by default.
        """

    def residual(self, at: Normal) -> Array:
        """Residual R_λ, area times length, in the shape of the multipliers. Collective."""

    def in_forces(self) -> Array:
        """Factors from R_λ to forces, (unknowns,)."""

    def stress(self, at: Normal, forces: Array) -> Array:
        """Stress of forces by which complementarity is violated. Collective."""

    def open_gap(self, at: Normal) -> float:
        """Largest gap (length) on this rank that multipliers have to close. Collective."""

    def known(self, multiplier: Array) -> Array:
        """Convert λ to the format stored in the gap. Collective."""

    def keep(self, at: Normal) -> None:
        """Store λ in the gap. Collective."""

    def softened(self, at: Normal) -> Array:
        """Diagonal terms that make the inexact derivative regular, (unknowns,)."""

    def rounding(self) -> float:
        """Largest factor from gaps to stress on this rank."""


class NodalRows:
    """Constraints R_λ = W/c_n ([λ + c_n ḡ*]₊ − λ), ḡ* = ḡ − λ/ε; see :class:`ConstraintRows`.

    Args:
        model: The contact.
        gap: The integration side; its constraints are at nodes.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap) -> None:
        self.model, self.gap = model, gap
        self.scales = Scales.of(model, model.eps * gap.relative_penalty)
        self._c: Array = 1 / OF_PRESSURE * self.scales.usual * self.scales.penalty

    @property
    def _width(self) -> int:
        return int(self.gap.operator.width)

    @property
    def num_multipliers(self) -> int:
        """Number of unknowns: one for each component of each constraint."""
        return self.gap.num_rows * self._width

    def first(self) -> Array:
        """First guess of λ: known values, elsewhere ε [ḡ]₊ of the last evaluation. Collective."""
        known, gap = self.gap.state.augmented, self.gap
        new = gap.multiplier_of(gap.state.values, self.scales.penalty)
        return np.where(known == 0, new, known)

    def evaluate(self, multiplier: Array, first: bool, opened: Flags | None) -> Normal:
        """See ``NormalRows``."""
        gap = self.gap.state.values - self.scales.compliance[:, None] * multiplier
        trial = multiplier + self._c[:, None] * gap
        active = self._active(multiplier, trial, first)
        if opened is not None:
            active &= ~opened
        image = np.where(active[:, None], trial, 0.0)
        at = Normal(multiplier, gap, trial, image, active, multiplier)
        return self._with_means(at)

    def _active(self, multiplier: Array, trial: Array, first: bool) -> Flags:
        """Constraints with y_n > 0; in the first iteration also with λ > 0 or touching, (rows,)."""
        active: Flags = trial[:, 0] > 0
        if first:
            near = trial[:, 0] >= -self._c * self.model.paired.touching
            active |= (multiplier[:, 0] > 0) | near
        return active

    def _with_means(self, at: Normal) -> Normal:
        """Add the components constrained on both sides, and their λ̄. Collective."""
        extension = self.gap.extension
        if extension is None:
            return at
        means = extension.means(at.multiplier)
        bears = self._bears(means)
        return at._replace(held=extension.held, means=np.where(bears, means, 0.0), bears=bears)

    def _bears(self, means: Array) -> Flags:
        """Components with λ̄ + c_n ḡ > 0, (rows, width)."""
        return np.asarray(means + self._c[:, None] * self.gap.state.values > 0)

    def entries_of_means(self, at: Normal, numbers: Indices) -> tuple[Indices, Indices, Array]:
        """Derivative of W/c_n λ̄ by λ: rows, columns and values. Collective.

        Args:
            at: The evaluated constraints.
            numbers: Numbers of λ in z, in the shape of λ.
        """
        extension = self.gap.extension
        assert extension is not None and at.bears is not None
        factor = np.repeat((self.gap.weight / self._c)[:, None], self._width, axis=1)
        return extension.entries(numbers, np.where(at.bears, factor, 0.0))

    def residual(self, at: Normal) -> Array:
        """See ``NormalRows``."""
        rows = self._unmet(at)
        if at.held is None or at.means is None:
            return rows
        held = (self.gap.weight / self._c)[:, None] * (at.means - at.multiplier)
        return np.where(at.held, held, rows)

    def _unmet(self, at: Normal) -> Array:
        """R_λ of constraints that are not redundant, (rows, width)."""
        return np.asarray((self.gap.weight / self._c)[:, None] * (at.image - at.multiplier))

    def in_forces(self) -> Array:
        """Factors c_n, for which forces are continuous where active sets change."""
        return np.repeat(self._c, self._width)

    def stress(self, at: Normal, forces: Array) -> Array:
        """Stress of violated constraints; for active ones ε ḡ*, or that in the stiffest body."""
        factor = np.where(at.active, np.maximum(self.scales.stiffest / self._c, 1.0), 1.0)
        return np.asarray(forces / self.gap.weight[:, None] * factor[:, None])

    def open_gap(self, at: Normal) -> float:
        """Largest gap of active constraints; 0 with a penalty."""
        if not self.model.augmented:
            return 0.0
        gaps = np.where(at.active[:, None], np.abs(at.gap), 0.0)
        if at.held is not None:
            gaps = np.where(at.held, 0.0, gaps)
        return float(np.max(gaps, initial=0.0))

    def known(self, multiplier: Array) -> Array:
        """Multipliers λ, unchanged: the gap stores them in this format."""
        return multiplier

    def keep(self, at: Normal) -> None:
        """See ``NormalRows``."""
        self.gap.state.augmented = np.where(at.active[:, None], at.multiplier, 0.0)

    def derivative(self, at: Normal, exact: bool) -> tuple[Array, Array]:
        """Derivatives of R_λ by ḡ (area), and by λ of the same constraint, (rows, width) each.

        Args:
            at: The evaluated constraints.
            exact: As for ``ConstraintRows.derivative``.
        """
        weight, width = self.gap.weight, self._width
        by_gap, own = self._slopes(at)
        if not exact:
            own = own - weight * at.active * self.scales.proximal
        by_gap, own = (np.repeat(part[:, None], width, axis=1) for part in (by_gap, own))
        if at.held is not None:
            by_gap = np.where(at.held, 0.0, by_gap)
            own = np.where(at.held, -(weight / self._c)[:, None], own)
        return by_gap, own

    def _slopes(self, at: Normal) -> tuple[Array, Array]:
        """Derivatives for constraints that are not redundant, (rows,) each. Collective."""
        weight, compliance = self.gap.weight, self.scales.compliance
        own = (weight / self._c) * (at.active * (1 - self._c * compliance) - 1)
        return weight * at.active, own

    def by_trial(self) -> tuple[Array, Array]:
        """Derivatives of y_n by ḡ and λ, (rows,) each."""
        return self._c, 1 - self._c * self.scales.compliance

    def softened(self, at: Normal) -> Array:
        """See ``NormalRows``."""
        normal = -self.gap.weight * at.active * self.scales.proximal
        rows = np.repeat(normal[:, None], self._width, axis=1)
        if at.held is not None:
            rows = np.where(at.held, 0.0, rows)
        return np.asarray(rows.ravel())

    def scale(self, at: Normal) -> Array:
        """Factors from R_λ to forces: c, or the usual penalty if active, (rows,)."""
        return np.where(at.active, 1 / self.scales.softness, self._c)

    def usual_compliance(self, at: Normal) -> Array:
        """Compliance missing in active constraints compared with the usual penalty, (rows,)."""
        return self.scales.usual_compliance(at.active)

    def rounding(self) -> float:
        """See ``NormalRows``."""
        return self.scales.largest(self._c)


class TieRows(NodalRows):
    """Constraints of a tie, R_λ = W ḡ*, which are all active.

    Arguments as for :class:`NodalRows`.
    """

    def first(self) -> Array:
        """First guess of λ: known values."""
        return np.asarray(self.gap.state.augmented + 0.0)

    def _active(self, multiplier: Array, trial: Array, first: bool) -> Flags:
        """All constraints."""
        return np.ones(self.gap.num_rows, dtype=bool)

    def _bears(self, means: Array) -> Flags:
        """All components."""
        return np.ones(means.shape, dtype=bool)

    def _unmet(self, at: Normal) -> Array:
        """R_λ of constraints that are not redundant, (rows, width)."""
        return np.asarray(self.gap.weight[:, None] * at.gap)

    def _slopes(self, at: Normal) -> tuple[Array, Array]:
        """Derivatives for constraints that are not redundant, (rows,) each. Collective."""
        weight = self.gap.weight
        return weight * at.active, -weight * self.scales.compliance


class AugmentedLawRows(NodalRows):
    """Constraints of a user's law with multipliers: R_λ = W/ε (φ'(ḡ + λ/ε) − λ).

    Arguments as for :class:`NodalRows`.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap) -> None:
        super().__init__(model, gap)
        self._c = self.scales.penalty

    def evaluate(self, multiplier: Array, first: bool, opened: Flags | None) -> Normal:
        """See ``NormalRows``."""
        at = super().evaluate(multiplier, first, opened)
        image = self.gap.multiplier_of(at.trial / self._c[:, None], self._c)
        active = self._slope(at.trial) > 0
        if opened is not None:
            active &= ~opened
        return at._replace(image=np.where(active[:, None], image, 0.0), active=active)

    def _unmet(self, at: Normal) -> Array:
        """R_λ of constraints that are not redundant, (rows, width)."""
        return np.asarray((self.gap.weight / self._c)[:, None] * (at.image - at.multiplier))

    def open_gap(self, at: Normal) -> float:
        """Largest difference of gaps of active constraints from those that the law gives."""
        unmet = np.where(at.active[:, None], at.image - at.multiplier, 0.0) / self._c[:, None]
        return float(np.max(np.abs(unmet), initial=0.0))

    def _slope(self, trial: Array) -> Array:
        """Slope φ'' of the law (stress per length), (rows,). Collective."""
        shifted = np.asarray(trial / self._c[:, None], dtype=np.float64)
        return self.gap.slope_of(shifted, self._c, self.model.paired.touching)

    def _slopes(self, at: Normal) -> tuple[Array, Array]:
        """Derivatives for constraints that are not redundant, (rows,) each. Collective."""
        part = at.active * self._slope(at.trial) / self._c
        weight = self.gap.weight
        return np.asarray(weight * part), np.asarray(weight * (part - 1) / self._c)


class AugmentedTieRows(AugmentedLawRows, TieRows):
    """Constraints of a user's law of the whole relative displacement with multipliers.

    Arguments as for :class:`NodalRows`.
    """
