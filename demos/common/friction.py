"""Set the friction laws between workpiece and dies in the forming demos.

The shear yield stress and the consistency are those of the workpiece: Tresca's limit is m̄ σ₀/√3,
Norton's law is α K |Δv|^(q−1) Δv with q from the rate sensitivity of the workpiece.
"""

import numpy as np

from dolfinx import fem

import qsdolfinx as qs

FRICTIONS = ("none", "norton", "coulomb", "tresca", "coulomb-tresca", "sticking")


class Friction:
    """Friction law for a Norton-Hoff workpiece, with limits that depend on its flow stress.

    Args:
        p: Parameters: ``friction`` names the law; ``mu``, ``m_bar`` and ``alpha`` are its
            coefficients.
        msh: Mesh of the workpiece.
        K: Consistency of the workpiece.
        m: Rate sensitivity of the workpiece.
    """

    def __init__(self, p, msh, K, m):
        self.p, self.K, self.m = p, K, m
        self.flow_stress, self.limit = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)

    def set_rate(self, rate):
        """Update the limit to the flow stress σ₀ = K √3^{m+1} ε̇^m at a strain rate."""
        self.flow_stress.value = self.K * np.sqrt(3) ** (self.m + 1) * rate**self.m
        self.limit.value = self.p.m_bar * self.flow_stress.value / np.sqrt(3)

    def law(self):
        """Return the friction law for one contact; None without friction."""
        return {
            "none": lambda: None,
            "norton": lambda: qs.Norton(self.p.alpha, self.K, self.m),
            "coulomb": lambda: qs.Coulomb(self.p.mu),
            "tresca": lambda: qs.Tresca(self.limit),
            "coulomb-tresca": lambda: qs.CoulombTresca(self.p.mu, self.p.m_bar, self.flow_stress),
            "sticking": qs.Sticking,
        }[self.p.friction]()
