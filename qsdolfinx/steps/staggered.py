"""A second problem, such as of temperatures, that is solved after the bodies in each time step."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.checks import FUNCTION, check, instance, require
from qsdolfinx.base.collective import checked
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.end_of_step import Place, moved
from qsdolfinx.system.body import Body

Array = npt.NDArray[np.float64]


LIST = instance((list, tuple), "a list of dolfinx.fem.Function")


class Staggered:
    """Heat after motion: with T of the step's start the bodies move, then T is solved for.

    The isothermal split, of order 1 in Δt, as backward Euler is, which :func:`qs.materials.heat`
    has: the bodies see the temperature of the step's start, and the heat of the step, from plastic
    work and friction, is that of the motion just found. Temperatures belong to the material, as the
    meshes of bodies in velocities move with it. If either solve fails the step is made again.

    Args:
        problem: Of the temperatures, on the meshes of the bodies or of tools. Its contacts have the
            pairs of the bodies' ones if made with ``of``, else they pair where bodies are.
        before: Temperature at the start of the step for each unknown of the problem, as its form
            has it; here it is set to the result when a step is accepted.
        dt: Constants of the forms that are Δt (time), set before each solve.

    Raises:
        TypeError: If something is of another type.
        ValueError: If ``before`` has another number of functions, or one of another space.
    """

    def __init__(
        self,
        problem: ContactProblem,
        before: typing.Sequence[fem.Function],
        dt: fem.Constant | typing.Sequence[fem.Constant] = (),
    ) -> None:
        check(instance(ContactProblem, "a ContactProblem"), problem=problem)
        with checked(problem.comm):
            check(LIST, before=before)
            fits = len(before) == len(problem.u)
            require(fits, "before: must have one Function for each unknown of the problem")
            for u, old in zip(problem.u, before, strict=True):
                check(FUNCTION, before=old)
                same = u.function_space == old.function_space
                require(same, "before: must be in the spaces of the problem's unknowns")
                require(u is not old, "before: must be other Functions than the unknowns")
            constants = [dt] if isinstance(dt, (fem.Constant, int, float)) else list(dt)
            for constant in constants:
                check(instance(fem.Constant, "a dolfinx.fem.Constant"), dt=constant)
            rates = any(old in body.form.coefficients() for old, body in _pairs(before, problem))
            text = "dt: must be the Constant in the form that is the length of the step"
            require(not rates or len(constants) > 0, text)
        self.problem, self.before, self._dt = problem, list(before), constants

    def check(self, problem: ContactProblem) -> None:
        """Refuse to be solved after this problem.

        Raises:
            ValueError: If it is the same.
        """
        require(
            problem is not self.problem, "staggered: must be of another problem than the bodies'"
        )

    def begin(self) -> None:
        """Start from what there is before the first step."""
        for u, old in zip(self.problem.u, self.before, strict=True):
            u.x.array[:] = old.x.array

    def solve(self, dt: float, places: typing.Sequence[Place]) -> None:
        """Solve for the end of a step. Collective.

        Args:
            dt: Δt.
            places: Where the motion of the step has put bodies, for contacts that pair by
                themselves.

        Raises:
            ConvergenceError: If that fails.
        """
        for constant in self._dt:
            constant.value = dt
        for contact in self.problem.contacts:
            if contact.dt is not None:
                contact.set_dt(dt)
            mechanics = contact.model.mechanics
            if mechanics is None or not mechanics.shares_pairs:
                with moved(places):
                    contact.update()
        self.problem.solve()

    def accept(self) -> None:
        """Let the next step start from the result."""
        for u, old in zip(self.problem.u, self.before, strict=True):
            old.x.array[:] = u.x.array

    def restore(self) -> None:
        """Go back to where the step began."""
        self.begin()


def _pairs(
    before: typing.Sequence[fem.Function], problem: ContactProblem
) -> typing.Iterator[tuple[fem.Function, Body]]:
    return zip(before, problem.bodies, strict=True)
