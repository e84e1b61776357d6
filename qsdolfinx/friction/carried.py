"""Friction at the points of a slip, carried to others where contact pairs anew."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.of_points import OfPoints, SavedNormals, carried_to, closest, turned
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.rows import PointRows

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def of_points(slip: Slip, keys: Indices, place: Array) -> OfPoints:
    """What points of a slip have.

    Args:
        slip: The slip, with rows at points.
        keys: As of the class, for example :func:`facets`.
        place: As of the class.
    """
    rest = slip.state.rest + np.zeros_like(slip.state.jump)
    return OfPoints(keys, place, rest, slip.gap.operator.slave_sum)


def carry(old: Slip, new: Slip) -> None:
    """Let a slip with rows at points go on where another one of the same surfaces was. Collective.

    Args:
        old: Of the pairing before.
        new: Of the present one.
    """
    if not new.gap.rows.are_points:
        return
    if new.gap.following is not None:  # whose points are others at each evaluation
        new.state.augmented = turned(
            new.state.augmented, normals_of_nodes(old), normals_of_nodes(new), new.slave.gdim
        )
        new.state.of_points = old.state.of_points
        return
    points, normals = of_points(old, facets(old), old.gap.points.multiplier_values), None
    if old.state.saved is not None:
        normals = old.state.saved.of_nodes
        points = points._replace(normal=old.state.saved.of_points)
    normals = normals_of_nodes(old) if normals is None else normals
    take(new, normals, points, facets(new), new.gap.points.multiplier_values)


def take(slip: Slip, normals: Array, old: OfPoints, keys: Indices, place: Array) -> None:
    """Let a slip go on whose nodes have their multipliers already. Collective.

    Points have what the closest point had that was on the same facet of the slave and opposite to
    the same one: if all are where they were nothing changes, on any number of ranks. Where there
    was none they have no more than nodes tell. Vectors turn with the surface, as its normals do.

    Args:
        slip: The slip.
        normals: As :func:`normals_of_nodes`, of before.
        old: Of the points before.
        keys: Of the points now, as those of the old ones.
        place: Likewise.
    """
    state, gdim = slip.state, slip.gap.slave.gdim
    state.augmented = turned(state.augmented, normals, normals_of_nodes(slip), gdim)
    normal = np.asarray(slip.gap.operator.slave_sum)
    state.rest = slip.tangential(carried_to(old, keys, place, normal))


def take_saved(slip: Slip, normals: Array, old: OfPoints, keys: Indices, place: Array) -> None:
    """The same from a checkpoint, without any turning, see ``SavedNormals``.

    Arguments are those of :func:`take`.
    """
    at = closest(old.keys, old.place, keys, place)
    found, rest = at >= 0, np.zeros_like(slip.state.jump)
    of_points = np.array(slip.gap.operator.slave_sum)
    rest[found], of_points[found] = old.rest[at[found]], old.normal[at[found]]
    slip.state.rest = rest
    slip.state.saved = SavedNormals(normals, of_points)


def facets(slip: Slip) -> Indices:
    """What tells apart between which facets, and of which one's parts, points are, (points, n)."""
    points = slip.gap.points
    sides = [side["dofs"][:, :, 0] for side in (points.slave, points.master)]
    return np.column_stack([parts(slip), *sides])


def parts(slip: Slip) -> Indices:
    """1 of points that facets of the slave were cut for, 0 of those of the master's, (points,)."""
    points = slip.gap.points
    return (np.arange(points.size) < points.num_of_slave).astype(np.int64)


def normals_of_nodes(slip: Slip) -> Array:
    """Sums of the points' normals for the sides of owned nodes, (nodes, block · gdim). Collective.

    Args:
        slip: With rows at points.
    """
    assert isinstance(slip.gap.rows, PointRows)
    return slip.gap.rows.sums_of_vectors(slip.gap.operator.slave_sum)
