"""Continuation in the rate sensitivity of viscoplastic bodies."""

from __future__ import annotations

import contextlib
import math
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base import interrupt
from qsdolfinx.base.checks import check, instance, number, require
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import multipliers
from qsdolfinx.contact.motion import catch_up
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.solve.snes import ConvergenceError

Array = npt.NDArray[np.float64]

TARGET = number("above 0 and at most 1", lambda m: 0 < m <= 1)

#: Largest factor between the rate sensitivities of two solves. With much more, a solve starts too
#: far away; with less, there are more solves.
FACTOR = 4.0

#: Smallest step of the continuation, relative to the whole. With much less, a problem without a
#: solution would be solved hundreds of times.
SMALLEST_STEP = 1 / 64


def solve_with_continuation(
    problem: ContactProblem,
    m: fem.Constant | typing.Sequence[fem.Constant],
    target: float | typing.Sequence[float],
) -> list[tuple[float, int]]:
    """Solve a problem with Norton-Hoff bodies by continuation in the rate sensitivity. Collective.

    The first solve is with m = 1, whose solution does not depend on the initial guess. Then all m
    are lowered as powers of their targets, m = target^s with s from 0 to 1. A step in s that fails
    is halved. If all m are at their targets and the bodies are not at rest (later steps of a
    loading history), a solve with the targets from the present unknowns is tried first.

    Args:
        problem: The problem; its forms contain the Constants ``m``.
        m: Rate sensitivity of one body, or a list for several bodies.
        target: Values that ``m`` is to reach, above 0 and at most 1.

    Returns:
        Each s that was solved for, with its number of Newton iterations.

    Raises:
        ConvergenceError: If the smallest step fails; unknowns, multipliers and m are as before.
    """
    check(instance(ContactProblem, "a ContactProblem"), problem=problem)
    constants = [m] if isinstance(m, fem.Constant) else m
    values = [target] if isinstance(target, (int, float, np.number)) else target
    with checked(problem.comm) as same:
        _check(constants, values)
        targets = [float(value) for value in values]
        same(target=targets)

    def set_to(s: float) -> None:
        for constant, value in zip(constants, targets, strict=True):
            constant.value = value**s

    for contact in problem.contacts:
        catch_up(contact.model)
    start = [u.x.array.copy() for u in problem.u]
    known = [multipliers.known(contact.model) for contact in problem.contacts]
    before = [constant.value.item() for constant in constants]
    with interrupt.heeded(problem.comm), problem.one_step():
        try:
            moving = problem.comm.allreduce(any(np.any(x) for x in start), op=MPI.LOR)
            if moving and before == targets:
                with contextlib.suppress(ConvergenceError):
                    problem.solve()
                    return [(1.0, problem.num_iterations)]
                _restore(problem, start, known)
            return _follow(problem, set_to, min(targets))
        except BaseException:
            _restore(problem, start, known)
            for constant, value in zip(constants, before, strict=True):
                constant.value = value
            raise


def _restore(
    problem: ContactProblem, start: typing.Sequence[Array], known: list[list[multipliers.Known]]
) -> None:
    """Restore unknowns and multipliers."""
    for u, array in zip(problem.u, start, strict=True):
        u.x.array[:] = array
    for contact, kept in zip(problem.contacts, known, strict=True):
        multipliers.set_known(contact.model, kept)


def _follow(
    problem: ContactProblem, set_to: typing.Callable[[float], None], smallest: float
) -> list[tuple[float, int]]:
    """Solve for s = 0, and then on to s = 1."""
    set_to(0.0)
    problem.solve()
    if smallest == 1:
        return [(1.0, problem.num_iterations)]
    solved = [(0.0, problem.num_iterations)]
    step = 1 / math.ceil(math.log(1 / smallest) / math.log(FACTOR))
    while solved[-1][0] < 1:
        s = solved[-1][0] + step
        s = 1.0 if s > 1 - step / 2 else s  # no tiny last step from rounding
        set_to(s)
        try:
            problem.solve()
        except ConvergenceError:
            step /= 2
            if step < SMALLEST_STEP:
                raise
        else:
            solved.append((s, problem.num_iterations))
    return solved


def _check(constants: typing.Any, values: typing.Any) -> None:
    """Check that m is a list of scalar Constants, with a target for each."""
    scalar = isinstance(constants, typing.Sequence) and all(
        isinstance(constant, fem.Constant) and constant.value.size == 1 for constant in constants
    )
    require(scalar, "m: must be a scalar dolfinx.fem.Constant, or a list of them", TypeError)
    as_many = isinstance(values, typing.Sequence) and len(values) == len(constants) > 0
    require(as_many, "target: must be a number, or a list with one for each m")
    for value in values:
        check(TARGET, target=value)
