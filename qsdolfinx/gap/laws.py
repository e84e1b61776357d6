"""Contact laws: multiplier from the weighted gap, at each slave node."""

from __future__ import annotations

import abc
import inspect
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.checks import FINITE, FRACTION, Kind, check, either, number, require

Array = npt.NDArray[np.float64]

NOT_NEGATIVE = number("a number that is not negative", lambda x: x >= 0)

#: Function h of pressure and distance, and optionally of the two temperatures; all are arrays of
#: the shape of the points.
ConductanceLaw = typing.Callable[..., npt.ArrayLike]

#: Kind of h. UFL functions are callable, too, but not with arrays.
H = Kind(
    "a number, a dolfinx.fem.Constant, or a Python function of arrays",
    lambda h: (
        isinstance(h, (int, float, np.number, fem.Constant))
        or (callable(h) and not hasattr(h, "ufl_shape"))
    ),
    TypeError,
)


class Law(abc.ABC):
    """Base class of contact laws: convex energy φ of the weighted gap, Φ = Σ S_k φ(ḡ_k).

    The multiplier is λ_k = φ'(ḡ_k). A law may have history variables: ``memory`` names the
    variables, functions on the slave's surface with a number for each of its nodes. :meth:`energy`,
    :meth:`multiplier`, :meth:`slope` and :meth:`commit` receive their values at the start of the
    step as keyword arguments of these names, arrays of shape (rows,). "Rows" in shapes is the
    number of constraints. See the page "A contact law of my own".
    """

    #: Whether the law acts on the whole relative displacement (True) or on the normal gap (False).
    jump: bool
    #: Whether λ is linear in the gap: contact then adds a constant matrix.
    linear: bool
    #: Names of the history variables, and their initial values.
    memory: typing.Mapping[str, float] = {}

    @abc.abstractmethod
    def energy(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """Energy φ(ḡ) per area for each constraint, shape (rows,)."""

    @abc.abstractmethod
    def multiplier(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """Multiplier λ = φ'(ḡ), stress, of the gap's shape (rows, 1) or (rows, gdim)."""

    @abc.abstractmethod
    def slope(self, gap: Array, penalty: Array, touching: float, **memory: Array) -> Array:
        """Slope φ''(ḡ) ≥ 0 for each constraint, stress per length, shape (rows,).

        If λ falls while the gap grows, return the secant λ/ḡ. A constraint with slope 0 is inactive
        and carries nothing, whatever finite number ``multiplier`` returns.

        Args:
            gap: Weighted gaps, shape (rows, 1) or (rows, gdim).
            penalty: ε of each constraint, stress per length, shape (rows,).
            touching: Gaps above ``-touching`` (length) count as closed.
            memory: History variables by name, (rows,).
        """

    def commit(self, gap: Array, penalty: Array, **memory: Array) -> typing.Mapping[str, Array]:
        """Return the history variables at the end of a step, by name, (rows,).

        It is called once in each step, with the gaps of the solution. A step that is made again
        with a smaller Δt starts from the history variables at the start of the step.

        Args:
            gap: Weighted gaps at the end of the step.
            penalty: As for :meth:`slope`.
            memory: History variables at the start of the step.
        """
        return memory


class JumpLaw(Law):
    """Law that is linear in the relative displacement: λ = ε ⟦u⟧, for all field components."""

    jump = True
    linear = True

    def energy(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """φ = ½ ε |⟦u⟧|²."""
        return 0.5 * penalty * np.sum(gap**2, axis=1)

    def multiplier(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """λ = ε ⟦u⟧."""
        return penalty[:, None] * gap

    def slope(self, gap: Array, penalty: Array, touching: float, **memory: Array) -> Array:
        """φ'' = ε everywhere."""
        return penalty


class Tied(JumpLaw):
    """Tied contact (bilateral, sticking): λ = ε ⟦u⟧, both signs, all components.

    ⟦u⟧ is the difference of the unknowns alone: an initial gap stays as it is.
    """


class Unilateral(Law):
    """Frictionless unilateral contact: λ = ε [ḡ]₊, ḡ > 0 being penetration."""

    jump = False
    linear = False

    def energy(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """φ = ½ ε [ḡ]₊², as in equation (12)."""
        return 0.5 * penalty * np.maximum(gap[:, 0], 0) ** 2

    def multiplier(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """λ = ε [ḡ]₊."""
        return penalty[:, None] * np.maximum(gap, 0)

    def slope(self, gap: Array, penalty: Array, touching: float, **memory: Array) -> Array:
        """φ'' = ε where the gap is closed: a semi-smooth derivative of [·]₊.

        A gap that is closed up to rounding errors counts as closed, so that bodies that just touch
        at the start support each other.
        """
        return np.where(gap[:, 0] >= -touching, penalty, 0.0)


class Conductance(JumpLaw):
    """Conductance law: flux q = h ⟦T⟧ from the slave to the master at each quadrature point.

    The energy is Φ = ½ Σ w_p h_p ⟦T⟧²: at each point h_p takes the place of the penalty ε of a law
    that is linear in the temperature difference ⟦T⟧.

    Args:
        h: Heat per time, area and temperature: a number, a ``fem.Constant``, or a function of
            arrays over the points, ``h(p, g)`` or ``h(p, g, T_slave, T_master)``. p is the pressure
            (stress, not negative) and g the distance (length, 0 in contact) of the contact given as
            ``mechanics``, see :class:`qs.Contact`. h should be smooth: the tangent has its
            derivatives by differences. Derivatives by p and g are included where displacement and
            field are parts of one mixed unknown.
        tool: Temperature of a rigid tool, a number or a Constant; needed if the master is a tool.
        friction: Share, from 0 to 1, of the heat of friction of the contact ``mechanics`` that goes
            into the slave, such as :func:`qs.effusivity_share`. The rest goes into the master or
            the tool. None: no heat of friction.
    """

    def __init__(
        self,
        h: float | fem.Constant | ConductanceLaw,
        *,
        tool: float | fem.Constant | None = None,
        friction: float | None = None,
    ) -> None:
        check(H, h=h)
        if not _is_function(h):
            check(NOT_NEGATIVE, h=_value("h", h))
        if tool is not None:
            check(FINITE, tool=_value("tool", tool))
        check(either(FRACTION, None), friction=friction)
        self.h, self.tool, self.friction = h, tool, friction
        self._num_arguments = _num_arguments(h) if self.of_state else 0
        fits = self._num_arguments in (0, 2, 4)
        require(fits, "h: must be a function of (p, g) or of (p, g, T_slave, T_master)")

    @property
    def numbers(self) -> dict[str, float | None]:
        """Present values of the numbers that have to be the same on all ranks.

        Raises:
            ValueError: If h is negative, or a number is not finite.
        """
        h = None if self.of_state else _value("h", self.h)
        check(either(NOT_NEGATIVE, None), h=h)
        tool = None if self.tool is None else _value("tool", self.tool)
        check(either(FINITE, None), tool=tool)
        return {"h": h, "tool": tool, "friction": self.friction}

    @property
    def of_state(self) -> bool:
        """Whether h is a function of the state of contact."""
        return _is_function(self.h)

    @property
    def of_temperature(self) -> bool:
        """Whether h is also a function of the temperatures."""
        return self._num_arguments == 4

    @property
    def tool_temperature(self) -> float:
        """Temperature of the rigid tool; 0 if there is none."""
        return 0.0 if self.tool is None else _value("tool", self.tool)

    def values(self, num_points: int, state: typing.Sequence[Array] = ()) -> Array:
        """Values of h at the points, shape (points,).

        Args:
            num_points: Number of points on this rank.
            state: p, g, and both temperatures if h depends on them.

        Raises:
            ValueError: If h is negative or not finite.
        """
        if not self.of_state:
            return np.full(num_points, _value("h", self.h))
        given = np.asarray(typing.cast(ConductanceLaw, self.h)(*state))
        fits = given.dtype.kind in "fiu" and given.shape in ((), (num_points,))
        require(fits, "h: must return a real number for each point, an array of the shape of p")
        out = np.broadcast_to(given, (num_points,)).astype(np.float64)
        wrong = ~(out >= 0) | ~np.isfinite(out)
        if wrong.any():
            i = int(np.argmax(wrong))
            at = ", ".join(f"{values[i]:.6g}" for values in state)
            raise ValueError(f"h: must be finite and not negative, not {out[i]:.6g} at ({at})")
        return out


#: Laws of the library, whose results need no checks.
BUILT_IN: tuple[type[Law], ...] = (Tied, Unilateral, Conductance)


def _is_function(h: typing.Any) -> bool:
    return callable(h) and not isinstance(h, fem.Constant)


def _value(name: str, given: typing.Any) -> float:
    """The number, or that of a Constant."""
    if not isinstance(given, fem.Constant):
        return typing.cast(float, given)
    require(given.value.size == 1, f"{name}: must be a Constant of one number")
    return float(given.value.item())


def _num_arguments(h: typing.Any) -> int:
    """Arguments without a default."""
    parameters = inspect.signature(h).parameters.values()
    return sum(parameter.default is parameter.empty for parameter in parameters)
