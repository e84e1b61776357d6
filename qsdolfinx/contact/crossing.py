"""Find points that have passed through the other surface since an earlier placement.

Contact detection finds only what lies within the search radius and faces the surface. A point that
was outside before and is inside now has passed through the surface, at whatever depth, and whether
or not the contact law noticed it.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.depth import SIDES, DeepPlace
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Placement, is_analytic
from qsdolfinx.pairing.distance import of_points, on_facets

Array = npt.NDArray[np.float64]


#: Part of its present depth that a point may have had before and still count as from outside. With
#: 0, points in contact, which penetrate a little, would never count; with 1, all points would.
OUTSIDE = 0.5


def motion_since(model: ContactModel, before: Placement) -> float:
    """Bound of the relative motion of the two surfaces since a placement. Collective.

    Args:
        model: The contact, evaluated.
        before: The earlier placement of the surfaces.

    Returns:
        A bound (length).
    """
    comm = model.comm
    if model.placement is before:
        return 0.0
    moved, *others = displacements_since(model, before)
    if not others:
        return _longest(comm, moved)
    sums = np.append(moved.reshape(-1, 3).sum(axis=0), moved.size / 3)
    sums = comm.allreduce(sums, op=MPI.SUM)
    mean = sums[:3] / max(sums[3], 1.0)
    return _longest(comm, moved - mean) + _longest(comm, others[0] - mean)


def displacements_since(model: ContactModel, before: Placement) -> list[Array]:
    """Displacements of the trace's nodes of the bodies, (facets, nodes, 3) each. Collective.

    With a rigid tool, there are those of the slave alone, relative to the tool.
    """
    now = model.placement
    carried = now.master.carried(before.slave.positions(), before.master)
    both = zip(now.master.bodies, before.master.bodies, strict=True)
    return [
        now.slave.positions() - carried,
        *(place.positions() - start.positions() for place, start in both),
    ]


def deepest_crossing(
    model: ContactModel, before: Placement, moved: float, least: float, unpaired: float = np.inf
) -> DeepPlace | None:
    """Deepest point that was outside the other surface before and is inside now. Collective.

    Args:
        model: The contact, evaluated.
        before: The earlier placement of the surfaces.
        moved: Bound of the relative motion, see :func:`motion_since`.
        least: Smallest depth (length) that is reported.
        unpaired: Such a depth for slave nodes that no contact quadrature point reaches.

    Raises:
        DegenerateFacetsError: If a facet has no area.
    """
    if model.with_itself:  # points within the body are always inside
        return None
    # Points further from the other surface, or deeper, cannot have come from outside; but paths are
    # not straight.
    farthest = 1.1 * moved
    radius = model.paired.search_radius + farthest
    found: list[tuple[float, tuple[float, ...], str]] = []
    for side, nodes in _sampled(model):
        x, was = _depths(before, side, nodes, radius)
        x, depth = _depths(model.placement, side, nodes, radius)
        came = ~(was > OUTSIDE * depth) & (depth - np.fmax(was, 0.0) <= farthest)
        limit = np.full(len(x), least)
        if side == "slave" and nodes:
            limit[_alone(model)] = min(least, unpaired)
        deep = np.flatnonzero(came & (depth > limit))
        if len(deep):
            i = deep[np.argmax(depth[deep])]
            place = tuple(float(c) for c in x[i, : model.slave.gdim])
            found.append((float(depth[i]), place, side))
    all_found = [f for each in model.comm.allgather(found) for f in each]
    if not all_found:
        return None
    most, where, of = max(all_found)
    return DeepPlace(where, most, of)


def _longest(comm: MPI.Intracomm, vectors: Array) -> float:
    lengths = np.linalg.norm(vectors.reshape(-1, 3), axis=1)
    return float(comm.allreduce(np.max(lengths, initial=0.0), op=MPI.MAX))


def _sampled(model: ContactModel) -> list[tuple[str, bool]]:
    """Sides to be checked, each with a flag: nodes, or points within facets."""
    sides = SIDES[:1] if model.master.is_analytic else SIDES
    return [(side, nodes) for side in sides for nodes in (True, False)]


def _depths(placement: Placement, side: str, nodes: bool, radius: float) -> tuple[Array, Array]:
    """Points of a side and their depths, in an order that does not depend on positions."""
    place = placement.place(side)
    other = placement.master if side == "slave" else placement.slave
    own = place.facets()
    points = _cpp.sample_nodes(own) if nodes else on_facets(own, own.facet_x.shape[1])
    x = points.slave["x"]
    if is_analytic(other):
        distance, _ = other.tool.distance(x, other.positions())
        return x, -distance  # a point inside is inside in whatever direction it faces
    found = of_points(x, points.normal, own, other.facets(), radius)
    return x, np.where(found.beside, np.nan, found.depth)


def _alone(model: ContactModel) -> npt.NDArray[np.int64]:
    """Owned slave nodes without a constraint, in the numbering of the deformed surface."""
    gap = model.gaps[0]
    alone = np.setdiff1d(np.arange(len(model.slave.node_area)), gap.rows.reached)
    dofs = model.placement.slave.facets().node_dofs[:, 0]
    return np.flatnonzero(np.isin(dofs, model.slave.node_dofs[alone, 0]))
