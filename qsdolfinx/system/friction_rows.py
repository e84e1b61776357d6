"""Constraints of τ at nodes: the friction law."""

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


class Tangential(typing.NamedTuple):
    """Constraints of τ at given unknowns.

    Attributes:
        multiplier: τ, stress, (rows, gdim).
        told: Input of the law.
        response: Response of the law.
        active: Active constraints.
        filled: Modification of the response on the edge of contact; None for a continuous law.
        traction: Stress from which forces are computed, (rows, gdim): τ, or at points the response.
    """

    multiplier: Array
    told: Rows
    response: Response
    active: Flags
    filled: Filled | None
    traction: Array

    @property
    def closed(self) -> Flags:
        """Constraints that are active, or have friction at the edge of contact."""
        if self.filled is None:
            return self.active
        return self.active | self.filled.edge | self.filled.closed

    @property
    def on_edge(self) -> Flags:
        """Constraints whose friction depends on τ, not on the pressure: 0 for inactive ones.

        Where λ = ḡ = 0, rounding would make some of these active, and the law would jump.
        """
        if self.filled is None:
            return ~self.active
        return ~(self.active & self.filled.closed)

    @property
    def sticking(self) -> Flags:
        """Active constraints that stick."""
        return np.asarray(self.active & ~self.response.slipping)


class OfTangential(typing.NamedTuple):
    """Derivatives of R_τ.

    Attributes:
        by_slip: Derivative by g (area), (rows, gdim, gdim).
        by_own: Derivative by τ, (rows, gdim, gdim).
        by_pressure: Derivative by the pressure of the constraints, (rows, gdim).
        by_trial: Derivative by y_n of the constraints, (rows, gdim); None for a continuous law.
    """

    by_slip: Array
    by_own: Array
    by_pressure: Array
    by_trial: Array | None


class FrictionRows:
    """Friction R_τ = W/c_t (T(g, τ + c_t (g* − g), λ₊) − τ); see :class:`ConstraintRows`.

    Args:
        model: The contact.
        slip: Its slip.
    """

    def __init__(self, model: ContactModel, slip: Slip) -> None:
        self.model, self.slip = model, slip
        self.scales = Scales.of(model, model.tangential_eps * slip.gap.relative_penalty)
        self._c: Array = self.scales.usual * self.scales.penalty
        #: Whether constraints may be on the edge of contact.
        self._fills = slip.friction.jumps and slip.friction.is_bounded

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the unknowns τ of this rank."""
        return self.slip.works.num_rows, self.slip.gap.slave.gdim

    def first(self) -> Array:
        """First guess of τ, from the last solve."""
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
        """Evaluate the constraints for the last evaluation of slip. Collective.

        Args:
            multiplier: τ.
            normal: The constraints of λ.
            first: Whether active constraints stick, except those that slipped at the start of the
                step.
            again: Whether the step has been solved before, so that τ shows the present slip state.
            opened: Constraints of λ that count as inactive.
            sticks: Whether all active constraints stick.
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
        with collective_errors(self.model.comm):  # a law may be user code
            response = slip.respond(told, not all(self.model.kinematics.in_displacement))
        found = Tangential(multiplier, told, response, active, None, slip.tangential(multiplier))
        return self._filled(found, normal, first, opened) if self._fills else found

    def _filled(
        self, found: Tangential, normal: Normal, first: bool, opened: Flags | None
    ) -> Tangential:
        """Add the friction on the edge of contact, see ``fill``. Collective."""
        active = found.active
        # Nodes constrained by conditions are active or inactive according to their λ̄.
        alone = np.zeros_like(active) if normal.held is None else normal.held[:, 0]
        whole = active & (alone | (first & (found.told.pressure > 0)))
        none = alone & ~active
        if opened is not None:
            none = none | opened
        filled = fill(found.response, found.multiplier, normal.trial[:, 0], whole, none)
        return found._replace(response=filled.response, filled=filled)

    def _told(self, multiplier: Array, closed: Flags, pressure: Array) -> Rows:
        """Input of the friction law."""
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
            memory=state.memory.known,
        )

    def residual(self, at: Tangential) -> Array:
        """Residual R_τ: area times length, (rows, gdim)."""
        weight = self.slip.weight / self._c
        return np.asarray(weight[:, None] * (at.response.traction - at.multiplier))

    def in_forces(self) -> Array:
        """Factors c_t from residual to forces, (unknowns,)."""
        return np.repeat(self._c, self.slip.gap.slave.gdim)

    def stress(self, at: Tangential, forces: Array) -> Array:
        """Stress of forces by which the law is violated, beyond rounding, (rows, gdim)."""
        stiffest = np.maximum(self.scales.stiffest / self._c, 1.0)
        factor = np.where(at.sticking, stiffest, 1.0)
        stress = np.abs(forces / self.slip.weight[:, None] * factor[:, None])
        return np.maximum(stress - self.slip.rounding(at.response)[:, None], 0.0)

    def keep(self, at: Tangential) -> None:
        """Store τ in the slip."""
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
            at: The evaluated constraints.
            exact: As for ``ConstraintRows.derivative``.
        """
        slip, weight = self.slip, self.slip.weight / self._c
        stiffness = at.response.stiffness
        if not exact and isinstance(slip.friction, Limited):
            stiffness = _with_direction_of_tau(at)
        gdim = stiffness.shape[1]
        own = np.zeros_like(stiffness)
        if isinstance(slip.friction, Limited):
            # The trial has τ minus the part that a penalty stores.
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
        """Diagonal terms that make the inexact derivative regular, (unknowns,)."""
        return np.repeat(-self.slip.weight * self.scales.proximal, self.slip.gap.slave.gdim)

    def scale(self, at: Tangential) -> Array:
        """Factors from R_τ to forces: c, or the usual penalty where constraints stick, (rows,)."""
        return np.where(at.sticking, 1 / self.scales.softness, self._c)

    def usual_compliance(self, at: Tangential) -> Array:
        """Compliance missing in active constraints compared with the usual penalty, (rows,)."""
        return self.scales.usual_compliance(at.active)

    def rounding(self) -> float:
        """Largest factor from slips to stress on this rank."""
        return self.scales.largest(self._c)


def _with_direction_of_tau(at: Tangential) -> Array:
    """D with (I − τ/max(κ, |τ|) ⊗ d) in place of (I − d ⊗ d) where constraints slip."""
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
