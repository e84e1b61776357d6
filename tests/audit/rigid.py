"""Rigid motions, and rigid tools that move by them."""

import copy
import dataclasses
import typing

import numpy as np
from audit.distance import Found, Meshed, Tool
from audit.state import BodyState, SurfaceState


class Motion(typing.NamedTuple):
    """Rigid motion from x to R x + t, shapes (3, 3) and (3,)."""

    R: np.ndarray
    t: np.ndarray

    @classmethod
    def none(cls):
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def about(cls, vector, center, shift=0.0):
        """Make a rotation by a vector about a point, followed by a translation."""
        R = rotation(np.asarray(vector, dtype=float))
        return cls(R, center - R @ center + shift)

    @classmethod
    def read(cls, position):
        """Make the motion from the position of a tool of the library."""
        R, t, gdim = np.eye(3), np.zeros(3), len(position)
        R[:gdim, :gdim], t[:gdim] = position[:, :gdim], position[:, gdim]
        return cls(R, t)

    def __call__(self, x):
        return x @ self.R.T + self.t

    def after(self, first):
        return Motion(self.R @ first.R, self.R @ first.t + self.t)

    def back(self):
        return Motion(self.R.T, -self.R.T @ self.t)

    def since(self, before):
        """Return the motion from another position to this one."""
        return self.after(before.back())

    def vector(self):
        """Return the rotation vector, of less than half a turn."""
        w = 0.5 * np.array([self.R[2, 1] - self.R[1, 2], self.R[0, 2] - self.R[2, 0],
                            self.R[1, 0] - self.R[0, 1]])  # fmt: skip
        sine = np.linalg.norm(w)
        angle = np.arctan2(sine, (np.trace(self.R) - 1) / 2)
        return w if sine < 1e-12 else w * angle / sine


def rotation(w):
    """Return the matrix of the rotation by a vector."""
    angle = np.linalg.norm(w)
    if angle == 0:
        return np.eye(3)
    x, y, z = w / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


@dataclasses.dataclass
class PosedTool(Tool):
    """A rigid plane or sphere that can rotate.

    Attributes:
        paired: Position at contact detection.
        now: Present position.
    """

    paired: Motion = dataclasses.field(default_factory=Motion.none)
    now: Motion = dataclasses.field(default_factory=Motion.none)

    def at(self, paired, now):
        """Return the tool at other positions."""
        return dataclasses.replace(self, paired=paired, now=now)

    def find(self, points, deformed=True):
        """Find the closest points, for the tool as it is now or as it was at contact detection."""
        place = self.now if deformed else self.paired
        found = super().find(place.back()(points), deformed=False)
        return Found(found.distance, found.facing, found.normal @ place.R.T, points=points)

    def displacement(self, found):
        """Return the displacement of the closest points since contact detection."""
        return self.now.since(self.paired)(found.points) - found.points


class FacetTool(Meshed):
    """A rigid tool of segments or triangles.

    Args:
        x: Initial vertices, shape (vertices, 3).
        facets: Vertices of the facets.
        outwards: Sign of each facet, as in SurfaceState.
        paired: Position at contact detection.
        now: Present position.
    """

    rigid = True

    def __init__(self, x, facets, outwards, paired=None, now=None):
        self.x, self._facets, self._outwards = x, facets, outwards
        self.paired, self.now = paired or Motion.none(), now or Motion.none()
        nodes = np.arange(len(x))
        surface = SurfaceState(
            facets, facets, outwards, np.arange(len(facets)), nodes, nodes, np.eye(len(x))
        )
        x = self.paired(self.x)
        zero = np.zeros_like(x)
        state = BodyState(x, self.now(self.x) - x, zero, np.zeros(x.shape, dtype=bool))
        super().__init__(state, surface)

    def find(self, points, deformed=True):
        """Find the closest points as on any surface, and keep the given points."""
        return dataclasses.replace(super().find(points, deformed), points=points)

    def displacement(self, found):
        """Return the displacement of the points as if fixed to the tool, rotation included."""
        return self.now.since(self.paired)(found.points) - found.points

    def at(self, paired, now):
        """Return the tool at other positions."""
        return FacetTool(self.x, self._facets, self._outwards, paired, now)


def displaced(opponent, before, u=None):
    """Return an opponent with its displacements of another time since contact detection.

    Args:
        opponent: A meshed surface or a tool.
        before: Position of the tool at that time.
        u: Displacements of the body at that time.
    """
    if isinstance(opponent, (PosedTool, FacetTool)):
        return opponent.at(opponent.paired, before)
    out = copy.copy(opponent)
    out.body = dataclasses.replace(opponent.body, u=u)
    return out
