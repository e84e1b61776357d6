"""State of a rigid tool: where it is, how it moves next, and what force drives it."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import check_array, check_vector
from qsdolfinx.base.collective import check_agreement, collective_errors
from qsdolfinx.base.crash import end_all_ranks
from qsdolfinx.surface.affine import Affine, rotation_about, rotation_matrix

Array = npt.NDArray[np.float64]


class Driven(typing.NamedTuple):
    """A force that drives a tool.

    Attributes:
        force: Force (in 2D per length) with which the tool is pushed along the direction.
        direction: Unit vector, shape (gdim,).
    """

    force: float
    direction: Array


class Tool:
    """Position, coming motion and driving force of a tool; the base of RigidSurface.

    Args:
        comm: Communicator of the tool.
        center: What it is rotated about, shape (gdim,).
    """

    def __init__(self, comm: MPI.Intracomm, center: Array) -> None:
        end_all_ranks(comm)
        self._comm = comm
        self._center = np.asarray(center, dtype=np.float64)
        gdim = len(self._center)
        self._matrix: Array = np.eye(gdim)
        self._shift: Array = np.zeros(gdim)
        self._displacement: Array = np.zeros(gdim)
        self._rotation: Array = np.zeros(1 if gdim == 2 else 3)
        self._driven: Driven | None = None
        #: Counts the positions that the tool has had.
        self.version = 0

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the tool."""
        return self._comm

    @property
    def gdim(self) -> int:
        """Geometric dimension, 2 or 3."""
        return len(self._center)

    # --- Motion

    @property
    def displacement(self) -> Array:
        """Translation over the coming step (length), shape (gdim,)."""
        return self._displacement

    @displacement.setter
    def displacement(self, value: npt.ArrayLike) -> None:
        self._displacement = check_vector("displacement", value, self.gdim)

    @property
    def rotation(self) -> Array:
        """Rotation about :attr:`center` over the coming step, radians.

        In 2D an angle, counter-clockwise, shape (1,); in 3D a rotation vector, shape (3,).
        """
        return self._rotation

    @rotation.setter
    def rotation(self, value: npt.ArrayLike) -> None:
        size = len(self._rotation)
        self._rotation = check_vector("rotation", [value] if np.isscalar(value) else value, size)

    @property
    def center(self) -> Array:
        """The point of the tool that it is rotated about, where it is now, shape (gdim,)."""
        return np.asarray(self._matrix @ self._center + self._shift)

    @property
    def motion(self) -> Affine:
        """Displacement field of the coming step."""
        R = rotation_matrix(self._rotation)
        return rotation_about(R, self.center, self._displacement)

    def advance(self) -> None:
        """Move the tool for good by its displacement and rotation, and set these to zero.

        Call ``contact.update()`` next: it pairs with the new position.
        """
        A, b = self.motion
        step = A + np.eye(self.gdim)
        self.position = np.column_stack([step @ self._matrix, step @ self._shift + b])
        self._displacement = np.zeros_like(self._displacement)
        self._rotation = np.zeros_like(self._rotation)

    @property
    def position(self) -> Array:
        """Where the tool is: [R | t], shape (gdim, gdim + 1); x₀ has gone to R x₀ + t.

        It can be set, to go on from a checkpoint; ``contact.update()`` has to follow.
        """
        return np.column_stack([self._matrix, self._shift])

    @position.setter
    def position(self, value: npt.ArrayLike) -> None:
        d = self.gdim
        position = check_array("position", value, (d, d + 1))
        if not np.isfinite(position).all():
            raise ValueError(f"position: must be finite, of shape ({d}, {d + 1})")
        R = position[:, :d]
        error = np.abs(R @ R.T - np.eye(d)).max()
        if error > 1e-6 or np.linalg.det(R) < 0:
            raise ValueError("position: the first columns must be a rotation")
        if error > 1e-14:  # many steps would let rounding errors grow
            U, _, V = np.linalg.svd(R)
            R = U @ V
        self._matrix, self._shift = R.copy(), position[:, d].copy()
        self.version += 1

    # --- Force

    def drive(self, force: float, direction: npt.ArrayLike) -> None:
        """Push the tool with a force, instead of a prescribed displacement, in the next solves.

        A solve finds the displacement along the direction for which the contact forces balance
        this one: ``contact.force("master") @ direction == -force``, to 1e-8 of the force.
        :attr:`displacement` holds it afterwards; the other components stay prescribed.

        Args:
            force: Force, in 2D per length; negative values pull, which only tied contact can hold.
            direction: Vector of any length, shape (gdim,).

        Raises:
            ValueError: If the force is zero or not finite, or the direction is zero or has another
                shape.
        """
        number = float(check_vector("force", [force], 1)[0])
        if number == 0:
            raise ValueError("force: must not be zero; use a tool that is not in contact instead")
        self._driven = Driven(number, unit_vector("direction", direction, self.gdim))

    def release(self) -> None:
        """Prescribe all of the displacement again."""
        self._driven = None

    @property
    def driven(self) -> Driven | None:
        """The force that drives the tool, None if its displacement is prescribed."""
        return self._driven

    # --- For contacts

    def check_state(self) -> None:
        """Refuse a motion or force that is not finite or differs between ranks. Collective.

        Raises:
            ValueError: With the name of what is wrong.
        """
        with collective_errors(self.comm):
            self.displacement = self._displacement
            self.rotation = self._rotation
        force, direction = (None, None) if self._driven is None else self._driven
        check_agreement(
            self.comm,
            displacement=self._displacement.tolist(),
            rotation=self._rotation.tolist(),
            position=self.position.tolist(),
            force=force,
            direction=None if direction is None else direction.tolist(),
        )

    @property
    def _embedded(self) -> tuple[Array, Array]:
        """Rotation and translation of the position, in three dimensions."""
        R = np.eye(3)
        R[: self.gdim, : self.gdim] = self._matrix
        return R, padded(self._shift)


def padded(x: Array) -> Array:
    """Coordinates in three dimensions."""
    return np.append(x, np.zeros(3 - len(x)))


def unit_vector(name: str, value: npt.ArrayLike | None, size: int) -> Array:
    """Vector of unit length.

    Raises:
        ValueError: If the value is not made of this many finite numbers, or zero.
    """
    vector = check_vector(name, value, size)
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise ValueError(f"{name}: must not be zero")
    return np.asarray(vector / length)
