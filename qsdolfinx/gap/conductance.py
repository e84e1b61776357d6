"""Heat across a contact: a flux that the jump of a scalar field drives."""

from __future__ import annotations

import inspect
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.checks import FINITE, FRACTION, POSITIVE, check, either, number, require
from qsdolfinx.gap.laws import Law

Array = npt.NDArray[np.float64]

#: h of pressure and distance, and perhaps of the two temperatures, arrays of the points' shape.
ConductanceLaw = typing.Callable[..., npt.ArrayLike]

NOT_NEGATIVE = number("a number that is not negative", lambda x: x >= 0)


class Conductance(Law):
    """Flux q = h ⟦T⟧ from the slave to the master, at each pairing point: Φ = ½ Σ w_p h_p ⟦T⟧².

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

    jump = True
    linear = True

    def __init__(
        self,
        h: float | fem.Constant | ConductanceLaw,
        *,
        tool: float | fem.Constant | None = None,
        friction: float | None = None,
    ) -> None:
        if not callable(h) or isinstance(h, fem.Constant):
            check(POSITIVE, h=_value(h))
        if tool is not None:
            check(FINITE, tool=_value(tool))
        check(either(FRACTION, None), friction=friction)
        self.h, self.tool, self.friction = h, tool, friction
        self._num_arguments = _num_arguments(h) if self.of_state else 0
        fits = self._num_arguments in (0, 2, 4)
        require(fits, "h: must be a function of (p, g) or of (p, g, T_slave, T_master)")

    @property
    def of_state(self) -> bool:
        """Whether h is a function of the state of contact."""
        return callable(self.h) and not isinstance(self.h, fem.Constant)

    @property
    def of_temperature(self) -> bool:
        """Whether it is one of the temperatures as well."""
        return self._num_arguments == 4

    @property
    def tool_temperature(self) -> float:
        """Temperature of a rigid tool; 0 of none."""
        return 0.0 if self.tool is None else _value(self.tool)

    def values(self, num_points: int, state: typing.Sequence[Array] = ()) -> Array:
        """H at the points, shape (points,).

        Args:
            num_points: Points on this rank.
            state: p, g, and both temperatures if it depends on them.

        Raises:
            ValueError: If it is negative or not finite.
        """
        if not callable(self.h) or isinstance(self.h, fem.Constant):
            return np.full(num_points, _value(self.h))
        given = np.asarray(self.h(*state), dtype=np.float64)
        out = np.broadcast_to(given, (num_points,)).copy()
        if not (np.all(np.isfinite(out)) and np.all(out >= 0)):
            raise ValueError("h: gives conductances that are negative or not finite")
        return out

    def energy(self, gap: Array, penalty: Array) -> Array:
        """φ = ½ h ⟦T⟧²; ``penalty`` is h."""
        return 0.5 * penalty * np.sum(gap**2, axis=1)

    def multiplier(self, gap: Array, penalty: Array) -> Array:
        """Q = h ⟦T⟧."""
        return penalty[:, None] * gap

    def slope(self, gap: Array, penalty: Array, touching: float) -> Array:
        """φ'' = h."""
        return penalty

    def admissible(self, multiplier: Array) -> Array:
        """Any."""
        return multiplier


def rough_surfaces(
    conductivity: tuple[float, float],
    hardness: tuple[float, float],
    gas: float = 0.0,
    roughness: float | None = None,
    radiation: float = 0.0,
) -> ConductanceLaw:
    """H of rough surfaces: k̄ p/H̄ of the spots that touch, beside gas and radiation.

    k̄ and H̄ are harmonic means. Gas conducts with k_gas/(g + δ), of distance g and roughness δ, and
    radiation with σ_r (T_s² + T_m²)(T_s + T_m), of absolute temperatures.

    Args:
        conductivity: k of slave and master, power per length and temperature.
        hardness: H of the two (stress).
        gas: Conductivity of what is between them.
        roughness: δ (length), needed with gas.
        radiation: σ_r, power per area and temperature⁴: Stefan and Boltzmann's constant, with the
            emissivities.
    """
    k, H = (_harmonic(name, pair) for name, pair in _named(conductivity, hardness))
    check(NOT_NEGATIVE, gas=gas, radiation=radiation)
    check(either(POSITIVE, None), roughness=roughness)
    require(gas == 0 or roughness is not None, "roughness: needed with gas, which it keeps finite")
    delta = 1.0 if roughness is None else float(roughness)

    def of_contact(p: Array, g: Array) -> Array:
        return k * p / H + gas / (g + delta)

    def of_temperatures(p: Array, g: Array, slave: Array, master: Array) -> Array:
        return of_contact(p, g) + radiation * (slave**2 + master**2) * (slave + master)

    return of_temperatures if radiation > 0 else of_contact


def effusivity_share(slave: tuple[float, float], master: tuple[float, float]) -> float:
    """Share of the heat of friction that goes into the slave: e_s/(e_s + e_m), e = √(k c).

    Args:
        slave: Conductivity k and heat capacity per volume c of the slave.
        master: The same of the master.
    """
    both = np.array([slave, master], dtype=np.float64)
    require(both.shape == (2, 2), "slave, master: must be pairs of conductivity and heat capacity")
    check(POSITIVE, slave=both[0].min(), master=both[1].min())
    e = np.sqrt(np.prod(both, axis=1))
    return float(e[0] / e.sum())


def _named(
    conductivity: tuple[float, float], hardness: tuple[float, float]
) -> list[tuple[str, tuple[float, float]]]:
    return [("conductivity", conductivity), ("hardness", hardness)]


def _harmonic(name: str, pair: tuple[float, float]) -> float:
    require(len(pair) == 2, f"{name}: must be a pair, of slave and master")
    for value in pair:
        check(POSITIVE, **{name: value})
    return float(2 / (1 / pair[0] + 1 / pair[1]))


def _value(given: typing.Any) -> float:
    return float(given.value) if isinstance(given, fem.Constant) else given


def _num_arguments(h: typing.Any) -> int:
    return len(inspect.signature(h).parameters)
