"""Restore the volume enclosed by a new boundary."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.outline import enclosed_volume, volume_gradient
from qsdolfinx.remeshing.retriangulate import Boundary

Array = npt.NDArray[np.float64]

#: Relative change of the volume that counts as rounding error: a larger one would remain after each
#: new mesh.
EXACT = 1e-12

#: Displacement of nodes, in units of the local cell size, above which the volume cannot be
#: restored. With more, cells at the boundary would be turned over.
FAR = 0.25


def restore_volume(boundary: Boundary, volume: float, axisymmetric: bool) -> float:
    """Shift free nodes along their normals until the boundary encloses a volume.

    Nodes on planes stay on them; fixed nodes are not moved. All others move by the same distance
    along the admissible part of the normal.

    Args:
        boundary: The boundary; its coordinates are changed in place.
        volume: The volume (2D: area; axisymmetric: of the whole body).
        axisymmetric: Whether coordinates are (r, z).

    Returns:
        The largest displacement of a node (length).

    Raises:
        RemeshError: If nodes would have to move too far.
    """
    start, x = boundary.x.copy(), boundary.x
    directions = _directions(boundary)
    for _ in range(5):
        gradient, now = volume_gradient(x, boundary.facets, axisymmetric)
        if abs(now - volume) <= EXACT * volume:
            break
        slope = float(np.sum(gradient * directions))
        if slope <= 0.0:
            break
        x += (volume - now) / slope * directions
        boundary.onto_planes()
    ways = np.linalg.norm(x - start, axis=1)
    far = ways > FAR * boundary.sizes
    if far.any():
        change = enclosed_volume(start, boundary.facets, axisymmetric) / volume - 1
        boundary.x = start
        raise RemeshError.at(
            f"the volume within the new boundary differs by {change:.2g}, too much to be restored: "
            "ask for smaller cells",
            start[far][np.argsort(-ways[far])],
        )
    return float(ways.max(initial=0.0))


def _directions(boundary: Boundary) -> Array:
    """Unit normals of free nodes, without components normal to their planes; 0 at fixed nodes."""
    x, facets = boundary.x, boundary.facets
    normal = np.zeros_like(x)
    curved = _area_vectors(x, facets)
    for i in range(facets.shape[1]):
        np.add.at(normal, facets[:, i], curved)
    for planes, nodes in boundary.on_same_planes():
        basis = np.linalg.svd(np.array([plane.normal for plane in planes]))
        across = basis[2][: int(np.sum(basis[1] > 1e-9))]
        normal[nodes] -= (normal[nodes] @ across.T) @ across
    normal[boundary.fixed] = 0.0
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.asarray(np.divide(normal, size, out=np.zeros_like(normal), where=size > 0))


def _area_vectors(x: Array, facets: npt.NDArray[np.int64]) -> Array:
    corners = x[facets]
    if facets.shape[1] == 3:
        return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    along = corners[:, 1] - corners[:, 0]
    return np.stack([along[:, 1], -along[:, 0], 0 * along[:, 0]], axis=1)
