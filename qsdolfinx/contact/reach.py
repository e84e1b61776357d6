"""Surfaces that have passed through each other where contact had not looked when it was paired."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.messages import ContactWarning
from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact.crossing import deepest_crossing, motion_since
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.passed import find_passed
from qsdolfinx.surface.deformed import DegenerateFacetsError


class ReachWarning(ContactWarning):
    """Points have passed through the other surface without being found by contact detection."""


def find_passed_through(model: ContactModel) -> str | None:
    """What to say of points that were outside when they were paired, and are inside, unseen.

    Those are slave nodes without a partner, and any points that are deeper than the search radius.
    Where facets without an area have no distances, it says that. Collective.

    Args:
        model: The contact, solved.
    """
    before = model.placement.as_paired
    moved = motion_since(model, before)
    radius = model.paired.search_radius
    try:
        passed = find_passed(model, before)
        if passed is not None:
            return (
                f"{passed} has passed through a part of the other surface: make time steps in "
                "which surfaces move by less than the part is thick"
            )
        if moved <= reach(model):
            return None  # nothing can have come from beyond what was paired
        found = deepest_crossing(model, before, moved, radius, NOTICED * model.paired.facet_size)
    except DegenerateFacetsError as error:
        return (
            f"{error}: it is not known whether surfaces have passed through each other; the "
            "solution satisfies the equations, but is probably not the one that is meant"
        )
    if found is None:
        return None
    return (
        f"surfaces have passed through each other, {found}, where contact had not looked when "
        f"it was paired (search_radius: {radius:g}): give a larger search_radius, or make time "
        "steps, which pair anew"
    )


def reach(model: ContactModel) -> float:
    """How far surfaces may move (length) without a point coming from beyond what is paired.

    Points that are paired do not get deep without moving by the search radius; others may be
    just beyond the radius at their place. Collective.
    """
    paired, slave = model.paired, model.slave
    alone = np.setdiff1d(np.arange(len(slave.node_area)), model.gaps[0].rows.reached)
    if model.settings.search_radius != "local" or model.master.is_analytic:
        least = paired.search_radius if len(alone) else np.inf
    else:
        sizes = np.asarray(slave.cpp_object.node_facet_size)[alone]
        least = float(np.min(sizes, initial=np.inf))
    return min(model.comm.allreduce(least, op=MPI.MIN), paired.search_radius)
