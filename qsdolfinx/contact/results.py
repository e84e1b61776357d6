"""Results of a contact after a solve; :class:`qs.Contact` explains their meaning."""

from __future__ import annotations

import contextlib
import math
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import check, check_vector, one_of, require
from qsdolfinx.base.collective import checked
from qsdolfinx.contact import active_set, depth
from qsdolfinx.contact.bridged import in_contact, like_neighbours
from qsdolfinx.contact.memory import names
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.rows import PointRows
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec, skew, trace_positions
from qsdolfinx.surface.surface import Surface
from qsdolfinx.surface.traction import nodal_forces, recover
from qsdolfinx.tools.pose import padded
from qsdolfinx.tools.rigid_surface import AnySurface, is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

SIDES = ("slave", "master")
SIDE = one_of(SIDES)
PART = one_of(("whole", "normal", "tangential"))


# --- Sides


def surface_of(model: ContactModel, side: str) -> AnySurface:
    """The surface of one side.

    Raises:
        ValueError: If there is no such side.
    """
    check(SIDE, side=side)
    return model.slave if side == "slave" else model.master


def agreed(model: ContactModel, side: str) -> AnySurface:
    """The surface of one side, the same on all ranks. Collective."""
    with checked(model.comm) as same:
        same(SIDE, side=side)
    return surface_of(model, side)


def body_on(model: ContactModel, side: str, what: str) -> Surface:
    """The surface of one side that has what is asked for: that of a body.

    Args:
        model: The contact.
        side: ``"slave"`` or ``"master"``.
        what: Name of the result, and what to take instead.

    Raises:
        ValueError: If the side is a rigid tool.
    """
    bodies = surface_of(model, side).bodies
    require(bodies, f"side: a rigid tool has no {what}")
    return bodies[0]


def has_multiplier(model: ContactModel, side: str) -> bool:
    """Whether a side carries multipliers."""
    return side == "slave" or len(model.of_sides) > 1


def gap_of(model: ContactModel, side: str) -> WeightedGap:
    """Gap of the integration side whose slave is this side.

    Raises:
        ValueError: If there is none.
    """
    surface_of(model, side)
    if not has_multiplier(model, side):
        formulation = model.settings.formulation
        raise ValueError(f"side: {formulation} contact has no multiplier on the master")
    return model.of_sides[SIDES.index(side)]


def slip_of(model: ContactModel, side: str) -> Slip:
    """Slip of the integration side whose slave is this side.

    Raises:
        ValueError: If there is none, or the contact has no friction.
    """
    gap_of(model, side)
    if not model.slips:
        raise ValueError("friction: this contact has no friction")
    return model.slips[SIDES.index(side)]


# --- At nodes


def gap(model: ContactModel, side: str) -> Array:
    """Signed distance of deformed surfaces; for ties the relative displacement. Collective.

    Raises:
        ValueError: If the side is a rigid tool, or has no multiplier and is tied.
    """
    agreed(model, side)
    if not model.has_gaps:
        return weighted_gap(model, side)
    body_on(model, side, "gaps; see those of the slave")
    return depth.gap(model, side)


def weighted_gap(model: ContactModel, side: str) -> Array:
    """Weighted gap ḡ of each node; NaN where a node has no contact quadrature point."""
    p = gap_of(model, side)
    return typing.cast(Array, _flat(p.rows.on_nodes(p.state.values, math.nan)))


def multiplier(model: ContactModel, side: str) -> Array:
    """Multiplier λ at nodes; 0 where unpaired."""
    p = gap_of(model, side)
    return typing.cast(Array, _flat(p.rows.on_nodes(multiplier_of(model, p), 0.0)))


def memory(model: ContactModel, name: str, side: str) -> Array:
    """History variable of the law, or of the friction law, after the last step, (nodes,).

    Raises:
        ValueError: If neither law has a history variable of that name.
    """
    known = names(model)
    require(name in known, f"name: the laws have memory {known}, not {name!r}")
    gap = gap_of(model, side)
    part = gap if name in model.law.memory else slip_of(model, side)
    return gap.rows.means_of_patches(part.state.memory.latest[name])


def active(model: ContactModel, side: str) -> Flags:
    """Nodes in contact, including nodes with an active vertex constraint. Collective."""
    agreed(model, side)
    p = gap_of(model, side)
    out = np.array(p.rows.on_nodes(rows_in_contact(model, p), False), dtype=bool)
    for vertices in model.of_vertices if is_known(model) else ():
        if vertices.slave is p.slave:
            out |= vertices.rows.on_nodes(active_set.closed(model, vertices), False).astype(bool)
    return out


def is_known(model: ContactModel) -> bool:
    """Whether contact status is known: not before an automatic penalty is computed."""
    return model.penalty.value is not None


def rows_in_contact(model: ContactModel, p: WeightedGap) -> Flags:
    """Constraints of an integration side in contact; none while this is unknown. Collective."""
    return in_contact(model, p) if is_known(model) else np.zeros(p.num_rows, dtype=bool)


def tangential_multiplier(model: ContactModel, side: str) -> Array:
    """Tangential multiplier τ at nodes; 0 where unpaired."""
    slip = slip_of(model, side)
    return np.asarray(slip.gap.rows.on_nodes(slip.state.response.traction, 0.0), dtype=np.float64)


def slip(model: ContactModel, side: str) -> Array:
    """Slip accumulated over all steps."""
    found = slip_of(model, side)
    assert model.friction is not None
    return model.friction.slip(SIDES.index(side), found)


def slipping(model: ContactModel, side: str) -> Flags:
    """Nodes in contact that slip; none without friction. Collective."""
    agreed(model, side)
    p = gap_of(model, side)
    if not model.slips:
        return np.zeros(len(p.slave.node_area), dtype=bool)
    found = slip_of(model, side)
    slips = _slipping(found)
    if not is_known(model):
        return slips
    closed = np.asarray(p.rows.on_nodes(active_set.closed(model, p), False), dtype=bool)
    slips = np.array(like_neighbours(p.slave, closed, slips, active(model, side) & ~closed))
    for vertices in model.slips_of_vertices:
        if vertices.slave is p.slave:
            at_nodes = vertices.gap.rows.on_nodes
            there = at_nodes(active_set.closed(model, vertices.gap), False).astype(bool)
            slips = np.where(there, at_nodes(vertices.slipping, False).astype(bool), slips)
    return slips


def shares(model: ContactModel, side: str) -> tuple[Array, Array]:
    """Parts of the nodes' areas that are in contact, and that slip. Collective."""
    agreed(model, side)
    p = gap_of(model, side)
    closed = rows_in_contact(model, p)
    slips: Flags = np.zeros(p.num_rows, dtype=bool)
    if model.slips and is_known(model):
        slips = slip_of(model, side).slipping & closed
    return _share(p, closed), _share(p, slips)


def _share(p: WeightedGap, flags: Flags) -> Array:
    """Part of each node's area that belongs to constraints with a flag. Collective."""
    if not isinstance(p.rows, PointRows):
        return np.asarray(p.rows.on_nodes(flags.astype(np.float64), 0.0), dtype=np.float64)
    sums = p.rows.sums(flags.astype(np.float64)).sum(axis=1)
    return np.asarray(np.minimum(sums / p.slave.node_area, 1.0))


def _slipping(found: Slip) -> Flags:
    """Slipping nodes; with constraints at points, more than half of their contact area slips."""
    rows, slips, closed = found.gap.rows, found.slipping, found.state.closed
    if not rows.are_points:
        return np.asarray(rows.on_nodes(slips, False), dtype=bool)
    both = np.column_stack([slips, closed]).astype(np.float64)
    parts = rows.on_nodes(both, 0.0).astype(np.float64)
    return np.asarray(parts[:, 0] > 0.5 * parts[:, 1])


def dissipation(model: ContactModel, side: str) -> Array:
    """Energy dissipated by friction at each node in the last step."""
    found = slip_of(model, side)
    out = found.dissipation_at_nodes()
    for vertices in model.slips_of_vertices:
        if vertices.slave is found.slave:
            out = out + vertices.dissipation_at_nodes()
    return out


# --- Totals


def penetration(model: ContactModel) -> float:
    """Depth of the deepest point; for ties the size of the relative displacement. Collective."""
    return depth.penetration(model) if model.has_gaps else weighted_penetration(model)


def weighted_penetration(model: ContactModel) -> float:
    """Largest weighted gap of the slave; for ties its absolute value. Collective."""
    local = float(np.max(model.gaps[0].violation, initial=0.0))
    return float(model.comm.allreduce(local, op=MPI.MAX))


def mean_penetration(model: ContactModel) -> float:
    """Largest weighted gap of a node, also where constraints are at points. Collective."""
    gap = model.gaps[0]
    if not gap.rows.are_points:
        return weighted_penetration(model)
    means = gap.rows.on_nodes(gap.state.values[:, 0], 0.0)
    return float(model.comm.allreduce(float(np.max(means, initial=0.0)), op=MPI.MAX))


def energy(model: ContactModel) -> float:
    """Contact energy Φ of the gaps. Collective."""
    local, part = 0.0, model.part_of_multipliers
    if model.is_evaluated:
        local = sum(p.energy(model.eps, part) for p in model.gaps)
    return float(model.comm.allreduce(local, op=MPI.SUM))


def step_dissipation(model: ContactModel) -> float:
    """Total energy dissipated by friction in the last step. Collective."""
    local = sum(float(slip.dissipation().sum()) for slip in model.slips)
    return float(model.comm.allreduce(local, op=MPI.SUM))


def patch(model: ContactModel) -> tuple[float, float]:
    """Area of slave nodes or points in contact, and radius of a disc of this area. Collective.

    Areas are those used for tractions.
    """
    slave, p = model.slave, model.gaps[0]
    place = _place(model, "slave")
    vertices = place.coordinates[0]
    if p.cut is not None:  # gaps with updated geometry have their own areas
        vertices = p.cut.places[0][:, : slave.num_facet_vertices]
    paired = _measured(place.surface, vertices)
    row_area = p.rows.areas(_areas(model, "slave"), np.asarray(paired.node_area))
    area = float(np.sum(row_area[rows_in_contact(model, p)]))
    area = float(model.comm.allreduce(area, op=MPI.SUM))
    return area, area / 2 if slave.area_dim == 1 else math.sqrt(area / math.pi)


# --- Forces


def force(model: ContactModel, side: str) -> Array:
    """Total contact force on the body of one side, shape (gdim,). Collective."""
    agreed(model, side)
    check_mechanical(model, "flow")
    return total(model, side)


def flow(model: ContactModel, side: str) -> float:
    """Total flow of a scalar field into the body of one side. Collective."""
    agreed(model, side)
    check_scalar(model, "force")
    return float(total(model, side)[0])


def flux(model: ContactModel, side: str) -> fem.Function:
    """Flow per area into the body of one side. Collective."""
    agreed(model, side)
    check_scalar(model, "traction")
    surface = body_on(model, side, "flux; see flow, or the flux of the slave")
    with _force_vec(model, side, whole_body=True) as vec:
        return recover(surface, vec, _areas(model, side))


def check_mechanical(model: ContactModel, instead: str) -> None:
    """Raise an error if forces are requested from contact of scalar fields.

    Raises:
        ValueError: If the contact is of this kind.
    """
    if model.is_scalar:
        raise ValueError(f"a contact of scalar fields has no forces; use contact.{instead}(side)")


def check_scalar(model: ContactModel, instead: str) -> None:
    """Raise an error if flows are requested from contact of displacements.

    Raises:
        ValueError: If the contact is of this kind.
    """
    if not model.is_scalar:
        text = "contact of displacements or velocities has no flows; use"
        raise ValueError(f"{text} contact.{instead}(side)")


def total(model: ContactModel, side: str) -> Array:
    """Sum of contact forces or flows on the unknowns of one side, shape (block,). Collective."""
    if is_rigid(surface_of(model, side)):
        heat = model.friction_heat
        power = 0.0 if heat is None else model.comm.allreduce(float(heat.power.sum()), op=MPI.SUM)
        return power - total(model, "slave")
    with _force_vec(model, side) as vec:
        owned = nodal_forces(_place(model, side).surface, vec).sum(axis=0)
    return np.asarray(model.comm.allreduce(owned, op=MPI.SUM))


def moment(model: ContactModel, side: str, about: npt.ArrayLike | None) -> Array:
    """Total moment of the contact forces on one side, shape (3,) or (1,). Collective."""
    with checked(model.comm) as same:
        same(SIDE, side=side)
        check_mechanical(model, "flow")
        point = _center(model) if about is None else check_vector("about", about, model.slave.gdim)
        same(about=point)
    return _moment(model, side, point)


def _moment(model: ContactModel, side: str, about: Array) -> Array:
    if is_rigid(surface_of(model, side)):
        return -_moment(model, "slave", about)
    surface, x, out = _place(model, side).surface, _places_of_forces(model, side), []
    with _force_vec(model, side) as vec:
        for axis in np.eye(1 if len(about) == 2 else 3):
            A = skew(axis)  # work of the forces in a small rotation
            field = affine_vec(surface, Affine(A, -A @ about), x)
            out.append(field.dot(vec))
            field.destroy()
    return np.array(out)


def _places_of_forces(model: ContactModel, side: str) -> Array:
    """Points of action of forces at trace nodes of a side, (facets, nodes, 3). Collective.

    Gaps, normals and the lines of action of the forces belong to the positions at which contact was
    evaluated: with ``sliding="finite"`` the positions of the last evaluation, otherwise those of
    contact detection. Points in contact with a tool move along with its centre to the end of a time
    step.
    """
    place = _place(model, side)
    if model.settings.sliding == "finite":
        return place.positions()
    x = trace_positions(place.surface, place.coordinates)
    if _is_at_end(model):
        paired, now = model.placement.master.centers
        x = x + padded(now - paired)
    return x


def _is_at_end(model: ContactModel) -> bool:
    """Whether moments are at the end of a tool's motion: in time steps or with finite sliding."""
    moves = model.master.motion is not None
    return moves and (model.offset is not None or model.follows)


def _center(model: ContactModel) -> Array:
    """Centre of a tool, at the end of its motion in a time step; without a tool the origin."""
    return model.placement.master.centers[int(_is_at_end(model))]


def traction(model: ContactModel, side: str, part: str) -> fem.Function:
    """Traction t_k = f_k / S_k, recovered from the contact forces. Collective."""
    with checked(model.comm) as same:
        same(SIDE, side=side)
        same(PART, part=part)
        check_mechanical(model, "flux")
    surface = body_on(model, side, "traction; take the traction of the slave, times -1")
    with _force_vec(model, side, part, whole_body=True) as vec:
        return recover(surface, vec, _areas(model, side))


def pressure(model: ContactModel, side: str) -> fem.Function:
    """Pressure p_k = −t_k·n_k, with normals n_k of the vertices as deformed. Collective."""
    whole = traction(model, side, "normal" if model.slips else "whole")
    surface = _place(model, side).surface
    normal = np.asarray(_facets_at(_place(model, side)).node_normal)[:, : surface.gdim]
    values = -np.sum(surface.linear.node_values(whole) * normal, axis=1)
    return surface.linear.vertex_function(values)


def _place(model: ContactModel, side: str) -> Place:
    """Position of a deformable side at the last evaluation."""
    return model.placement.bodies[SIDES.index(side)]


def _areas(model: ContactModel, side: str) -> Array:
    """Areas of the vertices of one side, by which its tractions are computed. Collective.

    The areas are those of the configuration in which the body is in equilibrium. For a
    velocity-based body this is its mesh at the solve, independent of the number of contact
    detections in a step and of the kind of sliding. A displacement-based body is in equilibrium as
    deformed: in time steps and with finite sliding, its facets have their positions of the last
    evaluation. Otherwise, as with small strains, areas are those of its mesh.
    """
    place = _place(model, side)
    in_displacement = model.kinematics.in_displacement[SIDES.index(side)]
    follows = model.settings.sliding == "finite"
    deforms = in_displacement and (follows or model.offset is not None)
    vertices = place.vertices() if deforms else place.vertices_of_mesh()
    return np.asarray(_measured(place.surface, vertices).node_area)


def _facets_at(place: Place) -> _cpp.Surface:
    """Flat facets through the present vertices of a side, with measures. Collective."""
    return _measured(place.surface, place.vertices())


def _measured(surface: Surface, vertices: Array) -> _cpp.Surface:
    """Flat facets of a surface through other vertices, with measures. Collective."""
    facets = surface.linear.twin()
    facets.follow(np.ascontiguousarray(vertices))
    facets.measure_nodes()
    return facets


def multiplier_of(model: ContactModel, p: WeightedGap) -> Array:
    """Multiplier λ of an integration side's constraints; 0 before the first solve. Collective."""
    if not model.is_evaluated:
        return np.zeros_like(p.state.values)
    return p.multiplier(model.eps)


def forces_on_bodies(model: ContactModel) -> list[Array]:
    """Forces on the owned unknowns of each body, of the slave first. Collective."""
    out = []
    for side in SIDES[: 1 if model.with_itself else len(model.bodies)]:
        with _force_vec(model, side, whole_body=True) as vec:
            out.append(vec.array.copy())
    return out


@contextlib.contextmanager
def _force_vec(
    model: ContactModel, side: str, part: str = "whole", whole_body: bool = False
) -> typing.Iterator[PETSc.Vec]:
    """Contact forces on the unknowns of one side's body: minus the assembled residual.

    For self-contact, they are those of both sides if ``whole_body`` is set.
    """
    vecs = model.slave.create_vec(), model.master.create_vec()
    for p in model.gaps if part != "tangential" else ():
        p.add_forces(multiplier_of(model, p), model.ordered(p, vecs))
    for slip in model.slips if part != "normal" else ():
        slip.add_forces(model.ordered(slip.gap, vecs))
    if model.friction_heat is not None:
        model.friction_heat.add_to(vecs)
    wanted = vecs[SIDES.index(side)]
    assert wanted is not None
    if model.with_itself and whole_body:
        wanted.axpy(1.0, vecs[1 - SIDES.index(side)])
    wanted.scale(-1)
    try:
        yield wanted
    finally:
        for vec in vecs:
            if vec is not None:
                vec.destroy()


def _flat(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Drop the second axis of arrays with a single column."""
    return values[:, 0] if values.shape[1] == 1 else values
