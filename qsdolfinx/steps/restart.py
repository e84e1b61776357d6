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
from qsdolfinx.contact import memory
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.carried import normals_of_nodes
from qsdolfinx.steps.checkpoint import Checkpoint
from qsdolfinx.steps.end_of_step import go_on_at, show_at
from qsdolfinx.steps.stepper import TimeStepper
from qsdolfinx.steps.stored_mesh import stored
from qsdolfinx.steps.stored_points import load_points, stored_points
from qsdolfinx.steps.stored_vertices import (
    areas_of_vertices,
    load_vertices,
    parts_at_vertices,
    stored_vertices,
)
from qsdolfinx.steps.tool_motion import ToolRate
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

_SCALARS = ("t", "dt", "last_dt", "num_steps", "num_cutbacks")


def save_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
    values: typing.Mapping[str, typing.Any] | None = None,
) -> None:
    """Write a checkpoint with all data that the next steps need. Collective; see Checkpoint.save.

    With remeshing, the meshes of the bodies are also written, see :func:`qs.load_meshes`.

    Args:
        stepper: The run, after a step.
        folder: Folder of the checkpoint. An existing checkpoint is replaced when the new one is
            complete.
        functions: Your own functions, such as accumulated strains; also at quadrature points, such
            as ``J2Plasticity.state``. A warning names functions at quadrature points that are in
            the forms, but not given here.
        values: Your own numbers, such as accumulated work; they must be writable as JSON.
    """
    _check(stepper, folder, functions, values)
    _look_for_states(stepper, functions or {})
    state: dict[str, typing.Any] = {name: getattr(stepper, name) for name in _SCALARS}
    state["positions"] = [tool.position.tolist() for tool in stepper.tools]
    state["tool_rates"] = [[x.tolist() for x in rate] for rate in stepper.tool_rates]
    models = [contact.model for contact in stepper.problem.contacts]
    state["contacts"] = [{q.name: q.read() for q in memory.of_contact(m)} for m in models]
    state["kinds"] = [_kind(model) for model in models]
    state["laws"] = [memory.names(model) for model in models]
    state["log"] = stepper.log.stored()
    state["user"] = dict(values or {})
    state["num_temperatures"] = _num_temperatures(stepper)
    if stepper.remeshing is not None:
        state["num_bodies"] = len(stepper.motions)
        state["remeshed_at"] = stepper.remeshed_at
    Checkpoint(stepper.problem.comm, folder).save(
        _functions(stepper, functions) | _of_nodes(models),
        _meshes(stepper),
        state,
        stored(stepper),
        _points(models),
    )


def _look_for_states(stepper: TimeStepper, saved: typing.Mapping[str, fem.Function]) -> None:
    """Warn if forms depend on functions at quadrature points that are not saved."""
    kept = {id(function) for function in saved.values()}
    lost = sorted(
        f"{function.name!r} of u[{i}]"
        for i, body in enumerate(stepper.problem.system.bodies)
        for function in body.at_points()
        if id(function) not in kept
    )
    if lost:
        warn(
            f"functions: the forms depend on {', '.join(lost)}, not contained in the checkpoint: "
            "give these functions to save_run and load_run, such as the state of a J2Plasticity",
            ContactWarning,
        )


def load_run(
    stepper: TimeStepper,
    folder: str | pathlib.Path,
    functions: typing.Mapping[str, fem.Function] | None = None,
) -> dict[str, typing.Any]:
    """Continue from a checkpoint, on any number of ranks. Collective.

    Contacts with finite sliding have the gaps and forces of the end of the run. With small sliding,
    contact detection is done at the positions at which the run ended, and gaps and forces are then
    those of the saved multipliers: they differ from the saved forces by the change of areas and
    normals since the contact detection of the last step. With a penalty they are those of the gaps
    at these positions. The difference may be larger on a curved tool, and a corner of a tool that
    is not paired there has no force until the next step. Friction that depends on slip rates has no
    traction, and no constraint slips, until the next step, since slip begins there; a warning says
    so. Later steps are as without interruption.

    Args:
        stepper: The run, set up exactly as before; on the meshes of :func:`qs.load_meshes` if it
            was remeshed. Forces on tools (``tool.drive``), loads and Dirichlet values are not in
            the checkpoint: set them again, as the stepper's ``drive`` does in each step.
        folder: Folder of the checkpoint.
        functions: As for save_run.

    Returns:
        The ``values`` that were given to save_run.

    Raises:
        OSError: If there is no checkpoint.
        ValueError: If the checkpoint is of another run; nothing is changed then.
    """
    _check(stepper, folder, functions, {})
    models = [contact.model for contact in stepper.problem.contacts]
    meshes = _meshes(stepper)
    of_nodes = _of_nodes(models)
    functions_of_run = _functions(stepper, functions)
    checkpoint = Checkpoint(stepper.problem.comm, folder)
    values = checkpoint.values()
    for name, mine in (("positions", stepper.tools), ("contacts", models)):
        as_many = len(values.get(name, ())) == len(mine)
        require(as_many, f"stepper: the checkpoint {folder} is of other contacts or tools")
    for i, (saved, model) in enumerate(zip(values["kinds"], models, strict=True)):
        text = f"{saved} in the checkpoint {folder}, not {_kind(model)}"
        require(saved == _kind(model), f"stepper: {model.called(i)} is {text}")
    laws = [memory.names(model) for model in models]
    text = f"stepper: the laws of the checkpoint {folder} remember {values['laws']}, not {laws}"
    require(values["laws"] == laws, text)
    temperatures = values.get("num_temperatures", 0)
    text = f"stepper: the checkpoint {folder} has {temperatures} temperatures; give it staggered="
    require(temperatures == _num_temperatures(stepper), f"{text} as before")
    checkpoint.load(functions_of_run | of_nodes, meshes)
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
        go_on_at(*place)
    for i, (model, saved) in enumerate(zip(models, values["contacts"], strict=True)):
        memory.write(memory.of_contact(model), saved)
        for q in [*areas_of_vertices(model), *memory.of_nodes(model)]:
            # The next step rotates τ̂ to its tangent planes; rotating it here, too, would change
            # it.
            q.write(_read(q.slave, of_nodes, _name(i, q.name), q.read().shape[1]))
        for j in _at_points(model):
            slip = model.slips[j]
            width = normals_of_nodes(slip).shape[1]
            normals = _read(slip.slave, of_nodes, _name(i, f"normal_{j}"), width)
            load_points(slip, normals, checkpoint, f"points_{i}_{j}")
        for j, part, gap in parts_at_vertices(model):
            load_vertices(part, gap, checkpoint, f"vertices_{i}_{j}")
    for place in stepper.ends():
        show_at(*place)
    _warn_of_rates(models)
    return typing.cast(dict[str, typing.Any], values["user"])


def _warn_of_rates(models: typing.Sequence[ContactModel]) -> None:
    """Warn if forces shown before the next step lack friction that depends on slip rates."""
    laws = {
        model.called(i): type(model.friction.law).__name__
        for i, model in enumerate(models)
        if model.friction is not None and model.friction.law.needs_dt
    }
    if laws:
        warn(
            f"{', '.join(laws)}: forces, tractions and slip shown before the next step are without "
            f"the friction of {', '.join(sorted(set(laws.values())))}, since nothing slips at the "
            "start of a step: read them before save_run, or after a step, which is as without "
            "interruption",
            ContactWarning,
        )


def _check(
    stepper: typing.Any, folder: typing.Any, functions: typing.Any, values: typing.Any
) -> None:
    """Raise an error for arguments of a wrong type or that differ between ranks. Collective."""
    check(instance(TimeStepper, "a TimeStepper"), stepper=stepper)
    with checked(stepper.problem.comm) as same:
        check(PATH, folder=folder)
        check(either(MAPPING, None), functions=functions, values=values)
        check(FUNCTION, **{f"functions: {name!r}": f for name, f in (functions or {}).items()})
        try:
            json.dumps(dict(values or {}))
        except (TypeError, ValueError) as error:
            raise TypeError(f"values: must be writable as JSON: {error}") from None
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


def _meshes(stepper: TimeStepper) -> dict[str, tuple[mesh.Mesh, npt.NDArray[np.float64]]]:
    return {f"x_{i}": (m.mesh, m.reference.copy()) for i, m in enumerate(stepper.motions)}


def _kind(model: ContactModel) -> str:
    """Describe the kind of history variables of a contact, for comparison with a checkpoint."""
    friction = "without friction" if model.friction is None else "with friction"
    return f"{model.settings.formulation} {friction}"


def _of_nodes(models: typing.Sequence[ContactModel]) -> dict[str, fem.Function]:
    """Nodal history variables of contacts, functions of degree 1, gdim columns each. Collective."""
    out: dict[str, fem.Function] = {}
    for i, model in enumerate(models):
        for q in [*areas_of_vertices(model), *memory.of_nodes(model)]:
            out |= _written(q.slave, q.read(), _name(i, q.name))
        for j in _at_points(model):
            slip = model.slips[j]
            out |= _written(slip.slave, normals_of_nodes(slip), _name(i, f"normal_{j}"))
    return out


def _name(i: int, name: str) -> str:
    """Name of a quantity of a contact."""
    return f"contact_{i}_{name}"


def _written(slave: Surface, values: Array, name: str) -> dict[str, fem.Function]:
    """Nodal values as functions with numbered names. Collective."""
    surface = slave.linear
    parts = range(0, values.shape[1], surface.gdim)
    columns = [_padded(values[:, k : k + surface.gdim], surface.gdim) for k in parts]
    return {f"{name}_{k}": surface.function(values) for k, values in enumerate(columns)}


def _read(
    slave: Surface, functions: typing.Mapping[str, fem.Function], name: str, width: int
) -> Array:
    """Read the values that :func:`_written` has written, (nodes, width). Collective."""
    surface = slave.linear
    count = -(-width // surface.gdim)
    values = [surface.node_values(functions[f"{name}_{k}"]) for k in range(count)]
    return np.ascontiguousarray(np.hstack(values)[:, :width])


def _at_points(model: ContactModel) -> list[int]:
    """Indices of the slips with constraints at points."""
    return [j for j, slip in enumerate(model.slips) if slip.gap.rows.are_points]


def _points(models: typing.Sequence[ContactModel]) -> dict[str, tuple[Indices, Array]]:
    """Values of points of slips and of a tool's vertices, beside nodal values. Collective."""
    out: dict[str, tuple[Indices, Array]] = {}
    for i, model in enumerate(models):
        out |= {f"points_{i}_{j}": stored_points(model.slips[j]) for j in _at_points(model)}
        for j, part, gap in parts_at_vertices(model):
            out[f"vertices_{i}_{j}"] = stored_vertices(part, gap)
    return out


def _padded(values: Array, gdim: int) -> Array:
    """Append columns of zeros up to gdim columns."""
    return np.pad(values, ((0, 0), (0, gdim - values.shape[1])))


def _num_temperatures(stepper: TimeStepper) -> int:
    return 0 if stepper.staggered is None else len(stepper.staggered.before)
