"""Contact laws: from the weighted gap to the multiplier, at each slave node."""

from __future__ import annotations

import abc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Law(abc.ABC):
    """A convex energy φ of the weighted gap: Φ = Σ S_k φ(ḡ_k), with multiplier λ_k = φ'(ḡ_k)."""

    #: Whether the law acts on the whole jump vector (True) or on the normal gap (False).
    jump: bool
    #: Whether λ is linear in the gap: contact then adds a constant matrix.
    linear: bool

    @abc.abstractmethod
    def energy(self, gap: Array, penalty: Array) -> Array:
        """φ(ḡ), energy per area at each row, shape (rows,)."""

    @abc.abstractmethod
    def multiplier(self, gap: Array, penalty: Array) -> Array:
        """λ = φ'(ḡ), stress, of the gap's shape (rows, 1) or (rows, gdim)."""

    @abc.abstractmethod
    def slope(self, gap: Array, penalty: Array, touching: float) -> Array:
        """φ''(ḡ) ≥ 0 at each row, stress per length, shape (rows,).

        Args:
            gap: Weighted gaps, shape (rows, 1) or (rows, gdim).
            penalty: ε of each row, stress per length, shape (rows,).
            touching: Gaps above ``-touching`` (length) count as closed.
        """

    @abc.abstractmethod
    def admissible(self, multiplier: Array) -> Array:
        """The nearest multiplier that the law can give."""


class Tied(Law):
    """Bilateral sticking contact: λ = ε ⟦u⟧, both signs, all components.

    The jump is that of the unknown alone: an initial gap stays as it is.
    """

    jump = True
    linear = True

    def energy(self, gap: Array, penalty: Array) -> Array:
        """φ = ½ ε |⟦u⟧|²."""
        return 0.5 * penalty * np.sum(gap**2, axis=1)

    def multiplier(self, gap: Array, penalty: Array) -> Array:
        """λ = ε ⟦u⟧."""
        return penalty[:, None] * gap

    def slope(self, gap: Array, penalty: Array, touching: float) -> Array:
        """φ'' = ε everywhere."""
        return penalty

    def admissible(self, multiplier: Array) -> Array:
        """Any."""
        return multiplier


class Unilateral(Law):
    """Frictionless unilateral contact: λ = ε [ḡ]₊, ḡ > 0 being penetration."""

    jump = False
    linear = False

    def energy(self, gap: Array, penalty: Array) -> Array:
        """φ = ½ ε [ḡ]₊², as in equation (12)."""
        return 0.5 * penalty * np.maximum(gap[:, 0], 0) ** 2

    def multiplier(self, gap: Array, penalty: Array) -> Array:
        """λ = ε [ḡ]₊."""
        return penalty[:, None] * np.maximum(gap, 0)

    def slope(self, gap: Array, penalty: Array, touching: float) -> Array:
        """φ'' = ε where the gap is closed: a semi-smooth derivative of [·]₊.

        A gap closed to rounding error counts as closed, so that bodies that just touch at the start
        hold each other.
        """
        return np.where(gap[:, 0] >= -touching, penalty, 0.0)

    def admissible(self, multiplier: Array) -> Array:
        """None that pulls."""
        return np.maximum(multiplier, 0)
