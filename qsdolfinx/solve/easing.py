"""Loads that are put on gradually, where Newton's method fails with all of them at once."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base import interrupt
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Part of the way at first, and the smallest that is tried.
FIRST, SMALLEST = 0.25, 1 / 64

#: Runs at most.
MAX_RUNS = 30


def ease(
    system: ContactSystem, first_guess: PETSc.Vec, run: typing.Callable[[Array | None], bool]
) -> bool:
    """Follow R(u) = (1 − s) R(u₀) from the first guess u₀ to s = 1. Collective.

    Dirichlet values are (1 − s) u₀ + s g: where all is solved for with s = 0, whatever acts on u₀,
    overlaps included, is put on as s grows. Steps of s are halved where Newton's method fails.

    Args:
        system: The system; it ends where the last run does.
        first_guess: u₀.
        run: Solves from ``system.x``, but for a part of the residual; whether it converges.

    Returns:
        Whether s = 1 has been solved for.
    """
    first_guess.copy(system.x)
    for body, part in zip(system.bodies, system.parts(first_guess.array_r), strict=True):
        body.set_unknowns(part)
    start = [body.u.x.array.copy() for body in system.bodies]
    try:
        _set_conditions(system, 0.0, start)
        unbalanced = system.residual(first_guess.array_r).copy()
        s, step, good = 0.0, FIRST, first_guess.array_r.copy()
        for _ in range(MAX_RUNS):
            interrupt.look(system.comm)
            to = 1.0 if s + step > 1 - SMALLEST / 2 else s + step
            _set_conditions(system, to, start)
            system.x.array[:] = good
            if run((1 - to) * unbalanced if to < 1 else None):
                if to == 1:
                    return True
                s, step, good = to, 2 * step, system.x.array_r.copy()
            elif step > SMALLEST:
                step = min(step, 1 - s) / 2
            else:
                break
    finally:
        for body in system.bodies:
            body.begin_solve()
    return False


def _set_conditions(system: ContactSystem, part: float, start: list[Array]) -> None:
    """Let Dirichlet values go a part of their way. Collective."""
    for body, values in zip(system.bodies, start, strict=True):
        body.begin_solve(part, values)
