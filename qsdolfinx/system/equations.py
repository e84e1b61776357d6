"""System of equations R(z) = 0 for bodies, multipliers and force-controlled tools."""

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
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.system.condensed_rows import PointConstraints
from qsdolfinx.system.constraint_rows import ConstraintRows, Evaluated, Multipliers
from qsdolfinx.system.derivative import Derivative
from qsdolfinx.system.driven import DrivenTools
from qsdolfinx.system.friction_at_points import PointFriction
from qsdolfinx.system.layout import Layout
from qsdolfinx.system.passes import Pass, State
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Residual over contact forces above which unknowns do not count as a solution, and a foundation
#: not as balanced. Solvers of users end with less; a larger one would be seen in the forces of the
#: next step.
UNBALANCED = 1e-3


class Equations:
    """System of equations R(z) = 0 for z = (u_i, λ, τ, s), and its derivative.

        R_u = F(u) + Gᵀ W λ + Lᵀ W τ,   R_λ, R_τ: see ``ConstraintRows``,
        R_s = Σ W λ ∂ḡ/∂s + Σ W τ ∂g/∂s − force

    u_i are the unknowns of the bodies, λ and τ the multipliers of all integration sides, and s the
    displacements of force-controlled rigid tools. W λ are forces at nodes; G and J are the
    derivatives of gaps and slips. L is the conjugate of τ in the virtual work: L = J, except with
    finite sliding. R depends only on z and on the state at the start of the step. Each rank has the
    equations of its owned unknowns, then those of its multipliers; the first rank also has those of
    the tools.

    Where u does not yet have its Dirichlet values g, R_u of a body with a nonlinear form contains
    the additional term K(u) (g − u). The derivative treats K in this term as constant, so that it
    is exact when the Dirichlet conditions are met, as after one full step. R counts slip from the
    start of the step. ``problem.solve()`` counts the slip of constraints that become active in the
    step from their contact onset, see ``solve/onset.py``.

    The system must have been set up: penalties are known, and tools are at the start of the step.

    Args:
        system: The bodies and contacts; without scalar fields, with constraints at nodes.

    Attributes:
        system: The bodies and contacts.
        tools: Force-controlled rigid tools, in the order of s.
        passes: Integration sides of the contacts, in the order of their multipliers.
        num_local: Number of unknowns of this rank.
        start: Global number of the first unknown of this rank.
        size: Number of unknowns of all ranks.
        one_step: Context manager in which :meth:`accept` ends a step of the history of friction;
            ``one_step`` of the problem.
        layout: Positions of all unknowns in z.
        driven: Forces and equations of the tools.
        derivative: The derivative at the last evaluation.
    """

    def __init__(self, system: ContactSystem) -> None:
        self.system = system
        self.tools = [tool for tool in system.tools if tool.driven is not None]
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
        """Number of the force-controlled tool of a contact; None without one."""
        for i, tool in enumerate(self.tools):
            if tool is not contact.master or tool.driven is None:
                continue
            if tool.driven.turns and contact.slave.axisymmetric:
                text = "drive_moment: a tool of an axisymmetric problem cannot be rotated"
                raise ValueError(text)
            if tool.driven.turns and contact.follows:
                raise ValueError(
                    'drive_moment: sliding="finite" supports tools with forces, not with moments; '
                    'use sliding="small" with time steps, or prescribe the rotation'
                )
            return i
        return None

    @property
    def is_current(self) -> bool:
        """Whether there was no contact detection since the equations were made."""
        gaps = self.system.gaps
        return len(gaps) == len(self.passes) and all(
            p.gap is gap for p, gap in zip(self.passes, gaps, strict=True)
        )

    # --- Unknowns

    def part(self, z: Array, i: int) -> Array:
        """Part of this rank's unknowns that belongs to body i."""
        return self.layout.part(z, i)

    def bodies_of(self, z: Array) -> Array:
        """Part of this rank's unknowns that belongs to all bodies."""
        return z[: self.layout.ends[len(self.system.bodies)]]

    def multipliers(self, z: Array) -> list[Multipliers]:
        """Multipliers λ and τ of each integration side."""
        first = len(self.system.bodies)
        return [p.rows.split(self.layout.part(z, first + i)) for i, p in enumerate(self.passes)]

    def displacements(self, z: Array) -> Array:
        """Displacement (length) of each force-controlled tool, on all ranks. Collective."""
        out = np.zeros(len(self.tools))
        if self.system.comm.rank == 0:
            out[:] = z[self.layout.ends[-2] :]
        if self.tools:
            self.system.comm.Bcast(out, root=0)
        return out

    def join(
        self, x: Array, multipliers: typing.Sequence[Multipliers], displacements: Array
    ) -> Array:
        """Join the parts to this rank's unknowns z."""
        parts = [x]
        for values in multipliers:
            parts.append(values.normal.ravel())
            if values.tangential is not None:
                parts.append(values.tangential.ravel())
        if self.system.comm.rank == 0:
            parts.append(displacements)
        return np.concatenate(parts)

    def first(self) -> Array:
        """Initial guess z: present bodies and tools, and known multipliers. Collective.

        λ is that of the last solve with an augmented Lagrangian, and ε [ḡ]₊ at nodes without one.
        """
        x = self.unknowns_of([body.u.x.array for body in self.system.bodies])
        for slip in self.system.slips:
            slip.state.solved = None  # of results, at the points of the last solve
        self.system.residual(x)
        return self.join(x, [p.rows.first() for p in self.passes], np.zeros(len(self.tools)))

    def unknowns_of(self, arrays: typing.Sequence[Array]) -> Array:
        """Owned unknowns of all bodies; for linear bodies with the values of conditions.

        Args:
            arrays: Unknowns of each body, ghosts included.
        """
        parts = []
        for body, array in zip(self.system.bodies, arrays, strict=True):
            values = array[: body.num_owned]
            parts.append(body.with_conditions(values) if body.linear else values)
        return np.concatenate(parts)

    def meets_conditions(self, z: Array) -> bool:
        """Whether all Dirichlet conditions are satisfied at z. Collective."""
        met = True
        for i, body in enumerate(self.system.bodies):
            x = self.part(z, i)
            off = np.abs(body.with_conditions(x) - x).max(initial=0.0)
            met &= bool(off <= SOLVED * np.abs(x).max(initial=0.0))
        return bool(self.system.comm.allreduce(met, op=MPI.LAND))

    def accept(self, z: Array) -> None:
        """Accept a solution z for bodies, contacts and tools, as the end of a step. Collective.

        See also ``one_step``.

        Args:
            z: Unknowns of this rank, R(z) = 0.

        Raises:
            ValueError, RuntimeError: As :meth:`residual`.

        Warns:
            ContactWarning: If forces are not balanced at z.
        """
        z = self._checked(z)
        self._at = None
        at = self.evaluate(z)
        sums = np.array([float(np.sum(f**2)) for f in (self.forces_of(at), at.contact)])
        self.system.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        residual, forces = np.sqrt(sums)
        if residual > UNBALANCED * forces > 0:
            warn(
                f"z: no solution: |R_u| is {residual / forces:.2g} of the contact forces; continue "
                "the iteration before equations.accept(z)",
                ContactWarning,
            )
        with self.one_step():
            self.end_at(z)

    def end_at(self, z: Array) -> None:
        """Set bodies, contacts and tools to a known solution z. Collective."""
        for p, e in zip(self.passes, self.evaluate(z).passes, strict=True):
            p.rows.keep(e)
        self.system.x.array[:] = self.bodies_of(z)
        self.system.residual(self.system.x.array_r)
        self._at = None

    # --- Residual

    def residual(self, z: Array) -> Array:
        """Residual R(z) for this rank's unknowns z, with present loads and conditions. Collective.

        Raises:
            ValueError: If z is not of the shape of this rank's unknowns, or not finite.
            RuntimeError: If there was contact detection since the equations were made: get new
                equations from ``problem.equations()``.
        """
        z = self._checked(z)
        self._at = None
        for body in self.system.bodies:
            body.begin_solve()
        return self.residual_of(self.evaluate(z))

    def _checked(self, z: typing.Any) -> Array:
        """Check unknowns given by the caller. Collective."""
        with checked(self.system.comm):
            if not self.is_current:
                raise RuntimeError(
                    "contact pairs were updated since these equations were made: get new ones from "
                    "problem.equations()"
                )
            values = np.asarray(z)
            shape = (self.num_local,)
            require(values.shape == shape, f"z: must be of shape {shape}, this rank's unknowns")
            require(np.isrealobj(values), "z: must be real")
            require(bool(np.isfinite(values).all()), "z: must be finite")
        return np.array(values, dtype=np.float64)

    def residual_of(self, at: State) -> Array:
        """Residual R of an evaluation."""
        parts = [self.forces_of(at), at.constraints]
        if self.system.comm.rank == 0:
            parts.append(at.tools)
        return np.concatenate(parts)

    def in_forces(self, residual: Array, back: bool = False) -> Array:
        """Scale the equations of λ and τ in R to forces, c R: continuous at changes of active sets.

        A line search should reduce the norm of the scaled residual.

        Args:
            residual: R, as returned by :meth:`residual`.
            back: Whether to invert the scaling.
        """
        out, first = residual.copy(), len(self.system.bodies)
        for i, p in enumerate(self.passes):
            scale = p.rows.in_forces
            part = self.layout.part(out, first + i)
            part *= 1 / scale if back else scale
        return out

    def forces_of(self, at: State) -> Array:
        """Residual R_u of an evaluation."""
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
        """Evaluate all data for residual and tangent at z. Collective.

        Args:
            z: Unknowns of this rank.
            first: As for ``ConstraintRows.evaluate``.
            opened: Constraints of each integration side that count as inactive; by default none.
            again: As for ``ConstraintRows.evaluate``.
            sticking: For each integration side, whether all its active constraints stick; by
                default for none.
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
        """Set the pressures λ of contacts on which conductances depend. Collective."""
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
        """Derivative of the residual at z, an AIJ matrix that this object owns. Collective.

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
        """Derivative at a given evaluation; see ``Derivative.of``. Collective."""
        return self.derivative.of(at, exact, shift)

    def restart(self) -> None:
        """Count displacements of force-controlled tools from their present positions."""
        self.driven.restart()
        self._at = None

    def has_other_multipliers(self) -> bool:
        """Whether the nodes with multipliers differ at the last evaluation. Collective.

        Nodes have multipliers if the other surface covers their support.
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
        """Whether the earlier active constraints at points are known. Collective."""
        known = any(
            isinstance(p.rows.condensed, PointConstraints)
            and p.gap.state.closed is not None
            and bool(np.any(p.gap.state.closed > 0))
            for p in self.passes
        )
        return bool(self.system.comm.allreduce(known, op=MPI.LOR))

    @property
    def can_soften(self) -> bool:
        """Whether there are constraints at points whose penalty can be softer."""
        return bool(self._soft_rows)

    @property
    def _soft_rows(self) -> list[tuple[PointConstraints, PointFriction | None]]:
        """Constraints at points whose penalty can be softer, and their friction."""
        return [
            (p.rows.condensed, p.rows.condensed_friction)
            for p in self.passes
            if isinstance(p.rows.condensed, PointConstraints) and p.rows.condensed.can_soften
        ]

    def soften(self, part: float) -> None:
        """Use this part of the automatic penalties of constraints at points. Collective.

        Args:
            part: Factor of the penalties; 1 gives the usual R.
        """
        for rows, friction in self._soft_rows:
            rows.soften(part)
            if friction is not None:
                friction.soften(part)
        self.derivative.forget_gaps()
        self._at = None

    def set_proximal(self, part: float, far: bool = False) -> None:
        """Set the factor of the diagonal term that regularises λ's inexact derivative at points."""
        for p in self.passes:
            if p.rows.condensed is not None:
                p.rows.condensed.proximal = part
                p.rows.condensed.far = far
            if p.rows.condensed_friction is not None:
                p.rows.condensed_friction.proximal = part

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.derivative.destroy()
