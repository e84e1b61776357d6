"""Checkpoints of a run of time steps."""

from __future__ import annotations

import json
import pathlib
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from qsdolfinx.base.checks import FUNCTION, MAPPING, PATH, check, either, instance, require
from qsdolfinx.base.collective import checked
from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.multipliers import (
    num_columns,
    on_nodes,
    pressures_on_nodes,
    set_on_nodes,
    set_pressures_on_nodes,
)
from qsdolfinx.friction.carried import normals_of_nodes
from qsdolfinx.steps.checkpoint import Checkpoint
from qsdolfinx.steps.end_of_step import pair_at, show_at
from qsdolfinx.steps.stepper import TimeStepper
from qsdolfinx.steps.stored_mesh import stored
from qsdolfinx.steps.stored_points import load_points, stored_points
from qsdolfinx.steps.tool_motion import ToolRate

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_SCALARS = ("t", "dt", "last_dt", "num_steps", "num_cutbacks")


def save_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
    values: typing.Mapping[str, typing.Any] | None = None,
) -> None:
    """Write all that the steps to come depend on. Collective; see Checkpoint.save.

    With a stepper that makes new meshes also these, see :func:`qs.load_meshes`.

    Args:
        stepper: The run, after a step.
        folder: Folder of the checkpoint; an existing one is replaced when the new one is whole.
        functions: Functions of the user's own, such as accumulated strains; also at quadrature
            points, such as ``J2Plasticity.state``. There is a warning of those that forms have and
            that are not among them.
        values: Numbers of the user's own, such as accumulated work; what JSON can hold.
    """
    _check(stepper, folder, functions, values)
    _look_for_states(stepper, functions or {})
    multipliers = _multipliers(stepper.problem.contacts)
    state: dict[str, typing.Any] = {name: getattr(stepper, name) for name in _SCALARS}
    state["positions"] = [tool.position.tolist() for tool in stepper.tools]
    state["tool_rates"] = [[x.tolist() for x in rate] for rate in stepper.tool_rates]
    state["penalties"] = [contact.penalty for contact in stepper.problem.contacts]
    penalties = [contact.model.penalty for contact in stepper.problem.contacts]
    state["of_points"] = [(p.of_points, p.of_slips) for p in penalties]
    state["stiffness"] = [p.stiffness for p in penalties]
    state["automatic"] = [contact.has_automatic_penalty for contact in stepper.problem.contacts]
    state["dissipated"] = [contact.dissipated_energy() for contact in stepper.problem.contacts]
    state["slip_rates"] = [_slip_rate(contact) for contact in stepper.problem.contacts]
    state["log"] = stepper.log.stored()
    state["user"] = dict(values or {})
    state["num_temperatures"] = _num_temperatures(stepper)
    if stepper.remeshing is not None:
        state["num_bodies"] = len(stepper.motions)
        state["remeshed_at"] = stepper.remeshed_at
    Checkpoint(stepper.problem.comm, folder).save(
        _functions(stepper, functions) | multipliers,
        _meshes(stepper),
        state,
        stored(stepper),
        _points(stepper.problem.contacts),
    )


def _look_for_states(stepper: TimeStepper, saved: typing.Mapping[str, fem.Function]) -> None:
    """Warn of functions at quadrature points that forms depend on and that are not saved."""
    kept = {id(function) for function in saved.values()}
    lost = sorted(
        f"{function.name!r} of u[{i}]"
        for i, body in enumerate(stepper.problem.system.bodies)
        for function in body.at_points()
        if id(function) not in kept
    )
    if lost:
        warn(
            f"functions: the forms depend on {', '.join(lost)}, which the checkpoint does not "
            "hold; give them to save_run and load_run, such as the state of a J2Plasticity",
            ContactWarning,
        )


def load_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
) -> dict[str, typing.Any]:
    """Continue from a checkpoint, on any number of ranks. Collective.

    Contacts are paired where the run ended, and show gaps and forces of the saved multipliers
    there: the saved ones, but for what areas and normals have changed since the last step paired;
    with a penalty those of the gaps there, which may differ by more on a curved tool.

    Args:
        stepper: The run, set up just as before; on the meshes of :func:`qs.load_meshes` if it has
            made new ones. Forces that drive tools (``tool.drive``), loads and
            Dirichlet values are not in the checkpoint: set them again, as the stepper's ``drive``
            does at each step.
        folder: Folder of the checkpoint.
        functions: As for save_run.

    Returns:
        The user's values that save_run was given.

    Raises:
        OSError: If there is no checkpoint.
        ValueError: If it is of another run; nothing is changed then.
    """
    _check(stepper, folder, functions, {})
    contacts = stepper.problem.contacts
    meshes = _meshes(stepper)
    multipliers = _multipliers(contacts)
    functions_of_run = _functions(stepper, functions)
    checkpoint = Checkpoint(stepper.problem.comm, folder)
    values = checkpoint.values()
    of_contacts = ("penalties", contacts), ("automatic", contacts)
    for name, mine in (("positions", stepper.tools), *of_contacts):
        as_many = len(values.get(name, ())) == len(mine)
        require(as_many, f"stepper: the checkpoint {folder} is of other contacts or tools")
    temperatures = values.get("num_temperatures", 0)
    text = f"stepper: the checkpoint {folder} has {temperatures} temperatures; give it staggered="
    require(temperatures == _num_temperatures(stepper), f"{text} as before")
    checkpoint.load(functions_of_run | multipliers, meshes)
    for motion, (_, x) in zip(stepper.motions, meshes.values(), strict=True):
        motion.set_reference(x)
    for name in _SCALARS:
        setattr(stepper, name, values[name])
    stepper.remeshed_at = values.get("remeshed_at", -1)
    stepper.log.restore(values.get("log", []))
    if stepper.staggered is not None:
        stepper.staggered.begin()
    for tool, position in zip(stepper.tools, values["positions"], strict=True):
        tool.position = np.array(position)
    for i, of_tool in enumerate(values["tool_rates"]):
        stepper.tool_rates[i] = ToolRate(*map(np.array, of_tool))
    for i, rate in enumerate(stepper.rates):
        rate[:] = functions_of_run[f"rate_{i}"].x.array
        stepper.missed[i] = functions_of_run[f"missed_{i}"].x.array.copy()
    for place in stepper.ends():
        pair_at(*place)
    for i, (contact, penalty) in enumerate(zip(contacts, values["penalties"], strict=True)):
        if penalty is not None and values["automatic"][i]:
            contact.model.penalty.set_automatic(penalty, "automatic, before the restart")
        elif penalty is not None:
            contact.set_penalty(penalty)
        penalty_of = contact.model.penalty
        penalty_of.of_points, penalty_of.of_slips = values["of_points"][i]
        penalty_of.stiffness = tuple(values["stiffness"][i]) if "stiffness" in values else ()
        arrays = []
        for j, part in enumerate(contact.model.parts):
            names = _names(i, j, num_columns(part), part.slave.gdim)
            at_nodes = [part.slave.linear.node_values(multipliers[name]) for name in names]
            arrays.append(np.hstack(at_nodes)[:, : num_columns(part)])
        # The next step turns τ̂ to its tangent planes; turned here as well it would be another.
        set_on_nodes(contact.model.parts, arrays, turn=False)
        _load_slip(contact.model, i, multipliers, values["dissipated"][i])
        for j in _at_points(contact.model):
            slip = contact.model.slips[j]
            names = _normals(i, j, slip.slave.gdim)
            normals = [slip.slave.linear.node_values(multipliers[name]) for name in names]
            load_points(slip, np.hstack(normals), checkpoint, f"points_{i}_{j}")
        if contact.model.friction is not None:
            contact.model.friction.continue_with(values["slip_rates"][i])
    for place in stepper.ends():
        show_at(*place)
    return typing.cast(dict[str, typing.Any], values["user"])


def _check(
    stepper: typing.Any, folder: typing.Any, functions: typing.Any, values: typing.Any
) -> None:
    """Refuse arguments of another type or that differ between ranks. Collective."""
    check(instance(TimeStepper, "a TimeStepper"), stepper=stepper)
    with checked(stepper.problem.comm) as same:
        check(PATH, folder=folder)
        check(either(MAPPING, None), functions=functions, values=values)
        check(FUNCTION, **{f"functions: {name!r}": f for name, f in (functions or {}).items()})
        try:
            json.dumps(dict(values or {}))
        except (TypeError, ValueError) as error:
            raise TypeError(f"values: must be what JSON can hold: {error}") from None
        same(folder=str(folder), functions=list(functions or {}))


def _functions(
    stepper: TimeStepper, more: typing.Mapping[str, fem.Function] | None
) -> dict[str, fem.Function]:
    functions = {f"u_{i}": u for i, u in enumerate(stepper.problem.u)}
    for i, (u, rate) in enumerate(zip(stepper.problem.u, stepper.rates, strict=True)):
        functions[f"rate_{i}"] = fem.Function(u.function_space)
        functions[f"rate_{i}"].x.array[:] = rate
        functions[f"missed_{i}"] = fem.Function(u.function_space)
        functions[f"missed_{i}"].x.array[:] = stepper.missed[i]
    staggered = [] if stepper.staggered is None else stepper.staggered.before
    functions |= {f"staggered_{i}": before for i, before in enumerate(staggered)}
    return functions | {f"user_{name}": f for name, f in (more or {}).items()}


#: What contacts keep of the start of a step, see ``pressures_on_nodes``.
_OF_START = "pressed", "covered", "moved"


def _meshes(stepper: TimeStepper) -> dict[str, tuple[mesh.Mesh, npt.NDArray[np.float64]]]:
    return {f"x_{i}": (m.mesh, m.reference.copy()) for i, m in enumerate(stepper.motions)}


def _multipliers(contacts: typing.Sequence[Contact]) -> dict[str, fem.Function]:
    """λ̂, τ̂, slip and pressure as functions of degree 1; normal ones in the first component."""
    out = {}
    for i, contact in enumerate(contacts):
        for j, (part, values) in enumerate(
            zip(contact.model.parts, on_nodes(contact.model.parts), strict=True)
        ):
            surface = part.slave.linear
            names = _names(i, j, values.shape[1], surface.gdim)
            padded = _padded(values, len(names) * surface.gdim)
            for name, columns in zip(names, np.hsplit(padded, len(names)), strict=True):
                out[name] = surface.function(columns)
        if contact.model.friction is not None:
            slipped = contact.model.friction.slipped
            for j, (slip, values) in enumerate(zip(contact.model.slips, slipped, strict=True)):
                out[f"slip_{i}_{j}"] = slip.slave.linear.function(values)
            for j, values in enumerate(pressures_on_nodes(contact.model)):
                surface = contact.model.slips[j].slave.linear
                for name, columns in zip(_OF_START, np.split(values, [2, 3], axis=1), strict=True):
                    padded = _padded(columns, surface.gdim)
                    out[f"{name}_{i}_{j}"] = surface.function(padded)
            for j in _at_points(contact.model):
                surface = contact.model.slips[j].slave.linear
                normals = np.hsplit(normals_of_nodes(contact.model.slips[j]), surface.gdim)
                names = _normals(i, j, surface.gdim)
                out |= {n: surface.function(v) for n, v in zip(names, normals, strict=True)}
    return out


def _at_points(model: ContactModel) -> list[int]:
    """Numbers of the slips with rows at points."""
    return [j for j, slip in enumerate(model.slips) if slip.gap.rows.are_points]


def _normals(i: int, j: int, gdim: int) -> list[str]:
    """Names of the functions that hold the normals of the sides of nodes."""
    return [f"normal_{i}_{j}_{k}" for k in range(gdim)]


def _points(contacts: typing.Sequence[Contact]) -> dict[str, tuple[Indices, Array]]:
    """What points of slips have beyond their nodes. Collective."""
    models = [contact.model for contact in contacts]
    return {
        f"points_{i}_{j}": stored_points(model.slips[j])
        for i, model in enumerate(models)
        for j in _at_points(model)
    }


def _padded(values: Array, gdim: int) -> Array:
    """With columns of zeros, so that there are gdim."""
    return np.pad(values, ((0, 0), (0, gdim - values.shape[1])))


def _num_temperatures(stepper: TimeStepper) -> int:
    return 0 if stepper.staggered is None else len(stepper.staggered.before)


def _slip_rate(contact: Contact) -> float | None:
    """Largest slip rate that friction knows of."""
    friction = contact.model.friction
    return None if friction is None else friction.rate


def _names(i: int, j: int, num_columns: int, gdim: int) -> list[str]:
    """Names of the functions that hold a part's multipliers, ``gdim`` columns each."""
    more = range(1, -(-num_columns // gdim))
    return [f"multiplier_{i}_{j}", *(f"multiplier_{i}_{j}_{k}" for k in more)]


def _load_slip(
    model: ContactModel, i: int, functions: dict[str, fem.Function], dissipated: float
) -> None:
    """Put back what friction has done so far, if there is any."""
    if model.friction is None:
        return
    pressed = []
    for j, slip in enumerate(model.slips):
        surface = slip.slave.linear
        model.friction.slipped[j] = surface.node_values(functions[f"slip_{i}_{j}"])
        starts = [functions[f"{name}_{i}_{j}"] for name in _OF_START]
        pressure, cover, moved = (np.asarray(surface.node_values(f)) for f in starts)
        pressed.append(np.column_stack([pressure[:, :2], cover[:, 0], moved]))
    set_pressures_on_nodes(model, pressed)
    model.friction.dissipated = dissipated if model.comm.rank == 0 else 0.0
