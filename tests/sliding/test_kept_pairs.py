"""Pairs of facets that are kept between evaluations give the same segments as new searches."""

from mpi4py import MPI

import numpy as np
import pytest
from following import Body, Boxes, Nested, problem_of, rotation
from rigid_scenes import sphere_facets
from scenes import WORLD, box, plane
from slotted import Slotted

import qsdolfinx as qs
from qsdolfinx.gap import facet_cutter

#: Steps of a path, and evaluations in each: Newton's iterates, which end where the step ends.
STEPS, ITERATES = 24, 6


def wave(x, s, amplitude):
    """Displace points smoothly, in all directions, with a phase s."""
    phase = 5.0 * x[..., 0] - 3.0 * x[..., 1] + 4.0 * x[..., 2] + s
    return amplitude * np.stack([np.cos(phase), np.sin(2 * phase), np.sin(phase)], axis=-1)


def in_plane(x, gdim):
    x[..., gdim:] = 0.0
    return x


class Dragged:
    """A box dragged along another one, which moves, too, by several facets; both have waves.

    The search distance is less than a facet: the facets that come near are not known before.
    """

    def __init__(self, cell):
        across = () if cell in ("triangle", "quadrilateral") else (1.0,)
        n = [3] * len(across)
        scene = Boxes(
            cell,
            ((14, *n, 1), (5, *n, 1)),
            ((2.8, *across, 0.5), (0.8, *across, 0.6)),
            start=0.3,
            skew=0.5,
        )
        scene.clamp_far()
        contact = qs.Contact(scene.above, scene.below, sliding="finite", search_radius=0.1)
        self.problem, self.contact, self.gdim = scene.problem(contact), contact, scene.gdim

    def at(self, s, places):
        out = [x + wave(x, s + i, 0.02) for i, x in enumerate(places)]
        out[0][..., 0] += 0.7 * s
        out[1][..., 0] -= 0.8 * s
        return tuple(in_plane(x, self.gdim) for x in out)


class Turned:
    """A ring that turns in another one by 45°, or a shell: lines along normals turn, too."""

    def __init__(self, cell):
        scene = Nested(cell, n=(13, 17) if cell in ("triangle", "quadrilateral") else (4, 5))
        self.problem, self.contact, self.gdim = scene.problem(), scene.contact, scene.gdim

    def at(self, s, places):
        turn = rotation(s * np.pi / 4, None if self.gdim == 2 else (0.2, 0.5, 0.7))
        x, y = (place.copy() for place in places)
        x[..., : self.gdim] = x[..., : self.gdim] @ turn.T
        return x, y


class Tilted:
    """A small plate far above another one: it turns, and what it faces moves further than it."""

    def __init__(self, cell):
        across = () if cell in ("triangle", "quadrilateral") else (0.2,)
        n = [2] * len(across)
        scene = Boxes(
            cell,
            ((12, *n, 1), (2, *n, 1)),
            ((1.2, *across, 0.1), (0.2, *across, 0.1)),
            start=0.5,
            gap=0.6,
        )
        scene.clamp_far()
        contact = qs.Contact(scene.above, scene.below, sliding="finite", search_radius=1.0)
        self.problem, self.contact, self.gdim = scene.problem(contact), contact, scene.gdim

    def at(self, s, places):
        turn, x = rotation(-s * np.pi / 6), places[0].copy()
        ends = [0, self.gdim - 1]
        x[..., ends] = [0.6, 0.6] + (x[..., ends] - [0.6, 0.6]) @ turn.T
        return x, places[1].copy()


class Closed:
    """A slot whose faces touch each other and move along each other, as self-contact."""

    def __init__(self, cell):
        scene = Slotted(cell)
        self.gap, self.gdim = scene.gap, scene.gdim
        self.contact = scene.itself(scene.every, sliding="finite")
        self.problem = scene.problem(self.contact)

    def at(self, s, places):
        x = places[0].copy()
        upper = x[..., 1] > self.gap / 2
        x[..., 0] += np.where(upper, 0.5 * s, 0.0)
        x[..., 1] -= np.where(upper, self.gap * (1.0 + 0.1 * np.sin(3 * x[..., 0])), 0.0)
        return x, x.copy()


class Rolled:
    """A sphere of facets that rolls over a block with waves."""

    def __init__(self, cell):
        gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        body = Body(box(WORLD, [6] * (gdim - 1) + [1], cell, [0.0] * gdim, [1.0] * gdim))
        body.clamp(plane(body.mesh, gdim - 1, 0.0))
        self.center, self.gdim = np.array([0.2] * (gdim - 1) + [1.7]), gdim
        tool = sphere_facets(WORLD, 12, self.center, 0.7)
        self.contact = qs.Contact(body.side(gdim - 1, 1.0), tool, sliding="finite")
        self.problem = problem_of([body], [self.contact])

    def at(self, s, places):
        turn = rotation(-0.8 * s, None if self.gdim == 2 else (0.0, 1.0, 0.0))
        center = self.center + np.array([0.6 * s, *[0.0] * (self.gdim - 2), -0.02])
        x = in_plane(places[0] + wave(places[0], s, 0.01), self.gdim)
        return x, np.column_stack([turn, center - turn @ self.center])


SCENES = (Dragged, Turned, Tilted, Closed, Rolled)


def path():
    """Return positions along a path: iterates of each step, which converge."""
    ends = np.arange(1, STEPS + 1) / STEPS
    return (ends[:, None] - 0.3 ** np.arange(1, ITERATES + 1) / STEPS).ravel()


def segments(cut):
    """Return all that is known of the segments, and names of the facets of each."""
    found = cut.found.of_cutter
    arrays = found.x(), found.gaps(), found.side_dofs(), found.cover(), found.functions()
    return [np.asarray(a) for a in (*arrays, found.facets())]


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_same_segments_on_ranks(scene, cell, monkeypatch):
    kept = scene(cell)
    monkeypatch.setattr(facet_cutter, "SKIN", 0.0)
    anew = scene(cell)
    sides = [case.contact.model.gaps[0].following for case in (kept, anew)]
    places = sides[0].paired_at
    before = [side.kept_pairs.num_evaluations for side in sides]
    names = []
    for s in path():
        now = kept.at(s, places)
        cuts = [side.cut(now, None) for side in sides]
        found, expected = map(segments, cuts)
        same = all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
        assert WORLD.allreduce(same, op=MPI.LAND)
        names.append({tuple(row) for row in expected[-1]})
    assert WORLD.allreduce(len(names[0]), op=MPI.SUM) > 0
    assert WORLD.allreduce(names[0] != names[-1], op=MPI.LOR)  # pairs have changed
    counts = [side.kept_pairs for side in sides]
    evaluations = counts[0].num_evaluations - before[0]
    assert evaluations == STEPS * ITERATES == counts[1].num_evaluations - before[1]
    assert counts[1].num_searches == counts[1].num_evaluations
    assert 1 < counts[0].num_searches <= evaluations / 10


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_block_dragged_in_steps(cell, monkeypatch):
    def drag():
        across = () if cell == "triangle" else (0.5,)
        n = [1] * len(across)
        scene = Boxes(
            cell, ((12, *n, 2), (4, *n, 2)), ((2.4, *across, 0.5), (0.8, *across, 0.6)), start=0.3
        )
        top = scene.clamp_far()
        friction = qs.Coulomb(0.3)
        contact = qs.Contact(scene.above, scene.below, sliding="finite", friction=friction)
        problem, forces = scene.problem(contact, linear_solver="direct"), []
        for i in range(16):
            top.value[0], top.value[-1] = 0.05 * i, -0.02
            problem.solve()
            forces.append(contact.force("slave"))
        return np.array(forces), contact.model.gaps[0].following.kept_pairs

    forces, pairs = drag()
    monkeypatch.setattr(facet_cutter, "SKIN", 0.0)
    expected, anew = drag()
    assert anew.num_searches == anew.num_evaluations == pairs.num_evaluations
    assert pairs.num_searches <= pairs.num_evaluations / 10
    np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-14 * np.abs(expected).max())
