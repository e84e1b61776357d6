"""Friction laws: tangential multiplier from slip and contact pressure, at each constraint."""

from __future__ import annotations

import abc
import math
import types
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.checks import POSITIVE, check, either, require
from qsdolfinx.base.rounding import ROUNDING

Array = npt.NDArray[np.float64]
#: A constant, or a scalar function on the mesh of the slave.
Parameter: typing.TypeAlias = float | fem.Constant | fem.Function

#: Points of time, as parts of the step, at which limits of a changing pressure are averaged.
CHANGING = (np.arange(8) + 0.5) / 8


class Rows(typing.NamedTuple):
    """Input of a friction law, for each constraint.

    "Rows" in shapes is the number of constraints.

    Attributes:
        slip: Slip g (length): tangential part of the change of the relative displacement since the
            step began, or since the constraint became active in it, (rows, gdim).
        traction: Tangential multiplier τ̂ from which the trial starts (stress), (rows, gdim).
        pressure: Normal multiplier λ ≥ 0 (stress), (rows,).
        closed: Active constraints, (rows,).
        unlimited: Constraints to be evaluated as if there were no limit, (rows,).
        penalty: ε of each constraint in tangential direction (stress per length), (rows,).
        projector: Projector on the tangent plane, (rows, gdim, gdim).
        cover: Mortar weight of the covered support over the area of the constraint: g divided by it
            is a mean slip, (rows,).
        dt: Δt (time); None if there is none.
        slow: Slip rate (length per time) that counts as slow in this problem; None if friction does
            not depend on rates.
        parameters: Values of the law's parameters, (rows,) each.
        share: Part of the step, above 0, in which the constraint was active: g is the slip within
            the time share Δt, (rows,).
        pressed: λ at the start of the step; 0 for constraints that were inactive then, (rows,).
        goes_on: Constraints to be evaluated as slipping for any trial, (rows,); None for none.
        memory: History variables of the law at the start of the step by name, (rows,) each;
            read-only.
    """

    slip: Array
    traction: Array
    pressure: Array
    closed: npt.NDArray[np.bool_]
    unlimited: npt.NDArray[np.bool_]
    penalty: Array
    projector: Array
    cover: Array
    dt: float | None
    slow: float | None
    parameters: dict[str, Array]
    share: Array
    pressed: Array
    goes_on: npt.NDArray[np.bool_] | None = None
    memory: typing.Mapping[str, Array] = types.MappingProxyType({})


class Slid(typing.NamedTuple):
    """What a step has done at each constraint, for :meth:`Friction.commit`.

    Attributes:
        slip: Mean slip in the step (length): the part of the relative displacement that dissipates
            energy, along the surfaces, (rows, gdim). For constraints that open in the step it is
            the slip until they open; it is 0 for others without contact.
        traction: τ at the end of the step (stress), (rows, gdim).
        energy: Energy per area that the step has dissipated, (rows,).
    """

    slip: Array
    traction: Array
    energy: Array


class Response(typing.NamedTuple):
    """Result of a friction law, for each constraint.

    Attributes:
        traction: Multiplier τ (stress); the friction on the slave is −τ, (rows, gdim).
        stiffness: D = ∂τ/∂g (stress per length), (rows, gdim, gdim).
        coupling: ∂τ/∂λ, (rows, gdim).
        slipping: Active constraints that slip, (rows,).
        dissipative: Dissipative part of the slip g (length), (rows, gdim).
        secant: |τ| over the corresponding slip (stress per length), (rows,): the stiffness of τ if
            its direction could follow g freely.
    """

    traction: Array
    stiffness: Array
    coupling: Array
    slipping: npt.NDArray[np.bool_]
    dissipative: Array
    secant: Array


class Friction(abc.ABC):
    """Base class of friction laws: tangential multipliers τ_k that act on the weighted slip.

    With a law whose limit does not vanish with the pressure, τ jumps to zero when a node opens.
    There may be no equilibrium with such a node open, nor with the node in contact and the full τ.
    The node is then in contact with zero pressure and a part of τ, see ``fill``. With
    ``constraints="points"`` the law is evaluated at each contact quadrature point, see
    ``PointFriction``, and |τ| is at most 3 times the pressure there.

    A law may have history variables, such as the slip so far: ``memory`` names them, and ``commit``
    returns their values at the end of a step. All methods find the values at the start of the step
    in ``rows.memory``; they do not change within the step. See the page "A contact law of my own".

    The virtual work of contact is Σ S_k (λ_k δḡ_k + τ_k · δg_k), g_k being the tangential part of
    (1/S_k) Σ_p w_p N_k(ξ_p) (Δu_s − Δu_m), Δu the displacement since the step began.

    Args:
        parameters: The law's parameters by name.

    Raises:
        ValueError: If a number is negative or not finite.
        TypeError: If a parameter is neither a number nor a scalar Constant or Function.
    """

    #: Whether τ has a potential in g, so that the tangent is symmetric.
    symmetric: bool = True
    #: Whether τ jumps to zero when a node opens.
    jumps: bool = True
    #: Whether |τ| is bounded: constraints at the edge of contact may then have a part of it.
    is_bounded: bool = True
    #: Whether τ depends on the slip rate, and so on Δt.
    needs_dt: bool = False
    #: Whether it needs a slip rate that counts as slow.
    needs_rate: bool = False
    #: Names of the history variables, and their initial values.
    memory: typing.Mapping[str, float] = types.MappingProxyType({})

    def __init__(self, **parameters: Parameter) -> None:
        self._parameters = {name: _checked(name, value) for name, value in parameters.items()}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The law's numbers, Constants and Functions by name."""
        return self._parameters

    def __repr__(self) -> str:
        numbers = {k: v if isinstance(v, float) else "…" for k, v in self.parameters.items()}
        given = ", ".join(f"{name}={value}" for name, value in numbers.items())
        return f"{type(self).__name__}({given})"

    @abc.abstractmethod
    def respond(self, rows: Rows) -> Response:
        """Compute τ and its derivatives."""

    def growth(self, rows: Rows) -> Array:
        """Mean of |τ| in the step over |τ| at its end, (rows,), for a changing pressure.

        Used for the energy dissipated by friction; 1 where τ does not depend on the pressure.
        """
        return np.ones_like(rows.pressure)

    def used(self, rows: Rows, response: Response) -> Array:
        """Part of the friction limit that |τ| reaches, from 0 to 1, (rows,).

        Used for the energy of constraints that open in the next step. Without a limit, it is 1
        where constraints slip, and 0 elsewhere.

        Args:
            rows: Input of the law.
            response: Its response to them.
        """
        return response.slipping.astype(np.float64)

    def commit(self, rows: Rows, slid: Slid) -> typing.Mapping[str, Array]:
        """Return the history variables at the end of a step, by name, (rows,).

        It is called once in each step that has succeeded. A step that is made again with a smaller
        Δt starts from the history variables at the start of the step.

        Args:
            rows: Input of the law at the end of the step: its pressure, parameters, Δt, and
                ``memory`` at the start of the step.
            slid: Slip, traction and dissipated energy of the step.
        """
        return rows.memory


class Limited(Friction):
    """Sticks while |τ| is below a limit κ(λ), and slips in the direction of τ at the limit.

    Return mapping: the trial τ̂ + ε g is kept where it is below κ, and otherwise scaled to κ. With
    a penalty, τ̂ is the multiplier at the end of the last step, so that sticking is elastic with
    the stiffness ε. With an augmented Lagrangian, sticking is rigid, and slip and τ have the same
    direction.
    """

    @abc.abstractmethod
    def limit(self, rows: Rows) -> tuple[Array, Array]:
        """κ ≥ 0 (stress) and ∂κ/∂λ, (rows,) each."""

    def respond(self, rows: Rows) -> Response:
        """τ and its derivatives."""
        limit, slope = self.limit(rows)
        wrong = rows.closed & (rows.pressure > 0) & (limit < 0)
        require(not wrong.any(), f"friction: {type(self).__name__}.limit must not be negative")
        limit = np.where(rows.unlimited, np.inf, limit)
        eps = rows.penalty[:, None]
        trial = rows.traction + eps * rows.slip
        size = np.linalg.norm(trial, axis=1)
        # A node that has slipped starts the next step on its limit: rounding must not decide.
        slipping = rows.closed & ~(size <= limit * (1 + ROUNDING))  # and with NaN
        if rows.goes_on is not None:
            slipping |= rows.closed & rows.goes_on & (size > 0)
        safe = np.where(size > 0, size, 1.0)
        factor = np.where(slipping, np.minimum(limit / safe, 1.0), 1.0) * rows.closed
        traction = np.where(factor[:, None] <= 0, 0.0, factor[:, None] * trial)
        direction = np.where(slipping, 1 / safe, 0.0)[:, None] * trial
        plane = rows.projector - direction[:, :, None] * direction[:, None, :]
        return Response(
            traction,
            (factor * rows.penalty)[:, None, None] * plane,
            slope[:, None] * direction,
            slipping,
            np.where(rows.closed[:, None], (trial - traction) / eps, rows.slip),
            factor * rows.penalty,
        )

    def growth(self, rows: Rows) -> Array:
        """Mean of the limit over its value at the end, for a constant rate of the pressure."""
        end, change = self.limit(rows)[0], rows.pressure - rows.pressed
        between = [rows.pressed + x * change for x in CHANGING]
        limits = [self.limit(rows._replace(pressure=pressure))[0] for pressure in between]
        usual = np.isfinite(end) & (end > 0)
        return np.asarray(np.divide(np.mean(limits, axis=0), end, np.ones_like(end), where=usual))

    def used(self, rows: Rows, response: Response) -> Array:
        """|τ|/κ(λ); 1 where constraints slip."""
        limit, size = self.limit(rows)[0], np.linalg.norm(response.traction, axis=1)
        usual = rows.closed & np.isfinite(limit) & (limit > 0)
        part = np.divide(size, limit, out=np.zeros_like(size), where=usual)
        return np.where(response.slipping, 1.0, np.minimum(part, 1.0))


class Coulomb(Limited):
    """Coulomb's law |τ| ≤ μ λ. Its tangent is not symmetric.

    Args:
        mu: Coefficient of friction μ.
    """

    symmetric = False
    jumps = False

    def __init__(self, mu: Parameter) -> None:
        super().__init__(mu=mu)

    def limit(self, rows: Rows) -> tuple[Array, Array]:
        """κ = μ λ."""
        mu = rows.parameters["mu"]
        return mu * rows.pressure, mu


class Tresca(Limited):
    """Tresca's law |τ| ≤ κ at nodes in contact.

    τ jumps to zero where a node opens, so that a step in which nodes open can have more than one
    equilibrium. The equilibrium that is found may depend on the order of bodies and on the number
    of ranks. :class:`CoulombTresca`, whose limit vanishes with the pressure, has no such jump.
    ``constraints="points"`` avoids the jump, too.

    Args:
        limit: κ, stress.
    """

    def __init__(self, limit: Parameter) -> None:
        super().__init__(limit=limit)

    def limit(self, rows: Rows) -> tuple[Array, Array]:
        """κ as given."""
        limit = rows.parameters["limit"]
        return limit, np.zeros_like(limit)


class CoulombTresca(Limited):
    """Coulomb's law limited by the shear yield stress, |τ| ≤ min(μ λ, m̄ σ₀/√3). Not symmetric.

    Args:
        mu: Coefficient of friction μ.
        m_bar: Friction factor m̄, from 0 to 1; for a Constant or Function this is not checked.
        flow_stress: σ₀, stress.
    """

    symmetric = False
    jumps = False

    def __init__(self, mu: Parameter, m_bar: Parameter, flow_stress: Parameter) -> None:
        super().__init__(mu=mu, m_bar=m_bar, flow_stress=flow_stress)
        factor = self.parameters["m_bar"]
        if isinstance(factor, float) and factor > 1:
            raise ValueError(f"m_bar: must be from 0 to 1, not {m_bar!r}")

    def limit(self, rows: Rows) -> tuple[Array, Array]:
        """κ = min(μ λ, m̄ σ₀/√3)."""
        p = rows.parameters
        highest = p["m_bar"] * p["flow_stress"] / math.sqrt(3)
        limit = p["mu"] * rows.pressure
        return np.minimum(limit, highest), np.where(limit < highest, p["mu"], 0.0)


class Sticking(Limited):
    """Sticking friction: no slip in contact; at points as long as |τ| ≤ 3 times the pressure."""

    is_bounded = False

    def limit(self, rows: Rows) -> tuple[Array, Array]:
        """κ = ∞."""
        zero = np.zeros_like(rows.pressure)
        return zero + np.inf, zero


class Norton(Friction):
    """Viscoplastic friction τ = α K |Δv|^(q−1) Δv at nodes in contact, −τ acting on the slave.

    |Δv| is regularised as √(|Δv|² + v₀²): the law is linear for slip rates well below v₀. Above v₀
    this changes τ by a factor of less than 1 + ½ |q − 1| (v₀/|Δv|)².

    Args:
        alpha: α, dimensionless.
        K: Consistency K, stress × (time/length)^q.
        q: Sensitivity to the slip rate, above 0.
        v0: Slip rate v₀ (length per time). By default 1e-3 of the largest slip rate in the first
            step with slip, for any Δt. It is computed again in a later step in which the largest
            slip rate is at least 5 times smaller.
    """

    needs_dt = True

    def __init__(self, alpha: Parameter, K: Parameter, q: float, v0: float | None = None) -> None:
        check(POSITIVE, q=q)
        check(either(POSITIVE, None), v0=v0)
        super().__init__(alpha=alpha, K=K)
        self.q, self.v0, self.needs_rate = float(q), v0, v0 is None

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, q={self.q}, v0={self.v0})"

    def respond(self, rows: Rows) -> Response:
        """τ and its derivatives."""
        assert rows.dt is not None and rows.slow is not None
        # The mean slip rate of a constraint, and its derivative with respect to g.
        per_slip = np.where(rows.closed, 1 / (rows.cover * rows.share * rows.dt), 0.0)
        v = per_slip[:, None] * rows.slip
        v0 = rows.slow if self.v0 is None else self.v0
        size = np.sqrt(np.sum(v**2, axis=1) + v0**2)
        viscosity = rows.parameters["alpha"] * rows.parameters["K"] * size ** (self.q - 1)
        direction = v / size[:, None]
        plane = rows.projector + (self.q - 1) * direction[:, :, None] * direction[:, None, :]
        return Response(
            viscosity[:, None] * v,
            (viscosity * per_slip)[:, None, None] * plane,
            np.zeros_like(v),
            rows.closed & (np.sum(v**2, axis=1) > v0**2),
            rows.slip,
            viscosity * per_slip,
        )


def _checked(name: str, value: Parameter) -> Parameter:
    if isinstance(value, (fem.Constant, fem.Function)):
        if value.ufl_shape != ():
            raise TypeError(f"{name}: must be scalar, not of shape {value.ufl_shape}")
        return value
    number = isinstance(value, (int, float, np.floating, np.integer))
    if not number or isinstance(value, bool):
        raise TypeError(f"{name}: must be a number or a scalar Constant or Function, not {value!r}")
    if not (math.isfinite(value) and value >= 0):
        raise ValueError(f"{name}: must be finite and not negative, not {value!r}")
    return float(value)
