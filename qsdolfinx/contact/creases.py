"""Checks for sharp edges in 3D that penetrate where contact has no points."""

from __future__ import annotations

from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place, Placement
from qsdolfinx.contact.results import mean_penetration
from qsdolfinx.pairing.crossings import EdgesRole, deepest_of_creases, deepest_on_faces
from qsdolfinx.pairing.edges import Edges, edges_at, outward_signs
from qsdolfinx.pairing.facets import as_facets
from qsdolfinx.surface.deformed import DegenerateFacetsError
from qsdolfinx.tools.rigid_surface import AnySurface, as_tool

#: Depth, in units of the smallest facet, above which sharp edges give a warning.
NOTICED = 0.02

#: Such a depth in units of the largest weighted gap: a soft penalty allows this everywhere.
UNEVEN = 3.0


def find_crossing_edges(model: ContactModel) -> str | None:
    """Warning about sharp edges that penetrate where they cross, or None. Collective.

    Contact with finite sliding has points on facets and at vertices, but not where edges cross.

    Args:
        model: The contact, solved.
    """
    settings = model.settings
    none = model.law.jump or model.with_itself or not all(settings.sharp)
    if none or not model.follows or model.slave.gdim == 2:
        return None
    now = model.placement
    try:
        moved = now.slave.facets(), now.master.facets()
    except DegenerateFacetsError:  # such facets have no distances
        return None
    role = EdgesRole(model.slave, model.master, (True, True), moved)
    edges = _edges(model.slave, now), _edges(model.master, now)
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
    settings, slave, master = model.settings, model.slave, model.master
    none = model.law.jump or model.with_itself or master.is_analytic
    if none or not model.follows or slave.gdim == 2:
        return None
    now = model.placement
    try:
        moved = now.slave.facets(), now.master.facets()
    except DegenerateFacetsError:  # such facets have no distances
        return None
    found = [
        deepest_on_faces(
            EdgesRole(slave, master, (i == 0, i == 1), moved),
            _edges(surface, now),
            model.paired.search_radius,
        )
        for i, surface in enumerate((slave, master))
    ]
    depth, x = max(found)
    allowed = NOTICED * model.paired.facet_size + model.overclosure.allowed
    if depth <= max(allowed, UNEVEN * mean_penetration(model)):
        return None
    place = ", ".join(f"{c:.4g}" for c in x)
    owner = "slave" if found[0] >= found[1] else "master"
    return (
        f"sliding: a sharp edge or corner of the {owner} near ({place}) is {depth:.3g} deep in a "
        f'face of the other surface, with too small a force: "{settings.sliding}" has constraints '
        'on facets and at vertices of bodies only; take sliding="small", which also has '
        "constraints at edges and at corners of tools, or round the edge over several facets"
    )


def _edges(surface: AnySurface, now: Placement) -> Edges:
    """Sharp edges of one side at its present position. Collective."""
    tool = as_tool(surface)
    facets = as_facets(surface, now.slave.surface.axisymmetric)
    if tool is None:
        place = now.slave if now.slave.surface is surface else now.master
        assert isinstance(place, Place)
        return edges_at(facets, place.vertices(), outward_signs(facets))
    assert not isinstance(now.master, Place)
    return edges_at(facets, tool.facet_positions(now.master.now), outward_signs(facets))
