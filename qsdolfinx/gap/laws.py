"""Contact laws: from the weighted gap to the multiplier, at each slave node."""

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

#: h of pressure and distance, and perhaps of the two temperatures, arrays of the points' shape.
ConductanceLaw = typing.Callable[..., npt.ArrayLike]

#: A function of UFL can be called, too, but not with arrays.
H = Kind(
    "a number, a dolfinx.fem.Constant, or a Python function of arrays",
    lambda h: (
        isinstance(h, (int, float, np.number, fem.Constant))
        or (callable(h) and not hasattr(h, "ufl_shape"))
    ),
    TypeError,
)


class Law(abc.ABC):
    """A convex energy φ of the weighted gap: Φ = Σ S_k φ(ḡ_k), with multiplier λ_k = φ'(ḡ_k).

    A law may remember: ``memory`` names numbers of each slave node, and :meth:`energy`,
    :meth:`multiplier`, :meth:`slope` and :meth:`commit` are given, by these names, arrays (rows,)
    of what they were when the step began. See the page "A contact law of my own".
    """

    #: Whether the law acts on the whole jump vector (True) or on the normal gap (False).
    jump: bool
    #: Whether λ is linear in the gap: contact then adds a constant matrix.
    linear: bool
    #: What the law remembers of each slave node, by name, and its first value.
    memory: typing.Mapping[str, float] = {}

    @abc.abstractmethod
    def energy(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """φ(ḡ), energy per area at each row, shape (rows,)."""

    @abc.abstractmethod
    def multiplier(self, gap: Array, penalty: Array, **memory: Array) -> Array:
        """λ = φ'(ḡ), stress, of the gap's shape (rows, 1) or (rows, gdim)."""

    @abc.abstractmethod
    def slope(self, gap: Array, penalty: Array, touching: float, **memory: Array) -> Array:
        """φ''(ḡ) ≥ 0 at each row, stress per length, shape (rows,).

        Args:
            gap: Weighted gaps, shape (rows, 1) or (rows, gdim).
            penalty: ε of each row, stress per length, shape (rows,).
            touching: Gaps above ``-touching`` (length) count as closed.
            memory: What the law remembers, by name, (rows,).
        """

    def commit(self, gap: Array, penalty: Array, **memory: Array) -> typing.Mapping[str, Array]:
        """What the law remembers from the end of a step on, by name, (rows,).

        It is asked once a step, with the gaps of its solution; a step that is made again with a
        smaller Δt begins with what there was.

        Args:
            gap: Weighted gaps at the end of the step.
            penalty: As for :meth:`slope`.
            memory: What the law remembered when the step began.
        """
        return memory


class JumpLaw(Law):
    """A law that is linear in the whole jump: λ = ε ⟦u⟧, of the field's components."""

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
    """Bilateral sticking contact: λ = ε ⟦u⟧, both signs, all components.

    The jump is that of the unknown alone: an initial gap stays as it is.
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

        A gap closed to rounding error counts as closed, so that bodies that just touch at the start
        hold each other.
        """
        return np.where(gap[:, 0] >= -touching, penalty, 0.0)


class Conductance(JumpLaw):
    """Flux q = h ⟦T⟧ from the slave to the master, at each pairing point: Φ = ½ Σ w_p h_p ⟦T⟧².

    It is the penalty ε of a law that is linear in the jump, place by place.

    Args:
        h: Heat per time, area and temperature: a number, a ``fem.Constant``, or a function of
            arrays over the points, ``h(p, g)`` or ``h(p, g, T_slave, T_master)``, of the pressure p
            (stress, not negative) and the distance g (length, 0 in contact) of the contact that
            ``of`` names, see :class:`qs.Contact`. It should be smooth: the tangent has its
            derivatives by differences, those by p and g where displacement and field are parts of
            one mixed unknown.
        tool: Temperature of a rigid tool, number or Constant; needed if the master is one.
        friction: Share of the heat of friction of the contact ``of`` that goes into the slave, from
            0 to 1, such as :func:`qs.effusivity_share`; the rest goes into the master, or a tool.
            None: that heat is left out.
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
        """What has to be the same on all ranks, as it is now.

        Raises:
            ValueError: If h is negative, or one of them not finite.
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
        """Whether it is one of the temperatures as well."""
        return self._num_arguments == 4

    @property
    def tool_temperature(self) -> float:
        """Temperature of a rigid tool; 0 of none."""
        return 0.0 if self.tool is None else _value("tool", self.tool)

    def values(self, num_points: int, state: typing.Sequence[Array] = ()) -> Array:
        """H at the points, shape (points,).

        Args:
            num_points: Points on this rank.
            state: p, g, and both temperatures if it depends on them.

        Raises:
            ValueError: If it is negative or not finite.
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
            raise ValueError(f"h: gives {out[i]:.6g} at ({at}), negative or not finite")
        return out


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
