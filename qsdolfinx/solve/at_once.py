"""A solve by one Newton's method on bodies, multipliers and tools at once.

What :meth:`qs.ContactProblem.solve` is going to do; it does not yet.
"""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import motion, multipliers
from qsdolfinx.gap.following import NoGapError
from qsdolfinx.gap.rows import NodeRows
from qsdolfinx.solve.first_guess import guess
from qsdolfinx.solve.one_newton import NoConvergence, OneNewton
from qsdolfinx.solve.problem import MAX_MEASURES, SAME_AREA, ContactProblem
from qsdolfinx.solve.tool_balance import ToolBalance
from qsdolfinx.system.equations import Equations

Array = npt.NDArray[np.float64]


class AtOnce:
    """Solves a problem by Newton's method on R(z) = 0, see :class:`qs.Equations`.

    The first solve begins where springs would hold bodies and tools; later ones with the
    multipliers of the last, from where ``problem.u`` puts the bodies, and if that fails from where
    they were at :meth:`begin_step`.

    Args:
        problem: The problem; no scalar fields, constraints at nodes, no stabilisation.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        #: Linear systems of each solve.
        self.counts: list[int] = []
        #: Solves that have been begun again from the start of the step.
        self.num_retries = 0
        self._known: list[Array] = []
        self._start: list[Array] | None = None

    def begin_step(self) -> None:
        """Let failed solves be tried again from the present unknowns, once."""
        self._start = [body.u.x.array.copy() for body in self.problem.bodies]

    def solve(self, step: typing.Any = None) -> None:
        """As :meth:`qs.ContactProblem.solve`. Collective.

        Args:
            step: Not used: what ``qs.TimeStepper(solve=…)`` gives.
        """
        problem = self.problem
        problem.newton.begin()
        with problem.one_step():
            self._solve()

    def _solve(self) -> None:
        problem, system = self.problem, self.problem.system
        for contact in system.contacts:
            motion.catch_up(contact)
        state = [body.u.x.array.copy() for body in problem.bodies]
        known = [multipliers.known(contact) for contact in system.contacts]
        measures = [gap.state.measure for gap in system.gaps]
        equations = problem.equations()
        loop, balance = OneNewton(equations), ToolBalance(system)
        count = 0
        try:
            z = self._begin(equations, balance)
            try:
                z = loop.solve(z)
            except (NoConvergence, NoGapError):
                if self._start is None:
                    raise
                count += loop.num_iterations
                self.num_retries += 1
                z = loop.solve(self._begin_again(equations, z))
            count += loop.num_iterations
            for _ in range(MAX_MEASURES):
                if not system.have_areas_changed(SAME_AREA):
                    break
                equations.forget()
                z = loop.solve(z)
                count += loop.num_iterations
            self._keep(equations, z)
            equations.accept(z)
        except (NoConvergence, NoGapError) as error:
            for contact, values in zip(system.contacts, known, strict=True):
                multipliers.set_known(contact, values)
            for gap, measure in zip(system.gaps, measures, strict=True):
                gap.state.measure = measure
            balance.restore()
            for body, array in zip(problem.bodies, state, strict=True):
                body.u.x.array[:] = array
            problem.newton.record.iterations = count + loop.num_iterations
            raise problem.newton.error_of(str(error)) from error
        finally:
            loop.destroy()
            self._start = None
        problem.newton.record.iterations = count
        self.counts.append(count)

    def _begin(self, equations: Equations, balance: ToolBalance) -> Array:
        """Unknowns to begin with. Collective."""
        system = equations.system
        z = equations.first()
        warm = any(np.any(values) for values in self._known)
        if not system.comm.allreduce(bool(warm), op=MPI.LOR):
            system.x.array[:] = equations.bodies_of(z)
            if balance.tools:
                balance.approach()
            guess(system)
            equations.restart()
            return equations.join(
                system.x.array_r.copy(),
                [p.rows.first() for p in equations.passes],
                np.zeros(len(equations.tools)),
            )
        for p, values, known in zip(
            equations.passes, equations.multipliers(z), self._known, strict=True
        ):
            if not p.model.augmented and not p.gap.law.jump and isinstance(p.gap.rows, NodeRows):
                values.normal[:] = np.maximum(p.gap.rows.from_sides(known), 0.0)
        return z

    def _begin_again(self, equations: Equations, z: Array) -> Array:
        """The same multipliers, where the bodies were when the step began."""
        assert self._start is not None
        x = equations.unknowns_of(self._start)
        none = np.zeros(len(equations.tools))
        return equations.join(x, equations.multipliers(z), none)

    def _keep(self, equations: Equations, z: Array) -> None:
        """Keep λ at all nodes for the next solve, which may have other pairs. Collective."""
        self._known = []
        for p, e in zip(equations.passes, equations.evaluate(z).passes, strict=True):
            assert isinstance(p.gap.rows, NodeRows)
            normal = np.where(e.active[:, None], e.multipliers.normal, 0.0)
            self._known.append(p.gap.rows.on_sides(normal))
