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
    """Staggered thermo-mechanical coupling: in each step, temperatures are solved after motion.

    This is the isothermal split, of order 1 in Δt, as the backward Euler method of
    :func:`qs.materials.heat`. The bodies move with the temperature at the start of the step. The
    heat of the step, from plastic work and friction, is then that of the motion just found.
    Temperatures move with the material, since the meshes of velocity-based bodies move with it. If
    either solve fails, the step is made again.

    Args:
        problem: Problem for the temperatures, on the meshes of the bodies or of tools. Its contacts
            use the contact pairs of the mechanical contacts if they were made with ``mechanics``;
            otherwise they have their own contact detection at the positions of the bodies.
        before: Temperature at the start of the step for each unknown of the problem: the Function
            in its form. It is set to the result when a step is accepted.
        dt: Constants in the forms that are Δt (time); set before each solve.

    Raises:
        TypeError: If an argument is of another type.
        ValueError: If ``before`` has another number of functions, or a function of another space.
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
            text = "dt: give the Constant of the form that is the length Δt of the step"
            require(not rates or len(constants) > 0, text)
        self.problem, self.before, self._dt = problem, list(before), constants

    def check(self, problem: ContactProblem) -> None:
        """Check that this is not the problem of the bodies.

        Raises:
            ValueError: If it is.
        """
        require(
            problem is not self.problem, "staggered: needs a problem other than that of the bodies"
        )

    def begin(self) -> None:
        """Set the unknowns to the temperatures before the first step."""
        for u, old in zip(self.problem.u, self.before, strict=True):
            u.x.array[:] = old.x.array

    def solve(self, dt: float, places: typing.Sequence[Place]) -> None:
        """Solve for the end of a step. Collective.

        Args:
            dt: Δt.
            places: Positions of the bodies after the motion of the step, for contacts with their
                own contact detection.

        Raises:
            ConvergenceError: If the solve fails.
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
        """Accept the result as the start of the next step."""
        for u, old in zip(self.problem.u, self.before, strict=True):
            old.x.array[:] = u.x.array

    def restore(self) -> None:
        """Go back to where the step began."""
        self.begin()


def _pairs(
    before: typing.Sequence[fem.Function], problem: ContactProblem
) -> typing.Iterator[tuple[fem.Function, Body]]:
    return zip(before, problem.bodies, strict=True)
