"""Part of the last step's motion that predicts the start of the next step."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import results
from qsdolfinx.contact.shown import shown
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.tool_motion import ToolRate
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]

#: Part of the motion of a step that counts as nothing: a prediction by less begins at the end of
#: the last step, and an error of less does not swing. Solvers leave residuals of some 1e-9 of the
#: forces, so that it must not be as small as that.
NOTHING = 1e-3


def part_of_rates(
    problem: ContactProblem,
    in_velocity: typing.Sequence[bool],
    rates: typing.Sequence[Array],
    tools: typing.Sequence[RigidSurface],
    tool_rates: typing.Sequence[ToolRate],
    dt: float,
) -> float:
    """Part, from 0 to 1, of the last step's motion that this step's loads continue. Collective.

    Let R be the residual at the present positions of the bodies, under the new loads and conditions
    and the contact forces of the last step. Let R₁ be the residual at the positions given by the
    last velocities v. The potential energy along this path has its minimum after the part -R·v /
    (R₁ - R)·v. The part is 1 if loads continue as before, and 0 if they are constant, reverse, or
    act across v: a step without a change of loads begins, and ends, in the present equilibrium.

    Tools act on bodies by contact alone, so the part of the tools' own motion is used if it is
    larger. Velocity-based bodies and force-controlled tools continue as before. All bodies continue
    as before if a contact has no updated geometry: small sliding, with contact detection at the
    positions given by the last velocities, ties and scalar fields.

    Args:
        problem: The problem, after the loads of the step have been set.
        in_velocity: Whether the unknowns of each body are velocities.
        rates: Velocities of the bodies in the last step (length per time), including ghosts.
        tools: The rigid tools.
        tool_rates: Velocities of the tools.
        dt: Δt of the step.
    """
    if any(in_velocity) or any(tool.driven is not None for tool in tools):
        return 1.0
    if not all(contact.follows for contact in problem.system.contacts):
        return 1.0
    largest = max((float(np.abs(v).max(initial=0.0)) for v in rates), default=0.0)
    if problem.comm.allreduce(largest, op=MPI.MAX) == 0.0:
        return 1.0
    of_tools = [_part_of_tool(tool, rate, dt) for tool, rate in zip(tools, tool_rates, strict=True)]
    part = max([_part_of_bodies(problem, rates, dt), *of_tools])
    return part if part > NOTHING else 0.0


def _part_of_tool(tool: RigidSurface, rate: ToolRate, dt: float) -> float:
    """Part of a tool's last motion that its next motion continues; 0 if it did not move."""
    before = dt * np.concatenate([rate.displacement, rate.rotation])
    if not np.any(before):
        return 0.0
    now = np.concatenate([tool.displacement, tool.rotation])
    return float(np.clip(now @ before / (before @ before), 0.0, 1.0))


def _part_of_bodies(problem: ContactProblem, rates: typing.Sequence[Array], dt: float) -> float:
    work = change = 0.0
    for body, force, v in zip(problem.bodies, _contact_forces(problem), rates, strict=True):
        start = body.u.x.array.copy()
        body.begin_solve()
        owned = start[: body.num_owned]
        way = dt * v[: body.num_owned]
        here = body.residual(owned.copy()) - force
        there = body.residual(owned + way) - force
        work -= float(here @ way)
        change += float((there - here) @ way)
        body.u.x.array[:] = start
    work, change = (problem.comm.allreduce(x, op=MPI.SUM) for x in (work, change))
    if not np.isfinite(change) or change == 0.0:
        return 0.0
    return float(np.clip(work / change, 0.0, 1.0))


def _contact_forces(problem: ContactProblem) -> list[Array]:
    """Forces of the last step's contact on the owned unknowns of each body. Collective."""
    out: list[Array] = [np.zeros(body.num_owned) for body in problem.bodies]
    for contact, sides in zip(problem.system.contacts, problem.sides, strict=True):
        for i, force in zip(sides, results.forces_on_bodies(shown(contact)), strict=False):
            if i is not None:
                out[i] += force
    return out
