"""Output fields of a contact on both bodies: status, gap and traction as Functions."""

from __future__ import annotations

import enum
import typing

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.contact import results
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.shown import shown
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.traction import nodal_forces

Array = npt.NDArray[np.float64]

Source = typing.Callable[[], fem.Function]


class Status(enum.IntEnum):
    """Contact status of a node: the values of :meth:`qs.Contact.status`."""

    #: Not in contact detection: off the surface, or too far from the other surface.
    UNPAIRED = 0
    #: Paired, with an open gap.
    OPEN = 1
    #: In contact (with friction: sticking), or tied.
    ACTIVE = 2
    #: In contact and slipping.
    SLIPPING = 3


class Faced(typing.NamedTuple):
    """Master nodes reached by contact quadrature points, and the mean of the values they face."""

    reached: npt.NDArray[np.bool_]
    mean: Array


def faced(p: WeightedGap, rows: Array) -> Faced:
    """Means, at master nodes of an integration side, of opposite constraint values. Collective.

    For node l, the mean is Σ_p w_p N_l(ζ_p) c(ξ_p) / Σ_p w_p N_l(ζ_p), computed with the transposed
    operator: the nodes are those that the force of a multiplier would reach.

    Args:
        p: The integration side; its master is deformable.
        rows: Values c_k of the constraints, shape (rows,).
    """
    (master,), operator = p.master.bodies, p.jump_operator()
    found = []
    # Use the areas of this operator: surfaces may have moved since the gaps were read.
    for of_rows in (operator.row_area, operator.row_area * rows):
        forces = np.zeros((len(rows), p.slave.block))
        forces[:, 0] = of_rows
        vecs = p.slave.create_vec(), master.create_vec()
        operator.add_transpose(forces, vecs[0].handle, vecs[1].handle)
        found.append(-nodal_forces(master, vecs[1])[:, 0])
        for vec in vecs:
            vec.destroy()
    area, sums = found
    reached = area > ROUNDING * master.linear.node_area
    return Faced(reached, np.divide(sums, area, out=np.full_like(sums, np.nan), where=reached))


def status(model: ContactModel, side: str) -> fem.Function:
    """:class:`Status` of each node. Collective."""
    surface = deformable_side(model, side)
    if model.with_itself:
        found = np.maximum(_of_own_rows(model, "slave"), _of_faced_rows(model, "master"))
    elif results.has_multiplier(model, side):
        found = _of_own_rows(model, side)
    else:
        found = _of_faced_rows(model, side)
    return _scalar(surface, found.astype(np.float64))


def gap_function(model: ContactModel, side: str) -> fem.Function:
    """Weighted gap; for tied contact the size of the relative displacement. Collective."""
    surface = deformable_side(model, side)
    if model.with_itself:
        own = _sizes(results.weighted_gap(model, "slave"))
        values = np.where(np.isnan(own), _faced_gap(model), own)
    elif results.has_multiplier(model, side):
        values = _sizes(results.weighted_gap(model, side))
    else:
        values = _faced_gap(model)
    return _scalar(surface, np.nan_to_num(values))


def _faced_gap(model: ContactModel) -> Array:
    """Mean gaps opposite to the nodes of a master. Collective."""
    return faced(model.gaps[0], _sizes(model.gaps[0].state.values)).mean


def sources(model: ContactModel, side: str) -> dict[str, Source]:
    """Callables that compute the output fields, by name. Collective."""
    deformable_side(model, side)

    def source(read: typing.Callable[..., fem.Function], *more: str) -> Source:
        return lambda: read(shown(model), side, *more)

    if model.is_scalar:
        return {"flux": source(results.flux), "jump": source(gap_function)}
    out = {
        "traction": source(results.traction, "whole"),
        "pressure": source(results.pressure),
        "gap": source(gap_function),
        "status": source(status),
    }
    if model.slips:
        for part in ("normal", "tangential"):
            out[f"{part}_traction"] = source(results.traction, part)
        if results.has_multiplier(model, side):
            out["slip"] = source(slip_function)
    return out


def slip_function(model: ContactModel, side: str) -> fem.Function:
    """Slip accumulated over all steps. Collective."""
    surface = deformable_side(model, side)
    return surface.linear.vertex_function(results.slip(model, side))


def deformable_side(model: ContactModel, side: str) -> Surface:
    """The surface of one side, the same on all ranks. Collective.

    Raises:
        ValueError: If it is a rigid tool.
    """
    results.agreed(model, side)
    return results.body_on(model, side, "fields; see those of the slave")


def _of_own_rows(model: ContactModel, side: str) -> npt.NDArray[np.int_]:
    """Status of the nodes of a side that carries multipliers."""
    p = results.gap_of(model, side)
    paired = np.isin(np.arange(len(p.slave.node_area)), p.rows.reached)
    status = np.where(paired, Status.OPEN, Status.UNPAIRED)
    status = np.where(results.active(model, side), Status.ACTIVE, status)
    if model.slips:
        status = np.where(results.slipping(model, side), Status.SLIPPING, status)
    return status


def _of_faced_rows(model: ContactModel, side: str) -> npt.NDArray[np.int_]:
    """Status of the nodes of a master, from the constraints that they face. Collective."""
    p = model.gaps[0]
    # The force of another constraint may reach a part of a node with an open gap.
    force = faced(p, results.rows_in_contact(model, p).astype(np.float64))
    status = np.where(force.reached, Status.OPEN, Status.UNPAIRED)
    active = force.mean > ROUNDING  # not where it is NaN
    status = np.where(active, Status.ACTIVE, status)
    if model.slips:
        found = model.slips[0]
        slip = faced(found.gap, found.slipping.astype(np.float64))
        status = np.where(active & (slip.mean > force.mean / 2), Status.SLIPPING, status)
    return status


def _sizes(values: Array) -> Array:
    """Gaps unchanged; for relative displacements their size."""
    if values.ndim == 1:
        return values
    return values[:, 0] if values.shape[1] == 1 else np.linalg.norm(values, axis=1)


def _scalar(surface: Surface, values: Array) -> fem.Function:
    """Function of degree 1 with these values at the nodes. Collective."""
    return surface.linear.vertex_function(values)
