"""Contact quadrature points as arrays, for the user."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid


@dataclasses.dataclass(frozen=True)
class PairingSide:
    """One side (slave or master) of the contact quadrature points.

    Attributes:
        x: Positions, shape (points, 3).
        dofs: Global unknowns of the facet's vertices, shape (points, vertices, gdim); -1 if unused.
        owner: Ranks that own these unknowns, shape (points, vertices); -1 if unused.
        shape_values: Shape functions of the vertices, shape (points, vertices). A point at a node
            has one vertex with value 1.
    """

    x: npt.NDArray[np.float64]
    dofs: npt.NDArray[np.int64]
    owner: npt.NDArray[np.int32]
    shape_values: npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, repr=False)
class Pairing:
    """Contact quadrature points of one integration side, as found on this rank.

    A point belongs to the rank that owns the node for which it was found. Here, the slave is the
    side that carries the multiplier.

    Attributes:
        slave: Positions, vertices and shape functions on the slave.
        master: Positions, vertices and shape functions on the master.
        normal: Unit normals, pointing out of the slave, shape (points, 3).
        gap: Signed initial distances (x_master - x_slave)·n, positive when open, shape (points,).
        weight: Areas w_p, shape (points,).
        multiplier_values: P1 or Q1 functions N_k of the slave's vertices, shape (points, vertices).
            Vertices come first among the nodes.
        num_unpaired: Number of owned nodes (overlay: facets) without a partner.
    """

    slave: PairingSide
    master: PairingSide
    normal: npt.NDArray[np.float64]
    gap: npt.NDArray[np.float64]
    weight: npt.NDArray[np.float64]
    multiplier_values: npt.NDArray[np.float64]
    num_unpaired: int

    def __repr__(self) -> str:
        return f"Pairing({len(self.gap)} points here, {self.num_unpaired} without a partner)"

    @classmethod
    def from_cpp(cls, points: _cpp.PairingPoints) -> Pairing:
        """Copy the arrays of the extension's object."""
        return cls(
            PairingSide(**points.slave),
            PairingSide(**points.master),
            points.normal,
            points.gap,
            points.weight,
            points.multiplier_values,
            points.num_unpaired,
        )

    def __len__(self) -> int:
        return len(self.weight)


def with_unknowns_alone(points: _cpp.PairingPoints, master: AnySurface) -> _cpp.PairingPoints:
    """The points, without the numbers of a rigid tool's vertices, which are no unknowns."""
    if is_rigid(master):
        _cpp.forget_master(points)
    return points
