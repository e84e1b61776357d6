"""Errors of remeshing, with the places where they occur."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class RemeshError(RuntimeError):
    """No valid mesh can be created; the body is unchanged.

    Attributes:
        where: Coordinates of the places that cause the error, shape (places, 3); empty if unknown.
    """

    def __init__(self, text: str, where: npt.ArrayLike = ()) -> None:
        super().__init__(text)
        self.where: Array = np.asarray(where, dtype=np.float64).reshape(-1, 3)

    @classmethod
    def at(cls, text: str, where: npt.ArrayLike, most: int = 3) -> RemeshError:
        """Make an error with some of the places in its text."""
        points = np.asarray(where, dtype=np.float64).reshape(-1, 3)
        shown = ", ".join("({:.5g}, {:.5g}, {:.5g})".format(*x) for x in points[:most])
        more = f" and {len(points) - most} more places" if len(points) > most else ""
        return cls(f"{text} at {shown}{more}", points)


T = typing.TypeVar("T")


def on_root(comm: MPI.Intracomm, make: typing.Callable[[], T]) -> T | None:
    """Call a function on rank 0; None on others; its error is raised on all ranks. Collective.

    Raises:
        RemeshError: If ``make`` raises this or any other error on rank 0.
    """
    made: T | None = None
    failed: tuple[str, Array] | None = None
    cause: Exception | None = None
    if comm.rank == 0:
        try:
            made = make()
        except RemeshError as error:
            failed, cause = (str(error), error.where), error
        except Exception as error:
            failed, cause = (f"{type(error).__name__}: {error}", np.zeros((0, 3))), error
    failed = comm.bcast(failed, root=0)
    if failed is not None:
        raise RemeshError(*failed) from cause
    return made
