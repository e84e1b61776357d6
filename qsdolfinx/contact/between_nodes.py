"""Checks for points that penetrate between nodes whose weighted gaps are closed."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.handles import handle_of
from qsdolfinx.base.rounding import NOTICED
from qsdolfinx.contact import results
from qsdolfinx.contact.advice import facet_sizes
from qsdolfinx.contact.crossing import motion_since
from qsdolfinx.contact.depth import depths_of_points
from qsdolfinx.contact.depth import gap as gap_at_nodes
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap.weighted_gap import KINDS, WeightedGap
from qsdolfinx.pairing.facets import sharp_nodes
from qsdolfinx.surface.deformed import DegenerateFacetsError
from qsdolfinx.tools.rigid_surface import is_rigid

Array = npt.NDArray[np.float64]

#: Depth of a point, in units of the slave's facet size there, above which a warning is given. Well
#: resolved smooth bodies have depths of some hundredths, also at the ends of contact zones:
#: test_round_and_graded.
BETWEEN = 0.08

#: Such a depth in units of the largest weighted gap: a soft penalty allows this all around a node.
#: With less, each soft penalty would get a warning.
UNEVEN = 3.0


def find_deep_between_nodes(model: ContactModel) -> str | None:
    """Warning about points that penetrate where weighted gaps are closed, or None. Collective.

    Around an edge between two nodes, open gaps may compensate its penetration in the weighted gap,
    so that there may be no force at all. Depths are those of constraints at points: along the
    normals of the pairs, linear in displacements since contact detection.

    Args:
        model: The contact, solved.
    """
    settings = model.settings
    if settings.sampling.quadrature != "overlay":
        return None
    limit = BETWEEN * model.slave.facet_size_range[0] + model.overclosure.allowed
    if _deepest_when_paired(model) + motion_since(model, model.placement.as_paired) <= limit:
        return None
    weighted = results.mean_penetration(model)
    found: list[tuple[float, float, tuple[float, ...]]] = []
    for gap in model.of_sides:
        points, size = depths_of_points(model, gap), sizes_at_points(model, gap)
        limits = np.maximum(BETWEEN * size + model.overclosure.allowed, UNEVEN * weighted)
        beyond = points.depth - limits
        if len(beyond) and beyond.max() > 0:
            i = int(np.argmax(beyond))
            at = tuple(float(c) for c in points.x[i, : model.slave.gdim])
            found.append((float(points.depth[i]), float(size[i]), at))
    all_found = [f for each in model.comm.allgather(found) for f in each]
    if not all_found:
        return None
    depth, size_there, x = max(all_found)
    why = "an edge or tip sharper than the facets goes in between nodes, perhaps without a force"
    remedy = 'constraints="points", or finer facets'
    mean = "weighted gap of a node"
    if settings.constraints == "points":
        mean = "mean gap of a node's points"
        why = "facets are too coarse for the opposite surface, or bodies penetrated each other"
        remedy = "finer facets, or smaller steps"
    elif model.follows:
        can_swap = not is_rigid(model.master)
        remedy = "finer facets, or swap slave and master" if can_swap else "finer facets"
    place = ", ".join(f"{c:.4g}" for c in x)
    return (
        f"constraints: a point near ({place}) is {depth:.3g} deep in the other surface, "
        f"{depth / size_there:.2g} of the slave's facet there, and no {mean} is more than "
        f"{weighted:.2g}: {why}; take {remedy}"
    )


def find_deep_corners(model: ContactModel) -> str | None:
    """Warning about corners of the slave that penetrate before weighted gaps close, or None.

    Collective.
    """
    sharp = sharp_nodes(model.slave)
    if model.settings.sharp[0]:  # constraints of the slave's vertices, active from first contact
        sharp[model.of_vertices[0].rows.reached] = False
    if not model.comm.allreduce(bool(sharp.any()), op=MPI.LOR):
        return None
    closed = any(bool(np.any(gap.multiplier(model.eps) > 0)) for gap in model.gaps)
    # If nothing else carries a load, a corner should carry it from first contact.
    noticed = BETWEEN if model.comm.allreduce(closed, op=MPI.LOR) else NOTICED
    limit = noticed * model.slave.facet_size_range[0] + model.overclosure.allowed
    limit = max(limit, UNEVEN * results.mean_penetration(model))
    try:
        at_nodes = gap_at_nodes(model, "slave")
    except DegenerateFacetsError:  # there is no distance to such facets
        return None
    depth = np.where(sharp, np.nan_to_num(at_nodes, nan=0.0), 0.0)
    deepest = float(depth.max(initial=0.0))
    x = model.slave.node_x[int(np.argmax(depth))] if len(depth) else np.zeros(3)
    deepest, _, at = max(model.comm.allgather((deepest, model.comm.rank, tuple(map(float, x)))))
    if deepest <= limit:
        return None
    why = "its gap is a mean over the facets beside it: it carries too little or no force until "
    why, remedy = why + "it is about a quarter of a facet deep", 'constraints="points", '
    if model.settings.constraints == "points" or model.settings.sliding == "finite":
        remedy = ""
    if model.settings.constraints == "points":
        why = "only points of the facets beside it have constraints: it carries too little force"
    place = ", ".join(f"{c:.4g}" for c in at[: model.slave.gdim])
    return (
        f"constraints: a corner of the slave near ({place}) is {deepest:.3g} deep in the other "
        f"surface, and {why}; take {remedy}finer facets there, or a fillet of several facets"
    )


def sizes_at_points(model: ContactModel, gap: WeightedGap) -> Array:
    """Size (length) of the slave's facets at the points of a gap. Collective."""
    if gap.following is not None and gap.cut is not None:
        return gap.following.facet_sizes(gap.cut)
    slave = gap.slave
    x, dofs = slave.coordinates[0], slave.cpp_object.facet_dofs[..., 0].astype(PETSc.IntType)
    sums = [slave.create_vec(), slave.create_vec()]
    for vec, values in zip(sums, (facet_sizes(x), np.ones(len(x))), strict=True):
        at_nodes = np.repeat(values, dofs.shape[1])
        vec.setValues(dofs.ravel(), at_nodes, addv=PETSc.InsertMode.ADD_VALUES)
        vec.assemble()
    own = sums[1].array_r > 0
    sums[0].array[own] /= sums[1].array_r[own]
    surfaces = slave.cpp_object, gap.master.cpp_object
    operator = _cpp.GapOperator(*surfaces, gap.points, jump=True, rows=KINDS.index("points"))
    none = gap.master.create_vec()
    out = operator.apply(handle_of(sums[0]), handle_of(none))[:, 0]
    for vec in (*sums, none):
        if vec is not None:
            vec.destroy()
    return np.asarray(out)


def _deepest_when_paired(model: ContactModel) -> float:
    """Depth of the deepest contact quadrature point at contact detection. Collective."""
    deepest = max(float(np.max(-gap.points.gap, initial=0.0)) for gap in model.gaps)
    return float(model.comm.allreduce(deepest, op=MPI.MAX))
