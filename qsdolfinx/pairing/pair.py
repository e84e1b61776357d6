"""Quadrature of the contact integrals (7): where the gap is sampled."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, as_tool

Array = npt.NDArray[np.float64]

QUADRATURES = ("nodal", "overlay")
SMOOTHINGS = ("none", "shared-curvature")
NORMALS = ("facet", "bisector")  # in the order of Normals in cpp/pairing/pairing.h


class Sampling(typing.NamedTuple):
    """Where and along which normals the gap is sampled.

    Attributes:
        quadrature: ``"nodal"`` or ``"overlay"``.
        degree: Degree of the rule on the pieces of the overlay.
        normals: ``"facet"`` or ``"bisector"``.
        smoothing: ``"none"`` or ``"shared-curvature"``.
    """

    quadrature: str
    degree: int
    normals: str
    smoothing: str = "none"


#: Part of S_k that points cover, below which a node has no augmented multiplier of its own.
LEAST_COVER = 0.1

#: Degree of the rule along edges for general quadrilaterals: cpp/geometry/planar.h, PlanarFacet.
EDGE_DEGREE = 47


def check_quadrature(
    slave: Surface, master: AnySurface, quadrature: str, degree: int | None
) -> int:
    """Degree of the rule: the one given, or one that integrates exactly on affine facets.

    Raises:
        ValueError: If it is not a positive integer, or the nodal rule is to sample traces of degree
            2: their values at the vertices say nothing about the edges.
    """
    if quadrature == "nodal" and max(slave.degree, master.degree) > 1:
        raise ValueError(
            "quadrature: the nodal rule samples the gap at vertices, which sees nothing of the "
            'edges\' unknowns of a displacement of degree 2; use quadrature="overlay"'
        )
    if degree is not None:
        whole = isinstance(degree, (int, np.integer)) and not isinstance(degree, bool)
        if not whole or degree < 1:
            raise ValueError(f"quadrature_degree: must be a positive integer, not {degree!r}")
        return int(degree)
    both = slave, master
    trace = max(surface.shape_degree(surface.degree) for surface in both)
    return max(surface.shape_degree(1) for surface in both) + trace + slave.area_degree


def pair(
    slave: Surface,
    master: AnySurface,
    sampling: Sampling,
    both: bool,
    radius: _cpp.SearchRadius,
    corners: bool = False,
) -> _cpp.PairingPoints:
    """Pairing points of one pass. Collective.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        sampling: Where the gap is sampled.
        both: Whether both surfaces are sampled, each with half the weight.
        radius: Beyond which points are not paired.
        corners: Whether at nodes, between facets, a node in the corner of several walls has a pair
            for each of them and the side of the node that faces it.
    """
    tool = as_tool(master)
    if tool is not None and tool.is_analytic:
        return _face_shape(slave, tool, sampling, radius)
    points = _pair_facets(slave, master, sampling, both, radius, corners)
    if tool is not None:
        _cpp.forget_master(points)
    return points


def share_out_hardly_covered(slave: Surface, points: _cpp.PairingPoints) -> None:
    """Let neighbours carry the multipliers of nodes that points hardly cover. Collective.

    Beyond the master's rim a node's row is nearly that of its neighbour: two multipliers that are
    to close the gap would grow against each other.
    """
    _cpp.share_out_hardly_covered(points, slave.cpp_object, LEAST_COVER)


def _pair_facets(
    slave: Surface,
    master: AnySurface,
    sampling: Sampling,
    both: bool,
    radius: _cpp.SearchRadius,
    corners: bool,
) -> _cpp.PairingPoints:
    """Pairing points of two surfaces made of facets; see :func:`pair`."""
    kind_of_normals = NORMALS.index(sampling.normals)
    other = master.search_object(slave)
    if sampling.quadrature == "nodal":
        return _cpp.pair_surfaces(slave.cpp_object, other, both, radius, kind_of_normals, corners)
    return _cpp.overlay_surfaces(
        slave.cpp_object,
        other,
        both,
        radius,
        kind_of_normals,
        *overlay_rules(slave.gdim, sampling.degree),
        sampling.smoothing == "shared-curvature",
    )


def overlay_rules(gdim: int, degree: int) -> tuple[Array, Array, Array, Array]:
    """Points and weights on pieces of the overlay and along edges."""
    kind = basix.CellType.interval if gdim == 2 else basix.CellType.triangle
    piece_x, piece_w = map(np.asarray, basix.make_quadrature(kind, degree))
    edge_x, edge_w = map(np.asarray, basix.make_quadrature(basix.CellType.interval, EDGE_DEGREE))
    return piece_x, piece_w, edge_x, edge_w


class Conforming(typing.NamedTuple):
    """Points of the slave on this rank where both surfaces are curved the same way.

    Attributes:
        bulges: How far the surfaces of slave and master are out of their facets (length), along the
            slave's normal, shape (points, 2).
        gap: Between the curved surfaces (length).
        part: Part of all that is paired, of all ranks.
    """

    bulges: Array
    gap: Array
    part: float


def find_conforming(
    slave: Surface, master: AnySurface, degree: int, radius: _cpp.SearchRadius
) -> Conforming:
    """Where two surfaces made of facets are curved the same way. Collective."""
    found, area = _cpp.conforming_points(
        slave.cpp_object, master.search_object(slave), radius, *overlay_rules(slave.gdim, degree)
    )
    sums = slave.comm.allreduce(np.array([found[:, 3].sum(), area]), op=MPI.SUM)
    part = float(sums[0] / sums[1]) if sums[1] > 0 else 0.0
    return Conforming(found[:, :2], found[:, 2], part)


def _face_shape(
    slave: Surface, tool: RigidSurface, sampling: Sampling, radius: _cpp.SearchRadius
) -> _cpp.PairingPoints:
    """Points of the slave at their exact distance from a tool, along the tool's normals."""
    if sampling.quadrature == "nodal":
        points, group = _cpp.sample_nodes(slave.cpp_object), 1
    else:
        kinds = basix.CellType.interval, basix.CellType.triangle, basix.CellType.quadrilateral
        kind = kinds[slave.num_facet_vertices - 2]
        x, w = map(np.asarray, basix.make_quadrature(kind, sampling.degree))
        points, group = _cpp.sample_facets(slave.cpp_object, x, w), len(w)
    gap, normal = tool.distance(points.slave["x"])
    # As between two surfaces: what is too far away, or the back of a body, is not paired.
    keep = (np.abs(gap) <= radius.largest) & (np.sum(normal * points.normal, axis=1) < 0)
    _cpp.face_tool(points, keep.astype(np.uint8), -normal, gap, group)
    return points
