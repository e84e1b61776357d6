"""Checks for sharp edges in 3D that penetrate where contact has no points."""

from __future__ import annotations

from qsdolfinx.contact.between_nodes import UNEVEN
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import AnyPlace
from qsdolfinx.contact.results import mean_penetration
from qsdolfinx.pairing.crossings import EdgesRole, deepest_of_creases, deepest_on_faces
from qsdolfinx.pairing.edges import Edges, edges_at, outward_signs
from qsdolfinx.surface.deformed import DegenerateFacetsError
from qsdolfinx.tools.rigid_surface import AnySurface

#: Depth, in units of the smallest facet, above which sharp edges give a warning. The rim of a flat
#: punch that facets resolve is less deep; an edge that cuts into a face is deeper.
NOTICED = 0.02


def find_crossing_edges(model: ContactModel) -> str | None:
    """Warning about sharp edges that penetrate where they cross, or None. Collective.

    Contact with finite sliding has points on facets and at vertices, but not where edges cross.

    Args:
        model: The contact, solved.
    """
    if not all(model.settings.sharp) or not model.follows or model.slave.gdim == 2:
        return None
    now = model.placement
    try:
        moved = now.slave.facets(), now.master.facets()
    except DegenerateFacetsError:  # such facets have no distances
        return None
    role = EdgesRole(model.slave, model.master, (True, True), moved)
    edges = _edges(model.slave, now.slave), _edges(model.master, now.master)
    depth, x = deepest_of_creases(role, edges, model.paired.search_radius)
    if depth <= NOTICED * model.paired.facet_size + model.overclosure.allowed:
        return None
    place = ", ".join(f"{c:.4g}" for c in x)
    return (
        f"sliding: edges of both surfaces cross near ({place}), {depth:.3g} deep in each other: "
        '"finite" has constraints on facets and at vertices only; take sliding="small", which also '
        "has constraints where edges cross, or round these edges over several facets"
    )


def find_deep_edges(model: ContactModel) -> str | None:
    """Warning about sharp edges that penetrate faces of the other body, or None. Collective.

    Contact with finite sliding has no points at sharp edges and corners of tools in 3D, nor where
    sharp edges cross mesh lines. Facets beside an edge that is deep between their nodes have open
    gaps, which compensate its depth in the mean: there may be hardly any force.

    Args:
        model: The contact, solved.
    """
    slave, master, now = model.slave, model.master, model.placement
    if master.is_analytic or not model.follows or slave.gdim == 2:
        return None
    try:
        moved = now.slave.facets(), now.master.facets()
    except DegenerateFacetsError:  # such facets have no distances
        return None
    found = [
        deepest_on_faces(
            EdgesRole(slave, master, (i == 0, i == 1), moved),
            _edges(surface, place),
            model.paired.search_radius,
        )
        for i, (surface, place) in enumerate(((slave, now.slave), (master, now.master)))
    ]
    depth, x = max(found)
    allowed = NOTICED * model.paired.facet_size + model.overclosure.allowed
    if depth <= max(allowed, UNEVEN * mean_penetration(model)):
        return None
    where = ", ".join(f"{c:.4g}" for c in x)
    owner = "slave" if found[0] >= found[1] else "master"
    return (
        f"sliding: a sharp edge or corner of the {owner} near ({where}) is {depth:.3g} deep in a "
        "face of the other surface, with too small a force: finite sliding has constraints on "
        'facets and vertices of bodies only; take sliding="small", which has them at edges, too, '
        "and at corners of tools, or round the edge over several facets"
    )


def _edges(surface: AnySurface, place: AnyPlace) -> Edges:
    """Edges of one side at its present position. Collective."""
    facets = surface.as_facets()
    return edges_at(facets, place.vertices(), outward_signs(facets))
