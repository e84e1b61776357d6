"""Checks for rotations that are too large for small sliding, or for ties across a gap."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Placement, is_analytic
from qsdolfinx.contact.slid import largest_turn

Array = npt.NDArray[np.float64]

#: Spurious traction, over the largest traction of the tie, that gaps rotated by small rotations may
#: cause. More is an error that users see: test_rings_turned_by_hand in tests/steps/test_ties.py.
NOTICED = 0.05

#: Part of the contact force in other directions than along the present normals above which a solve
#: warns; a smaller rotation (radians) cannot cause it. See ``tests/contact/test_turned.py``.
MISDIRECTED = 0.1


def find_turned_normals(model: ContactModel) -> str | None:
    """Warning if forces of small sliding act along normals that have turned, or None. Collective.

    Forces act along the normals of contact detection. Those of a round tool that rotates in place
    do not turn. A velocity-based body is paired within the step, for which normals at its end are
    not better; nodal quadrature stays as in the paper.
    """
    is_nodal = model.settings.sampling.quadrature == "nodal"
    if model.follows or is_nodal or not all(model.kinematics.in_displacement):
        return None
    if largest_turn(model) <= MISDIRECTED:
        return None
    share = _misdirected(model)
    if share <= MISDIRECTED:
        return None
    return (
        "sliding: surfaces in contact have turned since contact detection, but small sliding keeps "
        f"the normals found then: {share:.0%} of the contact force does not act along the present "
        'normals; take sliding="finite", or smaller steps of a qs.TimeStepper'
    )


def _misdirected(model: ContactModel) -> float:
    """Part of the contact force that does not act along the present normals. Collective.

    It is the mean change of the normals at the slave's nodes, weighted with their forces.
    """
    gap, slave, now = model.gaps[0], model.slave, model.placement
    pressure = gap.rows.on_nodes(gap.multiplier(model.eps), 0.0).astype(np.float64)[:, 0]
    force = np.maximum(pressure, 0.0) * slave.node_area
    radius = model.paired.search_radius
    before, after = (_normals(place, radius) for place in (now.as_paired, now))
    turn = np.linalg.norm(after - before, axis=1)
    known = np.isfinite(turn)
    sums = np.array([force[known] @ turn[known], force[known].sum()])
    model.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    return float(sums[0] / sums[1]) if sums[1] > 0 else 0.0


def _normals(placement: Placement, radius: float) -> Array:
    """Unit normals along which forces would act at the slave's nodes, (nodes, 3). Collective.

    They are the bisectors of the normals of two bodies, and those of a tool, see ``slid.turned``.
    They are NaN where nothing is opposite within the search distance.
    """
    facets, other = placement.slave.facets(), placement.master
    x, own = np.asarray(facets.node_x), np.asarray(facets.node_normal)
    if is_analytic(other):
        distance, there = other.tool.distance(x, other.positions())
        found = np.abs(distance) <= radius
    else:
        closest = _cpp.closest_points(x, own, facets, other.facets(), radius)
        there, found = closest["mean_normal"], closest["found"].astype(bool)
    both = np.where(found[:, None], (own if other.bodies else 0.0) - there, np.nan)
    both /= np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-300)
    at = np.searchsorted(facets.node_dofs[:, 0], placement.slave.surface.node_dofs[:, 0])
    return np.asarray(both[at])


def find_turned_tie(model: ContactModel) -> str | None:
    """Warning about a tie that has rotated too far, or None. Collective."""
    share = turning_error(model)
    if share <= NOTICED:
        return None
    return (
        "sliding: tied surfaces with a gap between them have rotated so far since they were paired "
        f"that the linearised rotation causes {min(share, 1.0):.0%} of the largest traction: "
        'take sliding="finite", or smaller steps of a TimeStepper'
    )


def turning_error(model: ContactModel) -> float:
    """Spurious traction by the error of small rotations, over the largest one. Collective.

    It is the error of the gap times the stiffness of the bodies' nodes beside it; 0 for contact
    that is not tied.
    """
    if all(gap.turning is None for gap in model.gaps):
        return 0.0
    places = model.placement.slave.positions(), model.placement.master.positions()
    error = largest = 0.0
    for gap in model.gaps:
        both = model.ordered(gap, places)
        error = max(error, float(np.max(gap.turning_error(both), initial=0.0)))
        traction = np.linalg.norm(gap.multiplier(model.eps), axis=1)
        largest = max(largest, float(np.max(traction, initial=0.0)))
    both_found = np.array([error, largest])
    model.comm.Allreduce(MPI.IN_PLACE, both_found, op=MPI.MAX)
    error, largest = both_found
    if error <= SOLVED * model.paired.facet_size or largest * model.compliance == 0.0:
        return 0.0
    return float(error / (model.compliance * largest))
