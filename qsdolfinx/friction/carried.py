"""Friction at the points of a slip, carried to others where contact pairs anew."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.rows import PointRows

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def carry(old: Slip, new: Slip) -> None:
    """Let a slip with rows at points go on where another one of the same surfaces was. Collective.

    What belongs to nodes is known already. Beyond that points have what the closest point had that
    was on the same facet of the slave and opposite to the same one: if all are where they were
    nothing changes, on any number of ranks. Where there was none they have no more than nodes tell.
    Vectors turn with the surface, as its normals do.

    Args:
        old: Of the pairing before.
        new: Of the present one.
    """
    rows, before = new.gap.rows, old.gap.rows
    if not (isinstance(rows, PointRows) and isinstance(before, PointRows)):
        return
    turned = _turned(new.state.augmented, _of_nodes(old, before), _of_nodes(new, rows))
    new.state.augmented = turned
    rest, kept = np.zeros_like(new.state.jump), old.state.rest + np.zeros_like(old.state.jump)
    at = closest(old.gap.points, new.gap.points)
    found = at >= 0
    normals = old.gap.operator.slave_sum[at[found]], new.gap.operator.slave_sum[found]
    rest[found] = _turned(kept[at[found]], *normals)
    new.state.rest = new.tangential(rest)


def closest(old: _cpp.PairingPoints, new: _cpp.PairingPoints) -> Indices:
    """For each new point the closest old one between the same facets, or −1, (points,)."""
    keys = [_facets(points) for points in (old, new)]
    count = len(keys[0])
    _, group = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    group = group.ravel()
    order = np.argsort(group[:count], kind="stable")
    known = group[:count][order]
    starts = np.searchsorted(known, group[count:], side="left")
    ends = np.searchsorted(known, group[count:], side="right")
    place, here = old.slave["shape_values"], new.slave["shape_values"]
    out, least = np.full(len(here), -1, dtype=np.int64), np.full(len(here), np.inf)
    for i in range(int(np.max(ends - starts, initial=0))):
        some = np.flatnonzero(starts + i < ends)
        candidate = order[starts[some] + i]
        distance = np.sum((place[candidate] - here[some]) ** 2, axis=1)
        closer = distance < least[some]
        out[some[closer]], least[some[closer]] = candidate[closer], distance[closer]
    return out


def _facets(points: _cpp.PairingPoints) -> Indices:
    """What tells apart between which facets, and of which one's parts, points are."""
    own = np.arange(points.size) < points.num_of_slave
    sides = [side["dofs"][:, :, 0] for side in (points.slave, points.master)]
    return np.column_stack([own.astype(np.int64), *sides])


def _of_nodes(slip: Slip, rows: PointRows) -> Array:
    """Mean normals of the sides of owned nodes, (nodes · sides, gdim). Collective."""
    return rows.sums_of_vectors(slip.gap.operator.slave_sum).reshape(-1, slip.gap.slave.gdim)


def _turned(vectors: Array, before: Array, now: Array) -> Array:
    """Vectors turned as normals do, by the smallest angle, of the shape that is given."""
    v = vectors.reshape(before.shape)
    lengths = [np.linalg.norm(n, axis=1, keepdims=True) for n in (before, now)]
    some = (lengths[0] > 0) & (lengths[1] > 0)
    a, b = (
        np.divide(n, length, out=np.zeros_like(n), where=some)
        for n, length in zip((before, now), lengths, strict=True)
    )
    cosine = np.sum(a * b, axis=1, keepdims=True)
    # R v = v − (a·v + b·v)/(1 + a·b) (a + b) + 2 (a·v) b
    along, across = np.sum(a * v, axis=1, keepdims=True), np.sum(b * v, axis=1, keepdims=True)
    part = np.divide(along + across, 1 + cosine, out=np.zeros_like(along), where=cosine > -1 + 1e-9)
    out = v - part * (a + b) + 2 * along * b
    return np.where(some, out, v).reshape(vectors.shape)
