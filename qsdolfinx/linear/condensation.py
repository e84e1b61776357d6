"""Tangent of the bodies with contact condensed, and its preconditioner."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.solver import LinearSolver
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.factored import Formed
from qsdolfinx.system.matrices import Form
from qsdolfinx.system.row_blocks import RowBlocks
from qsdolfinx.system.sum import Sum
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]


class ContactPart(typing.NamedTuple):
    """Contributions of contact to the bodies' matrices, at one evaluation.

    Attributes:
        matrix: H, F, D and C: the derivative by all unknowns, without the bodies' own matrices.
        blocks: C_γ of its rows of multipliers.
        num_bodies: Number of unknowns of bodies on this rank; they come first, before the
            multipliers.
    """

    matrix: PETSc.Mat
    blocks: RowBlocks
    num_bodies: int

    def condensed(self, into: PETSc.Mat | None = None) -> PETSc.Mat:
        """H − F C_γ⁻¹ D of the bodies' unknowns. Collective.

        Args:
            into: An earlier result with the same pattern, to be reused; None for a new matrix.
        """
        C = self.blocks.inverse()
        C.scale(-1.0)
        start, num = self.matrix.getOwnershipRange()[0], self.blocks.num_rows
        sets = [
            PETSc.IS().createStride(size, first, 1, comm=self.matrix.comm)
            for size, first in ((self.num_bodies, start), (num, start + self.num_bodies))
        ]
        D = self.matrix.createSubMatrix(sets[1], sets[0])
        half = C.matMult(D)
        for thing in (D, C):  # to free memory before the next matrix
            thing.destroy()
        F = self.matrix.createSubMatrix(sets[0], sets[1])
        product = F.matMult(half)
        for thing in (F, half):
            thing.destroy()
        if into is not None:
            into.zeroEntries()
            into.axpy(1.0, product, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            product.destroy()
        out = self.matrix.createSubMatrix(sets[0], sets[0])
        for index_set in sets:
            index_set.destroy()
        if into is not None:
            into.axpy(1.0, out, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            out.destroy()
            return into
        if out.handle == self.matrix.handle:  # PETSc returns the matrix itself
            out.destroy()
            out = self.matrix.copy()
        out.axpy(1.0, product, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        product.destroy()
        return out


class Condensation(typing.Protocol):
    """K + H − F C_γ⁻¹ D, and its preconditioner V."""

    def update(self, contact: ContactPart, springs: Array, free: Array) -> None:
        """Update for the present bodies and contact. Collective.

        Args:
            contact: Contributions of contact.
            springs: Added to the diagonal, owned unknowns.
            free: Motions that active constraints do not resist, from ``Hold.free_motions``.
        """

    def multiply_bodies(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write K x to y, with springs. Collective."""

    def solve(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write V x to y. Collective."""

    def free(self) -> None:
        """Free PETSc's objects. Collective."""


def condensation_of(system: ContactSystem, linear: LinearSolver) -> Condensation:
    """Condensation for a problem's linear solver."""
    is_sum = isinstance(system.made.tangent, Additive)
    return _OfSum(system, linear) if is_sum else _OfMatrix(system, linear)


class _OfSum:
    """A sum that is never formed, with multigrid or the Schur complement of pressures."""

    def __init__(self, system: ContactSystem, linear: LinearSolver) -> None:
        assert isinstance(system.made.tangent, Additive)
        self._tangent, self._linear = system.made.tangent, linear
        #: Contact matrix and its condensed matrix at the last update: patterns are unchanged while
        #: both exist.
        self._last: tuple[PETSc.Mat, PETSc.Mat] | None = None

    def update(self, contact: ContactPart, springs: Array, free: Array) -> None:
        tangent = self._tangent
        if tangent.has_factors:
            tangent.assemble_with(contact.blocks.stiffness(), springs)
        else:
            last = (None, None) if self._last is None else self._last
            same = contact.matrix is last[0] and tangent.contact_matrix is last[1]
            known = tangent.contact_matrix if same else None
            tangent.assemble_beside(contact.condensed(known), springs)
            self._last = contact.matrix, tangent.contact_matrix
        self._linear.precondition(free)

    def multiply_bodies(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._tangent.sum.multiply_bodies(x, y)

    def solve(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._linear.apply(x, y)

    def free(self) -> None:
        """The sum is the system's."""


class _OfMatrix:
    """One AIJ matrix or a MatNest, with the preconditioner of a preset or a solver by options."""

    def __init__(self, system: ContactSystem, linear: LinearSolver) -> None:
        self._system, self._linear = system, linear
        self._sum: Sum | None = None
        self._own: list[PETSc.Mat] = []

    def update(self, contact: ContactPart, springs: Array, free: Array) -> None:
        self._forget()
        bodies = self._system.bodies
        bulk = [body.matrix() for body in bodies]
        beside = Formed(contact.condensed())
        parts = [(K, body.linear) for K, body in zip(bulk, bodies, strict=True)]
        self._sum = Sum(parts, beside)
        self._sum.renew(springs)
        whole = self._sum.formed()
        self._own = [beside.matrix, whole]
        if self._system.form is Form.NEST:
            whole = self._as_nest(whole)
        else:
            self._system.made.set_near_nullspaces(whole)
        self._linear.precondition_formed(whole)

    def _as_nest(self, whole: PETSc.Mat) -> PETSc.Mat:
        """The matrix as a nest with blocks of bodies. Collective."""
        sizes = [body.num_owned for body in self._system.bodies]
        ends = whole.getOwnershipRange()[0] + np.cumsum([0, *sizes])
        sets = [
            PETSc.IS().createStride(n, int(first), 1, comm=whole.comm)
            for n, first in zip(sizes, ends, strict=False)
        ]
        blocks = [[whole.createSubMatrix(i, j) for j in sets] for i in sets]
        nest = PETSc.Mat().createNest(blocks, comm=whole.comm)
        for i, body_blocks in enumerate(blocks):
            self._system.made.set_near_nullspace(i, body_blocks[i])
        self._own += [nest, *(block for of in blocks for block in of)]
        for index_set in sets:
            index_set.destroy()
        return nest

    def multiply_bodies(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        assert self._sum is not None
        self._sum.multiply_bodies(x, y)

    def solve(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._linear.apply(x, y)

    def _forget(self) -> None:
        if self._sum is not None:
            self._sum.destroy()
        for mat in self._own:
            mat.destroy()
        self._sum, self._own = None, []

    def free(self) -> None:
        self._forget()
