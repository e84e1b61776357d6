"""Entries of matrices, in any order, and assembly of a matrix from them."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Entries(typing.NamedTuple):
    """Entries of a matrix in rows of this rank; entries at the same position are added.

    Attributes:
        row: Numbers of rows.
        column: Numbers of columns; entries with negative numbers are ignored.
        value: The entries.
    """

    row: Indices
    column: Indices
    value: Array

    def matrix(self, num_rows: int, num_columns: int, comm: typing.Any) -> PETSc.Mat:
        """AIJ matrix with given numbers of rows and columns on this rank. Collective."""
        return matrix_of([self], num_rows, num_columns, comm)

    def scaled(self, factor: float | Array) -> Entries:
        """Entries times a factor, or times one factor for each entry."""
        return self._replace(value=factor * self.value)

    def below(self, first: int) -> Entries:
        """Entries with row numbers increased by ``first``."""
        return self._replace(row=first + self.row)


def joined(parts: typing.Sequence[Entries]) -> Entries:
    """Join lists of entries."""
    none = Entries(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    return Entries(*(np.concatenate(arrays) for arrays in zip(none, *parts, strict=True)))


def matrix_of(
    parts: typing.Sequence[Entries], num_rows: int, num_columns: int, comm: typing.Any
) -> PETSc.Mat:
    """Assemble an AIJ matrix from entries, part by part. Collective.

    Args:
        parts: Entries; rows are numbered on this rank, columns globally.
        num_rows: Number of rows on this rank.
        num_columns: Number of columns on this rank.
        comm: The communicator.
    """
    first = (comm.tompi4py() if isinstance(comm, PETSc.Comm) else comm).exscan(num_columns) or 0
    counts = np.zeros((2, num_rows), dtype=PETSc.IntType)
    for part in parts:
        own = (part.column >= first) & (part.column < first + num_columns)
        others = ~own & (part.column >= 0)
        for count, of in zip(counts, (own, others), strict=True):
            count += np.bincount(part.row[of], minlength=num_rows).astype(PETSc.IntType)
    sizes = (num_rows, PETSc.DETERMINE), (num_columns, PETSc.DETERMINE)
    counts[0] = np.minimum(counts[0], num_columns)
    mat: PETSc.Mat = PETSc.Mat().createAIJ(sizes, nnz=tuple(counts), comm=comm)
    # Set the same options as on ranks without rows, where petsc4py passes no counts. Otherwise,
    # assembly waits for all ranks.
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    mat.setOption(PETSc.Mat.Option.NO_OFF_PROC_ENTRIES, True)
    for part in parts:
        row, column, value = part
        if np.any(row[1:] < row[:-1]):
            order = np.argsort(row, kind="stable")
            row, column, value = row[order], column[order], value[order]
        ends = np.searchsorted(row, np.arange(num_rows + 1)).astype(PETSc.IntType)
        mat.setValuesIJV(ends, column.astype(PETSc.IntType, copy=False), value, addv=True)
    mat.assemble()
    return mat


def local_entries(mat: PETSc.Mat) -> Entries:
    """Entries of a matrix; rows are numbered on this rank."""
    starts, columns, values = mat.getValuesCSR()
    row = np.arange(len(starts) - 1, dtype=PETSc.IntType)
    return Entries(np.repeat(row, np.diff(starts)), columns, values)


def global_entries(mat: PETSc.Mat) -> Entries:
    """Entries in rows of this rank, with global numbers."""
    return local_entries(mat).below(mat.getOwnershipRange()[0])
