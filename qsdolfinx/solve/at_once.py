"""Solve for bodies, multipliers and tools together by one Newton's method."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.base.reasons import NOT_FINITE
from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.contact import overclosed
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.no_value import NoMultiplierError, NoValueError
from qsdolfinx.solve.first_guess import guess
from qsdolfinx.solve.newton import Newton
from qsdolfinx.solve.newton_step import LATE, NoConvergence
from qsdolfinx.solve.one_newton import OneNewton
from qsdolfinx.solve.snap_through import Missed
from qsdolfinx.solve.snes import NOT_BALANCED
from qsdolfinx.solve.tool_balance import ToolBalance
from qsdolfinx.system.equations import Equations

Array = npt.NDArray[np.float64]

#: Largest number of times that a solve is continued after the nodes with multipliers, or the
#: vertices with contact quadrature points, have changed. With 0, points that slide onto other
#: facets end the solve with a warning.
MOST_OTHERS = 5


UNSETTLED = (
    "sliding: with the nodes that are covered by the other surface at the end of the solve, there "
    "is no equilibrium nearby: forces at the ends of the contact zone depend on where the solve "
    "began; of two bodies make the smaller surface the slave; take smaller steps, or finer facets"
)


class AtOnce:
    """Solve a problem by Newton's method on R(z) = 0, see :class:`qs.Equations`.

    The first solve begins at the equilibrium of bodies and tools on springs. Later solves begin
    with the multipliers of the last solve and the present unknowns of the bodies. If that fails,
    they begin with the unknowns at the start of the step.

    Args:
        newton: Solver whose system, record and SNES are used.
    """

    def __init__(self, newton: Newton) -> None:
        self._newton, self._system = newton, newton.system
        #: Unknowns of the bodies at the start of the step, ghosts included.
        self.start: list[Array] | None = None
        #: What the first iterate lacks to the solution, in the solve of the step with the most.
        self.missed = Missed.nothing()
        #: Whether the solve starts without known multipliers.
        self._is_cold = True
        #: Whether the last solve was for the same step.
        self.again = False
        #: Why the last solve has failed, one of PETSc's reasons.
        self.reason = LATE
        #: Reason of its linear solver, if that has failed; 0 otherwise.
        self.linear_reason = 0
        #: The same reason in words, for error messages.
        self.why = ""

    @property
    def fits(self) -> bool:
        """Whether this method is used, rather than the paper's own penalty with nodal quadrature.

        The paper's method keeps the condensed blocks if bodies are linear or the user has chosen
        SNES options. Bodies without contact keep them, too.
        """
        contacts = self._system.contacts
        if contacts and not are_condensed(contacts):
            return True
        return not (self._system.linear or self._newton.has_users_snes)

    def begin_step(self) -> None:
        """Store the unknowns: solves of the step that fail are restarted from them."""
        self.start = [body.u.x.array.copy() for body in self._system.bodies]
        self.again, self.missed = False, Missed.nothing()

    def solve(self, stiffness: float | None = None) -> bool:
        """Solve from the system's unknowns; returns whether a solution was found. Collective.

        Without a solution, unknowns, multipliers and tools are those of the last iterate; the
        problem restores them.

        Args:
            stiffness: Stiffness of springs that vanish with the residual, as for :class:`Balance`.
        """
        newton, system = self._newton, self._system
        equations = Equations(system)
        loop = OneNewton(equations, newton, self.again, stiffness)
        try:
            with system.watch.stage("solve"):
                z = self._find(equations, loop)
            self._note_missed(equations, z, loop.first)
            equations.end_at(z)
            for _ in range(MOST_OTHERS):
                chosen = [gap.state.vertices for gap in system.gaps]
                others = system.have_vertices_changed() or equations.has_other_multipliers()
                if not (others or self._are_others_allowed()):
                    break
                last = loop, equations
                equations = Equations(system)
                loop = OneNewton(equations, newton, True, stiffness)
                try:
                    with system.watch.stage("solve"):
                        z = loop.solve(equations.first(), begins=False)
                except (NoConvergence, NoValueError):
                    for thing in (loop, equations):
                        thing.destroy()
                    loop, equations = last
                    self._set_vertices(chosen)
                    equations.evaluate(z)
                    equations.end_at(z)
                    warn(UNSETTLED, ContactWarning)
                    break
                for thing in last:
                    thing.destroy()
                equations.end_at(z)
            else:
                warn(UNSETTLED, ContactWarning)
            self.again = True
        except (NoConvergence, NoValueError) as error:
            self._note_failure(error, loop)
            self.again = False
            return False
        finally:
            if any(contact.augmented for contact in system.contacts):
                newton.record.violations = [loop.open_gap]
            loop.destroy()
            system.forget_tangent()
            equations.destroy()
        return True

    def _note_missed(self, equations: Equations, z: Array, first: Array | None) -> None:
        """Compare the solution z with the first iterate, for the check of the step. Collective."""
        if self.start is None or first is None:
            return
        x, pairs = equations.bodies_of(z), zip(self._system.bodies, self.start, strict=True)
        moved = self._system.norm(
            x - np.concatenate([array[: body.num_owned] for body, array in pairs])
        )
        if moved <= ROUNDING * self._system.norm(x) or self._is_nothing(moved):
            return
        change = z - first
        bodies = equations.bodies_of(change)
        part = self._system.norm(bodies) / moved
        if part > self.missed.part:
            tools = zip(equations.tools, equations.displacements(change), strict=True)
            self.missed = Missed(part, bodies, {tool: float(s) for tool, s in tools})

    def _is_nothing(self, moved: float) -> bool:
        """Whether motions of this norm are what solvers leave, compared with facets."""
        contacts = self._system.contacts
        size = min((contact.paired.facet_size for contact in contacts), default=0.0)
        return bool(moved <= SOLVED * size)

    def _set_vertices(self, vertices: typing.Sequence[Array | None]) -> None:
        """Set which vertices of each integration side have their own points."""
        for gap, chosen in zip(self._system.gaps, vertices, strict=True):
            gap.state.vertices = chosen

    def _are_others_allowed(self) -> bool:
        """Whether bodies have slid to nodes whose initial overclosure is allowed. Collective."""
        return any([overclosed.follow_bodies(contact) for contact in self._system.contacts])

    def _note_failure(self, error: NoConvergence | NoValueError, loop: OneNewton) -> None:
        """Store the reason why there is no solution."""
        self.reason, self.linear_reason, self.why = LATE, 0, str(error)
        if isinstance(error, NoValueError):
            self._newton.note_unseen(error)
            if isinstance(error, NoMultiplierError):
                self.reason = NOT_FINITE
            return
        self.reason, self.linear_reason = error.reason, error.linear
        if error.linear and loop.has_idle_tools:
            self.reason = NOT_BALANCED

    def _find(self, equations: Equations, loop: OneNewton) -> Array:
        """The solution. Collective."""
        z = self._begin(equations)
        softly = self._is_cold and equations.can_soften
        has_moved = self._has_moved()
        try:
            z = loop.solve(z, softly=softly)
        except (NoConvergence, NoValueError):
            if not has_moved:
                raise
            self._newton.record.restarts += 1
            z = loop.solve(self._begin_again(equations, z))
        return z

    def _begin(self, equations: Equations) -> Array:
        """Initial unknowns. Collective."""
        system = equations.system
        z = equations.first()
        warm = any(bool(np.any(gap.state.augmented)) for gap in system.gaps)
        self._is_cold = not system.comm.allreduce(warm, op=MPI.LOR)
        if not self._is_cold:
            return z
        system.x.array[:] = equations.bodies_of(z)
        balance = ToolBalance(system)
        if balance.tools:
            balance.approach()
        guess(system)
        equations.restart()
        return equations.join(
            system.x.array_r.copy(),
            [p.rows.first() for p in equations.passes],
            np.zeros(len(equations.tools)),
        )

    def _has_moved(self) -> bool:
        """Whether unknowns at the start of step and solve differ. Collective."""
        if self.start is None:
            return False
        moved = any(
            not np.array_equal(body.u.x.array, array)
            for body, array in zip(self._system.bodies, self.start, strict=True)
        )
        return bool(self._system.comm.allreduce(moved, op=MPI.LOR))

    def _begin_again(self, equations: Equations, z: Array) -> Array:
        """Unknowns with the same multipliers, and the bodies' unknowns at the start of the step."""
        assert self.start is not None
        x = equations.unknowns_of(self.start)
        none = np.zeros(len(equations.tools))
        return equations.join(x, equations.multipliers(z), none)


def are_condensed(contacts: typing.Sequence[ContactModel]) -> bool:
    """Whether contacts are those of the paper, frictionless and without force-controlled tools."""
    return all(
        contact.settings.sampling.quadrature == "nodal"
        and not (contact.augmented or contact.follows or contact.friction or contact.is_scalar)
        and not contact.law.memory
        and all(tool.driven is None for tool in contact.master.tools)
        for contact in contacts
    )
