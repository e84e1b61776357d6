"""The tangent as a sum that is never formed: each body's own matrix, and contact beside them."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.system.blocks import Blocks
from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]


class Additive:
    """Matrix of all bodies that can be multiplied and has a diagonal, which is all "amg" asks for.

    Bodies' matrices stay where they are and as they are, in blocks (BAIJ), with which PETSc
    multiplies twice as fast as with AIJ. Contact is an AIJ matrix, most of whose rows are empty.

    Args:
        bodies: The bodies.
        blocks: Contact's blocks, without bulk.
        matrices: Bulk block of each body.
        watch: Counts the time for the stage "conversion".
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        blocks: Blocks,
        matrices: typing.Sequence[PETSc.Mat],
        watch: Stopwatch,
    ) -> None:
        self._bodies, self._blocks, self._watch = bodies, blocks, watch
        #: Bulk block of each body, and whether it stays.
        self.bodies = [(K, body.linear) for K, body in zip(matrices, bodies, strict=True)]
        with watch.stage("conversion"):
            #: Contact alone.
            self.contact: PETSc.Mat = blocks.matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        ends = np.cumsum([body.num_owned for body in bodies])
        self._parts = [slice(e - b.num_owned, e) for e, b in zip(ends, bodies, strict=True)]
        self._product = _Product(matrices, self._parts, self.contact)
        sizes = self.contact.getSizes()
        self.matrix: PETSc.Mat = PETSc.Mat().createPython(sizes, self._product, bodies[0].comm)
        self.matrix.setUp()

    def assemble(self, contact: bool = True) -> None:
        """Update to the bodies' and the contacts' present state. Collective.

        Args:
            contact: False for the bulk alone.
        """
        for body in self._bodies:
            body.matrix()
        if contact:
            self._blocks.assemble()
        with self._watch.stage("conversion"):
            if contact:
                self._blocks.matrix.convert(PETSc.Mat.Type.AIJ, self.contact)
            else:
                self.contact.zeroEntries()
        self._product.shift = None
        self.matrix.assemble()  # its state tells solvers that it is another

    @property
    def shift(self) -> Array | None:
        """Owned values that were added to the diagonal, None for zeros."""
        return self._product.shift

    def weighted_diagonal(self, weight: float) -> PETSc.Vec:
        """New vector, the diagonal with contact's part of it times a weight. Collective."""
        diagonal, contact = self.matrix.getDiagonal(), self.contact.getDiagonal()
        diagonal.axpy(weight - 1, contact)
        contact.destroy()
        return diagonal

    def formed(self) -> PETSc.Mat:
        """The sum as a new AIJ matrix, with the same pattern each time. Collective."""
        mats = [K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()) for K, _ in self.bodies]
        out = diagonal_blocks(mats)
        out.axpy(1.0, self.contact, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        if self._product.shift is not None:
            diagonal = out.getDiagonal()
            diagonal.array[:] += self._product.shift
            out.setDiagonal(diagonal)
            diagonal.destroy()
        for mat in mats:
            mat.destroy()
        return out

    def diagonal(self, i: int) -> Array:
        """Diagonal of body i's block on this rank. Collective."""
        diagonal = self.matrix.getDiagonal()
        out: Array = diagonal.array_r[self._parts[i]].copy()
        diagonal.destroy()
        return out

    def set_diagonal(self, i: int, values: Array) -> None:
        """Replace the diagonal of body i's block. Collective."""
        change = values - self.diagonal(i)
        if self._product.shift is None:
            self._product.shift = np.zeros(self._parts[-1].stop)
        self._product.shift[self._parts[i]] += change
        self.matrix.assemble()

    def renew(self) -> None:
        """Nothing is left from one assembly to the next."""

    def destroy(self) -> None:
        """Free the matrices but for the bodies'. Collective."""
        self.matrix.destroy()
        self.contact.destroy()


class _Product:
    """What PETSc calls for the sum of bodies and contact."""

    def __init__(
        self, matrices: typing.Sequence[PETSc.Mat], parts: list[slice], contact: PETSc.Mat
    ) -> None:
        self._contact = contact
        self._bodies = [
            (K, part, K.createVecRight(), K.createVecLeft())
            for K, part in zip(matrices, parts, strict=True)
        ]
        #: Owned values on top of the diagonal.
        self.shift: Array | None = None

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._sum(x, y, PETSc.Mat.mult, PETSc.Mat.multAdd)

    def multTranspose(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._sum(x, y, PETSc.Mat.multTranspose, PETSc.Mat.multTransposeAdd)

    def _sum(
        self,
        x: PETSc.Vec,
        y: PETSc.Vec,
        mult: typing.Callable[..., None],
        add: typing.Callable[..., None],
    ) -> None:
        there, here = x.array_r, y.array
        for K, part, xi, yi in self._bodies:
            xi.placeArray(there[part])
            yi.placeArray(here[part])
            mult(K, xi, yi)
            xi.resetArray()
            yi.resetArray()
        if self.shift is not None:
            here += self.shift * there
        del here, there
        add(self._contact, x, y, y)

    def getDiagonal(self, _: PETSc.Mat, diagonal: PETSc.Vec) -> None:
        self._contact.getDiagonal(diagonal)
        for K, part, _x, yi in self._bodies:
            K.getDiagonal(yi)
            diagonal.array[part] += yi.array_r
        if self.shift is not None:
            diagonal.array[:] += self.shift

    def destroy(self, _: PETSc.Mat) -> None:
        """PETSc has freed the matrix."""
        for _K, _part, xi, yi in self._bodies:
            xi.destroy()
            yi.destroy()


def diagonal_blocks(blocks: list[PETSc.Mat]) -> PETSc.Mat:
    """New AIJ matrix with these blocks on its diagonal. Collective."""
    rows = [[b if i == j else None for j in range(len(blocks))] for i, b in enumerate(blocks)]
    nest = PETSc.Mat().createNest(rows, comm=blocks[0].comm)
    out: PETSc.Mat = nest.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    nest.destroy()
    return out
