"""What every form of the tangent can do."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Tangent(typing.Protocol):
    """Matrix of all bodies and contacts: MatNest, one AIJ matrix, or a sum that is never formed."""

    #: As the linear solver sees it.
    matrix: PETSc.Mat

    def assemble(self) -> None:
        """Fill the matrix for the bodies' and the contacts' present state. Collective."""

    def diagonal(self, i: int) -> Array:
        """Diagonal of body i's block on this rank. Collective."""

    def set_diagonal(self, i: int, values: Array) -> None:
        """Replace the diagonal of body i's block. Collective.

        Where a bulk that has not changed is not put back, it stays until :meth:`renew`.
        """

    def renew(self) -> None:
        """Put back all of the bulk at the next assembly."""

    def destroy(self) -> None:
        """Free the matrices that are its own. Collective."""
