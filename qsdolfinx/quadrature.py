"""Quadrature of the contact integrals (7): where the gap is sampled."""

from __future__ import annotations

import basix
from dolfinx import mesh

from qsdolfinx import _cpp
from qsdolfinx.surface import Surface

QUADRATURES = ("nodal", "overlay")
NORMALS = ("facet", "averaged")

#: Degree of the rule along edges for general quadrilaterals, see PlanarFacet in cpp/planar.h.
EDGE_DEGREE = 47

#: Polynomial degree that the functions of a facet have in the plane, by its cell's type.
_IS_TENSOR = (mesh.CellType.hexahedron,)


def _degree(surface: Surface, order: int) -> int:
    """Total degree of Lagrange functions of this order on the surface's facets."""
    return order * (2 if surface.mesh.topology.cell_type in _IS_TENSOR else 1)


def default_degree(slave: Surface, master: Surface) -> int:
    """Degree that integrates multipliers times traces exactly on affine facets."""
    trace = max(_degree(surface, surface.degree) for surface in (slave, master))
    return max(_degree(slave, 1), _degree(master, 1)) + trace


def pair(
    slave: Surface,
    master: Surface,
    quadrature: str,
    degree: int,
    normals: str,
    both: bool,
    radius: float,
) -> _cpp.PairingPoints:
    """Pairing points of one pass. Collective.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        quadrature: ``"nodal"`` or ``"overlay"``.
        degree: Degree of the rule on the pieces of the overlay.
        normals: ``"facet"`` or ``"averaged"``.
        both: Whether both surfaces are sampled, each with half the weight.
        radius: Search radius (length).
    """
    averaged = normals == "averaged"
    if quadrature == "nodal":
        return _cpp.pair_surfaces(slave._cpp_object, master._cpp_object, both, radius, averaged)
    kind = basix.CellType.interval if slave.gdim == 2 else basix.CellType.triangle
    piece = basix.make_quadrature(kind, degree)
    edge = basix.make_quadrature(basix.CellType.interval, EDGE_DEGREE)
    return _cpp.overlay_surfaces(
        slave._cpp_object, master._cpp_object, both, radius, averaged, *piece, *edge
    )
