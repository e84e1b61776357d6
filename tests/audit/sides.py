"""One side of a contact: forces, normals, distances and angles at its nodes."""

import dataclasses
import functools

import numpy as np
from audit.distance import Found, Meshed, Tool
from audit.state import cross_product
from fuzz.brute import dot, unit


@dataclasses.dataclass
class Side:
    """A surface and its opponent. Points are vertices, the other nodes, and centres of facet parts.

    Attributes:
        own: The surface.
        opponent: The opposite surface or tool.
        now: Closest points of the opponent to the deformed points.
        rest: Closest points in the undeformed state.
        alone: Whether each vertex has its own gap and normal.
    """

    own: Meshed
    opponent: Meshed | Tool
    now: Found
    rest: Found
    alone: bool

    @property
    def body(self):
        return self.own.body

    @property
    def gdim(self):
        return self.own.surface.pieces.shape[1]

    # --- Forces

    @property
    def nodal_x(self):
        return self.body.x[self.own.surface.nodes]

    @property
    def nodal_force(self):
        """Forces of the other side, and reactions where there are conditions."""
        return self.body.force[self.own.surface.nodes]

    @property
    def nodal_held(self):
        return self.body.held[self.own.surface.nodes]

    @functools.cached_property
    def force(self):
        """Nodal forces of the vertices' functions of degree 1: never negative if pushed."""
        return self.own.surface.hat @ self.nodal_force

    @functools.cached_property
    def held(self):
        """Components of these forces that contain reactions of conditions."""
        return (self.own.surface.hat > 0).astype(float) @ self.nodal_held > 0

    @property
    def hat_count(self):
        """Number of nodes of each function."""
        return np.count_nonzero(self.own.surface.hat, axis=1)

    @functools.cached_property
    def area(self):
        """Areas of the vertices."""
        surface, corners = self.own.surface, self.own.at_rest
        if self.own.is_bilinear:
            shares = bilinear_areas(self.body.x[surface.facets])
            out = np.zeros(self.num_vertices)
            np.add.at(out, np.searchsorted(surface.vertices, surface.facets), shares)
            return out
        size = np.linalg.norm(cross_product(corners), axis=1) / (corners.shape[1] - 1)
        hat = np.zeros((len(self.body.x), self.num_vertices))
        hat[surface.nodes] = surface.hat.T
        return size @ hat[surface.pieces].mean(axis=1)

    @functools.cached_property
    def normal(self):
        """Undeformed outward normals at the vertices: mean normals, or the tool's reversed."""
        if self.opponent.rigid:
            return -self.rest.normal[: self.num_vertices]
        surface = self.own.surface
        sums = np.zeros((len(self.body.x), 3))
        weighted = cross_product(self.own.at_rest) * surface.sign[:, None]
        for corner in surface.pieces.T:
            np.add.at(sums, corner, weighted)
        return unit(surface.hat @ sums[surface.nodes])

    @property
    def pull(self):
        """Force along the outward normal, negative if it pushes."""
        return dot(self.force, self.normal)

    @property
    def tangential(self):
        return self.force - self.pull[:, None] * self.normal

    @property
    def normal_free(self):
        """Vertices whose normal force comes from contact only."""
        return ~np.any(self.held & (np.abs(self.normal) > 1e-6), axis=1)

    @property
    def pressure(self):
        """Pressure at the vertices where it is known, otherwise 0."""
        return np.where(self.normal_free, -self.pull / self.area, 0.0)

    # --- Positions

    @property
    def num_vertices(self):
        return len(self.own.surface.vertices)

    @functools.cached_property
    def points(self):
        """Undeformed points."""
        return places(self.own.surface, self.body.x)

    @functools.cached_property
    def points_now(self):
        return places(self.own.surface, self.body.x + self.body.u)

    @property
    def vertices_now(self):
        return self.points_now[: self.num_vertices]

    @functools.cached_property
    def near_free(self):
        """Points whose facet parts have no node held along the normal."""
        surface = self.own.surface
        normals = self.own.normals(self.own.at_rest)
        bad = self.body.held[surface.pieces] & (np.abs(normals) > 1e-6)[:, None]
        off = np.any(bad, axis=(1, 2))
        nodes = np.zeros(len(self.body.x), dtype=bool)
        nodes[surface.pieces[off].ravel()] = True
        return ~np.concatenate([nodes[node_order(surface)], off])

    @functools.cached_property
    def size(self):
        """Size of the largest facet."""
        x = self.body.x[self.own.surface.facets]
        return np.linalg.norm(x[:, :, None] - x[:, None], axis=-1).max()

    # --- Motion, and angles between facets

    @functools.cached_property
    def jump(self):
        """Displacement of the points relative to their undeformed partners."""
        u = places(self.own.surface, self.body.u)
        return u - self.opponent.displacement(self.rest)

    @functools.cached_property
    def slide(self):
        """Largest tangential part of the jump."""
        jump = self.jump[: self.num_vertices]
        across = jump - dot(jump, self.normal)[:, None] * self.normal
        facing = self.rest.facing[: self.num_vertices]
        return np.linalg.norm(across[facing], axis=1).max(initial=0.0)

    @functools.cached_property
    def initial_gap(self):
        """Initial gaps of the vertices; 0 for vertices beside the other side."""
        n = self.num_vertices
        return np.where(self.rest.facing[:n], np.abs(self.rest.distance[:n]), 0.0)

    @functools.cached_property
    def opening(self):
        """Largest distance of points that face the other side, deformed or undeformed."""
        both = [np.abs(f.distance[f.facing]).max(initial=0.0) for f in (self.now, self.rest)]
        return max(both)

    def lever(self, sideways, tolerance):
        """Return the lever of forces on points that were not opposite to each other."""
        loaded = np.linalg.norm(self.force, axis=1) > tolerance
        gap = np.where(loaded, self.initial_gap, 0.0).max(initial=0.0)
        # A node beside the other surface may have been paired.
        beside = np.any(loaded & ~self.rest.facing[: self.num_vertices])
        tilt = np.where(loaded, self.tilt_at_rest, 0.0).max(initial=0.0)
        return gap * (1.0 if sideways else tilt) + tilt * self.size + 0.1 * self.size * beside

    @functools.cached_property
    def tilt_at_rest(self):
        """Sine of the largest angle between a vertex normal and normals nearby, undeformed."""
        return self.angles(deformed=False)

    @functools.cached_property
    def turn(self):
        """The same, also with the deformed normals."""
        return np.maximum(self.tilt_at_rest, self.angles(deformed=True))

    def angles(self, deformed):
        """Return sines of the largest angles between vertex normals and nearby facet normals."""
        own = self.own.deformed if deformed else self.own.at_rest
        found = self.now if deformed else self.rest
        centres, normals = own.mean(axis=1), self.own.normals(own)
        x = self.vertices_now if deformed else self.points[: self.num_vertices]
        near = np.linalg.norm(x[:, None] - centres, axis=2) <= 2 * self.size
        out = np.where(near, sine(self.normal[:, None], normals), 0.0).max(axis=1)
        if self.opponent.rigid and not deformed:
            out = np.zeros(self.num_vertices)  # a tool's normals are used instead
        if self.opponent.rigid and isinstance(self.opponent, Meshed):
            others = self.opponent.deformed if deformed else self.opponent.at_rest
            centres, normals = others.mean(axis=1), self.opponent.normals(others)
            wide = np.linalg.norm(others[:, 1:] - others[:, :1], axis=2).max()
            near = np.linalg.norm(x[:, None] - centres, axis=2) <= 2 * self.size + wide
            out = np.maximum(
                out, np.where(near, sine(self.normal[:, None], normals), 0.0).max(axis=1)
            )
        points = self.points_now if deformed else self.points
        near = np.linalg.norm(x[:, None] - points, axis=2) <= (0 if self.alone else 2 * self.size)
        near &= found.facing
        return np.maximum(
            out, np.where(near, sine(self.normal[:, None], found.normal), 0.0).max(axis=1)
        )


def bilinear_areas(corners):
    """Integrate the shape functions of quadrilaterals, shape (facets, 4)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    c, out = corners[:, 3] - corners[:, 0] - a - b, np.zeros(corners.shape[:2])
    for s in 0.5 + np.array([-1, 1]) / np.sqrt(12):
        for t in 0.5 + np.array([-1, 1]) / np.sqrt(12):
            size = np.linalg.norm(np.cross(a + t * c, b + s * c), axis=1) / 4
            shape = np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
            out += size[:, None] * shape
    return out


def sine(a, b):
    return np.linalg.norm(np.cross(a, b), axis=-1)


def node_order(surface):
    """Return the vertices first, then the other nodes."""
    return np.concatenate([surface.vertices, np.setdiff1d(surface.nodes, surface.vertices)])


def places(surface, values):
    """Return values at the vertices, the other nodes and the centres of facet parts."""
    return np.concatenate([values[node_order(surface)], values[surface.pieces].mean(axis=1)])


def read_side(own, opponent, alone):
    """Make a side and find its distances."""
    at_rest = places(own.surface, own.body.x)
    now = places(own.surface, own.body.x + own.body.u)
    rest = opponent.find(at_rest, deformed=False)
    return Side(own, opponent, opponent.find(now), rest, alone)
