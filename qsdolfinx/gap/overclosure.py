"""Initial overclosure: penetration of the surfaces at the first contact detection."""

from __future__ import annotations

import typing
import weakref

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import FRACTION, check, one_of
from qsdolfinx.base.collective import checked
from qsdolfinx.base.rounding import ROUNDING, SINGLE
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]

TREATMENTS = ("resolve", "ignore", "error")

#: Relative difference up to which depths count as equal: rounding, and facets that are chords. With
#: much more, depths that differ would slide along with the wrong nodes without a warning.
EVEN = 1e-3


class Overclosure:
    """Treatment of the penetration at the first contact detection of a contact.

    An allowed depth belongs to a node with a multiplier, and does not change when the contact pairs
    are updated: the node keeps its depth wherever it slides. A node that has no partner at first
    and gets one later is allowed the depth of the others if this depth is the same everywhere, and
    if the node is where the others were as seen from the other surface, which has slid to it.
    Otherwise it is allowed none.

    Args:
        treatment: ``"resolve"``, ``"ignore"`` or ``"error"``.
    """

    def __init__(self, treatment: str) -> None:
        check(one_of(TREATMENTS), initial_overclosure=treatment)
        self.treatment = treatment
        #: Part of the overclosure that is allowed, and not resolved.
        self.part = 1.0 if treatment == "ignore" else 0.0
        #: Largest depth (length) of a quadrature point at the first detection; 0 without any.
        self.depth = 0.0
        #: Whether all nodes with a partner at the first detection are equally deep.
        self.is_even = True
        #: Least depth (length) of a node at the first detection; open nodes count as 0.
        self.least = 0.0
        #: Whether other nodes of this rank are about as deep, and their allowed depth is unknown.
        self.has_strangers = False
        self._at_first: list[Array] = []  # by integration side; NaN for a node without a partner
        self._first: list[weakref.ref[WeightedGap]] = []  # the integration sides then
        self._at_nodes: list[Array] = []  # with the depths allowed to others
        self._zones: list[tuple[Array, Array]] = []

    @property
    def allowed(self) -> float:
        """Largest depth (length) that is allowed, and not resolved."""
        return self.part * self.depth

    def read(
        self, passes: typing.Sequence[WeightedGap], seen: list[Array], facet_size: float
    ) -> None:
        """Read the overclosure of the first contact detection. Collective.

        Args:
            passes: The integration sides, after contact detection.
            seen: Positions of the slave's nodes of each side in the frame of its master.
            facet_size: Size of the smallest facet, length.

        Raises:
            ValueError: If there is overclosure and the treatment is ``"error"``.
        """
        comm = passes[0].slave.comm
        deepest = max(float(np.max(-p.points.gap, initial=0.0)) for p in passes)
        self.depth = abs(float(comm.allreduce(deepest, op=MPI.MAX)))  # no -0.0
        if self.treatment == "error" and self.depth > SINGLE * facet_size:
            places = [place for p in passes for place in _places(p, self.depth)]
            place = min(place for found in comm.allgather(places) for place in found)
            raise ValueError(
                f"initial_overclosure: the surfaces penetrate each other by {self.depth:.6g} "
                f"({self.depth / facet_size:.3g} of the smallest facet) at "
                f"({', '.join(f'{v:.6g}' for v in place)}): move a mesh, or choose "
                '"resolve" (interference fit) or "ignore" (strain-free adjustment)'
            )
        self._at_first = self._at_nodes = [_depths(p) for p in passes]
        self._first = [weakref.ref(p) for p in passes]
        known = np.concatenate([depth.ravel() for depth in self._at_first])
        known = known[~np.isnan(known)]
        bounds = np.array([np.min(known, initial=np.inf), -np.max(known, initial=-np.inf)])
        comm.Allreduce(MPI.IN_PLACE, bounds, op=MPI.MIN)
        low, high = float(bounds[0]), -float(bounds[1])
        if low <= high:
            self.least = low
            self.is_even = high - low <= max(EVEN * high, SINGLE * facet_size)
        self._zones = [
            _box(comm, x[_of_nodes(depth) > 0], max(self.depth, _reach(p)))
            for p, x, depth in zip(passes, seen, self._at_first, strict=True)
        ]

    def follow(self, passes: typing.Sequence[WeightedGap], seen: list[Array]) -> None:
        """Find the depths allowed to nodes without a partner at the first detection. Collective.

        Args:
            passes: The integration sides, with updated contact pairs.
            seen: As for :meth:`read`.
        """
        self.has_strangers = False
        self._at_nodes = []
        if self.allowed == 0:
            self._at_nodes = self._at_first
            return
        for p, x, known, (low, high) in zip(passes, seen, self._at_first, self._zones, strict=True):
            there = self.is_even & np.all((x >= low) & (x <= high), axis=1)
            is_new = np.isnan(known) if known.ndim == 1 else np.isnan(known).all(axis=1)
            depth = known.copy()
            depth[is_new] = np.where(there, self.depth, 0.0)[is_new].reshape(
                -1, *[1] * (known.ndim - 1)
            )
            self._at_nodes.append(depth)
            as_deep = _of_nodes(_depths(p)) >= self.depth / 2
            self.has_strangers |= bool(np.any(is_new & ~there & as_deep))

    def apply(self, passes: typing.Sequence[WeightedGap]) -> None:
        """Apply the allowed part to the sides, perhaps with updated contact pairs. Collective."""
        for p, depth in zip(passes, self._at_nodes, strict=True):
            if isinstance(p.rows, PointRows) and p.following is not None:
                p.allow(self.part * np.nan_to_num(depth))
                continue
            if isinstance(p.rows, PointRows):
                is_first = any(p is first() for first in self._first)
                known = p.rows.from_sides(np.nan_to_num(depth))
                p.allow(self.part * (_depths_of_points(p) if is_first else known))
                continue
            share = p.cover_share if self.allowed > 0 else 1.0
            p.allow(self.part * p.rows.from_largest(np.nan_to_num(depth)) * share)

    @property
    def deep_nodes(self) -> npt.NDArray[np.bool_]:
        """Slave nodes of this rank that penetrated at the first detection, shape (nodes,)."""
        return np.asarray(_of_nodes(self._at_first[0]) > 0)

    def allow(self, comm: MPI.Intracomm, part: float) -> None:
        """Set the part that is allowed, and not resolved. Collective.

        Raises:
            ValueError: If ``part`` is not from 0 to 1, or differs between ranks.
        """
        with checked(comm) as same:
            same(FRACTION, part=part)
        self.part = float(part)


def _depths(p: WeightedGap) -> Array:
    """Depths of the owned nodes, at least 0, NaN where there is no partner. Collective.

    With constraints at nodes they have the form of ``largest_on_nodes``: where there may be
    corners, one for each smooth patch. With constraints at points they are the projection of the
    points' depths onto functions of the patches of nodes. With updated geometry, where the points
    change from one evaluation to the next, they are means around each patch, increased until no
    point is deeper. A tie keeps any gap: its constraints have no initial gap, and no depth.
    """
    if isinstance(p.rows, PointRows) and p.cut is not None:
        depth = _depths_of_points(p)
        faces: Array = np.ones(len(depth))
        faces[len(depth) - len(p.cut.alone.weight) :] = 0.0
        cover, sums = p.rows.sums(faces), p.rows.sums(faces * depth)
        some = cover > ROUNDING * p.slave.node_area[:, None]
        means = np.divide(sums, cover, out=np.zeros_like(sums), where=some)
        deeper = p.rows.largest_of_sides(faces * (depth - p.rows.from_sides(means)))
        return np.where(some, means + np.maximum(deeper, 0.0), np.nan)
    if isinstance(p.rows, PointRows):
        found = np.maximum(p.rows.projected(_depths_of_points(p)[:, None]), 0.0)
        return np.where(p.rows.covered, found.reshape(p.rows.covered.shape), np.nan)
    share = p.cover_share
    some = share > ROUNDING
    gap = np.divide(-p.operator.initial_gap, share, out=np.zeros(p.num_rows), where=some)
    has_partner = p.rows.largest_on_nodes(some.astype(np.float64)) > 0
    return np.where(has_partner, p.rows.largest_on_nodes(gap), np.nan)


def _depths_of_points(p: WeightedGap) -> Array:
    """Depths of the contact quadrature points, at least 0, (points,)."""
    return np.maximum(-p.operator.initial_gap, 0.0)


def _reach(p: WeightedGap) -> float:
    """Distance (length) from the nodes with a partner within which other nodes may get one.

    A contact quadrature point up to one facet away affects a node. With updated geometry, the other
    surface may end a facet beyond the outermost node with a partner, and it slides on in the solve.
    """
    return (1 if p.following is None else 3) * float(p.slave.facet_size_range[1])


def _of_nodes(depths: Array) -> Array:
    """The largest depth of the patches of each node, 0 without a partner."""
    known = np.nan_to_num(depths)
    return known if known.ndim == 1 else np.asarray(known.max(axis=1))


def _box(comm: MPI.Intracomm, x: Array, margin: float) -> tuple[Array, Array]:
    """Corners of the smallest box around points of all ranks, with a margin. Collective."""
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high])
    comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    return -corners[:3] - margin, corners[3:] + margin


def _places(p: WeightedGap, depth: float) -> list[list[float]]:
    """First of the points on the slave with this depth; rounded to be the same on any partition."""
    x = p.points.slave["x"][-p.points.gap >= depth * (1 - 1e-9), : p.slave.gdim]
    return sorted(np.round(x, 12).tolist())[:1]
