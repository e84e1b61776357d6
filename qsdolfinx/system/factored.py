"""Contact matrices, separate from those of bodies: a product of thin factors, or assembled."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np


class Beside(typing.Protocol):
    """Matrix of contact on all unknowns, as :class:`Sum` and multigrid use it."""

    comm: typing.Any

    def getSizes(self) -> typing.Any:
        """Local and global numbers of rows and columns, as PETSc has them."""

    def add_product(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += C x. Collective."""

    def add_transposed(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += Cᵀ x. Collective."""

    def diagonal(self) -> PETSc.Vec:
        """New vector with the diagonal of C. Collective."""

    def coarse(self, P: PETSc.Mat) -> Coarse:
        """Coarse matrix Pᵀ C P, which can be updated after changes of C. Collective."""

    def restricted(self, places: PETSc.IS, scale: PETSc.Vec) -> Beside:
        """Matrix of selected rows and columns, with scaled rows. Collective."""

    def follow(self) -> None:
        """Update to changes of the matrix of which this is a restriction. Collective."""

    def formed(self) -> PETSc.Mat:
        """New AIJ matrix, with the same pattern each time. Collective."""

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""


class Coarse(typing.Protocol):
    """A matrix of contact in multigrid's first coarse space."""

    #: Pᵀ C P.
    matrix: PETSc.Mat

    def update(self) -> None:
        """Update to changes of C. Collective."""

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""


class Factored:
    """C = Lᵀ W R: L gives the gaps of all constraints for the unknowns, W is their stiffness.

    A slave node on a finer master couples all opposite nodes with each other: the product has many
    more entries than its factors.

    Args:
        left: L, gaps by unknowns.
        weights: W, with few entries in each row; the values change.
        right: R, which is L with columns multiplied by the displacement per unknown.
        squares: Entrywise product of L and R.
        mixed: For rows of W with an off-diagonal entry that contributes to the diagonal of C:
            entrywise product of L in this row and R in the column of the entry.
        beside: These entries of W; the values change.
    """

    def __init__(
        self,
        left: PETSc.Mat,
        weights: PETSc.Mat,
        right: PETSc.Mat,
        squares: PETSc.Mat,
        mixed: PETSc.Mat,
        beside: PETSc.Vec,
    ) -> None:
        self.comm = left.comm
        self.left, self.weights, self.right = left, weights, right
        self._squares, self._mixed, self._beside = squares, mixed, beside
        self._gaps, self._forces = left.createVecLeft(), left.createVecLeft()
        #: Objects owned by this one, and freed with it.
        self.own: list[PETSc.Object] = []

    def getSizes(self) -> typing.Any:
        """Local and global numbers of rows and columns, as PETSc has them."""
        return (self.left.getSizes()[1], self.right.getSizes()[1])

    def add_product(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += C x. Collective."""
        self.right.mult(x, self._gaps)
        self.weights.mult(self._gaps, self._forces)
        self.left.multTransposeAdd(self._forces, y, y)

    def add_transposed(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += Cᵀ x. Collective."""
        self.left.mult(x, self._gaps)
        self.weights.multTranspose(self._gaps, self._forces)
        self.right.multTransposeAdd(self._forces, y, y)

    def diagonal(self) -> PETSc.Vec:
        """New vector with the diagonal of C. Collective."""
        out = self.left.createVecRight()
        self.weights.getDiagonal(self._gaps)
        self._squares.multTranspose(self._gaps, out)
        self._mixed.multTransposeAdd(self._beside, out, out)
        return out

    def coarse(self, P: PETSc.Mat) -> CoarseFactored:
        """Coarse matrix Pᵀ C P, which can be updated after changes of C. Collective."""
        return CoarseFactored(self, P)

    def restricted(self, places: PETSc.IS, scale: PETSc.Vec) -> Factored:
        """Matrix of selected rows and columns, with scaled rows. Collective."""
        first, last = self.left.getOwnershipRange()
        rows = PETSc.IS().createStride(last - first, first, 1, comm=self.comm)
        parts = (self.left, self.right, self._squares, self._mixed)
        left, right, squares, mixed = (part.createSubMatrix(rows, places) for part in parts)
        rows.destroy()
        for part in (left, squares, mixed):
            part.diagonalScale(None, scale)
        out = Factored(left, self.weights, right, squares, mixed, self._beside)
        out.own = [left, right, squares, mixed]
        return out

    def follow(self) -> None:
        """Do nothing: W is shared with the original matrix."""

    def formed(self) -> PETSc.Mat:
        """New AIJ matrix, with the same pattern each time. Collective."""
        half = self.weights.matMult(self.right)
        out: PETSc.Mat = self.left.transposeMatMult(half)
        half.destroy()
        return out

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        for thing in (self._gaps, self._forces, *self.own):
            thing.destroy()


class CoarseFactored:
    """Pᵀ C P = (L P)ᵀ W (R P).

    Args:
        fine: C.
        P: Prolongation from coarse unknowns to those of C.
    """

    def __init__(self, fine: Factored, P: PETSc.Mat) -> None:
        self._weights = fine.weights
        self._left = fine.left.matMult(P)
        self._right = self._left if fine.right is fine.left else fine.right.matMult(P)
        self._half = self._weights.matMult(self._right)
        self.matrix: PETSc.Mat = self._left.transposeMatMult(self._half)

    def update(self) -> None:
        """Update to changes of C. Collective."""
        self._weights.matMult(self._right, self._half)
        self._left.transposeMatMult(self._half, self.matrix)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        for mat in {id(m): m for m in (self._left, self._right, self._half, self.matrix)}.values():
            mat.destroy()


class Formed:
    """C as an AIJ matrix, most of whose rows are empty.

    Args:
        matrix: C.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        self.comm, self.matrix = matrix.comm, matrix
        self._of: tuple[PETSc.Mat, PETSc.IS, PETSc.Vec] | None = None

    def getSizes(self) -> typing.Any:
        """Local and global numbers of rows and columns, as PETSc has them."""
        return self.matrix.getSizes()

    def replace(self, matrix: PETSc.Mat) -> None:
        """Replace the matrix by another one, with any pattern. Collective."""
        self.matrix.destroy()
        self.matrix = matrix

    def take(self, matrix: PETSc.Mat) -> bool:
        """Take over another matrix, and return whether its pattern is the same.

        Collective.
        """
        pairs = zip(self.matrix.getRowIJ(), matrix.getRowIJ(), strict=True)
        same = all(np.array_equal(a, b) for a, b in pairs)
        if not self.comm.tompi4py().allreduce(same, op=MPI.LAND):
            self.replace(matrix)
            return False
        matrix.copy(self.matrix, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        matrix.destroy()
        return True

    def add_product(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += C x. Collective."""
        self.matrix.multAdd(x, y, y)

    def add_transposed(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add y += Cᵀ x. Collective."""
        self.matrix.multTransposeAdd(x, y, y)

    def diagonal(self) -> PETSc.Vec:
        """New vector with the diagonal of C. Collective."""
        return self.matrix.getDiagonal()

    def coarse(self, P: PETSc.Mat) -> CoarseFormed:
        """Coarse matrix Pᵀ C P, which can be updated after changes of C. Collective."""
        return CoarseFormed(self.matrix, P)

    def restricted(self, places: PETSc.IS, scale: PETSc.Vec) -> Formed:
        """Matrix of selected rows and columns, with scaled rows. Collective."""
        out = Formed(self.matrix.createSubMatrix(places, places))
        out._of = self.matrix, places, scale
        out.matrix.diagonalScale(scale, None)
        return out

    def follow(self) -> None:
        """Update to changes of the matrix of which this is a restriction. Collective."""
        if self._of is not None:
            matrix, places, scale = self._of
            matrix.createSubMatrix(places, places, submat=self.matrix)
            self.matrix.diagonalScale(scale, None)

    def formed(self) -> PETSc.Mat:
        """New AIJ matrix, with the same pattern each time. Collective."""
        return self.matrix.copy()

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.matrix.destroy()


class CoarseFormed:
    """Pᵀ C P of an assembled matrix C.

    Args:
        fine: C.
        P: Prolongation from coarse unknowns to those of C.
    """

    def __init__(self, fine: PETSc.Mat, P: PETSc.Mat) -> None:
        self._fine, self._P = fine, P
        self.matrix: PETSc.Mat = fine.ptap(P)

    def update(self) -> None:
        """Update to changes of C. Collective."""
        self._fine.ptap(self._P, self.matrix)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.matrix.destroy()
