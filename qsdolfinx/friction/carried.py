"""Transfer of friction data from old to new points when the contact pairs are updated."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.friction.of_points import OfPoints, carried_to, closest, turned
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.rows import PointRows

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def of_points(slip: Slip, keys: Indices, place: Array) -> OfPoints:
    """Collect the friction data of the points of a slip.

    Args:
        slip: The slip, with constraints at points.
        keys: See :class:`OfPoints`, for example :func:`facets`.
        place: See :class:`OfPoints`.
    """
    rest = slip.state.rest + np.zeros_like(slip.state.jump)
    return OfPoints(keys, place, rest, slip.gap.operator.slave_sum)


def carry(old: Slip, new: Slip) -> None:
    """Transfer the state of a slip to a new slip of the same surfaces. Collective.

    It does nothing unless the constraints of the new slip are at points.

    Args:
        old: Slip of the previous contact pairs.
        new: Slip of the present contact pairs.
    """
    if not new.gap.rows.are_points:
        return
    if new.gap.following is not None:  # its points change at each evaluation
        new.state.augmented = turned(
            new.state.augmented, normals_of_nodes(old), normals_of_nodes(new), new.slave.gdim
        )
        new.state.of_points = old.state.of_points
        return
    if old.state.saved is not None:
        old.state.saved(new)
        return
    points = of_points(old, facets(old), old.gap.points.multiplier_values)
    take(new, normals_of_nodes(old), points, facets(new), new.gap.points.multiplier_values)


def take(slip: Slip, normals: Array, old: OfPoints, keys: Indices, place: Array) -> None:
    """Transfer point data to a slip whose nodes already have their multipliers. Collective.

    A point gets the data of the closest old point on the same facet of the slave and opposite the
    same facet. If no point has moved, nothing changes, on any number of ranks. A point without such
    an old point has only the multipliers of the nodes. Vectors turn with the surface, as its
    normals do.

    Args:
        slip: The slip.
        normals: Earlier result of :func:`normals_of_nodes`.
        old: Data of the old points.
        keys: Keys of the present points, as those of the old points.
        place: Positions of the present points, as those of the old points.
    """
    state, gdim = slip.state, slip.gap.slave.gdim
    state.augmented = turned(state.augmented, normals, normals_of_nodes(slip), gdim)
    normal = np.asarray(slip.gap.operator.slave_sum)
    state.rest = slip.tangential(carried_to(old, keys, place, normal))


def show_saved(slip: Slip, old: OfPoints, keys: Indices, place: Array) -> None:
    """Show point data from a checkpoint, without rotation, until contact pairs are updated.

    Two successive rotations are not exactly one rotation: see ``SlipState.saved``.

    Args:
        slip: The slip.
        old: Data of the saved points.
        keys: Keys of the present points, as those of the saved points.
        place: Positions of the present points, as those of the saved points.
    """
    at, rest = closest(old.keys, old.place, keys, place), np.zeros_like(slip.state.jump)
    rest[at >= 0] = old.rest[at[at >= 0]]
    slip.state.rest = rest


def facets(slip: Slip) -> Indices:
    """Keys of the points, (points, n): the pair of facets, and the side of the segmentation."""
    points = slip.gap.points
    sides = [side["dofs"][:, :, 0] for side in (points.slave, points.master)]
    return np.column_stack([parts(slip), *sides, points.faced])


def parts(slip: Slip) -> Indices:
    """1 for points on segments of the slave's facets, 0 for those of the master's, (points,)."""
    points = slip.gap.points
    return (np.arange(points.size) < points.num_of_slave).astype(np.int64)


def normals_of_nodes(slip: Slip) -> Array:
    """Sums of point normals at the patches of owned nodes, (nodes, block · gdim). Collective.

    Args:
        slip: The slip, with constraints at points.
    """
    assert isinstance(slip.gap.rows, PointRows)
    return slip.gap.rows.sums_of_vectors(slip.gap.operator.slave_sum)
