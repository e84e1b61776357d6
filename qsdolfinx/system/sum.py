"""An unassembled sum as a matrix: blocks of bodies on the diagonal, and contact."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx import _cpp
from qsdolfinx.base.passing import passing
from qsdolfinx.system.factored import Beside
from qsdolfinx.system.symmetry import is_halved

Array = npt.NDArray[np.float64]


class Sum:
    """Matrix with products and a diagonal only, which is all that multigrid needs.

    Args:
        bodies: Block of each body, and whether it is constant.
        contact: Contact matrix, which couples all bodies.
    """

    def __init__(self, bodies: typing.Sequence[tuple[PETSc.Mat, bool]], contact: Beside) -> None:
        self.bodies = list(bodies)
        self.contact = contact
        sizes = [K.getLocalSize()[0] for K, _ in bodies]
        ends = np.cumsum(sizes)
        #: Positions of each body's unknowns among those of this rank.
        self.parts = [slice(e - size, e) for e, size in zip(ends, sizes, strict=True)]
        self._product = _Product([K for K, _ in bodies], self.parts, contact)
        self.matrix: PETSc.Mat = PETSc.Mat().createPython(
            contact.getSizes(), self._product, contact.comm
        )
        self.matrix.setUp()

    @property
    def shift(self) -> Array | None:
        """Owned values added to the diagonal; None for zeros."""
        return self._product.shift

    def take(self, i: int, K: PETSc.Mat) -> None:
        """Use another matrix of the same layout for body i, if it is another one."""
        if K.handle != self.bodies[i][0].handle:
            self.bodies[i] = (K, self.bodies[i][1])
            self._product.take(i, K)

    def renew(self, shift: Array | None = None) -> None:
        """Update the sum after a change of its terms. Collective.

        Args:
            shift: Owned values added to the diagonal.
        """
        self._product.shift = shift
        self.matrix.assemble()  # its new object state tells solvers that it has changed

    def multiply_bodies(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write to y the product of x and the sum without contact. Collective."""
        self._product.multiply_bodies(x, y)

    def weighted_diagonal(self, weight: float) -> PETSc.Vec:
        """New vector with the diagonal, in which the part of contact is weighted. Collective."""
        diagonal, contact = self.matrix.getDiagonal(), self.contact.diagonal()
        diagonal.axpy(weight - 1, contact)
        contact.destroy()
        return diagonal

    def formed(self) -> PETSc.Mat:
        """The sum as a new AIJ matrix, with the same pattern each time. Collective."""
        mats = [K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()) for K, _ in self.bodies]
        out, contact = diagonal_blocks(mats), self.contact.formed()
        out.axpy(1.0, contact, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        if self.shift is not None:
            diagonal = out.getDiagonal()
            diagonal.array[:] += self.shift
            out.setDiagonal(diagonal)
            diagonal.destroy()
        for mat in (*mats, contact):
            mat.destroy()
        return out

    def destroy(self) -> None:
        """Free the matrix, not its terms. Collective."""
        self.matrix.destroy()


class _Product:
    """Python context of PETSc's shell matrix for the sum of bodies and contact."""

    def __init__(
        self, bodies: typing.Sequence[PETSc.Mat], parts: list[slice], contact: Beside
    ) -> None:
        self._contact = contact
        self._bodies = [
            (_Block(K), part, K.createVecRight(), K.createVecLeft())
            for K, part in zip(bodies, parts, strict=True)
        ]
        #: Owned values added to the diagonal.
        self.shift: Array | None = None

    def take(self, i: int, K: PETSc.Mat) -> None:
        """Use another matrix for body i."""
        self._bodies[i] = (_Block(K), *self._bodies[i][1:])

    @passing()
    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self.multiply_bodies(x, y)
        self._contact.add_product(x, y)

    @passing()
    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self.multiply_bodies(x, y, transposed=True)
        self._contact.add_transposed(x, y)

    def multiply_bodies(self, x: PETSc.Vec, y: PETSc.Vec, transposed: bool = False) -> None:
        there, here = x.array_r, y.array
        for block, part, xi, yi in self._bodies:
            xi.placeArray(there[part])
            yi.placeArray(here[part])
            if transposed and not is_halved(block.K):
                block.K.multTranspose(xi, yi)
            else:
                block.multiply(xi, yi)
            xi.resetArray()
            yi.resetArray()
        if self.shift is not None:
            here += self.shift * there

    @passing()
    def getDiagonal(self, _: PETSc.Mat, diagonal: PETSc.Vec) -> None:
        contact = self._contact.diagonal()
        contact.copy(diagonal)
        contact.destroy()
        for block, part, _x, yi in self._bodies:
            block.K.getDiagonal(yi)
            diagonal.array[part] += yi.array_r
        if self.shift is not None:
            diagonal.array[:] += self.shift

    def destroy(self, _: PETSc.Mat) -> None:
        """Free work vectors, after PETSc has freed the matrix."""
        for _K, _part, xi, yi in self._bodies:
            xi.destroy()
            yi.destroy()


class _Block:
    """Matrix of a body, with fast products if PETSc stores it in blocks."""

    def __init__(self, K: PETSc.Mat) -> None:
        self.K = K
        self._fast: _cpp.BlockProduct | None = None

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write K x to y. Collective."""
        if self._fast is None and _cpp.BlockProduct.is_for(self.K.handle):
            self._fast = _cpp.BlockProduct(self.K.handle)
        if self._fast is None:
            self.K.mult(x, y)
        else:
            self._fast.apply(x.handle, y.handle)


def diagonal_blocks(blocks: list[PETSc.Mat]) -> PETSc.Mat:
    """New AIJ matrix with these blocks on its diagonal. Collective."""
    rows = [[b if i == j else None for j in range(len(blocks))] for i, b in enumerate(blocks)]
    nest = PETSc.Mat().createNest(rows, comm=blocks[0].comm)
    out: PETSc.Mat = nest.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    nest.destroy()
    return out
