"""Lagrange multipliers λ̂ and τ̂ of a contact, and how updates of the contact pairs keep them."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact.model import ContactModel, Part
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.own_rows import OfVertices
from qsdolfinx.gap.rows import PointRows

Array = npt.NDArray[np.float64]


class Known(typing.NamedTuple):
    """Multiplier of a part; for constraints at points also active parts, or τ of a penalty.

    ``of_vertices`` has the multipliers of a tool's vertices; None if there are none.
    """

    multiplier: Array
    at_points: Array | None
    of_vertices: OfVertices | None


def known(model: ContactModel) -> list[Known]:
    """Multipliers of each part after the last solve; see :func:`set_known`."""
    return [
        Known(
            part.state.augmented,
            part.state.reached if isinstance(part, Slip) else part.state.closed,
            part.state.of_vertices,
        )
        for part in model.parts
    ]


def set_known(model: ContactModel, multipliers: typing.Sequence[Known]) -> None:
    """Restore the multipliers returned by :func:`known`."""
    for part, kept in zip(model.parts, multipliers, strict=True):
        part.state.augmented, part.state.of_vertices = kept.multiplier, kept.of_vertices
        if isinstance(part, Slip):
            part.state.reached = kept.at_points
        else:
            part.state.closed = kept.at_points


def on_nodes(parts: typing.Sequence[Part]) -> list[Array]:
    """Multipliers at all owned slave nodes of each part; kept when contact pairs are updated."""
    return [part.augmented_on_nodes() for part in parts]


def num_columns(part: Part) -> int:
    """Number of values per node in the array of a part in :func:`on_nodes`."""
    return part.augmented_on_nodes().shape[1]


def set_on_nodes(parts: typing.Sequence[Part], multipliers: typing.Sequence[Array]) -> None:
    """Restore the multipliers returned by :func:`on_nodes`; τ̂ is rotated with the surface."""
    for part, multiplier in zip(parts, multipliers, strict=True):
        part.set_augmented_on_nodes(multiplier)
    turn(parts)


def turn(parts: typing.Sequence[Part]) -> None:
    """Rotate τ̂ with the surface."""
    for part in parts:
        if isinstance(part, Slip):
            part.turn_augmented()


def pressures_on_nodes(slip: Slip) -> Array:
    """Pressure and state of a slip at the start of the step, at all owned nodes.

    The columns are the pressure, whether the node slipped and the part of its friction limit that
    it reached, with constraints at points for each smooth patch of the node; then the covered part
    of its area, and which components conditions have moved.
    """
    state = slip.state
    num = 3 * (slip.slave.block if isinstance(slip.gap.rows, PointRows) else 1)
    none = np.zeros((len(state.covered), num))
    return np.column_stack(
        [none if state.of_nodes is None else state.of_nodes, state.covered, state.moved]
    )


def set_pressures_on_nodes(slip: Slip, columns: Array) -> None:
    """Restore the state returned by :func:`pressures_on_nodes`."""
    state, rows = slip.state, slip.gap.rows
    state.of_nodes, covered, state.moved = parts_of_start(slip.slave.gdim, columns.copy())
    state.covered = covered[:, 0]
    if isinstance(rows, PointRows):
        of_rows = rows.vectors_from_sides(state.of_nodes)
    else:
        of_rows = np.column_stack([rows.from_nodes(c) for c in state.of_nodes.T])
    state.pressed, state.slipped, state.used = of_rows.T


def parts_of_start(gdim: int, columns: Array) -> tuple[Array, Array, Array]:
    """Columns of :func:`pressures_on_nodes`: of pressures, covered parts, moved components."""
    count = columns.shape[1] - 1 - gdim
    return columns[:, :count], columns[:, count : count + 1], columns[:, count + 1 :]


def reset(model: ContactModel) -> None:
    """Reset the multipliers of gaps: the next solve begins with λ̂ = 0."""
    for gap in model.gaps:
        gap.state.augmented = np.zeros_like(gap.state.augmented)
        gap.state.closed = gap.state.of_vertices = None
