"""What friction at points has that nodes do not tell, as it goes from a pairing to the next."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class OfPoints(typing.NamedTuple):
    """What points of a slip have beyond the multipliers of nodes.

    Attributes:
        keys: What tells apart between which facets they are, (points, n).
        place: Where on the slave's facet: functions of its vertices, (points, vertices).
        rest: τ beyond the nodes' when the step began (stress), (points, gdim).
        normal: Normals, (points, gdim).
    """

    keys: Indices
    place: Array
    rest: Array
    normal: Array


class SavedNormals(typing.NamedTuple):
    """Normals of the pairing that a checkpoint was written with: vectors turn from these.

    That contact is paired anew when it is read, where bodies have come a little further, turns
    nothing: vectors that turn twice are not quite those that turn once.

    Attributes:
        of_nodes: See ``carried.normals_of_nodes``.
        of_points: Of the points that are at the same places now, (points, gdim).
    """

    of_nodes: Array
    of_points: Array
