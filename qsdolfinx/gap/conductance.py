"""Conductances of rough surfaces, and the share of the heat of friction of each body."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import POSITIVE, check, either, require
from qsdolfinx.gap.laws import NOT_NEGATIVE, ConductanceLaw

Array = npt.NDArray[np.float64]


#: One property of two bodies, or two properties of one body.
Pair = tuple[float, float]

BY_BODY = "slave, master: give both by name, {}, all of a body together"


def rough_surfaces(
    *unnamed: object,
    slave: Pair | None = None,
    master: Pair | None = None,
    conductivity: Pair | None = None,
    hardness: Pair | None = None,
    gas: float = 0.0,
    roughness: float | None = None,
    radiation: float = 0.0,
) -> ConductanceLaw:
    """Conductance h of rough surfaces: the sum of solid spots, gas, and radiation.

    Touching spots conduct with k̄ p/H̄, where k̄ and H̄ are harmonic means. Gas conducts with
    k_gas/(g + δ), for the distance g and the roughness δ. Radiation conducts with
    σ_r (T_s² + T_m²)(T_s + T_m), for absolute temperatures. All arguments are given by name:
    ``rough_surfaces(slave=(16.2, 129.0), master=(210.0, 15.0))``.

    Args:
        unnamed: Not allowed: a pair without a name can belong to a body or to a property.
        slave: Conductivity k (power per length and temperature) and hardness H (stress) of the
            slave.
        master: The same for the master.
        conductivity: Instead of ``slave`` and ``master``, together with ``hardness``: k of slave
            and master.
        hardness: H of slave and master.
        gas: Conductivity k_gas of the medium between the surfaces.
        roughness: δ (length), needed with gas.
        radiation: σ_r, power per area and temperature⁴: the Stefan-Boltzmann constant times the
            factor of the emissivities.

    Raises:
        TypeError: If pairs have no name, or are given both by body and by property.
    """
    by_body, by_property = (slave, master), (conductivity, hardness)
    text = BY_BODY.format("rough_surfaces(slave=(k, H), master=(k, H))")
    one_kind = by_body == (None, None) or by_property == (None, None)
    require(not unnamed and one_kind, text, TypeError)
    if by_property == (None, None):
        conductivity, hardness = _by_property("k, H", slave, master, text)
    else:
        require(None not in by_property, "conductivity, hardness: give both", TypeError)
    k, H = _harmonic("conductivity", conductivity), _harmonic("hardness", hardness)
    check(NOT_NEGATIVE, gas=gas, radiation=radiation)
    check(either(POSITIVE, None), roughness=roughness)
    text = "roughness: give it with gas; without it gas / (g + roughness) is infinite at no gap"
    require(gas == 0 or roughness is not None, text)
    delta = 1.0 if roughness is None else float(roughness)

    def of_contact(p: Array, g: Array) -> Array:
        return k * p / H + gas / (g + delta)

    def of_temperatures(p: Array, g: Array, slave: Array, master: Array) -> Array:
        return of_contact(p, g) + radiation * (slave**2 + master**2) * (slave + master)

    return of_temperatures if radiation > 0 else of_contact


def effusivity_share(
    *unnamed: object, slave: Pair | None = None, master: Pair | None = None
) -> float:
    """Share of the heat of friction that goes into the slave: e_s/(e_s + e_m), e = √(k c).

    Both pairs are given by name: ``effusivity_share(slave=(16.2, 4.0), master=(210.0, 3.6))``.

    Args:
        unnamed: Not allowed, as in :func:`rough_surfaces`.
        slave: Conductivity k (power per length and temperature) and heat capacity per volume c
            (energy per volume and temperature) of the slave.
        master: The same for the master.

    Raises:
        TypeError: If a pair has no name.
    """
    text = BY_BODY.format("effusivity_share(slave=(k, c), master=(k, c))")
    require(not unnamed, text, TypeError)
    k, c = _by_property("k, c", slave, master, text)
    e = np.sqrt(np.multiply(k, c))
    return float(e[0] / e.sum())


def _by_property(what: str, slave: typing.Any, master: typing.Any, text: str) -> tuple[Pair, Pair]:
    """Return the pairs of the two bodies as pairs of the two properties."""
    require(slave is not None and master is not None, text, TypeError)
    for name, pair in (("slave", slave), ("master", master)):
        fits = isinstance(pair, typing.Sequence) and len(pair) == 2
        require(fits, f"{name}: must be a pair ({what}) of this body")
        for value in pair:
            check(POSITIVE, **{name: value})
    return (float(slave[0]), float(master[0])), (float(slave[1]), float(master[1]))


def _harmonic(name: str, pair: typing.Any) -> float:
    fits = isinstance(pair, typing.Sequence) and len(pair) == 2
    require(fits, f"{name}: must be a pair, of slave and master")
    for value in pair:
        check(POSITIVE, **{name: value})
    return float(2 / (1 / pair[0] + 1 / pair[1]))
