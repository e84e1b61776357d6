"""Checks for corners of the master in 2D whose contact is narrower than the slave's facets."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.contact.between_nodes import sizes_at_points
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.pairing.facets import corner_nodes
from qsdolfinx.surface.deformed import DegenerateFacetsError

Array = npt.NDArray[np.float64]

#: Part of the contact force at corners of a tool above which a warning is given. Where sides of the
#: corner carry as much, forces are 3 % too large; where the corner carries all, 5 % to 120 %.
CARRIED = 0.5

#: Radius of a corner over the size of the facets there from which on forces of a corner that is
#: dragged swing by 2 % or less, and its work is that of the body's energy to 1.5 %: with half this
#: radius by 16 %, and to 5 % (``tests/sliding/test_tool_corners.py``).
ROUNDED = 2.0

#: Depth of a corner in units of the facet there from which on it is compared with the motion of the
#: facet by the force, and the ratio of both above which a warning is given. Above it forces are 4 %
#: to 60 % too small as the corner is moved by half a facet; where they are right to 4 % everywhere,
#: the ratio is 0.9 at most, and corners may be 0.13 facets deep.
DEEP, UNMOVED = 0.04, 0.95

#: Part of the force within three facets of a corner that is within one if contact is that narrow.
#: Facets beside the corners of a wider face carry less, and its force is right to 3 %.
NARROW = 0.8

#: Least angle (radians) between the two facets at a corner: with less, segments of round tools
#: would be corners; with more, blunt ones of 20° are not seen.
CORNER = float(np.radians(15))

#: Size of facets to name over the present one: forces that were up to 60 % too small are right to
#: 5 % with it.
FINER = 0.25


def find_loaded_corners(model: ContactModel) -> str | None:
    """Warning about corners of a tool in 2D that carry most of the force, or None. Collective.

    A corner touches one point of a facet. The gap there is that to the facet, and its force has the
    direction of a curved surface: this force is not the derivative of the gap, and its work not the
    energy of the body. Even if it were, the body would be as stiff as this point of its facet,
    whether or not sides of the corner touch the body between two nodes.

    Args:
        model: The contact, solved.
    """
    roles = model.settings.roles_of_vertices
    corners = [gap for role, gap in zip(roles, model.of_vertices, strict=False) if role.of_tool]
    if model.slave.gdim != 2 or not corners:
        return None
    total, at_corners = 0.0, 0.0
    found: list[tuple[float, float, tuple[float, ...]]] = []
    for gap in model.gaps:
        force = gap.weight * np.linalg.norm(gap.multiplier(model.eps), axis=1)
        total += float(force.sum())
        if gap not in corners:
            continue
        at_corners += float(force.sum())
        x, size = _positions(gap), sizes_at_points(model, gap)
        if len(x):
            most = int(np.argmax(force[: len(x)]))
            place = tuple(float(c) for c in x[most, : model.slave.gdim])
            found.append((float(force[most]), float(size[most]), place))
    total, at_corners = model.comm.allreduce(np.array([total, at_corners]), op=MPI.SUM)
    if not at_corners > CARRIED * total:
        return None
    _, size_there, place = max(one for each in model.comm.allgather(found) for one in each)
    where = ", ".join(f"{c:.4g}" for c in place)
    return (
        f"constraints: sharp corners of the tool, such as that near ({where}), carry "
        f"{at_corners / total:.0%} of the contact force, each at one point of a facet of size "
        f"{size_there:.3g}: forces are too large, swing by 10 % or more as a corner slides from "
        "facet to facet, and do work that is not the energy of the body; round these corners with "
        f"a radius of at least {ROUNDED * size_there:.3g} (or {ROUNDED:g} facets, if these are "
        "refined) in segments that turn by 10° or less, and let contact be 4 facets wide"
    )


def _positions(gap: WeightedGap) -> Array:
    """Points of the constraints on this rank, (points, 3)."""
    if gap.following is not None and gap.cut is not None:
        return gap.following.points(gap.cut)[0]
    return np.asarray(gap.points.slave["x"])


def find_deep_corners_of_master(model: ContactModel) -> str | None:
    """Warning about corners of the master that are deep where the facet gives way less, or None.

    With finite sliding, corners of a body, blunt corners of a tool, and its corners beside a face
    that lies on the body, have no constraints of their own. The gaps of the facet they face are
    closed in the mean. If contact is narrower than the facet, open gaps beside the corner
    compensate its depth, and its force is too small. Bodies of degree 2 are not checked.
    Collective.

    Args:
        model: The contact, solved.
    """
    slave, master, now = model.slave, model.master, model.placement
    if master.is_analytic or not model.follows or slave.gdim != 2 or slave.axisymmetric:
        return None
    if model.with_itself or model.compliance <= 0:
        return None
    if any(body.degree > 1 for body in master.bodies):  # their deformed facets have other nodes
        return None
    which = corner_nodes(master.as_facets(), CORNER)
    if not model.comm.allreduce(bool(which.any()), op=MPI.LOR):
        return None
    try:
        moved = now.master.facets(), now.slave.facets()
    except DegenerateFacetsError:  # such facets have no distances
        return None
    points = _cpp.pair_vertices(*moved, which.astype(np.uint8), model.paired.radius)
    least = DEEP * model.paired.facet_size + model.overclosure.allowed
    deep = [
        (-float(gap), tuple(map(float, x)))
        for gap, x in zip(points.gap, points.slave["x"], strict=True)
        if -gap > least
    ]
    for depth, x in sorted(one for each in model.comm.allgather(deep) for one in each)[::-1]:
        size, force, wider = _around(model, np.array(x))
        given_way = model.compliance * force / size
        allowed = max(DEEP * size + model.overclosure.allowed, UNMOVED * given_way)
        if force > NARROW * wider and depth > allowed:
            where = ", ".join(f"{c:.4g}" for c in x[: slave.gdim])
            whose = "tool" if master.tools else "master"
            return (
                f"constraints: a corner of the {whose} near ({where}) is {depth:.3g} deep in a "
                f"facet of size {size:.3g}, and its force moves it by {given_way:.2g} only: "
                "contact there is narrower than the facet, and the force is too small; refine the "
                f"surface there to facets of at most {FINER * size:.2g}"
            )
    return None


def _around(model: ContactModel, x: Array) -> tuple[float, float, float]:
    """Size of the facet at a place, and normal forces within 1 and 3 times of it. Collective."""
    places, sizes, forces = [], [], []
    for gap in model.of_sides:
        at = _positions(gap)
        force = gap.weight * np.linalg.norm(gap.multiplier(model.eps), axis=1)
        places.append(np.linalg.norm(at - x, axis=1))
        sizes.append(sizes_at_points(model, gap)[: len(at)])
        forces.append(force[: len(at)])
    away, size, force = map(np.concatenate, (places, sizes, forces))
    mine = min(zip(away.tolist(), size.tolist(), strict=True), default=(np.inf, 1.0))
    there = min(model.comm.allgather(mine))[1]
    near = np.array([force[away < times * there].sum() for times in (1, 3)])
    near = model.comm.allreduce(near, op=MPI.SUM)
    return there, float(near[0]), float(near[1])
