"""The tangent as one AIJ matrix: constant bulk inserted once, contact added in its rows."""

from __future__ import annotations

import enum
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.system.blocks import Blocks, forbid_allocation
from qsdolfinx.system.body import Body
from qsdolfinx.system.numbering import numbering

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int32]
#: Bodies of a block's rows and columns.
Pair = tuple[int, int]


class Mode(enum.IntEnum):
    """How existing entries are changed by inserted rows; as in cpp/tangent/rows.h."""

    ZERO = 0
    INSERT = 1
    ADD = 2


class Monolithic:
    """AIJ matrix of all bodies: bulk on the diagonal, and contact blocks added to it.

    If a bulk block has not changed, only its rows with contact are restored.

    Args:
        bodies: The bodies.
        blocks: Contact blocks, without bulk.
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
        with watch.stage("conversion"):
            self._numbers = numbering(matrices)
            self._all: list[Rows] = [np.arange(b.num_owned, dtype=np.int32) for b in bodies]
            counts = self._contact_counts()
            #: Rows of each contact block, and rows of each body in any contact block.
            self._rows = {pair: _filled(count) for pair, count in counts.items()}
            self._touched = [self._rows_of(i) for i in range(len(bodies))]
            for i, matrix in enumerate(matrices):
                counts[i, i] = counts[i, i] + _cpp.count_entries(handle_of(matrix))
            self.matrix: PETSc.Mat = self._allocate(counts)
            self._put_contact(Mode.ZERO)
            for i, matrix in enumerate(matrices):
                self._put(matrix, (i, i), self._all[i], Mode.INSERT)
            self.matrix.assemble()
        forbid_allocation(self.matrix)
        # Number of each body's assembly whose bulk is in the matrix.
        self._inserted: list[int | None] = [body.num_assemblies for body in bodies]

    def assemble(self) -> None:
        """Fill the matrix for the bodies' and the contacts' present state. Collective."""
        self._blocks.assemble()
        matrices = [body.matrix() for body in self._bodies]
        with self._watch.stage("conversion"):
            self._put_contact(Mode.ZERO)
            for i, (body, matrix) in enumerate(zip(self._bodies, matrices, strict=True)):
                same = body.num_assemblies == self._inserted[i]
                self._put(matrix, (i, i), (self._touched if same else self._all)[i], Mode.INSERT)
                self._inserted[i] = body.num_assemblies
            self.matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)
            self._put_contact(Mode.ADD)
            self.matrix.assemble()

    def diagonal(self, i: int) -> Array:
        """Diagonal of body i's block on this rank. Collective."""
        diagonal = self.matrix.getDiagonal()
        out: Array = diagonal.array_r[self._part(i)].copy()
        diagonal.destroy()
        return out

    def set_diagonal(self, i: int, values: Array) -> None:
        """Replace the diagonal of body i's block. Collective."""
        diagonal = self.matrix.getDiagonal()
        diagonal.array[self._part(i)] = values
        self.matrix.setDiagonal(diagonal)
        diagonal.destroy()

    def renew(self) -> None:
        """Restore all of the bulk at the next assembly, without values added to its diagonal."""
        self._inserted = [None] * len(self._bodies)

    def destroy(self) -> None:
        """Free the matrix. Collective."""
        self.matrix.destroy()

    # --- Rows of this rank

    def _part(self, i: int) -> slice:
        """Positions of body i's unknowns among those of this rank."""
        start = sum(body.num_owned for body in self._bodies[:i])
        return slice(start, start + self._bodies[i].num_owned)

    def _put(self, block: PETSc.Mat, pair: Pair, rows: Rows, mode: Mode) -> None:
        numbers = self._numbers[pair[0]], self._numbers[pair[1]]
        _cpp.put_rows(handle_of(block), handle_of(self.matrix), rows, *numbers, mode)

    def _put_contact(self, mode: Mode) -> None:
        for pair, rows in self._rows.items():
            block = self._blocks.block(*pair)
            assert block is not None
            self._put(block, pair, rows, mode)

    def _contact_counts(self) -> dict[Pair, Rows]:
        """Number of entries in own and in other columns, for each row of each contact block."""
        blocks = {pair: self._blocks.block(*pair) for pair in self._blocks.pairs}
        return {p: _cpp.count_entries(handle_of(b)) for p, b in blocks.items() if b is not None}

    def _rows_of(self, i: int) -> Rows:
        """Rows of body i with contact entries."""
        rows = [rows for (k, _), rows in self._rows.items() if k == i]
        return np.unique(np.concatenate(rows)) if rows else np.zeros(0, dtype=np.int32)

    def _allocate(self, counts: dict[Pair, Rows]) -> PETSc.Mat:
        """Matrix with room for bulk and contact."""
        size = sum(body.num_owned for body in self._bodies)
        room = np.zeros((2, size), dtype=PETSc.IntType)
        for (i, _), count in counts.items():
            room[:, self._part(i)] += count
        matrix = PETSc.Mat().create(comm=self._bodies[0].comm)
        matrix.setSizes(((size, PETSc.DETERMINE), (size, PETSc.DETERMINE)))
        matrix.setType(PETSc.Mat.Type.AIJ)
        # The same column may have been counted for bulk and for contact.
        total = sum(int(ranges[-1]) for ranges, _ in self._numbers)
        limits = np.array([[size], [total - size]], dtype=PETSc.IntType)
        room = np.minimum(room, limits)
        matrix.setPreallocationNNZ((room[0], room[1]))
        # On a rank without rows, PETSc treats this option as unset, and assembly would wait for the
        # others.
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
        return matrix


def _filled(counts: Rows) -> Rows:
    """Rows with at least one entry."""
    return np.flatnonzero(counts.sum(axis=0)).astype(np.int32)
