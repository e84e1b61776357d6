"""A user's law at gaps chosen for checks: how far it reaches, and whether its signs are right."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.gap.laws import Law

Array = npt.NDArray[np.float64]

#: Smallest and largest opening at which the reach of a law is looked for, and its steps, as powers
#: of 2 times the size of a facet.
OPENINGS = 2.0 ** np.arange(-20.0, 20.0, 0.25)

#: Multiplier over its largest value below which a law has ended: with much less, the tail of an
#: exponential law would never end; with more, a part of its work is lost.
ENDED = 1e-3

#: Gaps at which signs are checked, in units of the size of a facet.
GAPS = 2.0 ** np.arange(-12.0, 0.0)

#: Factor by which a slope may differ from both difference and secant of the multiplier: kinks of
#: legal laws cause less than 2, a forgotten factor or sign causes more.
ALIKE = 2.0


class Samples(typing.NamedTuple):
    """Results of a law along one direction, for its initial history variables.

    Attributes:
        gap: Gaps, positive in penetration (length), (n,).
        multiplier: λ (stress), (n,).
        slope: φ'' as the law returns it (stress per length), (n,).
        change: ∂λ/∂gap by differences (stress per length), (n,).
    """

    gap: Array
    multiplier: Array
    slope: Array
    change: Array

    @property
    def secant(self) -> Array:
        """λ/gap (stress per length), (n,)."""
        return np.asarray(self.multiplier / self.gap)


def reach(law: Law, penalty: float, size: float) -> float | None:
    """Opening (length) beyond which a law of normal gaps gives no multiplier; None if unknown.

    Args:
        law: The law.
        penalty: ε (stress per length).
        size: Size of a facet (length).
    """
    opening = size * OPENINGS
    found = _multiplier(law, -opening[:, None], penalty)
    if found is None or not np.isfinite(found).all():
        return None
    acts = np.abs(found[:, 0]) > ENDED * np.abs(found).max()
    if not acts.any() or acts[-1]:
        return None
    return float(opening[np.flatnonzero(acts)[-1] + 1])


def sampled(law: Law, penalty: float, size: float, gdim: int) -> Samples | None:
    """A law at gaps of both signs, where it is finite; None if it cannot be asked at these.

    Args:
        law: The law; one of the whole relative displacement is asked along the first axis.
        penalty: ε (stress per length).
        size: Size of a facet (length).
        gdim: Dimension of space.
    """
    along = size * np.concatenate([-GAPS[::-1], GAPS])
    gap = np.zeros((len(along), gdim if law.jump else 1))
    gap[:, 0] = along
    small = 1e-6  # with less, rounding would be seen; with more, the curvature of laws
    first, second = (_multiplier(law, part * gap, penalty) for part in (1.0, 1 + small))
    slope = _slope(law, gap, penalty)
    if first is None or second is None or slope is None:
        return None
    change = (second[:, 0] - first[:, 0]) / (small * along)
    out = np.array([along, first[:, 0], slope, change])
    return Samples(*out[:, np.isfinite(out).all(axis=0)])


def fault(law: Law, samples: Samples) -> str | None:
    """What is wrong with signs or slopes of a law; None if nothing is.

    Adhesion, which pulls where surfaces are apart, and a pressure at a distance are right.
    """
    name, s = type(law).__name__, samples
    if (where := s.slope < 0).any():
        return f"{name}.slope is negative ({_at(s, where, s.slope)}); return the secant {_SECANT}"
    acts = (s.slope > 0) & (s.multiplier != 0)
    against = acts & (s.change < 0) & (s.secant < 0)
    if law.jump:
        if against.any():
            text = f"{name}.multiplier acts along the relative displacement, slave minus master, "
            return f"{text}so that surfaces drive each other apart ({_at(s, against)})"
        return None
    closed = s.gap > 0
    pulls, presses = acts & closed & (s.multiplier < 0), acts & ~closed & (s.multiplier > 0)
    if pulls.any() and not (s.multiplier[closed] > 0).any():
        return f"{name}.multiplier pulls where surfaces penetrate ({_at(s, pulls)}); {_SIGNS}"
    if presses.any() and not (s.multiplier[closed] > 0).any():
        text = f"{name}.multiplier presses where surfaces are apart ({_at(s, presses)}), and not "
        return f"{text}where they penetrate; {_SIGNS}"
    if against.any():
        text = f"{name}.multiplier grows as surfaces part ({_at(s, against)}): "
        return f"{text}a tension is negative; {_SIGNS}"
    return _slope_fault(name, s, acts)


def _slope_fault(name: str, s: Samples, acts: npt.NDArray[np.bool_]) -> str | None:
    """What is wrong with the size of most slopes; None if nothing is."""
    both = np.abs([s.change, s.secant])
    wrong = acts & ((s.slope > ALIKE * both.max(axis=0)) | (s.slope < both.min(axis=0) / ALIKE))
    if not np.count_nonzero(wrong) > 0.5 * np.count_nonzero(acts):
        return None
    i = int(np.flatnonzero(wrong)[-1])
    return (
        f"{name}.slope is {s.slope[i]:.3g} at gap = {s.gap[i]:.3g}, but the multiplier changes by "
        f"{s.change[i]:.3g} per gap there (secant {s.secant[i]:.3g}): Newton's method needs one of "
        "these, the secant where the multiplier falls"
    )


_SECANT = "multiplier/gap where the multiplier falls as the gap grows"
_SIGNS = "gap is positive in penetration, and a positive multiplier is a pressure"


def _at(s: Samples, where: npt.NDArray[np.bool_], values: Array | None = None) -> str:
    """The last sample with a flag."""
    i = int(np.flatnonzero(where)[-1])
    return f"{(s.multiplier if values is None else values)[i]:.3g} at gap = {s.gap[i]:.3g}"


def _multiplier(law: Law, gap: Array, penalty: float) -> Array | None:
    return _asked(lambda *a, **m: law.multiplier(*a, **m), law, gap, penalty, gap.shape)


def _slope(law: Law, gap: Array, penalty: float) -> Array | None:
    return _asked(lambda g, eps, **m: law.slope(g, eps, 0.0, **m), law, gap, penalty, gap.shape[:1])


def _asked(
    function: typing.Callable[..., Array],
    law: Law,
    gap: Array,
    penalty: float,
    shape: tuple[int, ...],
) -> Array | None:
    """Result of a function of the law; None if it has another shape, or the law refuses the gaps.

    Errors of the law are left to the solve, which asks at gaps that occur.
    """
    memory = {name: np.full(len(gap), float(value)) for name, value in law.memory.items()}
    try:
        with np.errstate(all="ignore"):
            out = np.array(function(gap.copy(), np.full(len(gap), penalty), **memory), dtype=float)
    except Exception:
        return None
    return out if out.shape == shape else None
