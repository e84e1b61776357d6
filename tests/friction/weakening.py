"""User-defined friction laws with history variables: coefficients that fall."""

import numpy as np

import qsdolfinx as qs
from qsdolfinx.friction import Limited


class Weakening(Limited):
    """Coulomb's law whose coefficient falls with the slip so far.

    Args:
        first: Coefficient of friction before any slip.
        last: Coefficient of friction after much slip.
        length: Slip within which it falls.
    """

    symmetric, jumps = False, False
    memory = {"way": 0.0}  # noqa: RUF012

    def __init__(self, first, last, length):
        super().__init__(first=first, last=last, length=length)

    def mu(self, parameters, way):
        """Coefficient of friction."""
        p = parameters
        return p["last"] + (p["first"] - p["last"]) * np.exp(-way / p["length"])

    def limit(self, rows):
        mu = self.mu(rows.parameters, rows.memory["way"])
        return mu * rows.pressure, mu

    def commit(self, rows, slid):
        return {"way": rows.memory["way"] + np.linalg.norm(slid.slip, axis=1)}


class Worn(qs.Coulomb):
    """Coulomb's law with a coefficient that falls with the energy dissipated per area."""

    memory = {"energy": 0.0, "depth": 1.0}  # noqa: RUF012

    #: Energy per area at which the coefficient is half as large.
    HALF = 0.05

    def limit(self, rows):
        limit, mu = super().limit(rows)
        part = 1 / (1 + rows.memory["energy"] / self.HALF)
        return part * limit, part * mu

    def commit(self, rows, slid):
        way = np.linalg.norm(slid.slip, axis=1)
        return {
            "energy": rows.memory["energy"] + slid.energy,
            "depth": rows.memory["depth"] + rows.pressure * way,
        }
