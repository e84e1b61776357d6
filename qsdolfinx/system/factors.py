"""Contact part of the tangent in factors: gaps of all constraints, and their stiffness."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact import terms
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.blocks import Side, Sides
from qsdolfinx.system.entries import Entries, joined
from qsdolfinx.system.factored import Factored
from qsdolfinx.system.numbering import numbering

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
#: Converts global unknowns of a body to numbers in a larger system; -1 stays -1.
Number = typing.Callable[[Indices], Indices]


class ContactFactors:
    """Lᵀ W R of all contacts: L is constant until contact pairs are updated, W varies.

    An integration side has a row for each of its gaps. A slip has a row for each component of each
    relative displacement. The rows of a slip follow those of its integration side.

    Args:
        contacts: Contacts with the penalty already known, all with ``terms.has_factors``.
        sides: Bodies of each contact.
        matrices: Bulk block of each body, for its layout.
        scales: Displacement per unknown of each body.
    """

    def __init__(
        self,
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
        matrices: typing.Sequence[PETSc.Mat],
        scales: typing.Sequence[float],
    ) -> None:
        self._contacts = list(contacts)
        self._numbers: list[Number] = [body.__call__ for body in numbering(matrices)]
        self._comm = matrices[0].comm
        sizes = [K.getLocalSize()[0] for K in matrices]
        parts: list[_Part] = []
        for contact, side in zip(contacts, sides, strict=True):
            parts += [_Part(contact, side, part, self._numbers) for part in _in_order(contact)]
        #: First row of each part, and the number of rows of this rank.
        self._starts = np.cumsum([0, *(part.num_rows for part in parts)])
        self._parts = parts
        shape = int(self._starts[-1]), sum(sizes), self._comm
        left = _stacked([part.entries for part in parts], self._starts).matrix(*shape)
        squares = _stacked([part.squares for part in parts], self._starts).matrix(*shape)
        mixed = _stacked([part.mixed for part in parts], self._starts).matrix(*shape)
        right = left
        if any(scale != 1 for scale in scales):
            factor = left.createVecRight()
            factor.array[:] = np.repeat(scales, sizes)
            right = left.copy()
            for mat in (right, squares, mixed):
                mat.diagonalScale(None, factor)
            factor.destroy()
        self._beside = left.createVecLeft()
        self._pointer, self._columns = self._pattern(left.getOwnershipRange()[0])
        none = np.zeros(self._columns.size)
        size = left.getSizes()[0]
        csr = self._pointer, self._columns, none
        self._weights: PETSc.Mat = PETSc.Mat().createAIJ((size, size), csr=csr, comm=self._comm)
        #: The product.
        self.product = Factored(left, self._weights, right, squares, mixed, self._beside)
        own = {id(mat): mat for mat in (left, right, squares, mixed, self._weights)}
        self.product.own = [*own.values(), self._beside]

    def _pattern(self, first: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Pattern of W in compressed row form: global columns, ascending."""
        counts, columns = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)]
        for part, start in zip(self._parts, self._starts, strict=False):
            of_rows = np.arange(start, start + part.num_rows)[:, None]
            if isinstance(part.of, Slip):
                gdim = part.width
                block = start + np.arange(part.num_rows).reshape(-1, 1, gdim)
                of_rows = np.broadcast_to(block, (block.shape[0], gdim, gdim))
                gap = self._pass_of(part.of)
                row = self._starts[gap] + np.arange(block.shape[0])
                beside = np.broadcast_to(row[:, None, None], (row.size, gdim, 1))
                of_rows = np.concatenate([beside, of_rows], axis=2)
                of_rows = of_rows.reshape(part.num_rows, of_rows.shape[2])
            counts.append(np.full(part.num_rows, of_rows.shape[1], dtype=np.int64))
            columns.append(of_rows.ravel())
        pointer = np.cumsum(np.concatenate(counts))
        return pointer.astype(np.int32), (first + np.concatenate(columns)).astype(np.int32)

    def _pass_of(self, slip: Slip) -> int:
        """Part with the pressures of a slip."""
        return next(i for i, part in enumerate(self._parts) if part.of is slip.gap)

    def update(self) -> None:
        """Update the weights to the present contacts. Collective."""
        self.set([pair for contact in self._contacts for pair in terms.gaps_and_slips(contact)])

    def set(self, given: typing.Sequence[tuple[WeightedGap | Slip, terms.Weights]]) -> None:
        """Set the stiffness of gaps and slips. Collective."""
        found = {id(of): stiffness for of, stiffness in given}
        values, beside = [np.zeros(0)], [np.zeros(0)]
        for part in self._parts:
            stiffness = found[id(part.of)]
            coupling = np.zeros(part.num_rows)
            if isinstance(stiffness, tuple):
                block, change = stiffness
                coupling = change.ravel()
                block = np.concatenate([change[:, :, None], block], axis=2)
                values.append(block.ravel())
            else:
                stiffness = stiffness if stiffness.ndim == 2 else stiffness[:, None]
                values.append(np.broadcast_to(stiffness, (part.num_gaps, part.width)).ravel())
            beside.append(coupling)
        self._weights.setValuesCSR(self._pointer, self._columns, np.concatenate(values))
        self._weights.assemble()
        self._beside.array[:] = np.concatenate(beside)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.product.destroy()


def _in_order(contact: ContactModel) -> list[WeightedGap | Slip]:
    """Gaps, each followed by its slip."""
    out: list[WeightedGap | Slip] = []
    for j, gap in enumerate(contact.gaps):
        out += [gap, *contact.slips[j : j + 1]]
    return out


class _Part:
    """Rows of a gap or of a slip.

    Args:
        contact: Its contact.
        side: Bodies of the contact.
        of: The gap or slip.
        numbers: Numbers of the bodies' unknowns.
    """

    def __init__(
        self,
        contact: ContactModel,
        side: Side,
        of: WeightedGap | Slip,
        numbers: typing.Sequence[Number],
    ) -> None:
        self.of = of
        gap = of.gap if isinstance(of, Slip) else of
        bodies = side if gap.slave is contact.slave else side[::-1]
        sided = _sides(of.operator, bodies, numbers)
        #: Number of components of each gap, of gaps, and of rows.
        self.width, self.num_gaps = of.operator.width, of.operator.num_rows
        self.num_rows = self.width * self.num_gaps
        #: Entries of L, and their squares.
        self.entries = joined(sided)
        self.squares = self.entries._replace(value=self.entries.value**2)
        #: Products of the entries of a slip with those of its gap; empty for a gap.
        self.mixed = joined([])
        if isinstance(of, Slip):
            normal = _sides(of.gap.operator, bodies, numbers)
            pairs = zip(sided, normal, strict=True)
            self.mixed = joined([J._replace(value=J.value * G.value) for J, G in pairs])


def _sides(
    operator: _cpp.GapOperator,
    bodies: typing.Sequence[int | None],
    numbers: typing.Sequence[Number],
) -> list[Entries]:
    """Entries of both sides; relative displacements have a row for each component."""
    out = []
    for k, body in enumerate(bodies[: operator.num_sides]):
        assert body is not None
        offset, column, value = operator.entries(k)
        unknowns = numbers[body](operator.columns(k)).astype(PETSc.IntType)[column]
        gap = np.arange(operator.num_rows * operator.width, dtype=PETSc.IntType)
        row = np.repeat(gap.reshape(-1, operator.width), np.diff(offset), axis=0)
        if operator.turns:  # each component has entries for all unknowns of a node
            row, width = np.repeat(row, operator.width, axis=1), operator.width
            unknowns = np.tile(unknowns, (1, width))
        shape = unknowns.shape
        row, value = (np.broadcast_to(a, shape).ravel() for a in (row, value))
        out.append(Entries(row, unknowns.ravel(), value))
    return out


def entries_of(
    operator: _cpp.GapOperator,
    bodies: typing.Sequence[int | None],
    numbers: typing.Sequence[Number],
    scales: typing.Sequence[float],
) -> list[Entries]:
    """Entries of both sides, times the scale of each body."""
    sides = _sides(operator, bodies, numbers)
    pairs = zip(sides, bodies, strict=False)
    return [e if scales[i] == 1 else e.scaled(scales[i]) for e, i in pairs if i is not None]


def _stacked(parts: typing.Sequence[Entries], starts: Indices) -> Entries:
    """All entries, with the rows of the parts stacked."""
    pairs = zip(parts, starts, strict=False)
    return joined([part.below(int(start)) for part, start in pairs])
