"""Conductances of rough surfaces, and how the heat of friction is shared."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import POSITIVE, check, either, require
from qsdolfinx.gap.laws import NOT_NEGATIVE, ConductanceLaw

Array = npt.NDArray[np.float64]


def rough_surfaces(
    conductivity: tuple[float, float],
    hardness: tuple[float, float],
    gas: float = 0.0,
    roughness: float | None = None,
    radiation: float = 0.0,
) -> ConductanceLaw:
    """Conductance h of rough surfaces: k̄ p/H̄ of the spots that touch, beside gas and radiation.

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
    k, H = _harmonic("conductivity", conductivity), _harmonic("hardness", hardness)
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


def _harmonic(name: str, pair: tuple[float, float]) -> float:
    fits = isinstance(pair, typing.Sequence) and len(pair) == 2
    require(fits, f"{name}: must be a pair, of slave and master")
    for value in pair:
        check(POSITIVE, **{name: value})
    return float(2 / (1 / pair[0] + 1 / pair[1]))
