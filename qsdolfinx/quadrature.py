"""Quadrature of the contact integrals (7): where the gap is sampled."""

from __future__ import annotations

import numpy as np

import basix
from dolfinx import mesh

from qsdolfinx import _cpp
from qsdolfinx.surface import Surface

QUADRATURES = ("nodal", "overlay")
NORMALS = ("facet", "averaged", "bisector")  # in the order of Normals in cpp/surface.h

#: Degree of the rule along edges for general quadrilaterals, see PlanarFacet in cpp/planar.h.
EDGE_DEGREE = 47


def _degree(surface: Surface, order: int) -> int:
    """Total polynomial degree of Lagrange functions of this order on affine facets."""
    return order * (2 if surface.mesh.topology.cell_type == mesh.CellType.hexahedron else 1)


def check_quadrature(slave: Surface, master: Surface, quadrature: str, degree: int | None) -> int:
    """Degree of the rule: the one given, or one that integrates exactly on affine facets.

    Raises:
        ValueError: If it is not a positive integer, or the nodal rule is to sample traces of degree
            2: their values at the vertices say nothing of the edges.
    """
    if quadrature == "nodal" and (slave.degree, master.degree) != (1, 1):
        raise ValueError(
            "quadrature: the nodal rule samples the gap at vertices, which sees nothing of the "
            'edges\' unknowns of a displacement of degree 2; use quadrature="overlay"'
        )
    if degree is not None:
        if not isinstance(degree, (int, np.integer)) or degree < 1:
            raise ValueError(f"quadrature_degree: must be a positive integer, not {degree!r}")
        return int(degree)
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
        normals: ``"facet"``, ``"averaged"`` or ``"bisector"``.
        both: Whether both surfaces are sampled, each with half the weight.
        radius: Search radius (length).
    """
    kind_of_normals = NORMALS.index(normals)
    if quadrature == "nodal":
        return _cpp.pair_surfaces(
            slave._cpp_object, master._cpp_object, both, radius, kind_of_normals
        )
    kind = basix.CellType.interval if slave.gdim == 2 else basix.CellType.triangle
    piece_x, piece_w = map(np.asarray, basix.make_quadrature(kind, degree))
    edge_x, edge_w = map(np.asarray, basix.make_quadrature(basix.CellType.interval, EDGE_DEGREE))
    return _cpp.overlay_surfaces(
        slave._cpp_object,
        master._cpp_object,
        both,
        radius,
        kind_of_normals,
        piece_x,
        piece_w,
        edge_x,
        edge_w,
    )
