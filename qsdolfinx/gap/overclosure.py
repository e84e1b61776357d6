"""Surfaces that penetrate each other where they are first paired, before anything has moved."""

from __future__ import annotations

import typing
import weakref

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import FRACTION, check, one_of
from qsdolfinx.base.collective import checked
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap

Array = npt.NDArray[np.float64]

TREATMENTS = ("resolve", "ignore", "error")

#: Overclosure that ``"error"`` lets pass, in units of the smallest facet: coordinates that went
#: through a file in single precision are off by about this much.
TOLERANCE = 1e-5

#: Part by which depths may differ that are the same but for rounding and the chords of facets.
EVEN = 1e-3

#: Part of a node's area that may be rounding.
_SOME = 1e-10


class Overclosure:
    """What a contact does about penetration at its first pairing.

    It belongs to the nodes that carry multipliers, and stays theirs when contact pairs anew: a node
    that is allowed a depth has that depth wherever it slides. Nodes that had no partner then, and
    have one later on, are allowed the depth of the others if that is the same all over and they are
    where the others were, seen from the other surface: it has slid to them. Else they are allowed
    none.

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
        #: Whether all nodes that had a partner are as deep.
        self.is_even = True
        #: Least depth (length) of a node at the first pairing; the open ones count as 0.
        self.least = 0.0
        #: Whether nodes of this rank are about as deep, and nothing tells what they are allowed.
        self.has_strangers = False
        self._at_first: list[Array] = []  # by pass; NaN where a node had no partner
        self._first: list[weakref.ref[WeightedGap]] = []  # the passes then
        self._at_nodes: list[Array] = []  # with what others are allowed
        self._zones: list[tuple[Array, Array]] = []

    @property
    def allowed(self) -> float:
        """Depth (length) that is not resolved, at most."""
        return self.part * self.depth

    def read(
        self, passes: typing.Sequence[WeightedGap], seen: list[Array], facet_size: float
    ) -> None:
        """Take the overclosure of the first pairing. Collective.

        Args:
            passes: The passes, as they were paired.
            seen: Where the slave's nodes of each pass are in the frame of its master.
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
            self.is_even = high - low <= max(EVEN * high, TOLERANCE * facet_size)
        self._zones = [
            _box(comm, x[_of_nodes(depth) > 0], max(self.depth, _reach(p)))
            for p, x, depth in zip(passes, seen, self._at_first, strict=True)
        ]

    def follow(self, passes: typing.Sequence[WeightedGap], seen: list[Array]) -> None:
        """Find what nodes are allowed that had no partner at the first pairing. Collective.

        Args:
            passes: The passes, paired anew.
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
        """Allow the passes, perhaps paired anew, the part that is not resolved. Collective."""
        for p, depth in zip(passes, self._at_nodes, strict=True):
            if p.law.jump:  # a tie keeps any gap
                continue
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
        """Slave nodes of this rank that penetrated at the first pairing, shape (nodes,)."""
        return np.asarray(_of_nodes(self._at_first[0]) > 0)

    def allow(self, comm: MPI.Intracomm, part: float) -> None:
        """Set the part that is not resolved. Collective.

        Raises:
            ValueError: If it is not from 0 to 1, the same on all ranks.
        """
        with checked(comm) as same:
            same(FRACTION, part=part)
        self.part = float(part)


def _depths(p: WeightedGap) -> Array:
    """Depths of the owned nodes, at least 0, NaN where there is no partner. Collective.

    As the rows keep what is largest on nodes: where there may be corners, of each side. With rows
    at points, of the functions of the sides of nodes that are closest to the points' depths; of
    gaps that follow the bodies, whose points are others next, means of what is around each side,
    and as much more as it takes for no point to be deeper.
    """
    if p.law.jump:
        return np.full(len(p.slave.node_area), np.nan)
    if isinstance(p.rows, PointRows) and p.cut is not None:
        depth = _depths_of_points(p)
        faces: Array = np.ones(len(depth))
        faces[len(depth) - len(p.cut.alone.weight) :] = 0.0
        cover, sums = p.rows.sums(faces), p.rows.sums(faces * depth)
        some = cover > _SOME * p.slave.node_area[:, None]
        means = np.divide(sums, cover, out=np.zeros_like(sums), where=some)
        deeper = p.rows.largest_of_sides(faces * (depth - p.rows.from_sides(means)))
        return np.where(some, means + np.maximum(deeper, 0.0), np.nan)
    if isinstance(p.rows, PointRows):
        found = np.maximum(p.rows.projected(_depths_of_points(p)[:, None]), 0.0)
        return np.where(p.rows.covered, found.reshape(p.rows.covered.shape), np.nan)
    share = p.cover_share
    some = share > _SOME
    gap = np.divide(-p.operator.initial_gap, share, out=np.zeros(p.num_rows), where=some)
    has_partner = p.rows.largest_on_nodes(some.astype(np.float64)) > 0
    return np.where(has_partner, p.rows.largest_on_nodes(gap), np.nan)


def _depths_of_points(p: WeightedGap) -> Array:
    """Depths of pairing points, at least 0, (points,)."""
    return np.maximum(-p.operator.initial_gap, 0.0)


def _reach(p: WeightedGap) -> float:
    """How far (length) beyond the nodes that have a partner others may be that are to have one.

    A node is reached by what is up to a facet away from it. Where gaps follow the bodies, what
    reaches it may end a facet beyond the outermost node that has a partner, and slides on in the
    solve.
    """
    return (1 if p.following is None else 3) * float(p.slave.facet_size_range[1])


def _of_nodes(depths: Array) -> Array:
    """The largest depth of the sides of each node, 0 without a partner."""
    known = np.nan_to_num(depths)
    return known if known.ndim == 1 else np.asarray(known.max(axis=1))


def _box(comm: MPI.Intracomm, x: Array, margin: float) -> tuple[Array, Array]:
    """Corners of the smallest box around points of all ranks, with a margin. Collective."""
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high])
    comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    return -corners[:3] - margin, corners[3:] + margin


def _places(p: WeightedGap, depth: float) -> list[list[float]]:
    """First of the places on the slave that are this deep, to the same digits on any ranks."""
    x = p.points.slave["x"][-p.points.gap >= depth * (1 - 1e-9), : p.slave.gdim]
    return sorted(np.round(x, 12).tolist())[:1]
