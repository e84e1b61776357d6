"""Checkpoints of a run of time steps."""

from __future__ import annotations

import pathlib
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from qsdolfinx.checkpoint import Checkpoint
from qsdolfinx.contact import Contact
from qsdolfinx.stepper import TimeStepper

_SCALARS = ("t", "dt", "last_dt", "num_steps", "num_cutbacks")


def save_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
) -> None:
    """Write all that the steps to come depend on. Collective; see Checkpoint.save.

    Args:
        stepper: The run, after a step.
        folder: Folder of the checkpoint; one that is there is replaced when the new one is whole.
        functions: Functions of the user's own, such as accumulated strains.
    """
    multipliers = _multipliers(stepper.problem.contacts)
    values: dict[str, typing.Any] = {name: getattr(stepper, name) for name in _SCALARS}
    values["positions"] = [tool.position.tolist() for tool in stepper.tools]
    values["penalties"] = [contact.penalty for contact in stepper.problem.contacts]
    Checkpoint(stepper.problem.comm, folder).save(
        _functions(stepper, functions) | multipliers, _meshes(stepper), values
    )


def load_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
) -> None:
    """Go on from a checkpoint, on any number of ranks. Collective.

    Args:
        stepper: The run, made anew just as before.
        folder: Folder of the checkpoint.
        functions: As for save_run.

    Raises:
        OSError: If there is no checkpoint.
        ValueError: If it is of another run; nothing is changed then.
    """
    contacts = stepper.problem.contacts
    meshes = _meshes(stepper)
    multipliers = _multipliers(contacts)
    functions_of_run = _functions(stepper, functions)
    checkpoint = Checkpoint(stepper.problem.comm, folder)
    values = checkpoint.values()
    for name, mine in (("positions", stepper.tools), ("penalties", contacts)):
        if len(values.get(name, ())) != len(mine):
            raise ValueError(f"stepper: the checkpoint {folder} is of other contacts or tools")
    checkpoint.load(functions_of_run | multipliers, meshes)
    for motion, (_, x) in zip(stepper.motions, meshes.values(), strict=True):
        motion.set_reference(x)
    for name in _SCALARS:
        setattr(stepper, name, values[name])
    for tool, position in zip(stepper.tools, values["positions"], strict=True):
        tool.position = np.array(position)
    for i, rate in enumerate(stepper.rates):
        rate[:] = functions_of_run[f"rate_{i}"].x.array
    for i, (contact, penalty) in enumerate(zip(contacts, values["penalties"], strict=True)):
        if penalty is not None and contact.penalty is None:
            contact.set_automatic_penalty(penalty)
        arrays = []
        for j, p in enumerate(contact.passes):
            at_nodes = _at_nodes(p.slave.linear, multipliers[f"multiplier_{i}_{j}"])
            arrays.append(at_nodes[:, : p.augmented.shape[1]])
        contact.set_multipliers_on_nodes(arrays)


def _functions(
    stepper: TimeStepper, more: typing.Mapping[str, fem.Function] | None
) -> dict[str, fem.Function]:
    functions = {f"u_{i}": u for i, u in enumerate(stepper.problem.u)}
    for i, (u, rate) in enumerate(zip(stepper.problem.u, stepper.rates, strict=True)):
        functions[f"rate_{i}"] = fem.Function(u.function_space)
        functions[f"rate_{i}"].x.array[:] = rate
    return functions | {f"user_{name}": f for name, f in (more or {}).items()}


def _meshes(stepper: TimeStepper) -> dict[str, tuple[mesh.Mesh, npt.NDArray[np.float64]]]:
    return {f"x_{i}": (m.mesh, m.reference.copy()) for i, m in enumerate(stepper.motions)}


def _multipliers(contacts: typing.Sequence[Contact]) -> dict[str, fem.Function]:
    """λ̂ of all passes as functions of degree 1; normal ones in the first component."""
    out = {}
    for i, contact in enumerate(contacts):
        for j, (p, values) in enumerate(
            zip(contact.passes, contact.multipliers_on_nodes(), strict=True)
        ):
            surface = p.slave.linear
            padded = np.zeros((len(values), surface.gdim))
            padded[:, : values.shape[1]] = values
            out[f"multiplier_{i}_{j}"] = surface.function(padded)
    return out


def _at_nodes(surface: typing.Any, function: fem.Function) -> npt.NDArray[np.float64]:
    """Values of a function that ``surface.function`` made, at the nodes this rank owns."""
    with_numbers = surface.function(
        np.arange(surface.gdim * len(surface.node_area)).reshape(-1, surface.gdim) + 1.0
    )
    index_map = with_numbers.function_space.dofmap.index_map
    owned = index_map.size_local * with_numbers.function_space.dofmap.index_map_bs
    numbers = with_numbers.x.array[:owned]
    out = np.zeros(surface.gdim * len(surface.node_area))
    at = np.flatnonzero(numbers)
    out[np.rint(numbers[at]).astype(int) - 1] = function.x.array[at]
    return out.reshape(-1, surface.gdim)
