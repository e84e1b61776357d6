"""The derivative of R(z) as one matrix, or without the matrices of the bodies."""

from __future__ import annotations

import functools
import hashlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.following import Changes, Destination, Mixed
from qsdolfinx.gap.turning import Turning
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated
from qsdolfinx.system.driven import DrivenTools
from qsdolfinx.system.entries import Entries, global_entries, joined
from qsdolfinx.system.factors import Number, entries_of
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.friction_rows import OfTangential, Tangential
from qsdolfinx.system.gap_matrices import GapMatrices, Gaps
from qsdolfinx.system.layout import Layout
from qsdolfinx.system.normal_rows import NodalRows, Normal
from qsdolfinx.system.passes import Pass, State
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Stiffness of springs over the diagonal of the bodies' matrices that is corrected by a second
#: solve with the same factors. These springs make matrices regular where conditions leave bodies a
#: rigid motion.
REGULAR = 1e-11

#: Terms that are added entry by entry: derivatives of constraints whose forces follow from gaps, or
#: co-rotated gaps of ties, which keep the pattern of the matrix as long as they exist; and a
#: function that adds them.
Product = tuple[GapMatrices | Turning, typing.Callable[[_cpp.RowSums], None]]


def _each(of: Entries, factor: Array, own: Indices) -> list[Entries]:
    """Entries of rows with one component, times a vector for each row."""
    return [
        Entries(own[of.row, k], of.column, factor[of.row, k] * of.value)
        for k in range(own.shape[1])
    ]


class Derivative:
    """Derivative of R(z), see ``Equations``: K of the bodies, and terms of contact and tools.

    Args:
        system: The bodies and contacts.
        passes: Integration sides of the contacts.
        layout: Numbering of the unknowns.
        tools: The force-controlled tools.

    Attributes:
        free_bodies: Numbers of the bodies that conditions leave some rigid motion.
        softened: Diagonal terms that make the last inexact derivative regular.
    """

    def __init__(
        self,
        system: ContactSystem,
        passes: typing.Sequence[Pass],
        layout: Layout,
        tools: DrivenTools,
    ) -> None:
        self._system, self._passes, self._layout, self._tools = system, passes, layout, tools
        self.free_bodies = system.free_bodies
        self.softened: Array = np.zeros(layout.num_local)
        self._whole, self._contact = _Placed(system.comm, layout), _Added(system.comm, layout)
        self._of_gaps: dict[ConstraintRows, GapMatrices] = {}

    def of(
        self, at: State, exact: bool = True, shift: tuple[float, float] = (0.0, 0.0)
    ) -> PETSc.Mat:
        """Derivative of R at the last evaluation, an AIJ matrix owned by this object. Collective.

        Args:
            at: The last evaluation.
            exact: As for ``ConstraintRows.derivative``.
            shift: Relative increase of the diagonal of bodies that conditions leave a rigid motion,
                and of bodies without any condition.
        """
        self.softened = np.zeros(self._layout.num_local)
        with self._system.watch.stage("insertion"):
            contact = self._contact.assemble(*self._beside(at, exact))
        found = [*self._bulk(), *self._shift(shift), global_entries(contact)]
        if not exact:
            for i, p in enumerate(self._passes):
                first = int(self._layout.ends[len(self._system.bodies) + i])
                soft = p.rows.softened(at.passes[i])
                self.softened[first : first + len(soft)] = soft
        return self._whole.assemble(found)

    def beside_bodies(self, at: State) -> PETSc.Mat:
        """The inexact derivative without the matrices of the bodies. Collective.

        Args:
            at: The last evaluation.

        Returns:
            An AIJ matrix on all unknowns, owned by this object.
        """
        with self._system.watch.stage("insertion"):
            return self._contact.assemble(*self._beside(at, False))

    def _beside(self, at: State, exact: bool) -> tuple[list[Entries], list[Product]]:
        """Entries of this matrix, and products for condensed constraints. Collective."""
        found = [*self._of_couplings(), *self._of_conductances()]
        products: list[Product] = []
        if self._tools.are_turning:
            turned = self._tools.turned(at)
            own = np.arange(self._layout.ends[-2], self._layout.ends[-1]) + self._layout.start
            found.append(Entries(own, own, turned[: len(own)]))
        for i, (p, e) in enumerate(zip(self._passes, at.passes, strict=True)):
            first, rows = self._layout.first_of_pass(i), p.rows
            own = first + np.arange(rows.num_multipliers)
            if rows.condensed is not None:
                of_friction = None if rows.condensed_friction is None else e.tangential
                matrices = self._matrices(p, rows.condensed, own, e.normal, of_friction)
                products.append((matrices, functools.partial(self._add_products, p, e, matrices)))
                found += [*matrices.mixed, *self._softened(rows, first, e, exact)]
            else:
                assert rows.nodal is not None
                found += self._of_nodes(p, rows.nodal, e, exact, own)
            if p.gap.turning is not None and not p.gap.is_linear:
                products.append((p.gap.turning, functools.partial(self._add_turning, p, e)))
            if rows.nodal_friction is not None and e.tangential is not None:
                by = rows.nodal_friction.derivative(e.tangential, exact)
                found += self._of_slip(p, e, by, own, first + len(own))
        return found, products

    def _add_products(
        self, p: Pass, at: Evaluated, matrices: GapMatrices, sums: _cpp.RowSums
    ) -> None:
        """Add the terms of constraints whose forces follow from gaps. Collective."""
        of_friction = None if p.rows.condensed_friction is None else at.tangential
        if p.gap.has_segments:
            matrices.add_at_segments(self._to(p, sums), at.normal, of_friction)
            return
        matrices.add_to(sums, at.normal, of_friction)
        if p.gap.following is not None:
            self._add_curvature(p, at, self._to(p, sums))

    def _add_turning(self, p: Pass, at: Evaluated, sums: _cpp.RowSums) -> None:
        """Add the change of the forces of a tie across a gap with the facets. Collective."""
        p.gap.add_turning(at.pressure, self._to(p, sums))

    def _softened(
        self, rows: ConstraintRows, first: int, at: Evaluated, exact: bool
    ) -> list[Entries]:
        """Diagonal terms that make the inexact derivative regular at points; zeros if exact."""
        assert rows.condensed is not None
        soft = rows.condensed.softened(at.normal)
        if rows.condensed_friction is not None:
            soft = np.concatenate([soft, rows.condensed_friction.softened()])
        every = first + np.arange(len(soft))
        return [Entries(every, every, 0.0 * soft if exact else soft)]

    def _of_matrix(self, mat: PETSc.Mat, i: int, j: int) -> Entries:
        """Entries of the block of bodies i and j."""
        aij = (
            mat
            if "aij" in mat.getType() and "b" not in mat.getType()
            else mat.convert("aij", PETSc.Mat())
        )
        starts, columns, values = aij.getValuesCSR()
        first = self._layout.first_of_body(i)
        rows = first + np.repeat(np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts))
        out = (
            self._layout.numbers(i, rows),
            self._layout.numbers(j, columns.astype(np.int64)),
            values.copy(),
        )
        if aij is not mat:
            aij.destroy()
        return Entries(*out)

    def _bulk(self) -> list[Entries]:
        bodies = enumerate(self._system.bodies)
        diagonal = np.arange(
            self._layout.start, self._layout.start + self._layout.num_local, dtype=np.int64
        )
        # Every row has an entry on the diagonal, as direct solvers need.
        all_ = Entries(diagonal, diagonal, np.zeros(self._layout.num_local))
        return [all_, *(self._of_matrix(body.matrix(), i, i) for i, body in bodies)]

    def springs(self, parts: tuple[float, float]) -> Array:
        """Springs of unsupported bodies, not stiffer than the softest body. Collective.

        Args:
            parts: Parts of the diagonal, for bodies that conditions leave a rigid motion, and for
                bodies without any condition.
        """
        bodies, out = (
            self._system.bodies,
            np.zeros(int(self._layout.ends[len(self._system.bodies)])),
        )
        if not (any(parts) and self.free_bodies):
            return out
        sums = np.array([
            [np.sum(b.diagonal[b.free]), np.sum(b.diagonal[b.free] > 0), len(b.owned_constrained)]
            for b in bodies
        ])  # fmt: skip
        self._system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        softest = np.min(sums[:, 0] / np.maximum(sums[:, 1], 1.0))
        for i in self.free_bodies:
            part = parts[int(sums[i, 2] == 0)]
            self._layout.part(out, i)[:] = part * np.minimum(bodies[i].diagonal, softest)
        return out

    def _shift(self, parts: tuple[float, float]) -> list[Entries]:
        """Entries of the springs of unsupported bodies on the diagonal. Collective."""
        values = self.springs(parts)
        rows = self._layout.start + np.arange(len(values), dtype=np.int64)
        self.softened[: len(values)] = np.minimum(values, self.springs((REGULAR, REGULAR)))
        keep = values != 0
        return [Entries(rows[keep], rows[keep], values[keep])]

    def _of_couplings(self) -> list[Entries]:
        """Entries of variable conductances. Collective."""
        bodies, blocks = self._system.bodies, dict[tuple[int, int], PETSc.Mat]()
        for contact, sides in zip(self._system.contacts, self._system.sides, strict=True):
            if contact.coupling is None:
                continue
            of = [(i, j) for i in sides for j in sides]
            for i, j in of:
                if i is not None and j is not None and (i, j) not in blocks:
                    blocks[i, j] = _any_entries(
                        bodies[i].num_owned, bodies[j].num_owned, self._system.comm
                    )
            ss, sm, ms, mm = (blocks.get(at) for at in of)  # type: ignore[arg-type]
            contact.coupling.add_to((ss, sm, ms, mm), False)
        found = []
        for (i, j), mat in blocks.items():
            mat.assemble()
            found.append(self._of_matrix(mat, i, j))
            mat.destroy()
        return found

    def _to(self, p: Pass, sums: _cpp.RowSums) -> Destination:
        """Destination of derivatives of forces."""
        bodies = [i for i in p.bodies if i is not None]
        numbers = [functools.partial(self._layout.numbers, i) for i in bodies]
        to = Destination(sums, numbers, p.gap.state.scale)
        if p.tool is None or not p.gap.has_segments:
            return to
        return to._replace(tool=self._layout.of_tool(p.tool), way=self._tools.way(p))

    def _add_curvature(self, p: Pass, at: Evaluated, to: Destination) -> None:
        """Add Σ λ ∂²G, and changes of forces at constant τ, for updated geometry. Collective.

        Args:
            p: The integration side.
            at: Its last evaluation.
            to: Destination.
        """
        assert isinstance(p.rows.condensed, PointConstraints)
        p.rows.condensed.add_curvature(at.normal, to)
        if p.slip is not None and at.tangential is not None:
            p.gap.add_slip_curvature(at.tangential.traction, p.rows.condensed.moves, to)

    def _entries(self, operator: typing.Any, p: Pass, first: int, scaled: bool) -> Entries:
        """Entries of G or J with rows starting at a number, by displacements or by the unknowns."""
        return joined(self._of_sides(operator, p, scaled)).below(first)

    def _of_sides(self, operator: typing.Any, p: Pass, scaled: bool) -> list[Entries]:
        """Entries of each body; rows are numbered on this rank."""
        numbers: list[Number] = [
            functools.partial(self._layout.numbers, i) for i in range(self._layout.num_bodies)
        ]
        scale = self._system.scales if scaled else [1.0] * self._layout.num_bodies
        return entries_of(operator, p.bodies, numbers, scale)

    def _of_nodes(
        self, p: Pass, rows: NodalRows, at: Evaluated, exact: bool, own: Indices
    ) -> list[Entries]:
        """Entries of nodal multipliers λ. Collective."""
        by_gap, by_own = rows.derivative(at.normal, exact)
        first = self._first_of(p)
        left, right = (self._entries(p.gap.operator, p, first, scaled) for scaled in (False, True))
        weight = np.repeat(p.gap.weight, p.rows.width)
        found = [
            Entries(left.column, left.row, left.value * weight[left.row - first]),
            right._replace(value=right.value * by_gap.ravel()[right.row - first]),
            Entries(own, own, by_own.ravel()),
        ]
        if p.gap.extension is not None:
            shape = p.rows.num_rows, p.rows.width
            found.append(Entries(*rows.entries_of_means(at.normal, own.reshape(shape))))
        if p.tool is not None:
            found += self._with_tool(p, own, weight, by_gap, self._tools.changes(p)[0])
        return found

    def _of_conductances(self) -> list[Entries]:
        """Entries of conductances by λ, if λ is an unknown together with the field. Collective."""
        found, contacts = [], zip(self._system.contacts, self._system.sides, strict=True)
        for contact, sides in contacts:
            of = None if contact.coupling is None else contact.coupling.of_bodies
            if of is None or contact.coupling is None:
                continue
            p = next(p for p in self._passes if p.model is of)
            for i, product in zip(sides, contact.coupling.by_multipliers(), strict=False):
                assert i is not None
                found.append(self._by_multipliers(p, i, product))
                product.destroy()
        return found

    def _by_multipliers(self, p: Pass, i: int, mat: PETSc.Mat) -> Entries:
        """Entries of a matrix of body i's unknowns by multipliers of constraints. Collective."""
        first = mat.getOwnershipRange()[0]
        own = self._first_of(p) + np.arange(p.rows.num_multipliers)
        if p.rows.condensed is not None:
            mat = mat.matMult(self._matrices(p, p.rows.condensed, own).functions())
        starts, columns, values = mat.getValuesCSR()
        row = first + np.repeat(np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts))
        numbers = columns.astype(np.int64)
        if p.rows.condensed is None:
            ends = np.append(0, np.cumsum(self._system.comm.allgather(p.rows.num_rows)))
            part = self._layout.num_bodies + self._passes.index(p)
            rank = np.searchsorted(ends, numbers, side="right") - 1
            numbers = self._layout.first[rank, part] + numbers - ends[rank]
        else:
            mat.destroy()
        return Entries(self._layout.numbers(i, row), numbers, values.copy())

    def _matrices(
        self,
        p: Pass,
        rows: CondensedRows,
        own: Indices,
        at: Normal | None = None,
        tangential: Tangential | None = None,
    ) -> GapMatrices:
        """Derivatives of gaps; constant while gaps are linear and contact pairs are not updated.

        Collective.

        Args:
            p: The integration side.
            rows: Its constraints.
            own: Numbers of the unknowns λ.
            at: The constraints at the last evaluation; None to use existing derivatives.
            tangential: Friction at these points; None without.
        """
        turns = p.tool is not None and self._tools.are_turning
        is_new = at is not None and (turns or not p.gap.is_linear)
        if is_new and p.rows in self._of_gaps:
            self._of_gaps.pop(p.rows).destroy()
        if p.rows not in self._of_gaps:
            friction = p.rows.condensed_friction
            last = int(own[-1]) + 1 if len(own) else self._first_of(p)
            of_slip = last + np.arange(0 if friction is None else friction.shape[0])
            made = GapMatrices(
                rows,
                friction,
                None if p.gap.has_segments else self._gaps_of(p),
                None if friction is None else self._slips_of(p, rows, friction, tangential),
                (own, of_slip),
                self._layout.num_local,
                self._mixed(p, rows, at, tangential),
            )
            self._of_gaps[p.rows] = made
        return self._of_gaps[p.rows]

    def _gaps_of(self, p: Pass) -> Gaps:
        """Gap operator for the work of pressures, and for the change of gaps. Collective."""
        change = None if p.tool is None else self._tools.changes(p)[0]
        return self._gaps(p, p.gap.operator, change)

    def _slips_of(
        self,
        p: Pass,
        rows: CondensedRows,
        friction: PointFriction,
        tangential: Tangential | None,
    ) -> tuple[Gaps, Gaps] | None:
        """Slip operators for the work of tractions, and for the change of slips. Collective."""
        slip, by_tool = p.slip, None if p.tool is None else self._tools.changes(p)[1]
        if slip is None or p.gap.has_segments:
            return None
        operator, beside = Changes(slip.operator)
        if not rows.far and p.gap.following is not None and tangential is not None:
            operator, beside = friction.moving_slip(tangential)
        change = self._gaps(p, operator, by_tool)._replace(beside=self._beside_facets(p, beside))
        if slip.works is operator and beside is None:
            return change, change
        return self._gaps(p, slip.works, by_tool), change

    def _beside_facets(
        self, p: Pass, found: tuple[int, PETSc.Mat] | None
    ) -> _cpp.CompressedRows | None:
        """Convert ``Changes.beside`` to the numbering of all unknowns. Collective."""
        if found is None:
            return None
        body = p.bodies[found[0]]
        assert body is not None
        starts, columns, values = found[1].getValuesCSR()
        found[1].destroy()
        numbers = self._layout.numbers(body, columns.astype(np.int64))
        values = np.ascontiguousarray(self._system.scales[body] * values)
        return _cpp.CompressedRows(starts.astype(np.int64), numbers, values)

    def _mixed(
        self, p: Pass, rows: CondensedRows, at: Normal | None, tangential: Tangential | None
    ) -> list[tuple[int, Entries]]:
        """Changes of R_λ and R_τ with the facets, for each component. Collective."""
        if at is None or not isinstance(rows, PointConstraints) or p.gap.has_segments:
            return []
        found, friction = rows.mixed(at), p.rows.condensed_friction
        out = [] if found is None else [(0, self._of_mixed(p, found))]
        if friction is not None and tangential is not None:
            of_slips = friction.mixed(tangential) or []
            out += [(1 + k, self._of_mixed(p, of)) for k, of in enumerate(of_slips)]
        return out

    def _of_mixed(self, p: Pass, found: Mixed) -> Entries:
        """Entries on all unknowns; rows stay unknowns of the slave. Collective."""
        mixed = []
        for (side, unknown, value), body in zip(found, p.bodies, strict=False):
            assert body is not None
            scaled = self._system.scales[body] * value
            mixed.append(Entries(side, self._layout.numbers(body, unknown), scaled))
        return joined(mixed)

    def _first_of(self, p: Pass) -> int:
        """Number in z of the first unknown of an integration side on this rank."""
        return self._layout.first_of_pass(self._passes.index(p))

    def _gaps(self, p: Pass, operator: _cpp.GapOperator, change: Array | None) -> Gaps:
        """Gaps of an operator at the constraints, and their change by a force-controlled tool."""
        bodies = [i for i in p.bodies[: operator.num_sides] if i is not None]
        numbers = [self._layout.numbers(i, operator.columns(k)) for k, i in enumerate(bodies)]
        of_tool = None
        if p.tool is not None and change is not None:
            tool = np.full(change.size, self._layout.of_tool(p.tool))
            every = np.arange(change.size + 1, dtype=np.int64)
            of_tool = _cpp.CompressedRows(every, tool, np.ascontiguousarray(change, np.float64))
        scales = tuple(self._system.scales[i] for i in bodies)
        return Gaps(operator, tuple(numbers), scales, of_tool)

    def _with_tool(
        self, p: Pass, own: Indices, weight: Array, by_gap: Array, change: Array
    ) -> list[Entries]:
        """Entries that couple a force-controlled tool with multipliers."""
        assert p.tool is not None
        tool = np.full(len(own), self._layout.of_tool(p.tool))
        return [
            Entries(tool, own, weight * change.ravel()),
            Entries(own, tool, (by_gap * change).ravel()),
        ]

    def _of_slip(
        self, p: Pass, at: Evaluated, by: OfTangential, normal: Indices, first: int
    ) -> list[Entries]:
        """Entries of τ. Collective.

        Args:
            p: The integration side.
            at: Its constraints.
            by: Derivatives of R_τ.
            normal: Numbers of the unknowns λ.
            first: Number of the first unknown τ.
        """
        assert p.slip is not None
        num, gdim = p.slip.operator.num_rows, p.gap.slave.gdim
        own = first + np.arange(num * gdim).reshape(num, gdim)
        row = np.repeat(own[:, :, None], gdim, axis=2)
        column = np.repeat(own[:, None, :], gdim, axis=1)
        J = self._entries(p.slip.operator, p, 0, True)
        by_slip = by.by_slip @ p.slip.projector
        rows = J.row // gdim, J.row % gdim
        found = [Entries(row.ravel(), column.ravel(), by.by_own.ravel())]
        for k in range(gdim):  # D J, one component of the rows after the other
            found.append(Entries(own[rows[0], k], J.column, by_slip[rows[0], k, rows[1]] * J.value))
        found += self._of_pressure(p, at, by, normal, own)
        for k, works in enumerate(self._works_on(p)):
            factor = p.slip.projector[:, k, :] * p.slip.weight[:, None]
            for j in range(gdim):
                found.append(
                    Entries(works.column, own[works.row, j], works.value * factor[works.row, j])
                )
        if p.tool is not None:
            change = self._tools.changes(p)[1]
            assert change is not None
            weight, ones = np.repeat(p.slip.weight, gdim), np.ones((num, gdim))
            pushed = np.einsum("rij,rj->ri", by_slip, change)
            found += self._with_tool(p, own.ravel(), weight, ones, change)[:1]
            found += self._with_tool(p, own.ravel(), weight, ones, pushed)[1:]
        return found

    def _of_pressure(
        self, p: Pass, at: Evaluated, by: OfTangential, normal: Indices, own: Indices
    ) -> list[Entries]:
        """Entries of τ by the arguments of its limit: pressures, and y_n. Collective."""
        assert p.slip is not None
        if p.rows.condensed is not None:
            matrices, found = self._matrices(p, p.rows.condensed, normal), []
            if not p.slip.friction.symmetric:
                found += _each(matrices.pressures(at.normal), by.by_pressure, own)
            if by.by_trial is not None:
                found += _each(matrices.trials(), by.by_trial, own)
            return found
        assert p.rows.nodal is not None
        of_gap, of_multiplier = p.rows.nodal.by_trial()
        by_multiplier, gdim = by.by_pressure, own.shape[1]
        found = []
        if by.by_trial is not None:
            by_multiplier = by_multiplier + of_multiplier[:, None] * by.by_trial
            by_gap = of_gap[:, None] * by.by_trial
            found += _each(self._entries(p.gap.operator, p, 0, True), by_gap, own)
            if p.tool is not None:
                pushed = by_gap * self._tools.changes(p)[0]
                none = np.zeros(own.size)
                found += self._with_tool(p, own.ravel(), none, np.ones(own.shape), pushed)[1:]
        pressure = np.repeat(normal[:, None], gdim, axis=1)
        return [*found, Entries(own.ravel(), pressure.ravel(), by_multiplier.ravel())]

    def _works_on(self, p: Pass) -> list[Entries]:
        """Operator of the work of each tangential force component, over the weight. Collective."""
        assert p.slip is not None
        gdim = p.gap.slave.gdim
        J = self._entries(p.slip.operator, p, 0, False)
        out = []
        for k in range(gdim):
            of = J.row % gdim == k
            out.append(Entries(J.row[of] // gdim, J.column[of], J.value[of]))
        return out

    def forget_gaps(self) -> None:
        """Delete the derivatives of gaps. Collective."""
        for matrices in self._of_gaps.values():
            matrices.destroy()
        self._of_gaps = {}

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        for assembled in (self._whole, self._contact):
            assembled.destroy()
        self.forget_gaps()


class _Added:
    """Matrix of entries and products, whose pattern is kept while their positions are the same."""

    def __init__(self, comm: MPI.Comm, layout: Layout) -> None:
        self._comm, self._size = comm, layout.num_local
        self._matrix: PETSc.Mat | None = None
        self._places, self._made = b"", typing.cast(list[GapMatrices | Turning], [])

    def assemble(
        self, found: typing.Sequence[Entries], products: typing.Sequence[Product]
    ) -> PETSc.Mat:
        """Assemble these terms; some may be in rows of other ranks. Collective."""
        row, column, value = joined(found)
        places = _digest(row, column)
        made = [of for of, _ in products]
        same = [id(of) for of in made] == [id(of) for of in self._made]
        if self._matrix is not None and self._comm.allreduce(
            same and places == self._places, op=MPI.LAND
        ):
            self._matrix.zeroEntries()
        else:
            self.destroy()
            self._matrix = _any_entries(self._size, self._size, self._comm)
            self._places, self._made = places, made
        sums = _cpp.RowSums(self._matrix.handle)
        sums.add_entries(row, column, value)
        for _, add in products:
            add(sums)
        sums.insert()
        return self._matrix

    def destroy(self) -> None:
        """Free the matrix. Collective."""
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix, self._places, self._made = None, b"", []


class _Placed:
    """Matrix of entries on all unknowns, whose pattern is kept while positions are the same."""

    def __init__(self, comm: MPI.Comm, layout: Layout) -> None:
        self._comm, self._size = comm, (layout.num_local, layout.size)
        self._matrix: PETSc.Mat | None = None
        self._places = b""

    def assemble(self, found: typing.Sequence[Entries]) -> PETSc.Mat:
        """Assemble these entries; some may be in rows of other ranks. Collective."""
        row, column, value = joined(found)
        keep = (row >= 0) & (column >= 0)
        row, column, value = row[keep], column[keep], value[keep]
        places = _digest(row, column)
        if not self._comm.allreduce(places == self._places, op=MPI.LAND):
            self._allocate(row, column)
            self._places = places
        assert self._matrix is not None
        _cpp.set_values(self._matrix.handle, value)
        return self._matrix

    def _allocate(self, row: Indices, column: Indices) -> None:
        self.destroy()
        self._matrix = PETSc.Mat().create(comm=self._comm)
        self._matrix.setSizes((self._size, self._size))
        self._matrix.setType(PETSc.Mat.Type.AIJ)
        _cpp.set_places(self._matrix.handle, row, column)

    def destroy(self) -> None:
        """Free the matrix. Collective."""
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix, self._places = None, b""


def _digest(row: Indices, column: Indices) -> bytes:
    out = hashlib.blake2b(np.ascontiguousarray(row))
    out.update(np.ascontiguousarray(column))
    return out.digest()


def _any_entries(rows: int, columns: int, comm: MPI.Comm) -> PETSc.Mat:
    """Empty matrix that takes any entries, until it is assembled."""
    mat = PETSc.Mat().create(comm=comm)
    mat.setSizes(((rows, PETSc.DETERMINE), (columns, PETSc.DETERMINE)))
    mat.setType(PETSc.Mat.Type.AIJ)
    mat.setUp()
    return mat
