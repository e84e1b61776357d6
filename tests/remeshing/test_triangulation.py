"""Which edges, planes and places of a new boundary are kept."""

import contextlib

import numpy as np
import pytest
from remeshing_scenes import tagged
from scenes import WORLD

from dolfinx import mesh

import qsdolfinx as qs
from qsdolfinx.remeshing.errors import RemeshError
from qsdolfinx.remeshing.features import Features, Plane, find_features, plane_of
from qsdolfinx.remeshing.fill import check_cells
from qsdolfinx.remeshing.lattice import on_lattice
from qsdolfinx.remeshing.outline import Outline
from qsdolfinx.remeshing.retriangulate import Boundary
from qsdolfinx.remeshing.triangulation import Triangulation


def sphere(times):
    """Return nodes and triangles of a unit sphere: an octahedron whose triangles are split."""
    x = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    x = [np.array(p, dtype=float) for p in x]
    around = (0, 2, 1, 3)
    faces = [(around[i], around[(i + 1) % 4], 4) for i in range(4)]
    faces += [(around[(i + 1) % 4], around[i], 5) for i in range(4)]
    for _ in range(times):
        middle, new = {}, []

        def half(a, b, middle=middle):
            key = min(a, b), max(a, b)
            if key not in middle:
                p = x[a] + x[b]
                middle[key] = len(x)
                x.append(p / np.linalg.norm(p))
            return middle[key]

        for a, b, c in faces:
            ab, bc, ca = half(a, b), half(b, c), half(c, a)
            new += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = new
    return np.array(x), np.array(faces)


def surface(size, times=4, lines=None):
    """Return that sphere with requested sizes of edges, over the longest or shortest edge."""
    x, faces = sphere(times)
    features = Features(np.zeros(len(faces), dtype=np.int64), lines or {}, set(), {})
    made = Triangulation(x, faces, np.ones(len(x)), features)
    lengths = made.excess(made.edges())
    unit = lengths.max() if size < 1 else lengths.min()
    return Triangulation(x, faces, np.full(len(x), unit * size), features)


@pytest.mark.parametrize("excess, expected", ((1.1, False), (1.25, False), (1.45, True)))
def test_long_edges_are_split(excess, expected):
    """Halves of a split edge must not be much shorter than other edges."""
    assert (surface(1 / excess).split_long() > 0) == expected


@pytest.mark.parametrize("excess, expected", ((0.85, False), (0.6, True)))
def test_short_edges_are_collapsed(excess, expected):
    assert (surface(1 / excess).collapse_short() > 0) == expected


@pytest.mark.parametrize("angle, expected", ((24.8, 1), (25.2, 0)))
def test_triangles_that_would_turn(angle, expected):
    """The top of a pyramid of six triangles is removed if they are up to 25° steep."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)))
    inside = np.abs(i + j) <= 2
    i, j = i[inside], j[inside]
    number = {pair: k for k, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    faces = [
        [number.get(pair, -1) for pair in corners]
        for a, b in number
        for corners in (
            ((a, b), (a + 1, b), (a, b + 1)),
            ((a + 1, b), (a + 1, b + 1), (a, b + 1)),
        )
    ]
    faces = np.array([face for face in faces if min(face) >= 0])
    x = np.stack([i + j / 2, j * np.sqrt(3) / 2, np.zeros(len(i))], axis=1)
    top = number[0, 0]
    x[top, 2] = np.sqrt(3) / 2 * np.tan(np.radians(angle))
    others = set(range(len(x))) - {top}
    features = Features(np.zeros(len(faces), dtype=np.int64), {}, others, {})
    assert Triangulation(x, faces, np.full(len(x), 10.0), features).collapse_short() == expected


def volume(made):
    """Volume within a surface."""
    x = np.array(made.x)[np.array(list(made.faces.values()))]
    return np.linalg.det(x).sum() / 6


@pytest.mark.parametrize("size", (0.5, 2.0))
def test_changes_keep_a_surface_closed(size):
    """Each edge belongs to two triangles, and they enclose the same volume of flat faces."""
    x, faces = flat_octahedron(3)
    features = Features(np.zeros(len(faces), dtype=np.int64), {}, set(range(6)), {})
    lengths = np.linalg.norm(x[faces[:, 0]] - x[faces[:, 1]], axis=1)
    made = Triangulation(x, faces, np.full(len(x), size * lengths.mean()), features)
    before = volume(made)
    changes = made.split_long() if size < 1 else made.collapse_short()
    made.turn_edges()
    now = np.array(list(made.faces.values()))
    edges = np.sort(np.concatenate([now[:, [0, 1]], now[:, [1, 2]], now[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    assert changes > 0 and (count == 2).all()
    assert len(np.unique(now)) - len(unique) + len(now) == 2  # Euler's formula
    assert size > 1 or abs(volume(made) / before - 1) < 1e-12


def test_coarse_surfaces_keep_their_shape():
    """Edges are collapsed where triangles hardly turn, however large the requested size is."""
    made = surface(20.0)
    before = volume(made)
    while made.collapse_short():
        pass
    assert 0.3 < volume(made) / before and len(made.faces) < 100


def flat_octahedron(times):
    """Return nodes and triangles of an octahedron with flat faces."""
    x, faces = sphere(times)
    return x / np.abs(x).sum(axis=1, keepdims=True), faces


@pytest.mark.parametrize("times, expected", ((0, 0), (2, 8)))
def test_planes_of_many_triangles(times, expected):
    """Some triangles lie on a plane by chance, as one does; sixteen do not."""
    x, faces = flat_octahedron(times)
    tags = np.zeros(len(faces), dtype=np.int64)
    found = find_features(x, faces, tags, np.ones(len(x)), np.radians(40))
    assert len(found.planes) == expected


def partly_sharp_sphere():
    """Return nodes and triangles of a sphere whose equator is a sharp edge over some 90 degrees."""
    x, faces = sphere(4)
    radius, angle = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    parabola = np.sign(x[:, 2]) * (1 - radius**2)
    x[:, 2] += np.clip(1.5 - np.abs(angle), 0, 1) * (parabola - x[:, 2])
    return x, faces


@pytest.mark.parametrize("sizes, is_kept", ((1.5, False), (3.0, True)))
def test_short_lines_are_noise(sizes, is_kept):
    """A sharp edge that ends in a smooth surface is kept if it is more than two cells long."""
    x, faces = partly_sharp_sphere()
    tags = np.zeros(len(faces), dtype=np.int64)

    def edges(size):
        lines = find_features(x, faces, tags, np.full(len(x), size), np.radians(40)).lines
        return np.array(list(lines)).reshape(-1, 2)

    every = edges(1e-9)
    length = np.linalg.norm(x[every[:, 0]] - x[every[:, 1]], axis=1).sum()
    assert len(every) > 2 and len(edges(length / sizes)) == len(every) * is_kept


@pytest.mark.parametrize("level", (0.0, 0.7, 1.0))
def test_levels_of_planes(level):
    """Planes at round numbers are there exactly, and others where they are."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    x[:, 2] = level + 2.3e-16 * np.array([1, 1, 1, -1])
    found = plane_of(x, np.array([0.0, 0.0, 2.0])).level
    assert abs(found - level) < 1e-12 and (found == level or level == 0.7)


@pytest.mark.parametrize("angle, on_both", ((60.0, True), (0.6, False)))
def test_nodes_on_two_planes(angle, on_both):
    """A node is put on both planes, unless their intersection is far away."""
    a = np.radians(angle)
    planes = {0: Plane(np.array([0.0, 0, 1]), 0.0)}
    planes[1] = Plane(np.array([np.sin(a), 0, np.cos(a)]), 1e-3)
    zeros = np.zeros((1, 3))
    none = np.zeros((0, 3), dtype=np.int64)
    boundary = Boundary(
        zeros.copy(), none, none[:, 0], [[0, 1]], planes, np.zeros(1, dtype=bool), np.ones(1)
    )
    boundary.onto_planes()
    x = boundary.x[0]
    off = max(abs(x @ p.normal - p.level) for p in planes.values())
    assert (off < 1e-12) == on_both and np.linalg.norm(x) < 2e-3


@pytest.mark.parametrize("height, is_flat", ((0.003, True), (0.05, False)))
def test_flat_cells_are_refused(height, is_flat):
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0]])
    with pytest.raises(RemeshError) if is_flat else contextlib.nullcontext():
        check_cells(x, np.array([[0, 1, 2]]))


def square(shift):
    """Return a square of two triangles, with a shift of one of its nodes."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    x[2, :2] += shift
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    tags = np.zeros(4, dtype=np.int64)
    return Outline(x, edges, tags, np.array([[0, 1, 2], [0, 2, 3]]), np.ones(4))


@pytest.mark.parametrize("parts", (0, 1 / 3, 2 / 5, 1 / 2))
def test_lattice(parts):
    """Nodes that differ by solver errors get the same place, also between two lattice points."""
    at = 2.0**-11 * (5 + parts)  # lattices are powers of two
    copies = [on_lattice(square(at + error))[1].x for error in (-1e-9, 0.0, 1e-9)]
    assert np.array_equal(copies[0], copies[1]) and np.array_equal(copies[2], copies[1])
    assert np.abs(copies[0] - on_lattice(square(at))[0].x).max() < 2e-3


@pytest.mark.parametrize("segments, expected", ((2.495, 3), (2.45, 2)))
def test_number_of_segments(segments, expected):
    """It is rounded, up also if a little is missing: the lattice must not decide."""
    msh = mesh.create_rectangle(WORLD, [[0, 0], [1, 1]], [4, 4])
    made = qs.remesh(msh, 1 / segments, tagged(msh, [(0, 0.0)]))
    own = made.facet_tags.find(1) < made.mesh.topology.index_map(1).size_local
    assert WORLD.allreduce(int(np.count_nonzero(own))) == expected


def test_lines_keep_their_shape():
    """Nodes of a line are removed if they are hardly off it, however large the size is."""
    x, faces = sphere(4)
    equator = set(np.flatnonzero(np.abs(x[:, 2]) < 1e-9).tolist())
    edges = {
        tuple(sorted(map(int, face[[i, j]]))) for face in faces for i, j in ((0, 1), (1, 2), (2, 0))
    }
    lines = {edge: 0 for edge in edges if set(edge) <= equator}
    features = Features(np.zeros(len(faces), dtype=np.int64), lines, set(), {})
    made = Triangulation(x, faces, np.ones(len(x)), features)
    while made.collapse_short():
        pass
    assert len(lines) == 64 and 8 <= len(made.lines) <= 24
