"""Constraints of one integration side of a contact in the equations: those of λ, and of τ."""

from __future__ import annotations

import math
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.laws import Conductance, Law, Tied, Unilateral
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import FrictionRows, Tangential
from qsdolfinx.system.normal_rows import (
    AugmentedLawRows,
    AugmentedTieRows,
    NodalRows,
    Normal,
    NormalRows,
    TieRows,
)

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Constraints at nodes of the laws of the library; all other laws are a user's.
OF_LAWS: dict[type[Law], type[NodalRows]] = {Unilateral: NodalRows, Tied: TieRows}


class Multipliers(typing.NamedTuple):
    """Unknowns of the constraints of one integration side.

    Attributes:
        normal: λ, stress, (rows, 1), or (rows, gdim) for a law of the whole relative displacement.
        tangential: τ, stress, (rows, gdim), or at points (unknowns, 1); None without friction.
    """

    normal: Array
    tangential: Array | None


class Evaluated(typing.NamedTuple):
    """Constraints at given unknowns.

    Attributes:
        normal: Constraints of λ.
        tangential: Constraints of τ; None without friction.
    """

    normal: Normal
    tangential: Tangential | None

    @property
    def pressure(self) -> Array:
        """Stress from which the forces of the gaps are computed, (rows, width)."""
        return self.normal.pressure

    @property
    def active(self) -> Flags:
        """Active constraints of the gaps."""
        return self.normal.active

    @property
    def closed(self) -> Flags:
        """Constraints that are active or on the edge of contact; with friction those of τ."""
        return self.active if self.tangential is None else self.tangential.closed

    @property
    def sticking(self) -> Flags:
        """Active constraints that stick; all active constraints without friction."""
        return self.active if self.tangential is None else self.tangential.sticking


class ConstraintRows:
    """Constraints of one integration side: complementarity of λ and gap, and the friction law.

    With ḡ* = ḡ − λ/ε and g* = g − (τ − τ_0)/ε_t (1/ε = 1/ε_t = 0 for an augmented Lagrangian, which
    is then exact), τ_0 = τ at the start of the step, and the areas W of the constraints:

        R_λ = W/c_n ([λ + c_n ḡ*]₊ − λ),   R_τ = W/c_t (T(g, τ + c_t (g* − g), λ₊) − τ).

    T is the friction law, whose trial is the sum of its second argument and c_t g. For Coulomb it
    is the projection of τ + c_t g* onto the ball of radius μ λ₊ (Hüeber, Stadler & Wohlmuth, 2008).
    For a law that is discontinuous where constraints become inactive, only a part of T is used on
    the edge of contact, see ``fill``. A law of the whole relative displacement has R_λ = W (⟦u⟧ −
    λ/ε). Where conditions constrain both sides, multipliers are redundant and cannot close a gap.
    There, R_λ = W/c_n (λ̄ − λ), where λ̄ is the mean of the nodes around as long as λ̄ + c_n ḡ > 0,
    and otherwise 0. For points see ``PointConstraints`` and ``PointFriction``. All methods depend
    on their arguments only.

    Args:
        model: The contact.
        gap: The integration side.
        slip: Its slip; None without friction.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        self.model, self.gap, self.slip = model, gap, slip
        #: Constraints of λ at nodes, whose unknowns are forces; None for others.
        self.nodal: NodalRows | None = None
        #: Constraints whose forces follow from gaps; None for others.
        self.condensed: CondensedRows | None = None
        if isinstance(gap.law, Conductance):
            self.condensed = CondensedRows(model, gap)
        elif gap.rows.are_points:
            self.condensed = PointConstraints(model, gap)
        elif type(gap.law) in OF_LAWS:
            self.nodal = OF_LAWS[type(gap.law)](model, gap)
        elif model.augmented:
            of_user = AugmentedTieRows if gap.law.jump else AugmentedLawRows
            self.nodal = of_user(model, gap)
        else:
            self.condensed = CondensedRows(model, gap)
        normal = self.nodal or self.condensed
        assert normal is not None
        #: Constraints of λ.
        self.normal: NormalRows = normal
        #: Constraints of τ at nodes; None for others, and without friction.
        self.nodal_friction: FrictionRows | None = None
        #: Constraints of τ at points, whose forces follow from slips; None for others.
        self.condensed_friction: PointFriction | None = None
        if slip is not None and gap.rows.are_points:
            self.condensed_friction = PointFriction(model, slip)
        elif slip is not None:
            self.nodal_friction = FrictionRows(model, slip)
        #: Constraints of τ; None without friction.
        self.friction = self.nodal_friction or self.condensed_friction

    @property
    def num_rows(self) -> int:
        """Number of constraints of the gaps on this rank."""
        return self.gap.num_rows

    @property
    def width(self) -> int:
        """Number of components of λ."""
        return int(self.gap.operator.width)

    @property
    def num_multipliers(self) -> int:
        """Number of unknowns λ on this rank."""
        return self.normal.num_multipliers

    @property
    def num_unknowns(self) -> int:
        """Number of unknowns on this rank: those of λ, then those of τ."""
        return self.num_multipliers + self._num_tangential

    @property
    def _num_tangential(self) -> int:
        return 0 if self.friction is None else math.prod(self.friction.shape)

    def split(self, values: Array) -> Multipliers:
        """Split an array of unknowns into λ and τ."""
        end, width = self.num_multipliers, self.width
        normal = values[:end].reshape(end // width, width)
        if self.friction is None:
            return Multipliers(normal, None)
        return Multipliers(normal, values[end:].reshape(self.friction.shape))

    # --- Evaluation

    def first(self) -> Multipliers:
        """First guess of λ and τ, at the last evaluation of the gaps. Collective."""
        tangential = None if self.friction is None else self.friction.first()
        return Multipliers(self.normal.first(), tangential)

    def evaluate(
        self,
        at: Multipliers,
        first: bool = False,
        opened: Flags | None = None,
        again: bool = False,
        sticks: bool = False,
    ) -> Evaluated:
        """Evaluate the constraints at the last evaluation of gap and slip. Collective.

        Args:
            at: λ and τ.
            first: Whether constraints with λ > 0 count as active, and active constraints stick
                unless they slipped when the step began.
            opened: Constraints that count as inactive; none by default.
            again: Whether the step has been solved before, so that τ shows the present slip state.
            sticks: Whether all active constraints stick.
        """
        normal = self.normal.evaluate(at.normal, first, opened)
        if self.friction is None or at.tangential is None:
            return Evaluated(normal, None)
        tangential = self.friction.evaluate(at.tangential, normal, first, again, opened, sticks)
        return Evaluated(normal, tangential)

    def residual(self, at: Evaluated) -> Array:
        """Residuals R_λ, then R_τ: area times length, (unknowns,). Collective."""
        rows = self.normal.residual(at.normal).ravel()
        if self.friction is None or at.tangential is None:
            return np.asarray(rows)
        return np.concatenate([rows, self.friction.residual(at.tangential).ravel()])

    @property
    def in_forces(self) -> Array:
        """Factors from the residual to forces that are continuous where active sets change."""
        normal = self.normal.in_forces()
        if self.friction is None:
            return normal
        return np.concatenate([normal, self.friction.in_forces()])

    def violation(self, at: Evaluated) -> float:
        """Largest stress on this rank by which the constraints are violated. Collective."""
        forces = self.split(self.in_forces * self.residual(at))
        found = [self.normal.stress(at.normal, forces.normal)]
        if self.friction is not None and at.tangential is not None:
            assert forces.tangential is not None
            found.append(self.friction.stress(at.tangential, forces.tangential))
        return max(float(np.max(np.abs(stress), initial=0.0)) for stress in found)

    def open_gap(self, at: Evaluated) -> float:
        """Largest gap (length) on this rank that multipliers have to close. Collective."""
        return self.normal.open_gap(at.normal)

    def keep(self, at: Evaluated) -> None:
        """Store λ and τ in gap and slip. Collective."""
        self.normal.keep(at.normal)
        if self.friction is not None and at.tangential is not None:
            self.friction.keep(at.tangential)

    def rounding(self) -> float:
        """Stress of gaps as large as the coordinates: a part of it is rounding."""
        of_slip = 0.0 if self.friction is None else self.friction.rounding()
        return self._size * max(self.normal.rounding(), of_slip)

    @property
    def _size(self) -> float:
        """Largest coordinate of the slave on this rank."""
        return float(np.abs(self.gap.slave.mesh.geometry.x).max(initial=0.0))

    def forces_of_coordinates(self) -> Array:
        """Forces at points of gaps as large as coordinates, for gaps with updated geometry.

        A part of them is rounding. The array is empty for gaps that are linear in the unknowns.
        """
        if self.gap.following is None or not isinstance(self.normal, CondensedRows):
            return np.zeros(0)
        friction = self.condensed_friction
        gamma = self.normal.gamma + (0.0 if friction is None else friction.gamma)
        return np.asarray(self._size * gamma * self.gap.weight)

    def rounded_forces(self, at: Evaluated) -> Array:
        """Errors of forces due to rounding of slips, at some constraints of this rank."""
        if self.condensed_friction is None or at.tangential is None:
            return np.zeros(0)
        return self.condensed_friction.rounded_forces(at.tangential)

    @property
    def softness(self) -> float:
        """Smallest ratio on this rank of usual penalty to stiffness of the stiffest body."""
        parts = [self.normal.scales]
        if self.friction is not None:
            parts.append(self.friction.scales)
        return min(float(np.min(1 / (of.softness * of.stiffest), initial=1.0)) for of in parts)

    def softened(self, at: Evaluated) -> Array:
        """Diagonal terms that make the inexact derivative regular, (unknowns,).

        In the inexact derivative, friction with a limit combines the direction of the trial with
        that of τ, which avoids cycling at nodes. Active constraints are slightly compliant, so that
        redundant multipliers have a unique solution. Collective.
        """
        normal = self.normal.softened(at.normal)
        if self.friction is None:
            return normal
        return np.concatenate([normal, self.friction.softened()])
