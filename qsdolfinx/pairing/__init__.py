"""Contact detection: the quadrature points where the gap between two surfaces is sampled."""

from qsdolfinx.pairing.points import Pairing, PairingSide

__all__ = ["Pairing", "PairingSide"]
