"""Find distances between deformed surfaces, or to rigid tools, by brute force over all facets."""

import dataclasses
import typing

import numpy as np
from audit.state import cross_product
from fuzz.brute import closest, dot, unit

#: Distances count as equal up to this fraction of the facet size.
SAME = 1e-9

#: Angle between the line to the closest point and the normal, as a tangent, beyond which the point
#: is beside the surface.
BESIDE = 0.3


@dataclasses.dataclass
class Found:
    """Closest points of an opponent to given points.

    Attributes:
        distance: Signed distance, positive if apart, shape (points,).
        facing: Whether the point is in front of the opponent or inside it, and not beside it.
        normal: Outward normal of the opponent at the closest point, shape (points, 3).
        nodes: Nodes of the opponent's segment, triangle or quadrilateral; None for a tool.
        weights: Their shape functions at the closest point.
        points: The given points; only for a tool that rotates.
    """

    distance: np.ndarray
    facing: np.ndarray
    normal: np.ndarray
    nodes: np.ndarray | None = None
    weights: np.ndarray | None = None
    points: np.ndarray | None = None


class Meshed:
    """A surface of a body; see :class:`Tool`.

    Args:
        body: State of the body.
        surface: State of the surface.
    """

    #: Whether the surface belongs to a tool.
    rigid = False

    def __init__(self, body, surface):
        self.body, self.surface = body, surface
        self.at_rest, self.deformed = body.x[surface.pieces], (body.x + body.u)[surface.pieces]

    def normals(self, corners):
        """Return outward unit normals of the segments or triangles with these corners."""
        return unit(cross_product(corners)) * self.surface.sign[:, None]

    def find(self, points, deformed=True):
        """Find the closest points, on the deformed or on the undeformed surface."""
        corners = self.deformed if deformed else self.at_rest
        normals = self.normals(corners)
        size = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).max()
        q = closest(points, corners)
        away = points[:, None] - q
        length = np.linalg.norm(away, axis=2)
        pick, rows = np.argmin(length, axis=1), np.arange(len(points))
        # On an edge or a vertex, use the normals of all facets there.
        equal = length <= length[rows, pick][:, None] + SAME * size
        normal = unit(equal.astype(float) @ normals)
        steepest = np.abs(np.where(equal, np.sum(away * normals, axis=2), 0.0)).max(axis=1)
        offset, nodes = away[rows, pick], self.surface.pieces[pick]
        if self.is_bilinear:
            nodes = self.surface.facets[self.surface.parent[pick]]
            x = self.body.x + (self.body.u if deformed else 0.0)
            weights, across = closest_bilinear(x[nodes], points)
            across = unit(across) * self.surface.sign[pick][:, None]
            offset = points - np.einsum("pi,pij->pj", weights, x[nodes])
            inside = np.all(weights > SAME, axis=1)
            normal = np.where(inside[:, None], across, normal)
            steepest = np.maximum(steepest * ~inside, np.abs(dot(offset, across)))
        else:
            weights = barycentric(corners[pick], q[rows, pick])
        # At a convex edge the line is between the normals of the facets, and equals none of them.
        beside = np.sqrt(np.maximum(dot(offset, offset) - steepest**2, 0.0))
        facing = beside <= BESIDE * steepest + SAME * size
        distance = np.where(dot(offset, normal) < 0, -1, 1) * np.linalg.norm(offset, axis=1)
        return Found(distance, facing, normal, nodes, weights)

    @property
    def is_bilinear(self):
        """Whether facets are quadrilaterals with nodes only at their vertices, and may be warped.

        Displacements of degree 2 are treated as of degree 1 between the nodes.
        """
        surface = self.surface
        return surface.facets.shape[1] == 4 and len(surface.nodes) == len(surface.vertices)

    def displacement(self, found):
        """Return the displacement of the closest points."""
        return np.einsum("pi,pij->pj", found.weights, self.body.u[found.nodes])


def barycentric(corners, points):
    """Return shape functions of intervals or triangles at points on them."""
    edges = corners[:, 1:] - corners[:, :1]
    gram = np.einsum("pix,pjx->pij", edges, edges)
    right = np.einsum("pix,px->pi", edges, points - corners[:, 0])
    inner = np.linalg.solve(gram, right[..., None])[..., 0]
    return np.concatenate([1 - inner.sum(axis=1, keepdims=True), inner], axis=1)


def closest_bilinear(corners, points):
    """Return shape functions and normals of quadrilaterals at their closest points to given points.

    By the Gauss-Newton method, then along one coordinate after the other, which also converges on
    edges.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    c, p = corners[:, 3] - corners[:, 0] - a - b, points - corners[:, 0]
    s, t = np.full((2, len(points), 1), 0.5)
    for _ in range(10):
        slopes = np.stack([a + t * c, b + s * c], axis=1)
        gram = np.einsum("pix,pjx->pij", slopes, slopes)
        right = np.einsum("pix,px->pi", slopes, p - s * a - t * b - s * t * c)
        step = np.linalg.solve(gram, right[..., None])
        s, t = np.clip(s + step[:, 0], 0, 1), np.clip(t + step[:, 1], 0, 1)
    for _ in range(20):
        s = np.clip(dot(p - t * b, a + t * c) / dot(a + t * c, a + t * c), 0, 1)[:, None]
        t = np.clip(dot(p - s * a, b + s * c) / dot(b + s * c, b + s * c), 0, 1)[:, None]
    weights = np.concatenate([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
    return weights, np.cross(a + t * c, b + s * c)


@dataclasses.dataclass
class Tool:
    """A rigid plane (a point and a normal) or sphere, in 2D a circle (its centre and radius)."""

    point: np.ndarray
    normal: np.ndarray | None = None
    radius: float | None = None
    shift: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    rigid: typing.ClassVar[bool] = True

    def find(self, points, deformed=True):
        """Find the closest points, for the present or the initial position of the tool."""
        away = points - self.point - (self.shift if deformed else 0.0)
        every = np.ones(len(points), dtype=bool)
        if self.radius is None:
            normal = np.broadcast_to(self.normal, points.shape)
            return Found(away @ self.normal, every, normal)
        return Found(np.linalg.norm(away, axis=1) - self.radius, every, unit(away))

    def displacement(self, found):
        """Return the displacement of the closest points."""
        return np.broadcast_to(self.shift, found.normal.shape)
