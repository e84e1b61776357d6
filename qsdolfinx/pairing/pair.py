"""Quadrature of the contact integrals (7): where the gap is sampled."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix

import qsdolfinx._cpp as _cpp
from qsdolfinx.pairing.points import with_unknowns_alone
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, is_rigid, is_shape

Array = npt.NDArray[np.float64]

QUADRATURES = ("nodal", "overlay")
NORMALS = ("facet", "bisector")
OF_TOOL = "the tool's"
#: All kinds of normals, in the order of Normals in cpp/pairing/pairing.h.
KINDS_OF_NORMALS = (*NORMALS, OF_TOOL)


class Sampling(typing.NamedTuple):
    """Quadrature points and normals for sampling the gap.

    Attributes:
        quadrature: ``"nodal"`` or ``"overlay"``.
        degree: Degree of the rule on the segments of the overlay.
        normals: ``"facet"`` or ``"bisector"``.
        follows: Whether gaps are updated with the deformed geometry.
        degree_is_given: Whether the user has chosen the degree.
    """

    quadrature: str
    degree: int
    normals: str
    follows: bool = False
    degree_is_given: bool = False

    def normals_to(self, master: AnySurface) -> str:
        """Kind of normals along which points are paired with a master, of KINDS_OF_NORMALS.

        Forces act along the normals of a rigid tool, as for an analytic shape. With a mean of its
        normals and those of the slave, which tilt at its nodes, a flat tool would push sideways.
        """
        return OF_TOOL if is_rigid(master) else self.normals

    def heights(self, surface: AnySurface) -> Array | None:
        """Heights of curved facets over flat ones, see ``Surface.heights``; None for flat facets.

        With updated geometry the facets are those between the displaced nodes of degree 2. If
        displacements are of degree 1, these facets are flat on any mesh.
        """
        return None if self.follows and surface.degree == 1 else surface.heights


#: Least covered part of S_k, and of the area of a side of a node, for a multiplier of its own in
#: the augmented Lagrangian. With less it is not determined; with more, whole nodes at the edge of a
#: surface carry nothing.
LEAST_COVER = 0.1


def check_quadrature(
    slave: Surface, master: AnySurface, quadrature: str, degree: int | None, follows: bool
) -> int:
    """Return the degree of the rule: the given degree, or :func:`degree_of_rule`.

    Raises:
        ValueError: If the degree is not a positive integer, or if the nodal rule is given for
            traces of degree 2: values at the vertices contain nothing about the unknowns of the
            edges.
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
    return degree_of_rule(slave, master, follows)


def degree_of_rule(slave: Surface, master: AnySurface, follows: bool) -> int:
    """Default degree of the rule on segments.

    On affine facets, products of the functions of multipliers and displacements are integrated
    exactly. With updated geometry, where segmentation is repeated in each iteration, the degree for
    quadrilaterals is that of one factor only: uniform pressure is exact, with half as many points.
    """
    both = slave, master
    trace = max(surface.shape_degree(surface.degree) for surface in both)
    if follows:
        return max(trace, 1 + max(surface.degree for surface in both)) + slave.area_degree
    return max(surface.shape_degree(1) for surface in both) + trace + slave.area_degree


def pair(
    slave: Surface,
    master: AnySurface,
    sampling: Sampling,
    both: bool,
    radius: _cpp.SearchRadius,
    corners: bool = False,
) -> _cpp.PairingPoints:
    """Find the contact quadrature points of one integration side. Collective.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        sampling: Quadrature and normals.
        both: Whether both surfaces are sampled, each with half the weight.
        radius: Search distance: points farther away are not paired.
        corners: Whether, with the nodal rule between facets, a node in the corner of several walls
            has a pair for each wall, with the smooth patch of the node that faces it.
    """
    if is_shape(master):
        return _face_shape(slave, master, sampling, radius)
    points = _pair_facets(slave, master, sampling, both, radius, corners)
    return with_unknowns_alone(points, master)


def share_out_hardly_covered(slave: Surface, points: _cpp.PairingPoints) -> None:
    """Condense the multipliers of nodes that are hardly covered to their neighbours. Collective.

    Beyond the boundary of the master, the constraint of a node is nearly that of its neighbour: two
    multipliers that close the gap would grow with opposite signs.
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
    """Contact quadrature points of two surfaces made of facets; see :func:`pair`."""
    kind_of_normals = KINDS_OF_NORMALS.index(sampling.normals_to(master))
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
        sampling.heights(slave),
        sampling.heights(master),
    )


def overlay_rules(gdim: int, degree: int) -> tuple[Array, Array, Array, Array]:
    """Points and weights on segments of the overlay and along edges."""
    kind = basix.CellType.interval if gdim == 2 else basix.CellType.triangle
    piece_x, piece_w = map(np.asarray, basix.make_quadrature(kind, degree))
    # For general quadrilaterals: see PlanarFacet in cpp/geometry/planar.h.
    edge_x, edge_w = map(np.asarray, basix.make_quadrature(basix.CellType.interval, 47))
    return piece_x, piece_w, edge_x, edge_w


class Conforming(typing.NamedTuple):
    """Points of the slave on this rank where both surfaces are curved in the same direction.

    Attributes:
        points: All paired points; their gaps are the changes of the gap by chord errors.
        bulges: Heights of the curved surfaces of slave and master over flat facets (length), along
            the slave's normal, 0 on curved facets, shape (conforming points, 2).
        gap: Gap between the curved surfaces at these points (length).
        part: Area of these points over the area of all pairs, of all ranks.
    """

    points: _cpp.PairingPoints
    bulges: Array
    gap: Array
    part: float


def find_conforming(
    slave: Surface,
    master: AnySurface,
    degree: int,
    radius: _cpp.SearchRadius,
    follows: bool = False,
) -> Conforming:
    """Find the points where two surfaces are curved in the same direction. Collective.

    Args:
        slave: Surface that carries the multiplier.
        master: The other surface.
        degree: Degree of the rule.
        radius: Search distance: points farther away are not paired.
        follows: Whether gaps are updated with the deformed geometry.
    """
    sampling = Sampling("overlay", degree, "bisector", follows)
    if is_shape(master):
        return _conforming_to_shape(slave, master, sampling, radius.largest)
    points, found = _cpp.conforming_points(
        slave.cpp_object,
        master.search_object(slave),
        radius,
        *overlay_rules(slave.gdim, degree),
        sampling.heights(slave) is None,
        sampling.heights(master) is None,
    )
    part = _part(slave, found[:, 3], points.weight)
    points = with_unknowns_alone(points, master)
    return Conforming(points, found[:, :2], found[:, 2], part)


def _part(slave: Surface, some: Array, weights: Array) -> float:
    """Area of some points over that of all. Collective."""
    sums = slave.comm.allreduce(np.array([some.sum(), weights.sum()]), op=MPI.SUM)
    return float(sums[0] / sums[1]) if sums[1] > 0 else 0.0


def facet_rule(slave: Surface, degree: int) -> tuple[Array, Array]:
    """Points and weights on the slave's reference facet."""
    kinds = basix.CellType.interval, basix.CellType.triangle, basix.CellType.quadrilateral
    x, w = basix.make_quadrature(kinds[slave.num_facet_vertices - 2], degree)
    return np.asarray(x), np.asarray(w)


def _face_shape(
    slave: Surface, tool: RigidSurface, sampling: Sampling, radius: _cpp.SearchRadius
) -> _cpp.PairingPoints:
    """Points of the slave at their exact distance from a tool, along the tool's normals."""
    rule = None if sampling.quadrature == "nodal" else facet_rule(slave, sampling.degree)
    if rule is None:
        points, group = _cpp.sample_nodes(slave.cpp_object), 1
    else:
        points, group = _cpp.sample_facets(slave.cpp_object, *rule), len(rule[1])
    gap, normal = tool.distance(points.slave["x"])
    # As between two surfaces, points that are too far away or on the back of a body are not paired.
    keep = (np.abs(gap) <= radius.largest) & (np.sum(normal * points.normal, axis=1) < 0)
    heights = sampling.heights(slave)
    if rule is not None and heights is not None:
        gap = gap - np.asarray(_cpp.heights_at(slave.cpp_object, heights, *rule))
    _cpp.face_tool(points, keep.astype(np.uint8), -normal, gap, group)
    return points


def _conforming_to_shape(
    slave: Surface, tool: RigidSurface, sampling: Sampling, radius: float
) -> Conforming:
    """Find points where a slave is curved as an analytic tool, which has no facets. Collective."""
    rule = facet_rule(slave, max(sampling.degree, 4))  # with points where heights are largest
    points = _cpp.sample_facets(slave.cpp_object, *rule)
    distance, normal = tool.distance(points.slave["x"])
    near = (np.abs(distance) <= radius) & (np.sum(normal * points.normal, axis=1) < 0)
    own = np.asarray(_cpp.heights_at(slave.cpp_object, None, *rule))
    # Height that the tool would have above the facets if it touched all their vertices.
    N = np.asarray(points.multiplier_values).reshape(-1, len(rule[1]), slave.num_facet_vertices)
    x = slave.coordinates[0]
    at_vertices = tool.distance(x.reshape(-1, 3))[0].reshape(x.shape[:2])
    of_tool = distance - np.einsum("fpv,fv->fp", N, at_vertices).ravel()
    alike = (own * of_tool > 0) & (abs(own) < 2 * abs(of_tool)) & (abs(of_tool) < 2 * abs(own))
    alike &= near
    of_facets = own if sampling.heights(slave) is None else np.zeros_like(own)
    both = np.column_stack([of_facets, np.zeros_like(own)])[alike]
    weight = np.asarray(points.weight)
    part = _part(slave, weight[alike], weight[near])
    gap = np.where(alike, of_facets, 0.0)
    _cpp.face_tool(points, near.astype(np.uint8), -normal, gap, len(rule[1]))
    return Conforming(points, both, (distance - own)[alike], part)
