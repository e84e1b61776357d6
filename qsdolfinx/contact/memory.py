"""History variables of a contact: a single list, for checkpoints and remeshing.

Checkpoints and remeshing know multipliers, friction and a user's law only through this list.
"""

from __future__ import annotations

import dataclasses
import functools
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import multipliers
from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel, Part
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class OfNodes:
    """History variable at the owned slave nodes of an integration side.

    Attributes:
        name: Unique name within the contact, with the number of the integration side.
        slave: The surface.
        read: Returns the values, shape (nodes, columns). Collective.
        write: Sets the values.
        fit: Converts means computed on another mesh to valid values of this kind.
    """

    name: str
    slave: Surface
    read: typing.Callable[[], Array]
    write: typing.Callable[[Array], None]
    fit: typing.Callable[[Array], Array] = lambda values: values


@dataclasses.dataclass(frozen=True)
class OfContact:
    """History variable of the whole contact: a number or other JSON data, the same on all ranks.

    Attributes:
        name: Of the contact's own.
        read: Returns the value. Collective.
        write: Sets the value. Collective.
        of_mesh: Whether the value belongs to the mesh; another mesh then has its own value.
        of_pairs: Whether it has to be written to new contact pairs.
    """

    name: str
    read: typing.Callable[[], typing.Any]
    write: typing.Callable[[typing.Any], None]
    of_mesh: bool = False
    of_pairs: bool = False


def of_nodes(model: ContactModel) -> list[OfNodes]:
    """History variables at nodes: multipliers, friction of previous steps, and those of laws."""
    out = [
        OfNodes(
            f"multiplier_{j}",
            part.slave,
            part.augmented_on_nodes,
            part.set_augmented_on_nodes,
            functools.partial(_widened, part=part),
        )
        for j, part in enumerate(model.parts)
    ]
    for of_part, part in _remembering(model):
        for name in part.state.memory.first:
            begun = functools.partial(_begun, part, name), functools.partial(_set_begun, part, name)
            own = functools.partial(_memory, part, name), functools.partial(_set, part, name)
            out.append(OfNodes(f"{of_part}_{name}_begun", part.slave, *begun))
            out.append(OfNodes(f"{of_part}_{name}", part.slave, *own))
    for j, slip in enumerate(model.slips):
        slipped = functools.partial(_slipped, model, j), functools.partial(_set_slipped, model, j)
        start = functools.partial(_start, model, j), functools.partial(_set_start, model, j)
        out.append(OfNodes(f"slip_{j}", slip.slave, *slipped))
        fit = functools.partial(_flags, slip.slave.gdim)
        out.append(OfNodes(f"start_{j}", slip.slave, *start, fit=fit))
    return out


def of_contact(model: ContactModel) -> list[OfContact]:
    """History variables of the contact as a whole: penalty, limits of laws, dissipated energy."""
    penalty = model.penalty

    def stiffness() -> typing.Any:
        return [penalty.of_points, penalty.of_slips, list(penalty.stiffness)]

    def set_stiffness(values: typing.Any) -> None:
        penalty.of_points, penalty.of_slips, of_sides = values
        penalty.stiffness = tuple(of_sides)

    def eps() -> typing.Any:
        return [penalty.value, penalty.automatic]

    def set_eps(values: typing.Any) -> None:
        value, automatic = values
        if value is not None and automatic:
            penalty.set_automatic(value, "automatic, before the restart")
        elif value is not None:
            penalty.set(value)

    out = [OfContact("penalty", eps, set_eps, True)]
    out.append(OfContact("stiffness", stiffness, set_stiffness, True))
    for of_part, part in _remembering(model):
        both = functools.partial(_limits, part), functools.partial(_set_limits, part)
        out.append(OfContact(f"limits_of_{of_part}", *both, of_pairs=True))
    friction = model.friction
    if friction is None:
        return out

    def set_dissipated(energy: float) -> None:
        friction.dissipated = energy if model.comm.rank == 0 else 0.0

    out.append(OfContact("rate", lambda: friction.rate, friction.continue_with))
    out.append(OfContact("dissipated", friction.dissipated_energy, set_dissipated))
    return out


def of_pairs(model: ContactModel) -> list[OfNodes | OfContact]:
    """History variables that have to be written to new contact pairs."""
    return [*of_nodes(model), *(q for q in of_contact(model) if q.of_pairs)]


def write(
    quantities: typing.Iterable[OfNodes | OfContact], values: typing.Mapping[str, typing.Any]
) -> None:
    """Write values by their names. Collective."""
    for quantity in quantities:
        quantity.write(values[quantity.name])


def names(model: ContactModel) -> list[str]:
    """Names of the history variables of the contact's laws."""
    friction = () if model.friction is None else model.friction.law.memory
    return sorted(model.law.memory) + sorted(friction)


def begin_step(model: ContactModel) -> None:
    """Begin a step with the history variables of laws at the end of the last step."""
    for part in model.parts:
        part.state.memory = part.state.memory.begun()


def end_step(model: ContactModel) -> None:
    """Update history variables at the end of a step, for the start of the next step. Collective."""
    if model.law.memory:
        for gap in model.gaps:
            gap.commit(model.eps)
    if model.friction is not None:
        model.friction.end_step(model.slips)


def reset(model: ContactModel) -> None:
    """Delete the history: multipliers, friction, and the history variables of laws. Collective.

    Slip then counts from the positions set next, see :func:`motion.set_start`.
    """
    multipliers.reset(model)
    for gap in model.gaps:
        gap.state.memory = gap.state.memory.forgotten()
    if model.friction is not None:
        model.friction.reset(model.slips)


def held_nodes(model: ContactModel) -> list[Flags]:
    """Owned nodes with tension by a law with history, at the last evaluation. Collective."""
    if not (model.law.memory and model.is_evaluated):
        return []
    at_rows = [gap.multiplier(model.eps) for gap in model.gaps]
    found = [gap.rows.on_nodes(x, 0.0) for gap, x in zip(model.gaps, at_rows, strict=True)]
    return [np.any(values.astype(np.float64) < 0, axis=1) for values in found]


def check_held(model: ContactModel, held: typing.Sequence[Flags]) -> None:
    """Warn of bonded nodes that are no longer paired after a contact update. Collective.

    Args:
        model: The contact, with its present contact pairs.
        held: Result of :func:`held_nodes` before the update.
    """
    lost = 0
    for gap, before in zip(model.gaps, held, strict=False):
        paired = gap.rows.on_nodes(np.ones(gap.num_rows), 0.0).astype(np.float64) > 0
        lost += np.count_nonzero(before & ~paired)
    lost = model.comm.allreduce(int(lost), op=MPI.SUM)
    if lost > 0:
        reach, radius = model.settings.reach, model.paired.search_radius
        larger = f"one of at least {reach:.3g}" if reach is not None else "a larger one"
        tell(
            model,
            "lost bonds",
            f"search_radius: {lost} node(s) with tension by the law have gaps beyond {radius:.3g}, "
            f"and carry no load any more: give {larger}, the gap at which the law has no more "
            "tension; or leave it out",
        )


# --- History variables of single integration sides


def _remembering(model: ContactModel) -> list[tuple[str, Part]]:
    """Parts whose laws have history variables, with unique names."""
    named: list[tuple[str, Part]] = [(f"law_{j}", gap) for j, gap in enumerate(model.gaps)]
    named += [(f"friction_{j}", slip) for j, slip in enumerate(model.slips)]
    return [(name, part) for name, part in named if part.state.memory.first]


def _limits(part: Part) -> dict[str, list[float]]:
    return dict(part.state.memory.limits)


def _set_limits(part: Part, limits: typing.Mapping[str, list[float]]) -> None:
    part.state.memory = part.state.memory.with_limits(dict(limits))


def _memory(part: Part, name: str) -> Array:
    """Differences from the initial value, which nodes have that no value is transferred to."""
    memory = part.state.memory
    return memory.latest[name] - memory.first[name]


def _set(part: Part, name: str, values: Array) -> None:
    memory = part.state.memory
    end = memory.latest | {name: np.array(values + memory.first[name])}
    part.state.memory = dataclasses.replace(memory, end=end)


def _begun(part: Part, name: str) -> Array:
    """As :func:`_memory`, at the start of the step: results of the step are with these values."""
    memory = part.state.memory
    return memory.start[name] - memory.first[name]


def _set_begun(part: Part, name: str, values: Array) -> None:
    memory = part.state.memory
    start = memory.start | {name: np.array(values + memory.first[name])}
    part.state.memory = dataclasses.replace(memory, start=start, end=memory.latest, rows=None)


def _slipped(model: ContactModel, j: int) -> Array:
    assert model.friction is not None
    return model.friction.slipped[j]


def _set_slipped(model: ContactModel, j: int, values: Array) -> None:
    assert model.friction is not None
    model.friction.slipped[j] = values


def _start(model: ContactModel, j: int) -> Array:
    return multipliers.pressures_on_nodes(model.slips[j])


def _set_start(model: ContactModel, j: int, values: Array) -> None:
    multipliers.set_pressures_on_nodes(model.slips[j], values)


def _flags(gdim: int, start: Array) -> Array:
    """Round the flags of slipping, and of components moved by conditions, to 0 or 1."""
    out = start.copy()
    pressures, _, moved = multipliers.parts_of_start(gdim, out)
    pressures[:, 1::3], moved[:] = np.rint(pressures[:, 1::3]), np.rint(moved)
    return out


def _widened(values: Array, part: Part) -> Array:
    """Convert between values by smooth patches of nodes and values without patches."""
    columns, gdim = multipliers.num_columns(part), part.slave.gdim
    if values.shape[1] == columns:
        return values
    if values.shape[1] > columns:
        return np.asarray(values.reshape(len(values), gdim, columns).sum(axis=1))
    width = values.shape[1]
    out = np.zeros((len(values), gdim, width))
    out[:, 0] = values
    return out.reshape(len(values), columns)
