"""Rows of a pass whose law gives the multiplier for a gap: a conductance, or a user's own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.contact import active_set
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated, Multipliers

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


class CondensedRows(ConstraintRows):
    """Rows whose forces gaps make themselves: Gᵀ W λ(ḡ, …), whatever multipliers there are.

    Args:
        model: The contact.
        gap: The pass.
        slip: Its slip; None without friction.
    """

    #: What turns the gaps in what derivatives are by: γ.
    gamma = 1.0

    def stiffness(self, at: Evaluated) -> Array:
        """∂λ/∂ḡ of the rows (stress per length), (rows, width)."""
        raise NotImplementedError

    def seen(self, normal: Array) -> Array:
        """What the rows see of multipliers (stress), (rows, width). Collective."""
        return np.zeros((self.num_rows, self.width))

    def gathered(self, values: Array) -> Array:
        """The transposed, times areas, of values (rows,). Collective."""
        return np.zeros((0, self.width))

    @property
    def areas(self) -> Array:
        """Area of each multiplier, of its shape. Collective."""
        return np.zeros((0, self.width))

    def _means(self, at: Multipliers) -> tuple[None, None]:
        """None: multipliers that are no unknowns have no rows."""
        return None, None

    def _normal_derivative(self, at: Evaluated, exact: bool) -> tuple[Array, Array]:
        """None: see ``GapMatrices``."""
        return np.zeros((0, self.width)), np.zeros((0, self.width))


class LawRows(CondensedRows):
    """λ = φ'(ḡ), and no unknowns but τ. Arguments as of :class:`CondensedRows`."""

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        super().__init__(model, gap, slip)
        self._penalty: Array = model.eps * gap.relative_penalty

    @property
    def num_multipliers(self) -> int:
        """None."""
        return 0

    def first(self) -> Multipliers:
        """What is known of τ."""
        none = np.zeros((0, self.width))
        if self.slip is None:
            return Multipliers(none, None)
        return Multipliers(none, self.slip.turned(self.slip.state.augmented))

    def _normal(self, at: Multipliers, first: bool) -> tuple[Array, Array, Flags]:
        """Gaps, λ, and where that changes with the gap. Collective."""
        with collective_errors(self.model.comm):  # it may be the user's
            multiplier = self.gap.multiplier(self.model.eps)
            active = active_set.slope(self.model, self.gap) > 0
        return self.gap.state.values, multiplier, active

    def _pressure(self, at: Multipliers, trial: Array, active: Flags) -> Array:
        """λ."""
        return np.where(active[:, None], trial, 0.0)

    def stiffness(self, at: Evaluated) -> Array:
        """φ''(ḡ). Collective."""
        with collective_errors(self.model.comm):
            slope = active_set.slope(self.model, self.gap)
        out = np.where(at.active, slope, 0.0)[:, None] * np.ones(self.width)
        extension = self.gap.extension
        return out if extension is None or not self.gap.law.jump else out * ~extension.held

    def _normal_residual(self, at: Evaluated) -> Array:
        return np.zeros((0, self.width))

    def _normal_in_forces(self) -> Array:
        return np.zeros(0)

    def violation(self, at: Evaluated) -> float:
        """Largest stress on this rank by which the law of friction is violated."""
        return 0.0 if at.response is None else super().violation(at)

    def _of_gaps(self, at: Evaluated, forces: Array) -> Array:
        return np.zeros((0, 1))

    def open_gap(self, at: Evaluated) -> float:
        """None is to be closed."""
        return 0.0

    def keep(self, at: Evaluated) -> None:
        """Nothing but the gap."""

    def _normal_softened(self, at: Evaluated) -> Array:
        return np.zeros(0)


class AugmentedLawRows(ConstraintRows):
    """Rows of a user's law with multipliers: λ = φ'(ḡ + λ/ε), R_λ = W/ε (φ'(ḡ + λ/ε) − λ).

    Arguments as of :class:`CondensedRows`.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        super().__init__(model, gap, slip)
        self._c = self._eps

    def _shifted(self, normal: Array) -> Array:
        """ḡ + λ/ε."""
        return np.asarray(self.gap.state.values + normal / self._c[:, None])

    def _slope(self, normal: Array) -> Array:
        """φ'' there, (rows,). Collective."""
        with collective_errors(self.model.comm):  # it is the user's
            return self.gap.law.slope(self._shifted(normal), self._c, self.model.paired.touching)

    def _normal(self, at: Multipliers, first: bool) -> tuple[Array, Array, Flags]:
        """Gaps, φ' and where that changes with the gap. Collective."""
        with collective_errors(self.model.comm):
            trial = self.gap.law.multiplier(self._shifted(at.normal), self._c)
        return self.gap.state.values, trial, self._slope(at.normal) > 0

    def _normal_derivative(self, at: Evaluated, exact: bool) -> tuple[Array, Array]:
        """Derivatives of R_λ by ḡ and by its own λ. Collective."""
        weight, part = self.gap.weight, self._slope(at.multipliers.normal) * at.active / self._c
        soft = 0.0 if exact else self._proximal * at.active
        own = weight * ((part - 1) / self._c - soft)
        ones = np.ones(self.width)
        return (weight * part)[:, None] * ones, own[:, None] * ones
