"""Cover an old surface by new triangles of requested sizes."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from qsdolfinx.remeshing.features import Features, Plane
from qsdolfinx.remeshing.outline import listed
from qsdolfinx.remeshing.reference import OldSurface
from qsdolfinx.remeshing.triangulation import LEAST_SHAPE, Triangulation

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Part of the distance to the mean of its neighbours by which a node moves in a round. With 0
#: nothing is smoothed; above 1 nodes move beyond the mean.
STEP = 0.7

#: Ratio of singular values of normals (half of their angle, in radians) below which two planes
#: count as one for a node on both: their intersection moves far if the planes move a little.
NEARLY_ONE = 0.05


@dataclasses.dataclass
class Boundary:
    """A new boundary.

    Attributes:
        x: Coordinates of nodes, shape (nodes, 3).
        facets: Outward facets, shape (facets, gdim).
        tags: Tags of the facets, shape (facets,).
        sides: For each node, the numbers of the regions that contain it.
        planes: Planes of plane regions, by region number: nodes of a region must stay on its plane.
        fixed: Flags of nodes that are not moved, shape (nodes,).
        sizes: Requested cell sizes at the nodes (length), shape (nodes,).
    """

    x: Array
    facets: Indices
    tags: Indices
    sides: list[list[int]]
    planes: dict[int, Plane]
    fixed: npt.NDArray[np.bool_]
    sizes: Array

    def at(self, x: Array, planes: dict[int, Plane]) -> Boundary:
        """The boundary with its nodes at other places, exactly on planes.

        Args:
            x: Coordinates of nodes, shape (nodes, 3).
            planes: Planes by region number.
        """
        out = dataclasses.replace(self, x=x.copy(), planes=planes)
        out.onto_planes()
        return out

    def on_same_planes(self) -> list[tuple[list[Plane], Indices]]:
        """Sets of planes, and the nodes that must stay on exactly these planes."""
        nodes_of: dict[tuple[int, ...], list[int]] = {}
        planes_of: dict[tuple[int, ...], list[Plane]] = {}
        for node, numbers in enumerate(self.sides):
            found = {id(p): p for n in numbers if (p := self.planes.get(n)) is not None}
            if found:
                nodes_of.setdefault(tuple(found), []).append(node)
                planes_of[tuple(found)] = list(found.values())
        return [(planes, np.array(nodes_of[key])) for key, planes in planes_of.items()]

    def onto_planes(self) -> None:
        """Project nodes onto their planes, exactly if the planes are normal to axes."""
        for planes, nodes in self.on_same_planes():
            normals = np.array([plane.normal for plane in planes])
            levels = np.array([plane.level for plane in planes])
            off = levels - self.x[nodes] @ normals.T
            self.x[nodes] += off @ np.linalg.pinv(normals, rcond=NEARLY_ONE).T
            for plane in planes:
                if np.count_nonzero(plane.normal) == 1:
                    axis = int(np.argmax(np.abs(plane.normal)))
                    self.x[nodes, axis] = plane.level * plane.normal[axis]


def retriangulate(
    x: Array, triangles: Indices, tags: Indices, sizes: Array, features: Features
) -> Boundary:
    """Cover a closed surface by new triangles, with nodes on the old triangles.

    Edges are split and collapsed until they have the requested length, and flipped by the Delaunay
    criterion. Nodes are moved towards the mean of their neighbours and projected back onto the
    surface (Botsch and Kobbelt, 2004).

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        triangles: Outward, shape (triangles, 3).
        tags: Tags of the triangles, the same within each region, shape (triangles,).
        sizes: Wanted at nodes (length), shape (nodes,).
        features: What is kept.
    """
    used = np.unique(triangles)
    features = _renumbered(features, used)
    x, sizes = x[used], sizes[used]
    triangles = np.searchsorted(used, triangles)
    old = OldSurface(x, triangles, sizes, features)
    surface = Triangulation(x, triangles, sizes, features)
    for _ in range(12):  # after few rounds hardly any edge changes
        edges = len(surface.faces) * 3 // 2
        changes = surface.split_long() + surface.collapse_short()
        surface.turn_edges()
        _smooth(surface, old)
        if changes < 2e-3 * edges:  # with 0, some edges could be split and collapsed for ever
            break
    surface.turn_edges()
    tag_of = dict(zip(listed(features.region), listed(tags), strict=True))
    return _left(surface, features, tag_of)


def _renumbered(features: Features, used: Indices) -> Features:
    number = {int(node): i for i, node in enumerate(used)}
    lines = {(number[a], number[b]): line for (a, b), line in features.lines.items()}
    corners = {number[node] for node in features.corners}
    return Features(features.region, lines, corners, features.planes)


def _smooth(surface: Triangulation, old: OldSurface) -> None:
    """Move nodes towards the mean of their neighbours, and project them onto the old surface."""
    x = np.array(surface.x)
    sizes = np.array(surface.sizes)
    faces = np.array(list(surface.faces.values()))
    region = np.array(list(surface.region.values()))
    normals, shapes = _normals_and_shapes(x, faces)
    new, wanted = x.copy(), sizes.copy()
    on_line = np.array([bool(of) for of in surface.on_line])
    _on_surface(x, sizes, faces, region, on_line, normals, old, new, wanted)
    _on_lines(surface, x, sizes, old, new, wanted)
    # Nodes of triangles that would turn over or become flat are not moved; then other nodes may
    # have to stay, too. Collapsed edges leave triangles of the same least quality.
    moved = np.any(new != x, axis=1)
    while True:
        after, shaped = _normals_and_shapes(new, faces)
        turned = np.sum(normals * after, axis=1) < 0
        bad = (turned & (shapes > 0)) | (shaped < np.minimum(LEAST_SHAPE, shapes))
        back = np.zeros(len(x), dtype=bool)
        back[faces[bad].ravel()] = True
        back &= moved
        if not back.any():
            break
        new[back], wanted[back], moved[back] = x[back], sizes[back], False
    surface.x = [(p[0], p[1], p[2]) for p in listed(new)]
    surface.sizes = listed(wanted)


def _on_surface(
    x: Array,
    sizes: Array,
    faces: Indices,
    region: Indices,
    on_line: npt.NDArray[np.bool_],
    normals: Array,
    old: OldSurface,
    new: Array,
    wanted: Array,
) -> None:
    """Write new places of nodes within regions, and the requested sizes there."""
    area = np.linalg.norm(
        np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]), axis=1
    )
    # Centroids of triangles are weighted by their areas, in units of the requested size.
    weight = area / sizes[faces].mean(axis=1) ** 2
    middle = x[faces].mean(axis=1)
    sums, total, normal = np.zeros_like(x), np.zeros(len(x)), np.zeros_like(x)
    for i in range(3):
        np.add.at(sums, faces[:, i], weight[:, None] * middle)
        np.add.at(total, faces[:, i], weight)
        np.add.at(normal, faces[:, i], area[:, None] * normals)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    of_node = np.full(len(x), -1)
    of_node[faces.ravel()] = np.repeat(region, 3)
    of_node[on_line] = -1
    step = sums / np.maximum(total, 1e-300)[:, None] - x
    step -= np.sum(step * normal, axis=1, keepdims=True) * normal
    target = x + STEP * step
    for number in np.unique(of_node[of_node >= 0]):
        nodes = np.flatnonzero(of_node == number)
        at, size, facing = old.onto_region(int(number), target[nodes])
        same = np.sum(facing * normal[nodes], axis=1) > 0  # not the other side of a thin part
        new[nodes[same]], wanted[nodes[same]] = at[same], size[same]


def _on_lines(
    surface: Triangulation, x: Array, sizes: Array, old: OldSurface, new: Array, wanted: Array
) -> None:
    """Write new places of nodes on lines, and the requested sizes there."""
    nodes_of: dict[int, set[tuple[int, int, int]]] = {}
    for edge, line in surface.lines.items():
        for node in set(edge) - surface.corners:
            first, second = sorted(surface.on_line[node])
            nodes_of.setdefault(line, set()).add((node, first, second))
    for line, triples in sorted(nodes_of.items()):
        node, first, second = np.array(sorted(triples)).T
        ways = [np.linalg.norm(x[node] - x[end], axis=1) for end in (first, second)]
        # Equal distances to both neighbours, in units of the requested size.
        wants = [sizes[end] + sizes[node] for end in (first, second)]
        whole = ways[0] + ways[1]
        goal = whole * wants[0] / (wants[0] + wants[1])
        back = np.where(goal < ways[0], goal - ways[0], 0.0) / np.maximum(ways[0], 1e-300)
        ahead = np.where(goal > ways[0], goal - ways[0], 0.0) / np.maximum(ways[1], 1e-300)
        step = -back[:, None] * (x[first] - x[node]) + ahead[:, None] * (x[second] - x[node])
        new[node], wanted[node] = old.onto_line(line, x[node] + STEP * step)


def _normals_and_shapes(x: Array, faces: Indices) -> tuple[Array, Array]:
    a, b, c = (x[faces[:, i]] for i in range(3))
    n = np.cross(b - a, c - a)
    twice = np.linalg.norm(n, axis=1)
    squares = sum(np.sum(e * e, axis=1) for e in (b - a, c - a, c - b))
    unit = n / np.maximum(twice, 1e-300)[:, None]
    return unit, 2 * np.sqrt(3) * twice / np.maximum(squares, 1e-300)


def _left(surface: Triangulation, features: Features, tag_of: dict[int, int]) -> Boundary:
    """Boundary of the remaining nodes and triangles."""
    faces = np.array(list(surface.faces.values()))
    region = np.array(list(surface.region.values()))
    nodes, renumbered = np.unique(faces, return_inverse=True)
    corner = np.isin(nodes, list(surface.corners))
    sizes = np.array(surface.sizes)[nodes]
    x = np.array(surface.x)[nodes]
    return boundary_of(x, renumbered.reshape(-1, 3), region, corner, sizes, features, tag_of)


def boundary_of(
    x: Array,
    faces: Indices,
    region: Indices,
    corner: npt.NDArray[np.bool_],
    sizes: Array,
    features: Features,
    tag_of: dict[int, int],
) -> Boundary:
    """Create a boundary from nodes and triangles.

    Args:
        x: Coordinates of nodes, shape (nodes, 3).
        faces: Outward triangles, shape (triangles, 3).
        region: Regions of the triangles, shape (triangles,).
        corner: Flags of corner nodes, shape (nodes,).
        sizes: Wanted at nodes (length), shape (nodes,).
        features: What is kept.
        tag_of: Tags of regions.
    """
    regions: list[set[int]] = [set() for _ in x]
    for i in range(3):
        for node, number in zip(listed(faces[:, i]), listed(region), strict=True):
            regions[node].add(number)
    curved = np.array([any(r not in features.planes for r in of) for of in regions])
    sharp = np.array([len(of - features.planes.keys()) > 1 for of in regions])
    tags = np.array([tag_of[r] for r in listed(region)], dtype=np.int64)
    fixed = ~curved | corner | sharp
    sides = [sorted(of) for of in regions]
    return Boundary(x, faces, tags, sides, features.planes, fixed, sizes)
