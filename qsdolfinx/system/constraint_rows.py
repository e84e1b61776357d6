"""Constraints of one pass of a contact in the equations: residual and derivative of their rows."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.filled import Filled, fill
from qsdolfinx.friction.laws import Limited, Response, Rows
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: c_n and c_t over the automatic penalty of the rows (5 E/h). In small sliding they have no
#: influence over eight decades; where pairs change 0.1 to 1 fails at times for c_n.
C_NORMAL, C_TANGENTIAL = 1e-2, 1.0

#: Compliance of closed rows in the inexact derivative, over that of the penalty: where constraints
#: are redundant, as of a node in two contacts with one plane, their multipliers change least.
PROXIMAL = 1e-10

#: What rounding leaves of slips, over coordinates.
OF_RATES = 10 * np.finfo(np.float64).eps

#: Penalty over the bodies' stiffness from which on the factors are of that, times this; and up to
#: which they are, of an augmented Lagrangian.
USUAL, LEAST = 100.0, 5.0


class Multipliers(typing.NamedTuple):
    """Unknowns of the constraints of one pass.

    Attributes:
        normal: λ, stress, (rows, 1), or (rows, gdim) of a law of the whole jump.
        tangential: τ, stress, (rows, gdim); None without friction.
    """

    normal: Array
    tangential: Array | None


class Evaluated(typing.NamedTuple):
    """Constraints at given unknowns.

    Attributes:
        gap: ḡ* = ḡ − λ/ε (length), of the shape of λ.
        trial: y_n = λ + c_n ḡ* (stress), likewise.
        active: Rows with y_n > 0; all of a law of the whole jump.
        of_friction: What the law was told; None without friction.
        response: What it answered.
        multipliers: λ and τ.
        held: Components of λ that conditions hold on both sides; None if there are none anywhere.
        means: λ̄ of these, of the same shape.
        filled: What the edge of contact makes of the answer; None of a law that does not jump.
    """

    gap: Array
    trial: Array
    active: Flags
    of_friction: Rows | None
    response: Response | None
    multipliers: Multipliers
    held: Flags | None
    means: Array | None
    filled: Filled | None = None

    @property
    def closed(self) -> Flags:
        """Rows that are active or on the edge of contact."""
        return self.active if self.filled is None else self.active | self.filled.edge

    @property
    def sticking(self) -> Flags:
        """Closed rows that do not slip, (rows,); all without friction."""
        if self.response is None:
            return self.active
        return np.asarray(self.active & ~self.response.slipping)


class Derivative(typing.NamedTuple):
    """Derivatives of the rows' residual; what a gap or a slip changes by is of G and J.

    Attributes:
        normal_by_gap: Of the normal rows by ḡ (area), (rows, width).
        normal_by_normal: Of the normal rows by λ, their own, (rows, width).
        by_slip: Of the tangential rows by g (area), (rows, gdim, gdim); None without friction.
        by_tangential: By τ, (rows, gdim, gdim).
        by_normal: By λ, (rows, gdim).
        by_gap: By ḡ (area), (rows, gdim); None of a law that does not jump.
    """

    normal_by_gap: Array
    normal_by_normal: Array
    by_slip: Array | None
    by_tangential: Array | None
    by_normal: Array | None
    by_gap: Array | None = None


class ConstraintRows:
    """Rows of λ and τ of one pass: complementarity of pressure and gap, and the law of friction.

    With ḡ* = ḡ − λ/ε and g* = g − (τ − τ_0)/ε_t (1/ε = 1/ε_t = 0 of an augmented Lagrangian, which
    is then exact), τ_0 being τ at the start of the step, W the areas of the rows:

        R_λ = W/c_n ([λ + c_n ḡ*]₊ − λ),   R_τ = W/c_t (T(g, τ + c_t (g* − g), λ₊) − τ).

    T is the law of friction, whose trial is the sum of its second argument and c_t g: for Coulomb
    the projection of τ + c_t g* onto the ball of radius μ λ₊ (Hüeber, Stadler & Wohlmuth, 2008).
    Of a law that jumps where rows open it is a part of that on the edge of contact, see ``fill``.
    A law of the whole jump has R_λ = W (⟦u⟧ − λ/ε). Where conditions hold both sides, no gap can
    be closed: there R_λ = W/c_n (λ̄ − λ), λ̄ being the mean of the nodes around while the gap is
    closed, and else 0. They are functions of their arguments alone.

    Args:
        model: The contact.
        gap: The pass; its rows are nodes.
        slip: Its slip; None without friction.
    """

    def __init__(self, model: ContactModel, gap: WeightedGap, slip: Slip | None) -> None:
        self.model, self.gap, self.slip = model, gap, slip
        stiffness = model.eps * gap.relative_penalty
        exact = model.augmented
        #: ε, and what turns gaps into stress of the stiffest body: a part of what is read as λ.
        self._eps: Array = stiffness
        stiffest = max((k for k in model.penalty.stiffness if k < np.inf), default=0.0)
        self._stiffest: Array = np.maximum(stiffness, stiffest)
        ratio = model.penalty.ratio
        usual = min(1.0, USUAL / ratio) if ratio > 0 else 1.0
        if exact and ratio > 0:  # the result does not depend on the penalty
            usual = max(usual, LEAST / ratio)
        soft = LEAST / ratio if ratio > 0 else 1.0
        soft = soft if exact else min(soft, 1.0)
        #: Least compliance of closed rows where a linear solver is to see no stiff ones.
        self._softness: Array = 1 / (soft * stiffness)
        self._compliance: Array = np.zeros_like(stiffness) if exact else 1 / stiffness
        self._proximal: Array = np.asarray(exact * PROXIMAL / self._stiffest)
        self._c: Array = C_NORMAL * usual * stiffness
        #: Whether rows may be on the edge of contact.
        self._fills = slip is not None and slip.friction.jumps and slip.friction.is_bounded
        if slip is not None:
            tangential = model.tangential_eps * gap.relative_penalty
            self._stiffest_t: Array = np.maximum(tangential, stiffest)
            self._softness_t: Array = 1 / (soft * tangential)
            self._compliance_t: Array = np.zeros_like(tangential) if exact else 1 / tangential
            self._proximal_t: Array = np.asarray(exact * PROXIMAL / self._stiffest_t)
            self._ct: Array = C_TANGENTIAL * usual * tangential

    @property
    def num_rows(self) -> int:
        """Rows of λ on this rank."""
        return self.gap.num_rows

    @property
    def width(self) -> int:
        """Components of λ."""
        return int(self.gap.operator.width)

    @property
    def num_unknowns(self) -> int:
        """Unknowns on this rank: those of λ, then those of τ."""
        gdim = 0 if self.slip is None else self.gap.slave.gdim
        return self.num_rows * (self.width + gdim)

    def split(self, values: Array) -> Multipliers:
        """λ and τ in an array of the unknowns."""
        end = self.num_rows * self.width
        normal = values[:end].reshape(self.num_rows, self.width)
        if self.slip is None:
            return Multipliers(normal, None)
        return Multipliers(normal, values[end:].reshape(self.num_rows, self.gap.slave.gdim))

    # --- Evaluation

    def first(self) -> Multipliers:
        """What is known of the nodes, ε [ḡ]₊ where nothing is, where gaps were evaluated last."""
        gap = self.gap
        known, law = gap.state.augmented, gap.law
        new = 0.0 if law.jump else law.multiplier(gap.state.values, self._eps)
        normal = np.where(known == 0, new, known)
        if self.slip is None:
            return Multipliers(normal, None)
        return Multipliers(normal, self.slip.turned(self.slip.state.augmented))

    def evaluate(
        self,
        at: Multipliers,
        first: bool = False,
        opened: Flags | None = None,
        again: bool = False,
    ) -> Evaluated:
        """The constraints where gap and slip were evaluated last. Collective.

        Args:
            at: λ and τ.
            first: Whether what has λ > 0 counts as closed, and what is closed sticks, but where
                it slipped when the step began.
            opened: Rows that count as open; none by default.
            again: Whether the step has been solved before, so that what has τ is what it seems.
        """
        gap = self.gap.state.values - self._compliance[:, None] * at.normal
        trial = at.normal + self._c[:, None] * gap
        jump = self.gap.law.jump
        active = np.ones(self.num_rows, dtype=bool) if jump else trial[:, 0] > 0
        if first and not jump:
            active |= (at.normal[:, 0] > 0) | (trial[:, 0] >= -self._c * self.model.paired.touching)
        if opened is not None:
            active &= ~opened
        held, means = self._means(at)
        found = Evaluated(gap, trial, active, None, None, at, held, means)
        if self.slip is None:
            return found
        assert at.tangential is not None
        rows = self._told(self.slip, at, active)
        if first:
            slipped = np.any(at.tangential, axis=1) & (again | (self.slip.state.slipped > 0))
            rows = rows._replace(unlimited=active & ~slipped)
        if self._fills:
            rows = rows._replace(closed=np.ones_like(active))
        with collective_errors(self.model.comm):  # a law may be the user's
            flows = not all(self.model.kinematics.in_displacement)
            response = self.slip.respond(rows, flows)
        found = found._replace(of_friction=rows, response=response)
        return self._filled(found, first, opened) if self._fills else found

    def _filled(self, found: Evaluated, first: bool, opened: Flags | None) -> Evaluated:
        """The same with what friction is on the edge of contact, see ``fill``."""
        active, normal = found.active, found.multipliers.normal[:, 0]
        assert found.response is not None and found.multipliers.tangential is not None
        # What conditions hold is closed or open, as their λ̄ tells.
        alone = np.zeros_like(active) if found.held is None else found.held[:, 0]
        whole = active & (alone | (first & (normal > 0)))
        none = (alone & ~active) | (False if opened is None else opened)
        filled = fill(found.response, found.multipliers.tangential, found.trial[:, 0], whole, none)
        return found._replace(response=filled.response, filled=filled)

    def _means(self, at: Multipliers) -> tuple[Flags | None, Array | None]:
        """What is held on both sides, and λ̄ there. Collective."""
        extension = self.gap.extension
        if extension is None:
            return None, None
        means = extension.means(at.normal)
        if not self.gap.law.jump:
            means = np.where(self.gap.state.values >= -self.model.paired.touching, means, 0.0)
        return extension.held, means

    def by_means(self, at: Evaluated, normal: Array) -> Array:
        """Derivative of W/c_n λ̄ times changes of λ, of their shape. Collective."""
        extension = self.gap.extension
        if extension is None or at.held is None:
            return np.zeros_like(normal)
        means = extension.means(normal)
        if not self.gap.law.jump:
            means = np.where(self.gap.state.values >= -self.model.paired.touching, means, 0.0)
        return np.where(at.held, (self.gap.weight / self._c)[:, None] * means, 0.0)

    def entries_of_means(self, at: Evaluated, numbers: Indices) -> tuple[Indices, Indices, Array]:
        """Derivative of W/c_n λ̄ by λ: rows, columns and values. Collective.

        Args:
            at: The constraints where they were evaluated.
            numbers: Of the rows of λ in z, of its shape.
        """
        extension = self.gap.extension
        assert extension is not None
        factor = np.repeat((self.gap.weight / self._c)[:, None], self.width, axis=1)
        if not self.gap.law.jump:
            factor = np.where(self.gap.state.values >= -self.model.paired.touching, factor, 0.0)
        return extension.entries(numbers, factor)

    def _told(self, slip: Slip, at: Multipliers, active: Flags) -> Rows:
        """What the law of friction is told."""
        assert self.model.friction is not None and at.tangential is not None
        state, dt = slip.state, self.model.kinematics.dt
        start = slip.turned(state.augmented) if self.gap.following else state.augmented
        elastic = (self._ct * self._compliance_t)[:, None] * (at.tangential - start)
        return Rows(
            slip.values,
            slip.tangential(at.tangential - elastic),
            np.maximum(at.normal[:, 0], 0.0),
            active,
            np.zeros_like(active),
            self._ct,
            slip.projector,
            slip.cover,
            dt,
            self.model.friction.slow(dt, self.model.paired.facet_size),
            slip.parameters,
            state.share,
            np.where(slip.is_fresh, 0.0, state.pressed),
        )

    def residual(self, at: Evaluated) -> Array:
        """R_λ, then R_τ: area times length, (unknowns,)."""
        weight, (normal, tangential) = self.gap.weight, at.multipliers
        if self.gap.law.jump:
            rows = weight[:, None] * at.gap
        else:
            trial = np.where(at.active[:, None], at.trial, 0.0)
            rows = (weight / self._c)[:, None] * (trial - normal)
        if at.held is not None and at.means is not None:
            rows = np.where(at.held, (weight / self._c)[:, None] * (at.means - normal), rows)
        if at.response is None or tangential is None:
            return np.asarray(rows.ravel())
        of_friction = (weight / self._ct)[:, None] * (at.response.traction - tangential)
        return np.concatenate([rows.ravel(), of_friction.ravel()])

    def complementarity(self, at: Evaluated) -> list[Array]:
        """The same in forces, c R: continuous where sets change."""
        parts = self.split(self.residual(at))
        normal = self._c[:, None] * parts.normal
        if parts.tangential is None:
            return [normal]
        return [normal, self._ct[:, None] * parts.tangential]

    def violation(self, at: Evaluated) -> float:
        """Largest stress on this rank by which complementarity is violated.

        That of closed gaps is ε ḡ*, which is a part of what is read as λ, or what they stand for
        in the stiffest body.
        """
        weight, parts = self.gap.weight[:, None], self.complementarity(at)
        factor = np.where(at.closed, np.maximum(self._stiffest / self._c, 1.0), 1.0)
        found = [parts[0] / weight * factor[:, None]]
        if at.response is not None:
            factor = np.where(at.sticking, np.maximum(self._stiffest_t / self._ct, 1.0), 1.0)
            stress = np.abs(parts[1] / weight * factor[:, None])
            found.append(np.maximum(stress - self._of_rates(at.response)[:, None], 0.0))
        return max(float(np.max(np.abs(r), initial=0.0)) for r in found)

    def open_gap(self, at: Evaluated) -> float:
        """Gap (length) of closed rows that multipliers are to close: the largest on this rank."""
        if not self.model.augmented:
            return 0.0
        gaps = np.where(at.closed[:, None], np.abs(at.gap), 0.0)
        if at.held is not None:
            gaps = np.where(at.held, 0.0, gaps)
        return float(np.max(gaps, initial=0.0))

    def _of_rates(self, response: Response) -> Array:
        """Stress that rounding makes of slips by a law that slip rates steer, (rows,).

        It may be much stiffer than penalties and bodies; 0 of other laws.
        """
        if self.slip is None or not self.slip.friction.needs_dt:
            return np.zeros(self.num_rows)
        size = float(np.abs(self.gap.slave.mesh.geometry.x).max(initial=0.0))
        return np.asarray(OF_RATES * size * response.secant)

    def scales(self, at: Evaluated) -> tuple[Array, Array]:
        """What makes forces of R_λ and R_τ: c, or the usual penalty where they are closed."""
        normal = np.where(at.active, 1 / self._softness, self._c)
        if self.slip is None or at.response is None:
            return normal, normal
        return normal, np.where(at.sticking, 1 / self._softness_t, self._ct)

    @property
    def softness(self) -> float:
        """Usual penalty over what gaps stand for in the stiffest body: the least on this rank."""
        parts = [1 / (self._softness * self._stiffest)]
        if self.slip is not None:
            parts.append(1 / (self._softness_t * self._stiffest_t))
        return min(float(np.min(part, initial=1.0)) for part in parts)

    def usual_compliances(self, at: Evaluated) -> tuple[Array, Array]:
        """What closed rows lack of the usual penalty's compliance, of λ and of τ."""
        normal = at.active * np.maximum(self._softness - self._compliance, 0.0)
        if self.slip is None:
            return normal, normal
        return normal, at.active * np.maximum(self._softness_t - self._compliance_t, 0.0)

    def rounding(self) -> float:
        """Stress that stands for gaps as large as coordinates: rounding is a part of it."""
        size = float(np.abs(self.gap.slave.mesh.geometry.x).max(initial=0.0))
        factors = [self._c, self._stiffest]
        if self.slip is not None:
            factors += [self._ct, self._stiffest_t]
        return size * max(float(np.max(f, initial=0.0)) for f in factors)

    def derivative(self, at: Evaluated, exact: bool) -> Derivative:
        """Derivative of :meth:`residual` where it was evaluated.

        Args:
            at: The constraints there.
            exact: Whether it is. Otherwise friction with a limit takes the direction of the trial
                with that of τ, which does not cycle at nodes, and closed rows are a little soft, so
                that redundant ones have one solution.
        """
        weight, width = self.gap.weight, self.width
        closed = weight * at.active
        by_gap = np.repeat(closed[:, None], width, axis=1)
        soft = at.active * (1 - self._c * self._compliance) - 1
        own = (weight / self._c) * soft
        if self.gap.law.jump:
            own = -weight * self._compliance
        if not exact:
            own = own - weight * at.active * self._proximal
        own = np.repeat(own[:, None], width, axis=1)
        if at.held is not None:
            by_gap = np.where(at.held, 0.0, by_gap)
            own = np.where(at.held, -(weight / self._c)[:, None], own)
        if at.response is None or at.of_friction is None or self.slip is None:
            return Derivative(by_gap, own, None, None, None)
        stiffness = at.response.stiffness
        if not exact and isinstance(self.slip.friction, Limited):
            stiffness = self._with_direction_of_tau(at)
        gdim = stiffness.shape[1]
        by_slip = (weight / self._ct)[:, None, None] * stiffness
        by_tau = np.zeros_like(stiffness)
        if isinstance(self.slip.friction, Limited):
            # The trial has τ less what a penalty stores of it.
            part = (1 - self._ct * self._compliance_t) / self._ct
            by_tau = part[:, None, None] * (stiffness @ self.slip.projector)
        by_tau = (weight / self._ct)[:, None, None] * (by_tau - np.eye(gdim))
        if not exact:
            by_tau -= (weight * self._proximal_t)[:, None, None] * np.eye(gdim)
        positive = at.multipliers.normal[:, 0] > 0
        by_normal = (weight / self._ct * positive)[:, None] * at.response.coupling
        if at.filled is None:
            return Derivative(by_gap, own, by_slip, by_tau, by_normal)
        by_trial = (weight / self._ct)[:, None] * at.filled.by_trial
        return Derivative(
            by_gap,
            own,
            by_slip,
            by_tau + (weight / self._ct)[:, None, None] * at.filled.by_multiplier,
            by_normal + (1 - self._c * self._compliance)[:, None] * by_trial,
            self._c[:, None] * by_trial,
        )

    def softened(self, at: Evaluated) -> Array:
        """What the inexact derivative has on its diagonal to be regular, (unknowns,)."""
        normal = -self.gap.weight * at.active * self._proximal
        rows = np.repeat(normal[:, None], self.width, axis=1)
        if at.held is not None:
            rows = np.where(at.held, 0.0, rows)
        if self.slip is None:
            return np.asarray(rows.ravel())
        tangential = -self.gap.weight * self._proximal_t
        gdim = self.gap.slave.gdim
        return np.concatenate([rows.ravel(), np.repeat(tangential, gdim)])

    @staticmethod
    def _with_direction_of_tau(at: Evaluated) -> Array:
        """D with (I − τ/max(κ, |τ|) ⊗ d) in place of (I − d ⊗ d) where rows slip."""
        response, tangential = at.response, at.multipliers.tangential
        assert response is not None and tangential is not None and at.of_friction is not None
        limit = np.linalg.norm(response.traction, axis=1)
        size = np.linalg.norm(tangential, axis=1)
        slips = response.slipping & (limit > 0)
        d = np.divide(response.traction, limit[:, None], where=slips[:, None], out=0 * tangential)
        largest = np.maximum(limit, size)
        of_tau = np.divide(
            tangential, largest[:, None], where=slips[:, None], out=np.zeros_like(tangential)
        )
        change = response.secant[:, None, None] * (d - of_tau)[:, :, None] * d[:, None, :]
        return response.stiffness + change
