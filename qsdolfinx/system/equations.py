"""Bodies, multipliers and driven tools as one system of equations, R(z) = 0."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.checks import require
from qsdolfinx.base.collective import checked
from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.system.condensed_rows import PointConstraints
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated, Multipliers
from qsdolfinx.system.derivative import Derivative
from qsdolfinx.system.driven import DrivenTools
from qsdolfinx.system.layout import Layout
from qsdolfinx.system.passes import Pass, State
from qsdolfinx.system.system import ContactSystem
from qsdolfinx.tools.rigid_surface import RigidSurface, as_tool

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Residual over contact forces from which on unknowns are no solution.
UNBALANCED = 1e-3


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
        layout: Where all unknowns are in z.
        driven: What drives these tools.
        derivative: The derivative at the last evaluation.
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
        self.one_step: typing.Callable[[], contextlib.AbstractContextManager[None]] = (
            contextlib.nullcontext
        )
        self.driven = DrivenTools(self.tools, self.passes, system.comm)
        sizes = [body.num_owned for body in system.bodies]
        sizes += [p.rows.num_unknowns for p in self.passes]
        sizes.append(len(self.tools) if system.comm.rank == 0 else 0)
        self.layout = layout = Layout(system.comm, len(system.bodies), sizes)
        self.num_local, self.start, self.size = layout.num_local, layout.start, layout.size
        self.derivative = Derivative(system, self.passes, layout, self.driven)
        self._at: State | None = None

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
        return self.layout.part(z, i)

    def bodies_of(self, z: Array) -> Array:
        """That of all bodies."""
        return z[: self.layout.ends[len(self.system.bodies)]]

    def multipliers(self, z: Array) -> list[Multipliers]:
        """λ and τ of each pass."""
        first = len(self.system.bodies)
        return [p.rows.split(self.layout.part(z, first + i)) for i, p in enumerate(self.passes)]

    def displacements(self, z: Array) -> Array:
        """Displacement (length) of each driven tool since the start, on all ranks. Collective."""
        out = np.zeros(len(self.tools))
        if self.system.comm.rank == 0:
            out[:] = z[self.layout.ends[-2] :]
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
            part = self.layout.part(out, first + i)
            part *= 1 / scale if back else scale
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
        sticking: typing.Sequence[bool] | None = None,
    ) -> State:
        """Everything that residual and tangent need at z. Collective.

        Args:
            z: Unknowns of this rank.
            first: As for ``ConstraintRows.evaluate``.
            opened: Rows of each pass that count as open; none by default.
            again: As for ``ConstraintRows.evaluate``.
            sticking: Whether all that is closed of a pass sticks; of none by default.
        """
        first, usual = first or opened is not None, sticking is None
        sticks = [False] * len(self.passes) if sticking is None else sticking
        if not first and usual and self._is_at(z):
            assert self._at is not None
            return self._at
        system, multipliers = self.system, self.multipliers(z)
        self.driven.move(self.displacements(z))
        self._tell_conductances(multipliers)
        bulk = [body.residual(self.part(z, i)) for i, body in enumerate(system.bodies)]
        system.evaluate_contacts()
        both = list(zip(self.passes, multipliers, strict=True))
        passes = [
            p.rows.evaluate(values, first, None if opened is None else opened[i], again, sticks[i])
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
        tools = self.driven.residual(passes)
        pairs = zip(self.passes, passes, strict=True)
        constraints = np.concatenate([np.zeros(0), *(p.rows.residual(e) for p, e in pairs)])
        at = State(z.copy(), np.concatenate(bulk), forces, passes, constraints, tools)
        self._at = at if usual and not first else None
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
        handles = [0 if vec is None else vec.handle for vec in vecs]
        force = np.ascontiguousarray(p.slip.weight[:, None] * tangential)
        p.slip.works.add_transpose(force, *handles)

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
        """The same where the last evaluation was; see ``Derivative.of``. Collective."""
        return self.derivative.of(at, exact, shift)

    def restart(self) -> None:
        """Count displacements of driven tools from where they are now."""
        self.driven.restart()
        self._at = None

    def has_other_multipliers(self) -> bool:
        """Whether other nodes are covered at the last evaluation than where unknowns were found.

        Collective.
        """
        points = [p.rows.condensed for p in self.passes]
        found = [rows.has_others() for rows in points if isinstance(rows, PointConstraints)]
        return bool(self.system.comm.allreduce(any(found), op=MPI.LOR))

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
        self.derivative.forget_gaps()
        self._at = None

    def set_proximal(self, part: float, far: bool = False) -> None:
        """Take this part of the diagonal by which λ's inexact derivative is softer at points."""
        for p in self.passes:
            if p.rows.condensed is not None:
                p.rows.condensed.proximal = part
                p.rows.condensed.far = far
            if p.rows.condensed_friction is not None:
                p.rows.condensed_friction.proximal = part

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.derivative.destroy()
