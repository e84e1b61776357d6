"""Points that have gone in between nodes whose weighted gaps are closed."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.contact import results
from qsdolfinx.contact.crossing import motion_since
from qsdolfinx.contact.depth import depths_of_points
from qsdolfinx.contact.model import ContactModel

#: Depth of a point, in units of the slave's smallest facet, that is not left to weighted gaps.
#: Facets of curves and ends of contact leave some hundredths.
NOTICED = 0.08

#: The same, in units of the largest weighted gap: a soft penalty lets in all around a node.
UNEVEN = 3.0


def check_between_nodes(model: ContactModel) -> None:
    """Warn of points that are deep where the weighted gaps of nodes are closed. Collective.

    What is open around an edge between two nodes is set off against it, so that there may be no
    force at all. Depths are those that constraints at points would see: along the pairs' normals,
    linear in displacements since the pairing. Once for each contact.

    Args:
        model: The contact, solved.
    """
    settings = model.settings
    at_nodes = settings.constraints == "nodes" and settings.sampling.quadrature == "overlay"
    if model.depth_warned or model.law.jump or not at_nodes:
        return
    size = model.slave.facet_size_range[0]
    limit = NOTICED * size + model.overclosure.allowed
    if _deepest_when_paired(model) + motion_since(model, model.placement.as_paired) <= limit:
        return
    weighted = results.weighted_penetration(model)
    limit = max(limit, UNEVEN * weighted)
    found: list[tuple[float, tuple[float, ...]]] = []
    for gap in model.gaps:
        points = depths_of_points(model, gap)
        if len(points.depth) and points.depth.max() > limit:
            i = int(np.argmax(points.depth))
            found.append(
                (float(points.depth[i]), tuple(float(c) for c in points.x[i, : model.slave.gdim]))
            )
    all_found = [f for each in model.comm.allgather(found) for f in each]
    if not all_found:
        return
    depth, x = max(all_found)
    remedy = 'constraints="points", or finer facets'
    if model.follows:
        remedy = "finer facets, or swap slave and master"
    place = ", ".join(f"{c:.4g}" for c in x)
    warn(
        f"constraints: a point near ({place}) is {depth:.3g} deep in the other surface, "
        f"{depth / size:.2g} of the slave's smallest facet, and no weighted gap of a node is more "
        f"than {weighted:.2g}: an edge or tip sharper than the facets goes in between nodes, "
        f"perhaps without a force; take {remedy}",
        ContactWarning,
    )
    model.depth_warned = True


def _deepest_when_paired(model: ContactModel) -> float:
    """Depth of the deepest pairing point where it was paired. Collective."""
    deepest = max(float(np.max(-gap.points.gap, initial=0.0)) for gap in model.gaps)
    return float(model.comm.allreduce(deepest, op=MPI.MAX))
