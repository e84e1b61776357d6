"""Which edges of a closed surface are split, collapsed and flipped."""

import numpy as np
import pytest

from qsdolfinx.remeshing.features import Features
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


def volume(made):
    """Volume within a surface."""
    x = np.array(made.x)[np.array(list(made.faces.values()))]
    return np.linalg.det(x).sum() / 6


def test_coarse_surfaces_keep_their_shape():
    """Edges are collapsed where triangles hardly turn, however large the requested size is."""
    made = surface(20.0)
    before = volume(made)
    while made.collapse_short():
        pass
    assert 0.3 < volume(made) / before and len(made.faces) < 100
