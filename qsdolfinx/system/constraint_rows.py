"""Constraints of one pass of a contact in the equations: rows of λ, and of τ."""

from __future__ import annotations

import math
import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.laws import Conductance, Tied, Unilateral
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import FrictionRows, Tangential
from qsdolfinx.system.normal_rows import AugmentedLawRows, NodalRows, Normal, NormalRows

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Laws that ``NodalRows`` stand for; others are a user's.
LAWS = Unilateral, Tied


class Multipliers(typing.NamedTuple):
    """Unknowns of the constraints of one pass.

    Attributes:
        normal: λ, stress, (rows, 1), or (rows, gdim) of a law of the whole jump.
        tangential: τ, stress, (rows, gdim), or at points (unknowns, 1); None without friction.
    """

    normal: Array
    tangential: Array | None


class Evaluated(typing.NamedTuple):
    """Constraints at given unknowns.

    Attributes:
        normal: Rows of λ.
        tangential: Rows of τ; None without friction.
    """

    normal: Normal
    tangential: Tangential | None

    @property
    def pressure(self) -> Array:
        """Stress that makes forces at the rows of the gaps, (rows, width)."""
        return self.normal.pressure

    @property
    def active(self) -> Flags:
        """Rows of the gaps that are closed."""
        return self.normal.active

    @property
    def closed(self) -> Flags:
        """Rows that are closed, or on the edge of contact; with friction those of τ."""
        return self.active if self.tangential is None else self.tangential.closed

    @property
    def sticking(self) -> Flags:
        """Closed rows that do not slip; all without friction."""
        return self.active if self.tangential is None else self.tangential.sticking


class ConstraintRows:
    """Rows of λ and τ of one pass: complementarity of pressure and gap, and the law of friction.

    With ḡ* = ḡ − λ/ε and g* = g − (τ − τ_0)/ε_t (1/ε = 1/ε_t = 0 of an augmented Lagrangian, which
    is then exact), τ_0 being τ at the start of the step, W the areas of the rows:

        R_λ = W/c_n ([λ + c_n ḡ*]₊ − λ),   R_τ = W/c_t (T(g, τ + c_t (g* − g), λ₊) − τ).

    T is the law of friction, whose trial is the sum of its second argument and c_t g: for Coulomb
    the projection of τ + c_t g* onto the ball of radius μ λ₊ (Hüeber, Stadler & Wohlmuth, 2008).
    Of a law that jumps where rows open it is a part of that on the edge of contact, see ``fill``.
    A law of the whole jump has R_λ = W (⟦u⟧ − λ/ε). Where conditions hold both sides, no gap can
    be closed: there R_λ = W/c_n (λ̄ − λ), λ̄ being the mean of the nodes around while λ̄ + c_n ḡ > 0,
    and else 0. At points see ``PointConstraints`` and ``PointFriction``.
    All are functions of their arguments alone.

    Args:
        model: The contact.
        gap: The pass.
        slip: Its slip; None without friction.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        self.model, self.gap, self.slip = model, gap, slip
        #: Rows of λ where they are nodes' and their unknowns make forces; None of others.
        self.nodal: NodalRows | None = None
        #: Those whose gaps make forces themselves.
        self.condensed: CondensedRows | None = None
        if isinstance(gap.law, Conductance):
            self.condensed = CondensedRows(model, gap)
        elif gap.rows.are_points:
            self.condensed = PointConstraints(model, gap)
        elif type(gap.law) in LAWS:
            self.nodal = NodalRows(model, gap)
        elif model.augmented:
            self.nodal = AugmentedLawRows(model, gap)
        else:
            self.condensed = CondensedRows(model, gap)
        normal = self.nodal or self.condensed
        assert normal is not None
        #: Rows of λ.
        self.normal: NormalRows = normal
        #: Rows of τ where they are nodes'; None of others, and without friction.
        self.nodal_friction: FrictionRows | None = None
        #: Those of points, whose slips make forces themselves.
        self.condensed_friction: PointFriction | None = None
        if slip is not None and gap.rows.are_points:
            self.condensed_friction = PointFriction(model, slip)
        elif slip is not None:
            self.nodal_friction = FrictionRows(model, slip)
        #: Rows of τ; None without friction.
        self.friction = self.nodal_friction or self.condensed_friction

    @property
    def num_rows(self) -> int:
        """Rows of the gaps on this rank."""
        return self.gap.num_rows

    @property
    def width(self) -> int:
        """Components of λ."""
        return int(self.gap.operator.width)

    @property
    def num_multipliers(self) -> int:
        """Unknowns λ on this rank."""
        return self.normal.num_multipliers

    @property
    def num_unknowns(self) -> int:
        """Unknowns on this rank: those of λ, then those of τ."""
        return self.num_multipliers + self._num_tangential

    @property
    def _num_tangential(self) -> int:
        return 0 if self.friction is None else math.prod(self.friction.shape)

    def split(self, values: Array) -> Multipliers:
        """λ and τ in an array of the unknowns."""
        end, width = self.num_multipliers, self.width
        normal = values[:end].reshape(end // width, width)
        if self.friction is None:
            return Multipliers(normal, None)
        return Multipliers(normal, values[end:].reshape(self.friction.shape))

    # --- Evaluation

    def first(self) -> Multipliers:
        """What is known of λ and τ, where gaps were evaluated last. Collective."""
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
        """The constraints where gap and slip were evaluated last. Collective.

        Args:
            at: λ and τ.
            first: Whether what has λ > 0 counts as closed, and what is closed sticks, but where
                it slipped when the step began.
            opened: Rows that count as open; none by default.
            again: Whether the step has been solved before, so that what has τ is what it seems.
            sticks: Whether all that is closed sticks.
        """
        normal = self.normal.evaluate(at.normal, first, opened)
        if self.friction is None or at.tangential is None:
            return Evaluated(normal, None)
        tangential = self.friction.evaluate(at.tangential, normal, first, again, opened, sticks)
        return Evaluated(normal, tangential)

    def residual(self, at: Evaluated) -> Array:
        """R_λ, then R_τ: area times length, (unknowns,). Collective."""
        rows = self.normal.residual(at.normal).ravel()
        if self.friction is None or at.tangential is None:
            return np.asarray(rows)
        return np.concatenate([rows, self.friction.residual(at.tangential).ravel()])

    @property
    def in_forces(self) -> Array:
        """What makes forces of the residual that are continuous where sets change."""
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
        """Gap (length) that multipliers are to close: the largest on this rank. Collective."""
        return self.normal.open_gap(at.normal)

    def keep(self, at: Evaluated) -> None:
        """Let pass and slip know λ and τ. Collective."""
        self.normal.keep(at.normal)
        if self.friction is not None and at.tangential is not None:
            self.friction.keep(at.tangential)

    def rounding(self) -> float:
        """Stress that stands for gaps as large as coordinates: rounding is a part of it."""
        of_slip = 0.0 if self.friction is None else self.friction.rounding()
        return self._size * max(self.normal.rounding(), of_slip)

    @property
    def _size(self) -> float:
        """The largest coordinate of the slave on this rank."""
        return float(np.abs(self.gap.slave.mesh.geometry.x).max(initial=0.0))

    def forces_of_coordinates(self) -> Array:
        """Forces at points of gaps as large as coordinates, between which they are found anew.

        Rounding is a part of them; none where gaps are linear in the unknowns.
        """
        if self.gap.following is None or not isinstance(self.normal, CondensedRows):
            return np.zeros(0)
        friction = self.condensed_friction
        gamma = self.normal.gamma + (0.0 if friction is None else friction.gamma)
        return np.asarray(self._size * gamma * self.gap.weight)

    def rounded_forces(self, at: Evaluated) -> Array:
        """What rounding of slips makes of forces at some rows of this rank."""
        if self.condensed_friction is None or at.tangential is None:
            return np.zeros(0)
        return self.condensed_friction.rounded_forces(at.tangential)

    @property
    def softness(self) -> float:
        """Usual penalty over what gaps stand for in the stiffest body: the least on this rank."""
        parts = [self.normal.scales]
        if self.friction is not None:
            parts.append(self.friction.scales)
        return min(float(np.min(1 / (of.softness * of.stiffest), initial=1.0)) for of in parts)

    def softened(self, at: Evaluated) -> Array:
        """What the inexact derivative has on its diagonal to be regular, (unknowns,).

        In that, friction with a limit takes the direction of the trial with that of τ, which does
        not cycle at nodes, and closed rows are a little soft, so that redundant ones have one
        solution. Collective.
        """
        normal = self.normal.softened(at.normal)
        if self.friction is None:
            return normal
        return np.concatenate([normal, self.friction.softened()])
