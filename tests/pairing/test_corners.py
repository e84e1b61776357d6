"""Nodes in a corner of several walls: one pair per wall, or one pair."""

import itertools

import numpy as np
import pytest
from corners import turned
from scenes import PARTITIONS, WORLD, blocks, box, gathered, vector_space

from dolfinx import mesh

import qsdolfinx as qs

RADIUS = 0.6


def chain(*points, pieces=3):
    """Make a rigid tool on the left of line segments, each divided into pieces."""
    points = np.array(points, dtype=np.float64)
    parts = [
        a + (b - a) * np.arange(pieces)[:, None] / pieces for a, b in itertools.pairwise(points)
    ]
    x = np.concatenate([*parts, points[-1:]])
    return qs.RigidSurface.triangulated(
        WORLD, x, np.column_stack([np.arange(len(x) - 1), np.arange(1, len(x))])
    )


def square(low, angle, partition="scattered", faces=(0, 1)):
    """Make faces of a unit square with its lower left corner at ``low``, rotated about it."""
    msh = box(WORLD, (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
    x = msh.geometry.x
    facets = [
        mesh.locate_entities_boundary(msh, 1, lambda x, i=i: np.isclose(x[i], 0.0)) for i in faces
    ]
    x[:] = turned(x, angle)
    x[:, :2] += low
    return qs.Surface(vector_space(msh), facets=np.unique(np.concatenate(facets)))


def pairs_at(contact, place):
    """Return gaps, normals and weights of slave points at a place, of all ranks, by normals."""
    (p,) = contact.model.pairings
    here = np.linalg.norm(p.slave.x[:, :2] - place, axis=1) < 1e-9
    rows = np.column_stack([p.gap, p.normal, p.weight])[here]
    rows = gathered(WORLD, rows)
    return rows[np.lexsort(rows.T[1:3])]


def num_corners(contact):
    return WORLD.allreduce(sum(gap.points.num_corners for gap in contact.model.gaps))


@pytest.mark.parametrize("partition", PARTITIONS)
def test_pairs_in_a_corner(partition):
    """Random squares in a right-angled corner, open or overlapping: distances from both lines."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        turn = rng.uniform(0, 2 * np.pi)
        walls = turned(np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]), turn)
        tool = chain(*walls[:, :2])
        low, angle = rng.uniform(-0.05, 0.2, 2), rng.uniform(-0.4, 0.4)
        place = turned(np.append(low, 0.0), turn)[:2]
        slave = square(place, turn + angle, partition)
        contact = qs.Contact(
            slave, tool, formulation="master-slave", quadrature="nodal", search_radius=RADIUS
        )
        found = pairs_at(contact, place)
        normals = turned(-np.eye(3)[:2], turn)[:, :2]
        expected = np.column_stack([low, normals, np.full(2, 1 / 6)])
        expected = expected[np.lexsort(expected.T[1:3])]
        assert len(found) == 2
        np.testing.assert_allclose(found[:, [0, 1, 2, 4]], expected, atol=1e-12)
        assert num_corners(contact) == 1


@pytest.mark.parametrize("opening, expected", ((60, 2), (80, 2), (100, 2), (140, 2), (155, 1)))
def test_openings(opening, expected):
    """Corners of any angle have one pair per wall; walls that meet at 30° or less are one wall."""
    half = np.deg2rad(opening) / 2
    low = [0.0, 0.02]
    ways = np.array([[np.sin(half), np.cos(half)], [-np.sin(half), np.cos(half)]])
    tool = chain(3 * ways[0], [0.0, 0.0], 3 * ways[1])
    contact = qs.Contact(
        square(low, np.pi / 4),
        tool,
        formulation="master-slave",
        quadrature="nodal",
        search_radius=RADIUS,
    )
    found = pairs_at(contact, low)
    assert len(found) == expected
    assert num_corners(contact) == expected - 1
    if expected == 2:
        np.testing.assert_allclose(found[:, 0], 0.02 * np.sin(half), atol=1e-12)


@pytest.mark.parametrize("slope, expected", ((40, 1), (50, 2)))
def test_ramp_in_front_of_a_side(slope, expected):
    """A ramp beside the floor is a wall of its own if the side looks at it more than the bottom."""
    angle = np.deg2rad(slope)
    end = [-3.0 * np.cos(angle), 3.0 * np.sin(angle)]
    tool, low = chain([3.0, 0.0], [0.0, 0.0], end), [0.01, 0.01]
    options = {"formulation": "master-slave", "quadrature": "nodal", "search_radius": RADIUS}
    contact = qs.Contact(square(low, 0.0), tool, **options)
    assert len(pairs_at(contact, low)) == expected


@pytest.mark.parametrize(
    "distance, expected", ((0.02, 2), (RADIUS - 0.01, 2), (RADIUS + 0.01, 1), (1.4, 1))
)
def test_walls_further_away_than_the_radius(distance, expected):
    """Walls beyond the search radius do not count, and the node stands for all of its area."""
    tool = chain([3.0, 0.0], [0.0, 0.0], [0.0, 3.0], pieces=9)
    low = [distance, 0.01]
    contact = qs.Contact(
        square(low, 0.0), tool, formulation="master-slave", quadrature="nodal", search_radius=RADIUS
    )
    found = pairs_at(contact, low)
    assert len(found) == expected
    np.testing.assert_allclose(found[:, 4].sum(), 1 / 3, rtol=1e-12)


@pytest.mark.parametrize("faces", ((0,), (1,)))
def test_walls_that_no_face_looks_at(faces):
    """A single face has one pair at its end, with the wall that it faces."""
    tool = chain([3.0, 0.0], [0.0, 0.0], [0.0, 3.0])
    low = [0.01, 0.01]
    contact = qs.Contact(
        square(low, 0.0, faces=faces),
        tool,
        formulation="master-slave",
        quadrature="nodal",
        search_radius=RADIUS,
    )
    found = pairs_at(contact, low)
    assert len(found) == 1 and num_corners(contact) == 0
    assert found[0, 1 + faces[0]] < -0.99


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric", "double-pass"))
def test_convex_corners_have_one_pair(formulation):
    """Corners of squares that meet, open or overlapping, have one pair, as without the rule."""
    rng = np.random.default_rng(6)
    for _ in range(30):
        place, angle = rng.uniform(-0.15, 0.15, 2), rng.uniform(-0.7, 0.7)
        one = square(place, angle, "backward")
        other = square([0.0, 0.0], np.pi + rng.uniform(-0.3, 0.3))
        contact = qs.Contact(
            one, other, formulation=formulation, quadrature="nodal", search_radius=RADIUS
        )
        assert num_corners(contact) == 0
        (p, *_) = contact.model.pairings
        assert len(np.unique(p.slave.x[p.slave.owner[:, 1] < 0], axis=0)) == np.count_nonzero(
            p.slave.owner[:, 1] < 0
        )


def test_edge_of_a_step():
    """A corner above or slightly in a step is paired with the top or the front of the step only."""
    tool = chain([2.0, 0.0], [0.0, 0.0], [0.0, -2.0], [-2.0, -2.0])
    for low in ([0.1, 0.05], [-0.1, 0.05], [0.05, -0.03], [0.03, -0.05]):
        for angle in (-0.3, 0.0, 0.3):
            contact = qs.Contact(
                square(low, angle),
                tool,
                formulation="master-slave",
                quadrature="nodal",
                search_radius=RADIUS,
            )
            assert num_corners(contact) == 0
            assert len(pairs_at(contact, low)) <= 1


@pytest.mark.parametrize("walls", (1, 2, 3))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
def test_as_many_pairs_as_walls(walls, formulation):
    """A cube in front of one, two or three walls of other cubes has as many pairs at its corner."""
    steps = np.eye(3)[:walls]
    others = [(-step, 1 - step) for step in steps]
    slave = qs.Surface(
        vector_space(cube := blocks((np.zeros(3), np.ones(3)))), facets=faces_of(cube)
    )
    msh = blocks(*others)
    master = qs.Surface(vector_space(msh), facets=faces_of(msh))
    contact = qs.Contact(
        slave, master, formulation=formulation, quadrature="nodal", search_radius=0.3
    )
    found = gathered(
        WORLD, contact.model.pairings[0].slave.x[contact.model.pairings[0].slave.owner[:, 1] < 0]
    )
    at_corner = np.linalg.norm(found, axis=1) < 1e-9
    assert np.count_nonzero(at_corner) == walls


def faces_of(msh):
    return mesh.locate_entities_boundary(msh, 2, lambda x: np.full(x.shape[1], True))
