"""User-defined contact law with a history variable: a bond that breaks."""

import numpy as np

import qsdolfinx as qs


class Bond(qs.Law):
    """Bond that holds up to its strength, softens, and breaks at an opening.

    It resists compression like a penalty.

    Args:
        strength: Largest tension, stress.
        opening: Opening at which the bond is broken, length.
    """

    jump, linear = False, False
    memory = {"damage": 0.0}  # noqa: RUF012

    def __init__(self, strength, opening):
        self.strength, self.opening = strength, opening

    def commit(self, gap, penalty, damage):
        opening, first = np.maximum(-gap[:, 0], 1e-300), self.strength / penalty
        softens = self.opening / opening * (opening - first) / (self.opening - first)
        return {"damage": np.maximum(damage, np.clip(softens, 0.0, 1.0))}

    def slope(self, gap, penalty, touching, damage):
        lasts = 1 - self.commit(gap, penalty, damage)["damage"]
        return np.where(gap[:, 0] < 0, lasts, 1.0) * penalty

    def multiplier(self, gap, penalty, damage):
        return self.slope(gap, penalty, 0.0, damage)[:, None] * gap

    def energy(self, gap, penalty, damage):
        return 0.5 * self.slope(gap, penalty, 0.0, damage) * gap[:, 0] ** 2
