"""Rows of τ of one pass of a contact whose rows are nodes: the law of friction."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.filled import Filled, fill
from qsdolfinx.friction.laws import Limited, Response, Rows
from qsdolfinx.friction.slip import Slip
from qsdolfinx.system.normal_rows import Normal, Scales

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: c_t over the automatic penalty of the rows.
C_TANGENTIAL = 1.0


class Tangential(typing.NamedTuple):
    """Rows of τ at given unknowns.

    Attributes:
        multiplier: τ, stress, (rows, gdim).
        told: What the law was told.
        response: What it answered.
        active: Rows in contact.
        filled: What the edge of contact makes of the answer; None of a law that does not jump.
        traction: Stress that makes forces at the rows, (rows, gdim): τ, or at points the answer.
    """

    multiplier: Array
    told: Rows
    response: Response
    active: Flags
    filled: Filled | None
    traction: Array

    @property
    def closed(self) -> Flags:
        """Rows that are active, or have friction at the edge of contact."""
        if self.filled is None:
            return self.active
        return self.active | self.filled.edge | self.filled.closed

    @property
    def on_edge(self) -> Flags:
        """Rows whose friction their pressure does not tell, but τ alone: 0 of those that are open.

        Rounding would close some of these where λ = ḡ = 0, and the law would jump.
        """
        if self.filled is None:
            return ~self.active
        return ~(self.active & self.filled.closed)

    @property
    def sticking(self) -> Flags:
        """Closed rows that do not slip."""
        return np.asarray(self.active & ~self.response.slipping)


class OfTangential(typing.NamedTuple):
    """Derivatives of R_τ.

    Attributes:
        by_slip: By g (area), (rows, gdim, gdim).
        by_own: By τ, (rows, gdim, gdim).
        by_pressure: By the pressure of the rows, (rows, gdim).
        by_trial: By y_n of the rows, (rows, gdim); None of a law that does not jump.
    """

    by_slip: Array
    by_own: Array
    by_pressure: Array
    by_trial: Array | None


class FrictionRows:
    """R_τ = W/c_t (T(g, τ + c_t (g* − g), λ₊) − τ); see :class:`ConstraintRows`.

    Args:
        model: The contact.
        slip: Its slip.
    """

    def __init__(self, model: ContactModel, slip: Slip) -> None:
        self.model, self.slip = model, slip
        self.scales = Scales.of(model, model.tangential_eps * slip.gap.relative_penalty)
        self._c: Array = C_TANGENTIAL * self.scales.usual * self.scales.penalty
        #: Whether rows may be on the edge of contact.
        self._fills = slip.friction.jumps and slip.friction.is_bounded

    @property
    def shape(self) -> tuple[int, int]:
        """Of the unknowns τ of this rank."""
        return self.slip.operator.num_rows, self.slip.gap.slave.gdim

    def first(self) -> Array:
        """What is known of τ."""
        return self.slip.turned(self.slip.state.augmented)

    def evaluate(
        self,
        multiplier: Array,
        normal: Normal,
        first: bool,
        again: bool,
        opened: Flags | None,
        sticks: bool = False,
    ) -> Tangential:
        """The rows where slip was evaluated last. Collective.

        Args:
            multiplier: τ.
            normal: The rows of λ.
            first: Whether what is closed sticks, but where it slipped when the step began.
            again: Whether the step has been solved before, so that what has τ is what it seems.
            opened: Rows of λ that count as open.
            sticks: Whether all that is closed sticks.
        """
        slip = self.slip
        active = normal.active
        pressure = np.maximum(normal.pressure[:, 0], 0.0)
        told = self._told(multiplier, active, pressure)
        if first:
            slipped = np.any(multiplier, axis=1) & (again | slip.has_slipped)
            told = told._replace(unlimited=active & ~slipped)
        if sticks:
            told = told._replace(unlimited=active.copy())
        if self._fills:
            told = told._replace(closed=np.ones_like(active))
        with collective_errors(self.model.comm):  # a law may be the user's
            response = slip.respond(told, not all(self.model.kinematics.in_displacement))
        found = Tangential(multiplier, told, response, active, None, slip.tangential(multiplier))
        return self._filled(found, normal, first, opened) if self._fills else found

    def _filled(
        self, found: Tangential, normal: Normal, first: bool, opened: Flags | None
    ) -> Tangential:
        """The same with what friction is on the edge of contact, see ``fill``. Collective."""
        active = found.active
        # What conditions hold is closed or open, as their λ̄ tells.
        alone = np.zeros_like(active) if normal.held is None else normal.held[:, 0]
        whole = active & (alone | (first & (found.told.pressure > 0)))
        none = alone & ~active
        if opened is not None:
            none = none | opened
        filled = fill(found.response, found.multiplier, normal.trial[:, 0], whole, none)
        return found._replace(response=filled.response, filled=filled)

    def _told(self, multiplier: Array, closed: Flags, pressure: Array) -> Rows:
        """What the law of friction is told."""
        slip, state, dt = self.slip, self.slip.state, self.model.kinematics.dt
        assert self.model.friction is not None
        change = multiplier - state.augmented
        elastic = (self._c * self.scales.compliance)[:, None] * change
        return Rows(
            slip.values,
            slip.tangential(multiplier - elastic),
            pressure,
            closed,
            np.zeros_like(closed),
            self._c,
            slip.projector,
            slip.cover,
            dt,
            self.model.friction.slow(dt, self.model.paired.facet_size),
            slip.parameters,
            state.share,
            np.where(slip.is_fresh, 0.0, state.pressed),
        )

    def residual(self, at: Tangential) -> Array:
        """R_τ: area times length, (rows, gdim)."""
        weight = self.slip.weight / self._c
        return np.asarray(weight[:, None] * (at.response.traction - at.multiplier))

    def in_forces(self) -> Array:
        """c_t, (unknowns,)."""
        return np.repeat(self._c, self.slip.gap.slave.gdim)

    def stress(self, at: Tangential, forces: Array) -> Array:
        """Stress of forces by which the law is violated, beyond rounding, (rows, gdim)."""
        stiffest = np.maximum(self.scales.stiffest / self._c, 1.0)
        factor = np.where(at.sticking, stiffest, 1.0)
        stress = np.abs(forces / self.slip.weight[:, None] * factor[:, None])
        return np.maximum(stress - self.slip.rounding(at.response)[:, None], 0.0)

    def keep(self, at: Tangential) -> None:
        """Let the slip know τ."""
        state, tangential = self.slip.state, np.where(at.closed[:, None], at.multiplier, 0.0)
        if self.model.augmented:
            state.augmented = self.slip.tangential(tangential)
        if self.slip.friction.needs_dt:
            state.solved = self.slip.tangential(tangential)
        if self.slip.friction.jumps:
            size = np.linalg.norm(tangential, axis=1)
            state.on_edge = np.where(at.on_edge, size, np.inf)

    def derivative(self, at: Tangential, exact: bool) -> OfTangential:
        """Derivatives of R_τ.

        Args:
            at: The rows.
            exact: As of ``ConstraintRows.derivative``.
        """
        slip, weight = self.slip, self.slip.weight / self._c
        stiffness = at.response.stiffness
        if not exact and isinstance(slip.friction, Limited):
            stiffness = _with_direction_of_tau(at)
        gdim = stiffness.shape[1]
        own = np.zeros_like(stiffness)
        if isinstance(slip.friction, Limited):
            # The trial has τ less what a penalty stores of it.
            part = (1 - self._c * self.scales.compliance) / self._c
            own = part[:, None, None] * (stiffness @ slip.projector)
        own = weight[:, None, None] * (own - np.eye(gdim))
        if not exact:
            own -= (slip.weight * self.scales.proximal)[:, None, None] * np.eye(gdim)
        by_slip = weight[:, None, None] * stiffness
        by_pressure = (weight * (at.told.pressure > 0))[:, None] * at.response.coupling
        if at.filled is None:
            return OfTangential(by_slip, own, by_pressure, None)
        own = own + weight[:, None, None] * at.filled.by_multiplier
        by_trial = weight[:, None] * at.filled.by_trial
        return OfTangential(by_slip, own, by_pressure, by_trial)

    def softened(self) -> Array:
        """What the inexact derivative has on its diagonal to be regular, (unknowns,)."""
        return np.repeat(-self.slip.weight * self.scales.proximal, self.slip.gap.slave.gdim)

    def scale(self, at: Tangential) -> Array:
        """What makes forces of R_τ: c, or the usual penalty where rows stick, (rows,)."""
        return np.where(at.sticking, 1 / self.scales.softness, self._c)

    def usual_compliance(self, at: Tangential) -> Array:
        """What closed rows lack of the usual penalty's compliance, (rows,)."""
        return self.scales.usual_compliance(at.active)

    def rounding(self) -> float:
        """Largest factor that turns slips into stress on this rank."""
        return self.scales.largest(self._c)


def _with_direction_of_tau(at: Tangential) -> Array:
    """D with (I − τ/max(κ, |τ|) ⊗ d) in place of (I − d ⊗ d) where rows slip."""
    response, tangential = at.response, at.multiplier
    limit = np.linalg.norm(response.traction, axis=1)
    size = np.linalg.norm(tangential, axis=1)
    slips = response.slipping & (limit > 0)
    d = np.divide(response.traction, limit[:, None], where=slips[:, None], out=0 * tangential)
    largest = np.maximum(limit, size)
    of_tau = np.divide(
        tangential, largest[:, None], where=slips[:, None], out=np.zeros_like(tangential)
    )
    change = response.secant[:, None, None] * (d - of_tau)[:, :, None] * d[:, None, :]
    return np.asarray(response.stiffness + change)
