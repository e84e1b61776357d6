"""Bodies, multipliers and driven tools as one system of equations, R(z) = 0."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import checked
from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact import motion
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.following import MovingFunctions
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec
from qsdolfinx.system.blocks import Blocks
from qsdolfinx.system.condensed_rows import CondensedRows, PointConstraints
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated, Multipliers
from qsdolfinx.system.entries import Entries, joined
from qsdolfinx.system.factors import Number, entries_of
from qsdolfinx.system.friction_rows import OfTangential
from qsdolfinx.system.gap_matrices import GapMatrices, Moving, Sided
from qsdolfinx.system.normal_rows import NodalRows, Normal
from qsdolfinx.system.system import ContactSystem
from qsdolfinx.tools.rigid_surface import RigidSurface, as_tool

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Residual over contact forces from which on unknowns are no solution.
UNBALANCED = 1e-3


#: Springs over the diagonal of the bodies' matrices that a second solve with the same factors takes
#: back: they make matrices regular where conditions leave bodies a rigid motion.
REGULAR = 1e-11


class Pass(typing.NamedTuple):
    """One pass of a contact and its constraints.

    Attributes:
        model: The contact.
        bodies: Of the side with multipliers and of the other one; None of a rigid tool.
        rows: Its constraints.
        tool: Number of the driven tool that it presses on; None if there is none.
    """

    model: ContactModel
    bodies: tuple[int | None, int | None]
    rows: ConstraintRows
    tool: int | None

    @property
    def gap(self) -> WeightedGap:
        """The pass itself."""
        return self.rows.gap

    @property
    def slip(self) -> Slip | None:
        """Its slip; None without friction."""
        return self.rows.slip


class State(typing.NamedTuple):
    """What the last evaluation has found.

    Attributes:
        z: Unknowns of this rank.
        bulk: Residual of the bulk forms with conditions, owned unknowns.
        contact: Forces of contact on the owned unknowns, with reactions of conditions.
        passes: Constraints of each pass.
        constraints: R_λ and R_τ of all passes: where gaps follow the bodies, the points of another
            evaluation are others.
        tools: Σ (∂ḡ/∂s · S λ + ∂g/∂s · S τ) − force of each driven tool (force).
    """

    z: Array
    bulk: Array
    contact: Array
    passes: list[Evaluated]
    constraints: Array
    tools: Array


def _each(of: Entries, factor: Array, own: Indices) -> list[Entries]:
    """Entries of rows of one component, times a vector at each row."""
    return [
        Entries(own[of.row, k], of.column, factor[of.row, k] * of.value)
        for k in range(own.shape[1])
    ]


class Equations:
    """R(z) = 0 for z = (u_i, λ, τ, s), and its derivative.

        R_u = F(u) + Gᵀ W λ + Lᵀ W τ,   R_λ, R_τ: see ``ConstraintRows``,
        R_s = Σ W λ ∂ḡ/∂s + Σ W τ ∂g/∂s − force

    u_i are the bodies' unknowns, λ and τ the multipliers of all passes, and s the displacements of
    rigid tools that forces drive. W λ are forces at nodes, G and J the derivatives of gaps and
    slips; L is what τ works on, J but in finite sliding. R depends on z and on the state at the
    start of the step alone. A rank has the rows of its owned unknowns, then those of its
    multipliers, then, the first one, those of tools.

    While u misses values of conditions, R_u of a body whose form is not linear also has
    K(u) (g − u), g being these values; the derivative takes K there as given. It is exact where
    conditions are met, as they are after one full step. R counts slip from the start of the step;
    ``problem.solve()`` counts that of rows that close in the step from where they do, see
    ``solve/onset.py``.

    The system must have been set up: penalties are known, and tools where they start.

    Args:
        system: The bodies and contacts; no scalar fields, rows of contact at nodes.

    Attributes:
        system: As given.
        tools: Rigid tools that forces drive, in the order of s.
        passes: Passes of the contacts, in the order of their multipliers.
        num_local: Unknowns of this rank.
        start: Number of the first of them.
        size: Unknowns of all ranks.
        one_step: Within which :meth:`accept` ends a step of friction's history: the problem's.
        free_bodies: Numbers of the bodies that conditions leave some rigid motion.
        softened: What the last inexact derivative has on its diagonal to be regular.
    """

    def __init__(self, system: ContactSystem) -> None:
        self.system = system
        self.tools: list[RigidSurface] = []
        self.passes: list[Pass] = []
        for contact, side in zip(system.contacts, system.sides, strict=True):
            tool = self._number_of(contact)
            for j, gap in enumerate(contact.gaps):
                slip = contact.slips[j] if contact.slips else None
                bodies = side if gap.slave is contact.slave else side[::-1]
                rows = ConstraintRows(contact, gap, slip)
                self.passes.append(Pass(contact, bodies, rows, tool))
        self._starts = [(tool.displacement.copy(), tool.rotation.copy()) for tool in self.tools]
        self.one_step: typing.Callable[[], contextlib.AbstractContextManager[None]] = (
            contextlib.nullcontext
        )
        self._count()
        self.free_bodies = system.free_bodies
        self.softened: Array = np.zeros(self.num_local)
        self._blocks: Blocks | None = None
        self._whole, self._contact = (_Assembled(self) for _ in range(2))
        self._at: State | None = None
        self._of_gaps: dict[ConstraintRows, GapMatrices] = {}

    def _number_of(self, contact: ContactModel) -> int | None:
        """Number of the driven tool of a contact, added if it is new."""
        tool = as_tool(contact.master)
        if tool is None or tool.driven is None:
            return None
        if tool.driven.turns and contact.slave.axisymmetric:
            raise ValueError("drive_moment: a tool of an axisymmetric scene stands for a ring")
        if tool.driven.turns and contact.follows:
            raise ValueError(
                'drive_moment: sliding="finite" knows forces on tools alone; use sliding="small" '
                "with time steps, or prescribe the rotation"
            )
        for i, known in enumerate(self.tools):
            if known is tool:
                return i
        self.tools.append(tool)
        return len(self.tools) - 1

    def _count(self) -> None:
        """Where this rank's unknowns of bodies, passes and tools are, and their numbers."""
        comm = self.system.comm
        sizes = [body.num_owned for body in self.system.bodies]
        sizes += [p.rows.num_unknowns for p in self.passes]
        sizes.append(len(self.tools) if comm.rank == 0 else 0)
        self._ends = np.cumsum([0, *sizes])
        every = np.array(comm.allgather(self._ends), dtype=np.int64).reshape(comm.size, -1)
        first = np.append(0, np.cumsum(every[:, -1]))
        #: First number of each part on every rank.
        self._first = first[:-1, None] + every
        self._ranges = [
            np.append(0, np.cumsum(np.diff(every, axis=1)[:, i]))
            for i in range(len(self.system.bodies))
        ]
        self.num_local, self.start = int(self._ends[-1]), int(first[comm.rank])
        self.size = int(first[-1])

    @property
    def is_current(self) -> bool:
        """Whether contacts have not paired since."""
        gaps = self.system.gaps
        return len(gaps) == len(self.passes) and all(
            p.gap is gap for p, gap in zip(self.passes, gaps, strict=True)
        )

    # --- Unknowns

    def part(self, z: Array, i: int) -> Array:
        """Body i's part of this rank's unknowns."""
        return z[self._ends[i] : self._ends[i + 1]]

    def bodies_of(self, z: Array) -> Array:
        """That of all bodies."""
        return z[: self._ends[len(self.system.bodies)]]

    def multipliers(self, z: Array) -> list[Multipliers]:
        """λ and τ of each pass."""
        first = len(self.system.bodies)
        return [
            p.rows.split(z[self._ends[first + i] : self._ends[first + i + 1]])
            for i, p in enumerate(self.passes)
        ]

    def displacements(self, z: Array) -> Array:
        """Displacement (length) of each driven tool since the start, on all ranks. Collective."""
        out = np.zeros(len(self.tools))
        if self.system.comm.rank == 0:
            out[:] = z[self._ends[-2] :]
        if self.tools:
            self.system.comm.Bcast(out, root=0)
        return out

    def join(
        self, x: Array, multipliers: typing.Sequence[Multipliers], displacements: Array
    ) -> Array:
        """This rank's unknowns z."""
        parts = [x]
        for values in multipliers:
            parts.append(values.normal.ravel())
            if values.tangential is not None:
                parts.append(values.tangential.ravel())
        if self.system.comm.rank == 0:
            parts.append(displacements)
        return np.concatenate(parts)

    def first(self) -> Array:
        """Unknowns where bodies and tools are, with what is known of multipliers. Collective.

        λ of an augmented Lagrangian's last solve, and ε [ḡ]₊ of nodes that had none.
        """
        x = self.unknowns_of([body.u.x.array for body in self.system.bodies])
        self.system.residual(x)
        return self.join(x, [p.rows.first() for p in self.passes], np.zeros(len(self.tools)))

    def unknowns_of(self, arrays: typing.Sequence[Array]) -> Array:
        """Owned unknowns of all bodies, with conditions in place if they are linear.

        Args:
            arrays: Of each body, ghosts included.
        """
        parts = []
        for body, array in zip(self.system.bodies, arrays, strict=True):
            values = array[: body.num_owned]
            parts.append(body.with_conditions(values) if body.linear else values)
        return np.concatenate(parts)

    def accept(self, z: Array) -> None:
        """Let bodies, contacts and tools be at a solution: a step's end, see ``one_step``.

        Collective.

        Args:
            z: Unknowns of this rank, R(z) = 0.

        Raises:
            ValueError, RuntimeError: As :meth:`residual`.

        Warns:
            ContactWarning: If forces are not balanced there.
        """
        z = self._checked(z)
        self._at = None
        at = self.evaluate(z)
        sums = np.array([float(np.sum(f**2)) for f in (self.forces_of(at), at.contact)])
        self.system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        residual, forces = np.sqrt(sums)
        if residual > UNBALANCED * forces > 0:
            warn(
                f"z: no solution: |R_u| is {residual / forces:.2g} of the contact forces; iterate "
                "further before equations.accept(z)",
                ContactWarning,
            )
        with self.one_step():
            self.end_at(z)

    def end_at(self, z: Array) -> None:
        """Let bodies, contacts and tools be at z, which is known to be a solution. Collective."""
        for p, e in zip(self.passes, self.evaluate(z).passes, strict=True):
            p.rows.keep(e)
        self.system.x.array[:] = self.bodies_of(z)
        self.system.residual(self.system.x.array_r)
        self._at = None

    # --- Residual

    def residual(self, z: Array) -> Array:
        """R at this rank's unknowns z, with loads and conditions as they are now. Collective.

        Raises:
            ValueError: If z is not of this rank's unknowns, or not finite.
            RuntimeError: If contact has paired since: ``problem.equations()`` gives new ones.
        """
        z = self._checked(z)
        self._at = None
        for body in self.system.bodies:
            body.begin_solve()
        return self.residual_of(self.evaluate(z))

    def _checked(self, z: typing.Any) -> Array:
        """Unknowns of the caller's. Collective."""
        with checked(self.system.comm):
            if not self.is_current:
                raise RuntimeError(
                    "contacts have paired since these equations were made: ask for new ones, by "
                    "problem.equations()"
                )
            values = np.asarray(z)
            shape = (self.num_local,)
            require(values.shape == shape, f"z: must be of shape {shape}, this rank's unknowns")
            require(np.isrealobj(values), "z: must be real")
            require(bool(np.isfinite(values).all()), "z: must be finite")
        return np.array(values, dtype=np.float64)

    def residual_of(self, at: State) -> Array:
        """R where it was evaluated."""
        parts = [self.forces_of(at), at.constraints]
        if self.system.comm.rank == 0:
            parts.append(at.tools)
        return np.concatenate(parts)

    def in_forces(self, residual: Array, back: bool = False) -> Array:
        """R with the rows of λ and τ as forces, c R: continuous where sets change.

        Its norm is what a line search should make fall.

        Args:
            residual: R, as :meth:`residual` returns it.
            back: Whether R is wanted, from what this has made of it.
        """
        out, first = residual.copy(), len(self.system.bodies)
        for i, p in enumerate(self.passes):
            scale = p.rows.in_forces
            out[self._ends[first + i] : self._ends[first + i + 1]] *= 1 / scale if back else scale
        return out

    def forces_of(self, at: State) -> Array:
        """R_u where it was evaluated."""
        out = at.bulk.copy()
        for i, body in enumerate(self.system.bodies):
            part, forces = self.part(out, i), self.part(at.contact, i)
            part[body.free] += forces[body.free]
        return out

    def evaluate(
        self,
        z: Array,
        first: bool = False,
        opened: typing.Sequence[Flags] | None = None,
        again: bool = False,
    ) -> State:
        """Everything that residual and tangent need at z. Collective.

        Args:
            z: Unknowns of this rank.
            first: As for ``ConstraintRows.evaluate``.
            opened: Rows of each pass that count as open; none by default.
            again: As for ``ConstraintRows.evaluate``.
        """
        first = first or opened is not None
        if not first and self._is_at(z):
            assert self._at is not None
            return self._at
        system, multipliers = self.system, self.multipliers(z)
        self._move_tools(self.displacements(z))
        self._tell_conductances(multipliers)
        bulk = [body.residual(self.part(z, i)) for i, body in enumerate(system.bodies)]
        system.evaluate_contacts()
        both = list(zip(self.passes, multipliers, strict=True))
        passes = [
            p.rows.evaluate(values, first, None if opened is None else opened[i], again)
            for i, (p, values) in enumerate(both)
        ]
        for body in system.bodies:
            body.force.zeroEntries()
        for p, e in zip(self.passes, passes, strict=True):
            self._add_forces(p, e)
        for contact, (first_body, second) in zip(system.contacts, system.sides, strict=True):
            if contact.friction_heat is not None:
                bodies, other = system.bodies, None
                if second is not None:
                    other = bodies[second].force
                contact.friction_heat.add_to((bodies[first_body].force, other))
        forces = np.concatenate([body.force.array_r for body in system.bodies])
        tools = self._on_tools(passes)
        pairs = zip(self.passes, passes, strict=True)
        constraints = np.concatenate([np.zeros(0), *(p.rows.residual(e) for p, e in pairs)])
        at = State(z.copy(), np.concatenate(bulk), forces, passes, constraints, tools)
        self._at = None if first else at
        return at

    def _tell_conductances(self, multipliers: typing.Sequence[Multipliers]) -> None:
        """Let conductances that follow pressures know those of λ. Collective."""
        followed = [c.coupling.of_bodies for c in self.system.contacts if c.coupling is not None]
        for p, values in zip(self.passes, multipliers, strict=True):
            if any(p.model is of for of in followed):
                p.gap.state.augmented = p.rows.normal.known(values.normal)

    def _is_at(self, z: Array) -> bool:
        """Whether the last evaluation was at z. Collective."""
        same = self._at is not None and np.array_equal(self._at.z, z)
        return self.system.comm.allreduce(same, op=MPI.LAND)

    def _forces_of(self, p: Pass) -> tuple[PETSc.Vec, PETSc.Vec | None]:
        slave, master = p.bodies
        assert slave is not None
        bodies = self.system.bodies
        return bodies[slave].force, None if master is None else bodies[master].force

    def _add_forces(self, p: Pass, at: Evaluated) -> None:
        vecs = self._forces_of(p)
        p.gap.add_forces(at.pressure, vecs)
        if p.slip is None or at.tangential is None:
            return
        tangential = at.tangential.traction
        if p.gap.following is not None and not p.gap.rows.are_points:
            p.gap.add_slip_forces(tangential, vecs)
            return
        handles = [0 if vec is None else vec.handle for vec in vecs]
        force = np.ascontiguousarray(p.slip.weight[:, None] * tangential)
        p.slip.works.add_transpose(force, *handles)

    # --- Driven tools

    def _move_tools(self, displacements: Array) -> None:
        for tool, start, s in zip(self.tools, self._starts, displacements, strict=True):
            tool.move_driven(start, s)
        for contact in {id(p.model): p.model for p in self.passes if p.tool is not None}.values():
            motion.move_tool(contact)

    def changes(self, p: Pass) -> tuple[Array, Array | None]:
        """∂ḡ/∂s and ∂g/∂s of the rows of a pass with a driven tool. Collective."""
        assert p.tool is not None
        return self._moved_by(p, self.tools[p.tool].driven_motion)

    def _moved_by(self, p: Pass, field: Affine) -> tuple[Array, Array | None]:
        """How the rows of a pass change when the tool moves by a field. Collective."""
        slip = None if p.slip is None else p.slip.tangential(p.slip.change(field))
        return p.gap.change(field), slip

    def _on_tools(self, passes: typing.Sequence[Evaluated]) -> Array:
        """R_s on all ranks. Collective."""
        if not self.tools:
            return np.zeros(0)
        out = self._work_of([tool.driven_motion for tool in self.tools], passes)
        forces = [tool.driven.force for tool in self.tools if tool.driven is not None]
        return out - np.array(forces)

    def _work_of(
        self, fields: typing.Sequence[Affine | None], passes: typing.Sequence[Evaluated]
    ) -> Array:
        """Of the tractions where each tool moves by a field, on all ranks. Collective."""
        out = np.zeros(len(self.tools))
        for p, e in zip(self.passes, passes, strict=True):
            field = None if p.tool is None else fields[p.tool]
            if p.tool is None or field is None:
                continue
            gap, slip = self._moved_by(p, field)
            out[p.tool] += np.sum(p.gap.weight[:, None] * e.pressure * gap)
            if slip is not None and p.slip is not None and e.tangential is not None:
                weight = p.slip.weight[:, None]
                out[p.tool] += np.sum(weight * e.tangential.traction * slip)
        self.system.comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
        return out

    @property
    def _turning(self) -> bool:
        """Whether a moment drives a tool: what its rows change by changes with its angle."""
        return any(tool.driven is not None and tool.driven.turns for tool in self.tools)

    def turned(self, at: State) -> Array:
        """∂R_s/∂s at given tractions, of tools that turn, on all ranks. Collective."""
        if not self._turning:
            return np.zeros(len(self.tools))
        return self._work_of([tool.driven_curvature for tool in self.tools], at.passes)

    # --- Tangent

    def tangent(self, z: Array, exact: bool = True) -> PETSc.Mat:
        """Derivative of the residual at z, an AIJ matrix that stays this object's. Collective.

        Args:
            z: Unknowns of this rank.
            exact: As for ``ConstraintRows.derivative``.

        Raises:
            ValueError, RuntimeError: As :meth:`residual`.
        """
        return self.tangent_of(self.evaluate(self._checked(z)), exact)

    def tangent_of(
        self, at: State, exact: bool = True, shift: tuple[float, float] = (0.0, 0.0)
    ) -> PETSc.Mat:
        """The same where the last evaluation was. Collective.

        Args:
            at: That evaluation.
            exact: As for ``ConstraintRows.derivative``.
            shift: Part of its magnitude that is added to the diagonal of bodies that conditions
                leave some rigid motion, and of those that have no condition at all.
        """
        self.softened = np.zeros(self.num_local)
        found = [*self._bulk(), *self._shift(shift), *self._beside(at, exact)]
        if not exact:
            for i, p in enumerate(self.passes):
                first = int(self._ends[len(self.system.bodies) + i])
                soft = p.rows.softened(at.passes[i])
                self.softened[first : first + len(soft)] = soft
        return self._whole.assemble(found)

    def beside_bodies(self, at: State) -> PETSc.Mat:
        """The inexact derivative but for the bodies' own matrices. Collective.

        Args:
            at: The last evaluation.

        Returns:
            An AIJ matrix by all unknowns that stays this object's.
        """
        return self._contact.assemble(self._beside(at, False))

    def _beside(self, at: State, exact: bool) -> list[Entries]:
        """Its entries. Collective."""
        found = [*self._curvature(at), *self._of_conductances()]
        if self._turning:
            turned = self.turned(at)
            own = np.arange(self._ends[-2], self._ends[-1]) + self.start
            found.append(Entries(own, own, turned[: len(own)]))
        for i, p in enumerate(self.passes):
            found += self._of_pass(i, p, at.passes[i], exact)
        return found

    def _numbers(self, i: int, unknowns: Indices) -> Indices:
        """Numbers in z of global unknowns of body i; −1 stays."""
        ranges = self._ranges[i]
        owner = np.clip(np.searchsorted(ranges, unknowns, side="right") - 1, 0, len(ranges) - 2)
        return np.where(unknowns < 0, -1, unknowns - ranges[owner] + self._first[owner, i])

    def _of_matrix(self, mat: PETSc.Mat, i: int, j: int) -> Entries:
        """Entries of the block of bodies i and j."""
        aij = (
            mat
            if "aij" in mat.getType() and "b" not in mat.getType()
            else mat.convert("aij", PETSc.Mat())
        )
        starts, columns, values = aij.getValuesCSR()
        first = self._ranges[i][self.system.comm.rank]
        rows = first + np.repeat(np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts))
        out = self._numbers(i, rows), self._numbers(j, columns.astype(np.int64)), values.copy()
        if aij is not mat:
            aij.destroy()
        return Entries(*out)

    def _bulk(self) -> list[Entries]:
        bodies = enumerate(self.system.bodies)
        diagonal = np.arange(self.start, self.start + self.num_local, dtype=np.int64)
        # Every row has an entry on the diagonal, which direct solvers want.
        all_ = Entries(diagonal, diagonal, np.zeros(self.num_local))
        return [all_, *(self._of_matrix(body.matrix(), i, i) for i, body in bodies)]

    def springs(self, parts: tuple[float, float]) -> Array:
        """Springs of free bodies, no stiffer than the softest body, owned unknowns. Collective.

        Args:
            parts: Of the diagonal of bodies that conditions leave some rigid motion, and of those
                that have no condition at all.
        """
        bodies, out = self.system.bodies, np.zeros(int(self._ends[len(self.system.bodies)]))
        if not (any(parts) and self.free_bodies):
            return out
        sums = np.array([
            [np.sum(b.diagonal[b.free]), np.sum(b.diagonal[b.free] > 0), len(b.owned_constrained)]
            for b in bodies
        ])  # fmt: skip
        self.system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        softest = np.min(sums[:, 0] / np.maximum(sums[:, 1], 1.0))
        for i in self.free_bodies:
            part = parts[int(sums[i, 2] == 0)]
            self.part(out, i)[:] = part * np.minimum(bodies[i].diagonal, softest)
        return out

    def _shift(self, parts: tuple[float, float]) -> list[Entries]:
        """Springs of free bodies on the diagonal. Collective."""
        values = self.springs(parts)
        rows = self.start + np.arange(len(values), dtype=np.int64)
        self.softened[: len(values)] = np.minimum(values, self.springs((REGULAR, REGULAR)))
        keep = values != 0
        return [Entries(rows[keep], rows[keep], values[keep])]

    def _curvature(self, at: State) -> list[Entries]:
        """Σ λ ∂²G, and how the forces of τ change with τ held, of gaps that follow. Collective."""
        found = []
        for (i, j), mat in self._curvatures(at).items():
            found.append(self._of_matrix(mat, i, j))
            mat.destroy()
        return found

    def _curvatures(self, at: State) -> dict[tuple[int, int], PETSc.Mat]:
        """The same as new AIJ matrices for pairs of bodies; none without such gaps. Collective.

        And what conductances add as they change.
        """
        bodies = self.system.bodies
        blocks: dict[tuple[int, int], PETSc.Mat] = {}

        def given(s: int, m: int | None) -> list[PETSc.Mat | None]:
            of = [(s, s), (s, m), (m, s), (m, m)]
            for i, j in of:
                if i is not None and j is not None and (i, j) not in blocks:
                    blocks[i, j] = _any_entries(bodies[i].num_owned, bodies[j].num_owned, self)
            return [blocks.get((i, j)) for i, j in of]  # type: ignore[arg-type]

        for p, e in zip(self.passes, at.passes, strict=True):
            if p.gap.following is None:
                continue
            s, m = p.bodies
            assert s is not None
            if isinstance(p.rows.condensed, PointConstraints):
                p.rows.condensed.add_curvature(e.normal, given(s, m))
            else:
                p.gap.add_curvature(e.pressure, given(s, m))
            if p.slip is not None and e.tangential is not None:
                p.gap.add_slip_curvature(e.tangential.traction, given(s, m))
        for contact, sides in zip(self.system.contacts, self.system.sides, strict=True):
            if contact.coupling is not None:
                ss, sm, ms, mm = given(*sides)
                contact.coupling.add_to((ss, sm, ms, mm), False)
        for mat in blocks.values():
            mat.assemble()
        return blocks

    def _entries(self, operator: typing.Any, p: Pass, first: int, scaled: bool) -> Entries:
        """Of G or J with its rows from a number on; by displacements or by the unknowns."""
        return joined(self._of_sides(operator, p, scaled)).below(first)

    def _of_sides(self, operator: typing.Any, p: Pass, scaled: bool) -> list[Entries]:
        """Those of each body, rows being numbers on this rank."""
        numbers: list[Number] = [
            functools.partial(self._numbers, i) for i in range(len(self._ranges))
        ]
        scale = self.system.scales if scaled else [1.0] * len(self._ranges)
        return entries_of(operator, p.bodies, numbers, scale)

    def _of_pass(self, i: int, p: Pass, at: Evaluated, exact: bool) -> list[Entries]:
        """Entries that the constraints of a pass have a part in. Collective."""
        rank, rows = self.system.comm.rank, p.rows
        first = int(self._first[rank, len(self.system.bodies) + i])
        own = first + np.arange(rows.num_multipliers)
        if rows.condensed is not None:
            of_friction = None if rows.condensed_friction is None else at.tangential
            matrices = self._matrices(p, rows.condensed, own, at.normal)
            found = [matrices.derivative(at.normal, of_friction)]
            if not exact:
                soft = rows.condensed.softened(at.normal)
                if rows.condensed_friction is not None:
                    soft = np.concatenate([soft, rows.condensed_friction.softened()])
                every = first + np.arange(len(soft))
                found.append(Entries(every, every, soft))
        else:
            assert rows.nodal is not None
            found = self._of_nodes(p, rows.nodal, at, exact, own)
        if rows.nodal_friction is not None and at.tangential is not None:
            by = rows.nodal_friction.derivative(at.tangential, exact)
            found += self._of_slip(p, at, by, own, first + len(own))
        return found

    def _of_nodes(
        self, p: Pass, rows: NodalRows, at: Evaluated, exact: bool, own: Indices
    ) -> list[Entries]:
        """Entries of λ of nodes. Collective."""
        by_gap, by_own = rows.derivative(at.normal, exact)
        first = int(self._first[self.system.comm.rank, self._number_of_part(p)])
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
            found += self._with_tool(p, own, weight, by_gap, self.changes(p)[0])
        return found

    def _of_conductances(self) -> list[Entries]:
        """Entries of conductances by λ, where that is an unknown beside the field. Collective."""
        found, contacts = [], zip(self.system.contacts, self.system.sides, strict=True)
        for contact, sides in contacts:
            of = None if contact.coupling is None else contact.coupling.of_bodies
            if of is None or contact.coupling is None:
                continue
            p = next(p for p in self.passes if p.model is of)
            for i, product in zip(sides, contact.coupling.by_multipliers(), strict=False):
                assert i is not None
                found.append(self._by_multipliers(p, i, product))
                product.destroy()
        return found

    def _by_multipliers(self, p: Pass, i: int, mat: PETSc.Mat) -> Entries:
        """Entries of a matrix of body i's unknowns by λ̂ at the rows of a pass. Collective."""
        first, part = mat.getOwnershipRange()[0], self._number_of_part(p)
        own = self._first_of(p) + np.arange(p.rows.num_multipliers)
        if p.rows.condensed is not None:
            mat = mat.matMult(self._matrices(p, p.rows.condensed, own).functions())
        starts, columns, values = mat.getValuesCSR()
        row = first + np.repeat(np.arange(len(starts) - 1, dtype=np.int64), np.diff(starts))
        numbers = columns.astype(np.int64)
        if p.rows.condensed is None:
            ends = np.append(0, np.cumsum(self.system.comm.allgather(p.rows.num_rows)))
            rank = np.searchsorted(ends, numbers, side="right") - 1
            numbers = self._first[rank, part] + numbers - ends[rank]
        else:
            mat.destroy()
        return Entries(self._numbers(i, row), numbers, values.copy())

    def _number_of_part(self, p: Pass) -> int:
        """Of the unknowns of a pass among the parts of z."""
        return len(self.system.bodies) + self.passes.index(p)

    def _matrices(
        self, p: Pass, rows: CondensedRows, own: Indices, at: Normal | None = None
    ) -> GapMatrices:
        """Derivatives that stay while gaps are linear and contact does not pair anew.

        Collective.

        Args:
            p: The pass.
            rows: Its rows.
            own: Numbers of λ.
            at: The rows at the last evaluation; None for what has been made there.
        """
        turns = p.tool is not None and self._turning
        is_new = at is not None and (turns or not p.gap.is_linear)
        if is_new and p.rows in self._of_gaps:
            self._of_gaps.pop(p.rows).destroy()
        if p.rows not in self._of_gaps:
            friction, slips = p.rows.condensed_friction, None
            change = (None, None) if p.tool is None else self.changes(p)
            gaps = self._both(p, (p.gap.operator, p.gap.operator), change[0])
            last = int(own[-1]) + 1 if len(own) else self._first_of(p)
            of_slip = last + np.arange(0 if friction is None else friction.shape[0])
            if friction is not None and p.slip is not None:
                slips = self._both(p, (p.slip.works, p.slip.operator), change[1])
            numbers = own, of_slip
            moving = self._moving(p, rows, at)
            made = GapMatrices(rows, friction, gaps, slips, numbers, self.num_local, moving)
            self._of_gaps[p.rows] = made
        return self._of_gaps[p.rows]

    def _moving(self, p: Pass, rows: CondensedRows, at: Normal | None) -> Moving | None:
        """How λ_h moves along facets at the last evaluation; None if it does not. Collective."""
        if at is None or not isinstance(rows, PointConstraints):
            return None
        found = rows.moving(at)
        if found is None:
            return None
        mixed = []
        for (side, unknown, value), body in zip(found.mixed, p.bodies, strict=False):
            assert body is not None
            scaled = self.system.scales[body] * value
            mixed.append(Entries(side, self._numbers(body, unknown), scaled))
        of_tool = None if p.tool is None else self._moved_functions(p, found)
        operators = found.operator, found.operator
        return Moving(joined(self._both(p, operators, of_tool)[1]), joined(mixed))

    def _moved_functions(self, p: Pass, found: MovingFunctions) -> Array:
        """How λ_h changes at the rows when a driven tool moves, (rows, 1). Collective."""
        assert p.tool is not None
        r = affine_vec(p.gap.slave, self.tools[p.tool].driven_motion)
        out = -found.operator.apply(r.handle, 0)
        r.destroy()
        return np.asarray(out)

    def _both(
        self, p: Pass, operators: tuple[typing.Any, typing.Any], change: Array | None
    ) -> Sided:
        """Of L by displacements, and G or J by the unknowns, with those of a driven tool."""
        first, last = operators
        by_displacement = self._with_change(p, first, False, change)
        if first is last and all(scale == 1 for scale in self.system.scales):
            return by_displacement, by_displacement
        return by_displacement, self._with_change(p, last, True, change)

    def _with_change(
        self, p: Pass, operator: typing.Any, scaled: bool, change: Array | None
    ) -> list[Entries]:
        """Of one of them."""
        found = self._of_sides(operator, p, scaled)
        if p.tool is not None and change is not None:
            row = np.arange(change.size)
            tool = np.full(len(row), self._first[0, -2] + p.tool)
            found.append(Entries(row, tool, change.ravel()))
        return found

    def _first_of(self, p: Pass) -> int:
        """Number of a pass' first unknown on this rank."""
        return int(self._first[self.system.comm.rank, self._number_of_part(p)])

    def _with_tool(
        self, p: Pass, own: Indices, weight: Array, by_gap: Array, change: Array
    ) -> list[Entries]:
        """Entries of a driven tool and of multipliers."""
        assert p.tool is not None
        tool = np.full(len(own), self._first[0, -2] + p.tool)
        return [
            Entries(tool, own, weight * change.ravel()),
            Entries(own, tool, (by_gap * change).ravel()),
        ]

    def _of_slip(
        self, p: Pass, at: Evaluated, by: OfTangential, normal: Indices, first: int
    ) -> list[Entries]:
        """Entries of τ. Collective.

        Args:
            p: The pass.
            at: Its constraints.
            by: Derivatives of R_τ.
            normal: Numbers of λ.
            first: Of τ.
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
        for k in range(gdim):  # D J, a component of the rows after the other
            found.append(Entries(own[rows[0], k], J.column, by_slip[rows[0], k, rows[1]] * J.value))
        found += self._of_pressure(p, at, by, normal, own)
        for k, works in enumerate(self._works_on(p)):
            factor = p.slip.projector[:, k, :] * p.slip.weight[:, None]
            for j in range(gdim):
                found.append(
                    Entries(works.column, own[works.row, j], works.value * factor[works.row, j])
                )
        if p.tool is not None:
            change = self.changes(p)[1]
            assert change is not None
            weight, ones = np.repeat(p.slip.weight, gdim), np.ones((num, gdim))
            pushed = np.einsum("rij,rj->ri", by_slip, change)
            found += self._with_tool(p, own.ravel(), weight, ones, change)[:1]
            found += self._with_tool(p, own.ravel(), weight, ones, pushed)[1:]
        return found

    def _of_pressure(
        self, p: Pass, at: Evaluated, by: OfTangential, normal: Indices, own: Indices
    ) -> list[Entries]:
        """Entries of τ by what its limit depends on: pressures, and y_n. Collective."""
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
                pushed = by_gap * self.changes(p)[0]
                none = np.zeros(own.size)
                found += self._with_tool(p, own.ravel(), none, np.ones(own.shape), pushed)[1:]
        pressure = np.repeat(normal[:, None], gdim, axis=1)
        return [*found, Entries(own.ravel(), pressure.ravel(), by_multiplier.ravel())]

    def _works_on(self, p: Pass) -> list[Entries]:
        """What each component of the tangential force works on, over the weight. Collective."""
        assert p.slip is not None
        gdim = p.gap.slave.gdim
        operators = p.gap.slip_operators()
        if operators:
            return [self._entries(operator, p, 0, False) for operator in operators]
        J = self._entries(p.slip.operator, p, 0, False)
        out = []
        for k in range(gdim):
            of = J.row % gdim == k
            out.append(Entries(J.row[of] // gdim, J.column[of], J.value[of]))
        return out

    def restart(self) -> None:
        """Count displacements of driven tools from where they are now."""
        self._starts = [(tool.displacement.copy(), tool.rotation.copy()) for tool in self.tools]
        self._at = None

    def measure(self) -> bool:
        """Measure areas of gaps that follow at the last evaluation; whether there are any.

        Collective. R takes them as given: the derivative leaves out how they change.
        """
        following = [p.gap for p in self.passes if p.gap.following is not None]
        for gap in following:
            gap.measure_now()
        if following:
            self._at = None
        return bool(following)

    @property
    def slips_at_points(self) -> bool:
        """Whether there is friction at points."""
        return any(p.rows.condensed_friction is not None for p in self.passes)

    @property
    def knows_closed_points(self) -> bool:
        """Whether it is known of points what has been closed before. Collective."""
        known = any(
            isinstance(p.rows.condensed, PointConstraints)
            and p.gap.state.closed is not None
            and bool(np.any(p.gap.state.closed > 0))
            for p in self.passes
        )
        return bool(self.system.comm.allreduce(known, op=MPI.LOR))

    @property
    def can_soften(self) -> bool:
        """Whether there are multipliers of points, and none of friction."""
        rows = [p.rows.condensed for p in self.passes]
        found = any(isinstance(of, PointConstraints) and of.has_multipliers for of in rows)
        return found and all(p.slip is None for p in self.passes)

    def soften(self, part: float) -> None:
        """Take a part of γ in constraints at points. Collective.

        Args:
            part: Of the penalty; 1 is what R has otherwise.
        """
        for p in self.passes:
            if isinstance(p.rows.condensed, PointConstraints):
                p.rows.condensed.soften(part)
        self._forget_gaps()
        self._at = None

    def set_proximal(self, part: float, far: bool = False) -> None:
        """Take this part of the diagonal by which λ's inexact derivative is softer at points."""
        for p in self.passes:
            if p.rows.condensed is not None:
                p.rows.condensed.proximal = part
                p.rows.condensed.far = far

    def _forget_gaps(self) -> None:
        """Free derivatives of gaps. Collective."""
        for matrices in self._of_gaps.values():
            matrices.destroy()
        self._of_gaps = {}

    def forget(self) -> None:
        """Evaluate anew, since the state has been changed."""
        self._at = None

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        for assembled in (self._whole, self._contact):
            assembled.destroy()
        self._forget_gaps()


class _Assembled:
    """Matrix of entries by all unknowns, whose pattern stays while they are at the same places."""

    def __init__(self, equations: Equations) -> None:
        self._comm, self._size = equations.system.comm, (equations.num_local, equations.size)
        self._matrix: PETSc.Mat | None = None
        self._places = b""

    def assemble(self, found: typing.Sequence[Entries]) -> PETSc.Mat:
        """Take these entries, some perhaps of rows of other ranks. Collective."""
        row, column, value = joined(found)
        keep = (row >= 0) & (column >= 0)
        row, column, value = row[keep], column[keep], value[keep]
        places = hashlib.blake2b(np.ascontiguousarray(row))
        places.update(np.ascontiguousarray(column))
        if not self._comm.allreduce(places.digest() == self._places, op=MPI.LAND):
            self._allocate(row, column)
            self._places = places.digest()
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
        """Free it. Collective."""
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix, self._places = None, b""


def _any_entries(rows: int, columns: int, equations: Equations) -> PETSc.Mat:
    """Empty matrix that takes any entries, until it is assembled."""
    mat = PETSc.Mat().create(comm=equations.system.comm)
    mat.setSizes(((rows, PETSc.DETERMINE), (columns, PETSc.DETERMINE)))
    mat.setType(PETSc.Mat.Type.AIJ)
    mat.setUp()
    return mat
