"""Surfaces that penetrate each other where they are first paired, before anything has moved."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import FRACTION, check, one_of
from qsdolfinx.base.collective import checked
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]

TREATMENTS = ("resolve", "ignore", "error")

#: Overclosure that ``"error"`` lets pass, in units of the smallest facet: coordinates that went
#: through a file in single precision are off by about this much.
TOLERANCE = 1e-5


class Overclosure:
    """What a contact does about penetration at its first pairing.

    It belongs to the nodes that carry multipliers, and stays theirs when contact pairs anew: a node
    that is allowed a depth has that depth wherever it slides.

    Args:
        treatment: ``"resolve"``, ``"ignore"`` or ``"error"``.
    """

    def __init__(self, treatment: str) -> None:
        check(one_of(TREATMENTS), initial_overclosure=treatment)
        self.treatment = treatment
        #: Part of the overclosure that is not resolved.
        self.part = 1.0 if treatment == "ignore" else 0.0
        #: Largest depth (length) of a pairing point at the first pairing, 0 if there is none.
        self.depth = 0.0
        self._at_nodes: list[Array] | None = None

    @property
    def allowed(self) -> float:
        """Depth (length) that is not resolved, at most."""
        return self.part * self.depth

    def read(self, passes: typing.Sequence[WeightedGap], facet_size: float) -> None:
        """Take the overclosure of the first pairing. Collective.

        Args:
            passes: The passes, as they were paired.
            facet_size: Of the smallest facet, length.

        Raises:
            ValueError: If there is any and the treatment is ``"error"``.
        """
        comm = passes[0].slave.comm
        deepest = max(float(np.max(-p.points.gap, initial=0.0)) for p in passes)
        self.depth = abs(float(comm.allreduce(deepest, op=MPI.MAX)))  # no -0.0
        if self.treatment == "error" and self.depth > TOLERANCE * facet_size:
            places = [place for p in passes for place in _places(p, self.depth)]
            place = min(place for found in comm.allgather(places) for place in found)
            raise ValueError(
                f"initial_overclosure: the surfaces penetrate each other by {self.depth:.6g} "
                f"({self.depth / facet_size:.3g} of the smallest facet) at "
                f"({', '.join(f'{v:.6g}' for v in place)}); move a mesh, or choose "
                '"resolve", which presses the bodies apart, or "ignore"'
            )
        self._at_nodes = [
            np.zeros(0) if p.law.jump else p.rows.largest_on_nodes(p.state.values[:, 0])
            for p in passes
        ]

    def apply(self, passes: typing.Sequence[WeightedGap]) -> None:
        """Allow the passes, perhaps paired anew, the part that is not resolved."""
        assert self._at_nodes is not None
        for p, depth in zip(passes, self._at_nodes, strict=True):
            if not p.law.jump:  # a tie keeps any gap
                p.allow(self.part * p.rows.from_nodes(depth))

    def allow(self, comm: MPI.Intracomm, part: float) -> None:
        """Set the part that is not resolved. Collective.

        Raises:
            ValueError: If it is not from 0 to 1, the same on all ranks.
        """
        with checked(comm) as same:
            same(FRACTION, part=part)
        self.part = float(part)


def _places(p: WeightedGap, depth: float) -> list[list[float]]:
    """First of the places on the slave that are this deep, to the same digits on any ranks."""
    x = p.points.slave["x"][-p.points.gap >= depth * (1 - 1e-9), : p.slave.gdim]
    return sorted(np.round(x, 12).tolist())[:1]
