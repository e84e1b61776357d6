"""Sliding distance of contacts with small sliding since contact detection."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact import active_set
from qsdolfinx.contact.crossing import motion_since
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Placement
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.surface.affine import Affine, affine_vec, rotation_vector
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.tools.rigid_surface import is_rigid

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Ways = tuple[Array | None, Array | None]

#: Sliding distance, over the size of a facet, up to which points keep their partners: bodies that
#: deform slide so far. Beyond a facet, all points act on other facets than those with which they
#: were paired.
NEARBY = 0.5

#: Rotation (radians) above which a solve warns of sliding even if small sliding was asked for:
#: a gap of a facet is then wrong by a tenth of it (``tests/contact/test_turned.py``).
TURNS = 0.1


def find_slid(model: ContactModel) -> str | None:
    """Warning if nodes in contact have slid by more than a facet in a solve, or None. Collective.

    On an analytic plane any sliding distance is right. Users who set small sliding are aware of
    this limit, but not of a rotation: as points slide by s along normals that rotate by φ, gaps are
    wrong by s φ, so that even a round tool that rotates in place may lose contact.
    """
    if model.follows or (model.sliding_is_given and not _turns(model)):
        return None
    if any(tool.is_plane for tool in model.master.tools):
        return None
    if motion_since(model, model.placement.as_paired) <= model.paired.facet_size:
        return None
    way = _slid_since(model, model.placement)
    if way <= 1.0:  # facets
        return None
    known = model.sliding_is_given
    finite = 'sliding="finite", or ' if model.sliding_is_open or known else ""
    turns = " and has turned" if known else ""
    intended = "" if known else '; give sliding="small" if this is intended'
    return (
        f"sliding: the contact has slid by {way:.3g} facets{turns} since contact detection, but "
        f"small sliding keeps the points and normals found then: take {finite}time steps "
        f"(qs.TimeStepper){intended}"
    )


def _turns(model: ContactModel) -> bool:
    """Whether a tool has rotated so far that sliding changes gaps.

    Velocity-based bodies are paired within the step, and tools then rotate in place.
    """
    moves = all(model.kinematics.in_displacement)
    return moves and rotation_of(model.placement.master.motion) > TURNS


def rotation_of(tool: Affine | None) -> float:
    """Rotation (radians) of a tool by this motion; 0 without one."""
    if tool is None:
        return 0.0
    return float(np.linalg.norm(rotation_vector(tool.A + np.eye(len(tool.A)))))


def _slid_since(model: ContactModel, now: Placement) -> float:
    """Largest sliding distance of nodes in contact up to a placement, in facets. Collective.

    Open nodes count too, if rotation may have caused their gap.
    """
    vecs = [place.vec() for place in now.bodies]
    ways = [vec.array.copy() for vec in vecs]
    for vec in vecs:
        vec.destroy()
    both, tool = (ways[0], ways[1] if len(ways) > 1 else None), now.master.motion
    largest, turn = 0.0, _turn(model, tool)
    for gap in model.gaps:
        length = _along(model, gap, both, tool)
        counts = _on_nodes(gap, active_set.closed(model, gap)) | _may_touch(gap, turn * length)
        largest = max(largest, _in_facets(gap, length, counts))
    return float(model.comm.allreduce(largest, op=MPI.MAX))


def slid(model: ContactModel, slave: Array, master: Array | None, tool: Affine | None) -> float:
    """Largest sliding distance of nodes in contact since detection, in facets. Collective.

    Points, normals and weights are those of contact detection: nodes that have slid by much of a
    facet act at an earlier position of the other surface. Nodes that touched at contact detection
    count even if they are open now: points of a round surface that rotates in place leave their
    positions, and others take their place. Nodes also count if rotation may have caused their open
    gap: normals that rotate by φ, while points slide by s, open gaps by up to s φ, which other
    points close.

    Args:
        model: The contact; its constraints are normal gaps.
        slave: Displacement of the slave's body since contact detection, at all unknowns of this
            rank (length).
        master: Displacement of the master's body; None for a tool.
        tool: Displacement of a tool.
    """
    turn = _turn(model, tool)
    local = max(_slid(model, gap, (slave, master), tool, turn) for gap in model.gaps)
    return float(model.comm.allreduce(local, op=MPI.MAX))


def turned(model: ContactModel) -> float:
    """Largest rotation (radians) of facets of bodies since contact detection. Collective.

    Forces act along the normals of contact detection: frictionless forces have the same error. The
    result is 0 for nodal quadrature, which stays as in the paper, and on tools: there,
    contact updates for this reason take twice the iterations, and results are no closer to those of
    small steps (``bench/one_newton.py --scenes roller``).
    """
    is_nodal = model.settings.sampling.quadrature == "nodal"
    return 0.0 if is_nodal or is_rigid(model.master) else _turn(model, None)


def largest_turn(model: ContactModel) -> float:
    """Largest rotation (radians) of facets, or of a tool, since contact detection. Collective."""
    if is_rigid(model.master):
        return rotation_of(model.placement.master.motion)
    return _turn(model, None)


def _turn(model: ContactModel, tool: Affine | None) -> float:
    """Largest rotation (radians) of facets or of a tool since contact detection. Collective."""
    largest = rotation_of(tool)
    for place in model.placement.bodies:
        first, now = area_vectors(place.coordinates[0]), area_vectors(place.vertices())
        sine = np.linalg.norm(np.cross(first, now), axis=1)
        angles = np.arctan2(sine, np.sum(first * now, axis=1))
        largest = max(largest, float(np.max(angles, initial=0.0)))
    return float(model.comm.allreduce(largest, op=MPI.MAX))


def _slid(
    model: ContactModel, gap: WeightedGap, ways: Ways, tool: Affine | None, turn: float
) -> float:
    touched = gap.operator.initial_gap + gap.allowance < NOTICED * gap.slave.facet_size_range[0]
    length = _along(model, gap, ways, tool)
    counts = _on_nodes(gap, active_set.closed(model, gap) | touched)
    counts |= _may_touch(gap, turn * length)
    return _in_facets(gap, length, counts)


def _in_facets(gap: WeightedGap, length: Array, counts: Flags) -> float:
    """Largest distance of the nodes that count over the size of the largest facet at the node."""
    size = np.asarray(gap.slave.cpp_object.node_facet_size)
    return float(np.max((length / size)[counts], initial=0.0))


def _may_touch(gap: WeightedGap, opened: Array) -> Flags:
    """Nodes with an open gap smaller than a given length, (nodes,). Collective."""
    rows = gap.rows.from_nodes(opened)
    found = gap.rows.largest_on_nodes(gap.state.values[:, 0] + rows) > 0
    sides = found.size // max(len(opened), 1)
    return np.asarray(np.any(found.reshape(len(opened), sides), axis=1))


def _on_nodes(gap: WeightedGap, rows: Flags) -> Flags:
    """Nodes that have constraints with a flag, (nodes,). Collective."""
    return np.asarray(gap.rows.on_nodes(rows, False), dtype=bool)


def _along(model: ContactModel, gap: WeightedGap, ways: Ways, tool: Affine | None) -> Array:
    """Sliding distances of nodes along the surface (length), (nodes,). Collective."""
    mean_jump = _mean_jump(gap, model.ordered(gap, ways), tool)
    jump = np.asarray(gap.rows.on_nodes(mean_jump, 0.0), dtype=np.float64)
    normal = gap.slave.node_normal[:, : gap.slave.gdim]
    along = jump - np.sum(jump * normal, axis=1)[:, None] * normal
    return np.asarray(np.linalg.norm(along, axis=1))


def _mean_jump(gap: WeightedGap, ways: Ways, tool: Affine | None) -> Array:
    """Mean relative displacement of the two sides for each constraint. Collective."""
    operator = gap.jump_operator()
    vecs = gap.slave.create_vec(), gap.master.create_vec()
    for vec, way in zip(vecs, ways, strict=True):
        if vec is not None and way is not None:
            vec.array[:] = way[: len(vec.array_r)]
    jump = operator.apply(handle_of(vecs[0]), handle_of(vecs[1]))
    if tool is not None:
        moved = affine_vec(gap.slave, tool)
        jump = jump - operator.apply(moved.handle, 0)
        moved.destroy()
    for vec in vecs:
        if vec is not None:
            vec.destroy()
    return np.asarray(jump / operator.slave_sum[:, :1])
