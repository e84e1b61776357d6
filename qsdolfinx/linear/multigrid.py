"""Multigrid whose coarse spaces are the bodies' own, with contact in the coarse matrices."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.system.rigid_modes import orthonormal, set_near_nullspace
from qsdolfinx.system.sum import Sum, diagonal_blocks

#: Factor of the diagonal of contact in Jacobi's method. Without it the diagonal is too small:
#: contact couples many nodes with equal strength, so its largest eigenvalue would be more than
#: twice that of the bulk. The interval that Chebyshev polynomials must damp would be as large. With
#: too large a factor, the unknowns coupled by contact are hardly smoothed: at nodes, and with
#: multipliers, 3 takes a fifth more iterations.
CONTACT_WEIGHT = 1.5

_SUBSET = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN


class Multigrid:
    """Two-level multigrid: Chebyshev smoothing on the tangent, GAMG on the first coarse matrix.

    Unknowns are aggregated body by body, and the coarse spaces have each body's rigid modes: bodies
    can slide along each other on all levels. The first coarse matrix is PᵀKP, computed once while K
    is unchanged, plus PᵀCP of contact, which has few rows. The coarser spaces of GAMG are those of
    PᵀKP.

    Args:
        pc: PETSc's preconditioner, of type "mg".
        tangent: The tangent.
        spaces: First coarse space of each body, owned by the caller.
        modes: Rigid modes of each body.
    """

    def __init__(
        self,
        pc: PETSc.PC,
        tangent: Sum,
        spaces: list[Aggregates],
        modes: typing.Sequence[list[PETSc.Vec]],
    ) -> None:
        self._pc, self._tangent, self._spaces = pc, tangent, spaces
        self._P = diagonal_blocks([space.P for space in self._spaces])
        self._bulk = diagonal_blocks([space.coarse for space in self._spaces])
        self._contact = tangent.contact.coarse(self._P)
        # The pattern already includes contact, so that GAMG can keep its spaces when contact is
        # added.
        self._coarse: PETSc.Mat = self._contact.matrix.copy()
        self._coarse.zeroEntries()
        self._coarse.axpy(1.0, self._bulk, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._coarse.setBlockSize(self._spaces[0].coarse.getBlockSize())
        self._set_modes(modes)
        self._smoothed: PETSc.Mat = PETSc.Mat().createDiagonal(tangent.weighted_diagonal(1.0))
        self._start()

    def _start(self) -> None:
        """Pass all matrices to PETSc, and create GAMG's spaces for the bulk."""
        pc = self._pc
        pc.reset()
        pc.setMGLevels(2)
        pc.setMGInterpolation(1, self._P)
        pc.setFromOptions()
        pc.getMGSmoother(1).setOperators(self._tangent.matrix, self._smoothed)
        below = pc.getMGCoarseSolve()
        below.setOperators(self._coarse)
        below.setFromOptions()
        below.setUp()

    def update(self) -> None:
        """Update for the tangent, which has changed. Collective."""
        if not all([space.update() for space in self._spaces]):
            self._bulk.destroy()
            self._bulk = diagonal_blocks([space.coarse for space in self._spaces])
        self._contact.update()
        self._coarse.zeroEntries()
        for part in (self._bulk, self._contact.matrix):
            self._coarse.axpy(1.0, part, structure=_SUBSET)
        self._add_shift()
        diagonal = self._tangent.weighted_diagonal(CONTACT_WEIGHT)
        self._smoothed.setDiagonal(diagonal)
        diagonal.destroy()
        self._pc.getMGSmoother(1).setOperators(self._tangent.matrix, self._smoothed)
        self._pc.getMGCoarseSolve().setOperators(self._coarse)

    def _add_shift(self) -> None:
        """Add the regularisation of unsupported bodies."""
        if self._tangent.shift is None:
            return
        shift = self._tangent.matrix.createVecLeft()
        shift.array[:] = self._tangent.shift
        matrix = PETSc.Mat().createAIJ(self._tangent.matrix.getSizes(), nnz=1, comm=shift.comm)
        matrix.setDiagonal(shift)
        coarse = matrix.ptap(self._P)
        self._coarse.axpy(1.0, coarse, structure=_SUBSET)
        for thing in (shift, matrix, coarse):
            thing.destroy()

    def _set_modes(self, modes: typing.Sequence[list[PETSc.Vec]]) -> None:
        """Rigid modes in the coarse unknowns: columns of P are orthonormal."""
        if len({len(m) for m in modes}) > 1 or not modes[0]:
            return
        fine, vecs = self._P.createVecLeft(), []
        for parts in zip(*modes, strict=True):
            fine.array[:] = np.concatenate([part.array_r for part in parts])
            vecs.append(self._P.createVecRight())
            self._P.multTranspose(fine, vecs[-1])
        set_near_nullspace(self._coarse, orthonormal(vecs))
        for vec in (fine, *vecs):
            vec.destroy()

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self._pc.reset()
        for mat in (self._P, self._bulk, self._contact, self._coarse, self._smoothed):
            mat.destroy()


class Aggregates:
    """Coarse space of one body, by GAMG's aggregation of its unknowns.

    Args:
        K: The body's matrix.
        linear: Whether K is constant.
        modes: Its rigid modes.
        prefix: Prefix of the options.
    """

    def __init__(self, K: PETSc.Mat, linear: bool, modes: list[PETSc.Vec], prefix: str) -> None:
        self._K, self._linear = K, linear
        copy: PETSc.Mat = K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        if modes:
            set_near_nullspace(copy, modes)
        pc = PETSc.PC().create(comm=K.comm)
        pc.setOptionsPrefix(prefix)
        pc.setOperators(copy)
        pc.setFromOptions()
        pc.setGAMGLevels(2)
        pc.setUp()
        #: From coarse unknowns to the body's.
        self.P: PETSc.Mat = pc.getMGInterpolation(1)
        #: Pᵀ K P.
        self.coarse: PETSc.Mat
        if linear:
            self.coarse = pc.getMGCoarseSolve().getOperators()[0].copy()
            copy.destroy()
        else:
            self.coarse = copy.ptap(self.P)
        self._copy = copy
        pc.destroy()

    def follow(self, K: PETSc.Mat) -> None:
        """Use another matrix with the same pattern, and with the same values if K is constant."""
        self._K = K

    def update(self) -> bool:
        """Update for K; returns whether it is unchanged. Collective."""
        if not self._linear:
            self._K.convert(PETSc.Mat.Type.AIJ, self._copy)
            self._copy.ptap(self.P, self.coarse)
        return self._linear

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        for mat in (self._copy, self.P, self.coarse):
            mat.destroy()
