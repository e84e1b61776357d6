"""What a contact remembers from step to step: one list, for whoever saves it or hands it over.

Checkpoints and new meshes know nothing else of multipliers, friction or a user's law.
"""

from __future__ import annotations

import dataclasses
import functools
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.contact import multipliers
from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel, Part
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class OfNodes:
    """Values of the owned nodes of a pass's slave.

    Attributes:
        name: Of the contact's own; with the number of the pass.
        slave: The surface.
        read: Gives them, shape (nodes, columns). Collective.
        write: Takes them.
        fit: Makes values of this kind of means that were found on another mesh.
    """

    name: str
    slave: Surface
    read: typing.Callable[[], Array]
    write: typing.Callable[[Array], None]
    fit: typing.Callable[[Array], Array] = lambda values: values


@dataclasses.dataclass(frozen=True)
class OfContact:
    """A number of the whole contact, the same on all ranks, or what else JSON can hold.

    Attributes:
        name: Of the contact's own.
        read: Gives it. Collective.
        write: Takes it. Collective.
        of_mesh: Whether it belongs to the mesh, and another one has its own.
    """

    name: str
    read: typing.Callable[[], typing.Any]
    write: typing.Callable[[typing.Any], None]
    of_mesh: bool = False


def of_nodes(model: ContactModel) -> list[OfNodes]:
    """What nodes remember: multipliers, friction of the steps so far, what laws do."""
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
    for j, gap in enumerate(model.gaps):
        for name in gap.law.memory:
            own = functools.partial(_memory, gap, name), functools.partial(_set_memory, gap, name)
            out.append(OfNodes(f"law_{j}_{name}", gap.slave, *own))
    for j, slip in enumerate(model.slips):
        slipped = functools.partial(_slipped, model, j), functools.partial(_set_slipped, model, j)
        start = functools.partial(_start, model, j), functools.partial(_set_start, model, j)
        out.append(OfNodes(f"slip_{j}", slip.slave, *slipped))
        out.append(OfNodes(f"start_{j}", slip.slave, *start, fit=_flags))
    return out


def of_contact(model: ContactModel) -> list[OfContact]:
    """What the contact remembers as a whole: its penalty, and what friction has taken."""
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
    friction = model.friction
    if friction is None:
        return out

    def set_dissipated(energy: float) -> None:
        friction.dissipated = energy if model.comm.rank == 0 else 0.0

    out.append(OfContact("rate", lambda: friction.rate, friction.continue_with))
    out.append(OfContact("dissipated", friction.dissipated_energy, set_dissipated))
    return out


def write(
    quantities: typing.Iterable[OfNodes | OfContact], values: typing.Mapping[str, typing.Any]
) -> None:
    """Write values by their names. Collective."""
    for quantity in quantities:
        quantity.write(values[quantity.name])


def end_step(model: ContactModel) -> None:
    """Let what remembers take the end of a step, which the next one begins with. Collective."""
    if model.friction is not None:
        model.friction.end_step(model.slips)
    if model.law.memory:
        with collective_errors(model.comm):  # the law is the user's
            for gap in model.gaps:
                gap.commit(model.eps)


def held_nodes(model: ContactModel) -> list[Flags]:
    """Owned nodes of each pass that a law that remembers pulls, as last evaluated. Collective."""
    if not (model.law.memory and model.is_evaluated):
        return []
    found = [gap.rows.on_nodes(gap.multiplier(model.eps), 0.0) for gap in model.gaps]
    return [np.any(values.astype(np.float64) < 0, axis=1) for values in found]


def check_held(model: ContactModel, held: typing.Sequence[Flags]) -> None:
    """Warn where pairing anew has lost nodes that a law that remembers held. Collective.

    Args:
        model: The contact, as it is paired now.
        held: What :func:`held_nodes` has found before.
    """
    lost = 0
    for gap, before in zip(model.gaps, held, strict=False):
        paired = gap.rows.on_nodes(np.ones(gap.num_rows), 0.0).astype(np.float64) > 0
        lost += np.count_nonzero(before & ~paired)
    lost = model.comm.allreduce(int(lost), op=MPI.SUM)
    if lost > 0:
        tell(
            model,
            f"lost bonds after pairing {model.num_pairings}",
            f"search_radius: {lost} node(s) that the law held have opened beyond it, and carry "
            "nothing; give a larger search_radius, the opening at which the law lets go",
        )


# --- Of single passes


def _memory(gap: WeightedGap, name: str) -> Array:
    return gap.memory[name][:, None]


def _set_memory(gap: WeightedGap, name: str, values: Array) -> None:
    gap.set_memory(gap.memory | {name: np.array(values[:, 0])})


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


def _flags(start: Array) -> Array:
    """With whether it slipped, and what conditions moved, as yes or no."""
    out = start.copy()
    out[:, 1], out[:, 3:] = np.rint(out[:, 1]), np.rint(out[:, 3:])
    return out


def _widened(values: Array, part: Part) -> Array:
    """Values by sides of nodes for a part that has none, or the other way round."""
    columns, gdim = multipliers.num_columns(part), part.slave.gdim
    if values.shape[1] == columns:
        return values
    if values.shape[1] > columns:
        return np.asarray(values.reshape(len(values), gdim, columns).sum(axis=1))
    width = values.shape[1]
    out = np.zeros((len(values), gdim, width))
    out[:, 0] = values
    return out.reshape(len(values), columns)
