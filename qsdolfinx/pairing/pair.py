"""Quadrature of the contact integrals (7): where the gap is sampled."""

from __future__ import annotations

import numpy as np

import basix

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import RigidSurface

QUADRATURES = ("nodal", "overlay")
NORMALS = ("facet", "averaged", "bisector")  # in the order of Normals in cpp/surface/surface.h

#: Degree of the rule along edges for general quadrilaterals: cpp/geometry/planar.h, PlanarFacet.
EDGE_DEGREE = 47


def _degree(surface: Surface | RigidSurface, order: int) -> int:
    """Total polynomial degree of Lagrange functions of this order on affine facets."""
    return order * (2 if surface.num_facet_vertices == 4 else 1)


def check_quadrature(
    slave: Surface, master: Surface | RigidSurface, quadrature: str, degree: int | None
) -> int:
    """Degree of the rule: the one given, or one that integrates exactly on affine facets.

    Raises:
        ValueError: If it is not a positive integer, or the nodal rule is to sample traces of degree
            2: their values at the vertices say nothing of the edges.
    """
    traces = [
        (surface, surface.degree) for surface in (slave, master) if isinstance(surface, Surface)
    ]
    if quadrature == "nodal" and any(order > 1 for _, order in traces):
        raise ValueError(
            "quadrature: the nodal rule samples the gap at vertices, which sees nothing of the "
            'edges\' unknowns of a displacement of degree 2; use quadrature="overlay"'
        )
    if degree is not None:
        whole = isinstance(degree, (int, np.integer)) and not isinstance(degree, bool)
        if not whole or degree < 1:
            raise ValueError(f"quadrature_degree: must be a positive integer, not {degree!r}")
        return int(degree)
    trace = max(_degree(surface, order) for surface, order in traces)
    facets: list[Surface | RigidSurface] = [slave]
    if isinstance(master, Surface) or not master.is_analytic:
        facets.append(master)
    return max(_degree(surface, 1) for surface in facets) + trace + int(slave.axisymmetric)


def pair(
    slave: Surface,
    master: Surface | RigidSurface,
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
    if isinstance(master, RigidSurface) and master.is_analytic:
        return _face_shape(slave, master, quadrature, degree, radius)
    points = _pair_facets(slave, master, quadrature, degree, normals, both, radius)
    if isinstance(master, RigidSurface):
        _cpp.forget_master(points)
    return points


def _pair_facets(
    slave: Surface,
    master: Surface | RigidSurface,
    quadrature: str,
    degree: int,
    normals: str,
    both: bool,
    radius: float,
) -> _cpp.PairingPoints:
    """Pairing points of two surfaces made of facets; see :func:`pair`."""
    kind_of_normals = NORMALS.index(normals)
    axisymmetric = slave.axisymmetric
    if isinstance(master, RigidSurface):
        other = master.facets(axisymmetric)
    else:
        other = master._cpp_object
    if quadrature == "nodal":
        return _cpp.pair_surfaces(slave._cpp_object, other, both, radius, kind_of_normals)
    kind = basix.CellType.interval if slave.gdim == 2 else basix.CellType.triangle
    piece_x, piece_w = map(np.asarray, basix.make_quadrature(kind, degree))
    edge_x, edge_w = map(np.asarray, basix.make_quadrature(basix.CellType.interval, EDGE_DEGREE))
    return _cpp.overlay_surfaces(
        slave._cpp_object,
        other,
        both,
        radius,
        kind_of_normals,
        piece_x,
        piece_w,
        edge_x,
        edge_w,
    )


def _face_shape(
    slave: Surface, tool: RigidSurface, quadrature: str, degree: int, radius: float
) -> _cpp.PairingPoints:
    """Points of the slave at their exact distance from a tool, along the tool's normals."""
    if quadrature == "nodal":
        points, group = _cpp.sample_nodes(slave._cpp_object), 1
    else:
        kinds = basix.CellType.interval, basix.CellType.triangle, basix.CellType.quadrilateral
        kind = kinds[slave.num_facet_vertices - 2]
        x, w = map(np.asarray, basix.make_quadrature(kind, degree))
        points, group = _cpp.sample_facets(slave._cpp_object, x, w), len(w)
    gap, normal = tool.distance(points.slave["x"])
    # As between two surfaces: what is too far away, or the back of a body, is not paired.
    keep = (np.abs(gap) <= radius) & (np.sum(normal * points.normal, axis=1) < 0)
    _cpp.face_tool(points, keep.astype(np.uint8), -normal, gap, group)
    return points
