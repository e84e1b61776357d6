"""Which vertices get points of their own: those whose facets are neither flat nor towards."""

import numpy as np
import pytest
from scenes import WORLD, box, plane, vector_space

import qsdolfinx as qs
from qsdolfinx.pairing import ahead
from qsdolfinx.pairing.facets import normals_at_vertices
from qsdolfinx.pairing.vertices import lead_away


def away(angle, parallel):
    """Whether all, or none, of the vertices of a plane lead away from a surface at an angle (°)."""
    msh = box(WORLD, (4, 2), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
    surface = qs.Surface(vector_space(msh), facets=plane(msh, 1, 0.0))
    a = np.radians(angle)
    along = np.tile([np.sin(a), np.cos(a), 0.0], (len(surface.node_x), 1))
    x = surface.coordinates[0]
    found = WORLD.allgather(lead_away(surface, along, x, normals_at_vertices(surface), parallel))
    return np.concatenate(found)


@pytest.mark.parametrize("angle, expected", ((0.2, False), (2.0, True), (10.0, True)))
def test_flat(angle, expected):
    """Vertices of a facet that is parallel up to rounding get no points, others do."""
    assert np.all(away(angle, ahead.FLAT) == expected)


@pytest.mark.parametrize("angle, expected", ((2.0, False), (10.0, True)))
def test_pressed_flat(angle, expected):
    """Faces that are pressed on each other are less parallel."""
    assert np.all(away(angle, ahead.PRESSED_FLAT) == expected)


@pytest.mark.parametrize("angle, expected", ((10.0, True), (40.0, False)))
def test_towards(angle, expected):
    """A body bends around a tip with faces that are inclined by less."""
    assert np.all(away(angle, ahead.FLAT)) == expected


def test_far_sides():
    """What is deeper than about half a facet may be the far side of a body."""
    msh = box(WORLD, (4, 2), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
    surface = qs.Surface(vector_space(msh), facets=plane(msh, 1, 0.0))
    assert 0.2 < ahead.deepest(surface) / 0.5 < 1.0
