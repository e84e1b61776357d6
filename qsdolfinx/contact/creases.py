"""Check for sharp edges of two bodies in 3D that cross where contact has no points."""

from __future__ import annotations

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import AnyPlace
from qsdolfinx.pairing.crossings import EdgesRole, deepest_of_creases
from qsdolfinx.pairing.edges import Edges, edges_at, outward_signs
from qsdolfinx.surface.deformed import DegenerateFacetsError
from qsdolfinx.tools.rigid_surface import AnySurface

#: Depth, in units of the smallest facet, above which crossing sharp edges give a warning.
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


def _edges(surface: AnySurface, place: AnyPlace) -> Edges:
    """Edges of one side at its present position. Collective."""
    facets = surface.as_facets()
    return edges_at(facets, place.vertices(), outward_signs(facets))
