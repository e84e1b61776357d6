"""Interface of all matrix formats of the tangent."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Tangent(typing.Protocol):
    """Matrix of all bodies and contacts: MatNest, one AIJ matrix, or an unassembled sum."""

    #: The tangent as a matrix for the linear solver.
    matrix: PETSc.Mat

    def assemble(self) -> None:
        """Fill the matrix for the bodies' and the contacts' present state. Collective."""

    def diagonal(self, i: int) -> Array:
        """Diagonal of body i's block on this rank. Collective."""

    def set_diagonal(self, i: int, values: Array) -> None:
        """Replace the diagonal of body i's block. Collective.

        If unchanged bulk is not restored, the new diagonal is kept until :meth:`renew`.
        """

    def renew(self) -> None:
        """Restore all of the bulk at the next assembly."""

    def destroy(self) -> None:
        """Free the matrices owned by this object. Collective."""
