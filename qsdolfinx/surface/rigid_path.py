"""Paths of rigid motions by any angle, and the rigid motion that is closest to that of a body."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.surface.affine import rotation_matrix, rotation_vector

Array = npt.NDArray[np.float64]


class RigidPath(typing.NamedTuple):
    """Rotation about a point at a constant rate, while the point moves straight.

    Attributes:
        center: The point at the start, shape (3,).
        way: Its displacement, shape (3,).
        rotation: Rotation vector of the whole motion, of any length (radians), shape (3,).
    """

    center: Array
    way: Array
    rotation: Array

    @classmethod
    def at_rest(cls) -> RigidPath:
        """No motion."""
        return cls(np.zeros(3), np.zeros(3), np.zeros(3))

    @classmethod
    def closest(cls, comm: MPI.Intracomm, start: Array, end: Array, gdim: int) -> RigidPath:
        """Rigid motion closest to that of points of a body, by at most π. Collective.

        Args:
            comm: Communicator of the body.
            start: Points on this rank at the start, shape (..., 3).
            end: The same points at the end, of the same shape.
            gdim: Geometric dimension.
        """
        x, y = (points.reshape(-1, 3) for points in (start, end))
        sums = comm.allreduce(np.array([*x.sum(axis=0), *y.sum(axis=0), len(x)]), op=MPI.SUM)
        first, last = sums[:3] / max(sums[6], 1.0), sums[3:6] / max(sums[6], 1.0)
        H = comm.allreduce((y - last).T @ (x - first), op=MPI.SUM)
        if gdim == 2:  # points on a line determine an angle, but no rotation in space
            angle = np.arctan2(H[1, 0] - H[0, 1], H[0, 0] + H[1, 1])
            return cls(first, last - first, np.array([0.0, 0.0, angle]))
        U, _, V = np.linalg.svd(H)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
        return cls(first, last - first, rotation_vector(R))

    @property
    def angle(self) -> float:
        """Angle of the whole motion (radians)."""
        return float(np.linalg.norm(self.rotation))

    def turn(self, part: float) -> Array:
        """Rotation matrix of a part of the motion, shape (3, 3)."""
        return rotation_matrix(part * self.rotation)

    def between(self, start: Array, end: Array, s: float) -> Array:
        """Points, (..., 3), after a part s of the motion, with given positions at its ends.

        What the rigid motion does not explain grows at a constant rate in the frame that moves.
        """
        if s in (0.0, 1.0):
            return start if s == 0.0 else end
        x = start - self.center
        rest = (end - self.center - self.way) @ self.turn(1.0) - x
        return self.center + s * self.way + (x + s * rest) @ self.turn(s).T

    def carried(self, x: Array, s: float) -> Array:
        """Points, (..., 3), that are at x after a part s of the motion, at its end."""
        if s == 1.0:
            return x
        away = x - self.center - s * self.way
        return self.center + self.way + away @ self.turn(1.0 - s).T
