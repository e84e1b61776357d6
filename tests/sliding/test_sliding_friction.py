"""Friction with objective slip, by many facets per solve."""

import numpy as np
import pytest
from following import Boxes, moment, total
from scenes import largest, plane

import qsdolfinx as qs

MU, FACET = 0.2, 0.2
KINDS = {
    "quasi-symmetric": {},
    "master-slave": {"formulation": "master-slave"},
    "penalty": {"enforcement": "penalty", "penalty": 3e3},
}
kinds = pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)


class Drag:
    """Low block pressed on a floor that is held everywhere, so that both stay flat.

    Args:
        cell: Cell type of both.
        length: Length of the floor.
        floor_is_slave: Whether the floor carries the multipliers.
        press: Distance by which the block's top is pressed down.
    """

    def __init__(self, cell, length, floor_is_slave=False, mu=MU, press=0.004, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        widths, n = ([1.6], [1.0]) if gdim == 3 else ([], []), [4] * (gdim - 2)
        scene = Boxes(
            cell,
            ((round(length / FACET), *n, 1), (5 if gdim == 3 else 7, *n, 2)),
            ((length, *widths[0], 0.5), (1.0, *widths[1], 0.2)),
            start=0.73,
        )
        self.scene, self.floor, self.block = scene, scene.lower, scene.upper
        for z in (-0.5, 0.0):
            self.floor.clamp(plane(self.floor.mesh, gdim - 1, z))
        self.top = self.block.clamp(plane(self.block.mesh, gdim - 1, 0.2))
        surfaces = scene.above, scene.below
        self.contact = qs.Contact(
            *(surfaces[::-1] if floor_is_slave else surfaces),
            sliding="finite",
            friction=qs.Coulomb(mu) if mu else None,
            **options,
        )
        self.side = "master" if floor_is_slave else "slave"
        self.problem = scene.problem(self.contact, solver="direct")
        self.top.value[-1] = -press
        self.problem.solve()

    def slide(self, way):
        """Slide the top; the initial guess moves the whole block."""
        way = np.append(way, 0.0)
        self.top.value[:] += way
        u = self.block.u.x.array
        u += np.tile(way, len(u) // self.gdim)
        self.problem.solve()

    @property
    def force(self):
        """Return the force on the block."""
        return self.contact.force(self.side)

    @property
    def ratio(self):
        return np.linalg.norm(self.force[:-1]) / self.force[-1]


@kinds
@pytest.mark.parametrize("facets", (0.5, 3))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_block_on_a_floor(cell, facets, options):
    """In full slip T = μ N, and friction dissipates μ N s of the work."""
    way = facets * FACET
    scene = Drag(cell, 2.0 + 3 * way + 0.4, **options)
    for _ in range(3):
        scene.slide([way])
    tolerance = 1e-8 if "penalty" not in options else 3e-3  # the corners of the block tilt
    assert abs(scene.ratio / MU - 1) < tolerance
    work = scene.ratio * scene.force[-1] * way
    assert abs(scene.contact.step_dissipation() / work - 1) < max(1e-6, tolerance)
    assert scene.problem.num_iterations <= 3


@pytest.mark.parametrize("floor_is_slave", (False, True))
def test_stick(floor_is_slave):
    """Below the limit nothing slips or dissipates, and the block springs back."""
    scene = Drag("quadrilateral", 3.0, floor_is_slave, mu=1.0)
    start = scene.force
    for way in (2e-4, -2e-4):
        scene.slide([way])
        assert abs(scene.contact.step_dissipation()) < 1e-3 * 2e-4 * scene.force[-1]
    assert largest(scene.force - start) < 1e-2 * start[-1]


@pytest.mark.parametrize("facets", (1, 6))
def test_floor_is_slave(facets):
    """The same holds with the block as master, which reaches other nodes of the slave.

    The energy of nodes that it leaves within the step is not counted, see docs/limits.md.
    """
    way = facets * FACET
    scene = Drag("quadrilateral", 5.6, True, **KINDS["penalty"])
    scene.slide([way])
    scene.slide([way])
    assert abs(scene.ratio / MU - 1) < 1e-2
    work = MU * scene.force[-1] * way
    assert facets > 1 or abs(scene.contact.step_dissipation() / work - 1) < 0.05
    assert scene.problem.num_iterations <= 12


@pytest.mark.parametrize("floor_is_slave", (False, True))
@pytest.mark.parametrize("facets", (2, 6))
def test_energy_at_points(facets, floor_is_slave):
    """All of the tangential work is dissipated, for any slide and either slave."""
    scene = Drag("quadrilateral", 5.6, floor_is_slave, constraints="points")
    way = facets * FACET
    for _ in range(2):
        scene.slide([way])
        assert scene.problem.num_iterations <= 15  # including nodes only covered at the end
    assert abs(scene.ratio / MU - 1) < 3e-3  # faces tilt slightly
    work = MU * scene.force[-1] * way
    assert abs(scene.contact.step_dissipation() / work - 1) < 1e-3


def test_direction_in_three_dimensions():
    """Friction is opposite to sliding, whatever the direction to the facets."""
    scene = Drag("tetrahedron", 3.4)
    way = 0.25 * np.array([0.8, 0.6])
    for _ in range(2):
        scene.slide(way)
    along = scene.force[:-1] / np.linalg.norm(scene.force[:-1])
    assert largest(along + way / 0.25) < 1e-3
    assert abs(scene.ratio / MU - 1) < 1e-6


@kinds
def test_press_release_press(options):
    """After separation no friction of the earlier contact remains."""
    scene = Drag("quadrilateral", 4.0, **options)
    first = scene.force
    scene.slide([0.5])
    assert scene.force[0] < 0
    for height in (0.05, -0.004):
        scene.top.value[-1] = height
        scene.block.set(lambda x, h=height: np.tile([0.5, max(h, 0.0)], (len(x), 1)))
        scene.problem.solve()
        if height > 0:
            assert largest(scene.force) == 0
    assert largest(scene.force - first) < 2e-3 * first[-1]


@kinds
def test_balance(options):
    """External forces and moments on both bodies balance, computed by DOLFINx alone."""
    scene = Boxes("triangle", ((8, 3), (5, 4)), ((2.0, 0.6), (1.0, 0.7)), start=0.43)
    top = scene.clamp_far()
    contact = qs.Contact(
        scene.above, scene.below, sliding="finite", friction=qs.Coulomb(0.3), **options
    )
    problem = scene.problem(contact)
    for move in ((0.0, -0.03), (0.15, -0.03)):
        top.value[:] = move
        problem.solve()
        forces = [body.internal_forces() for body in scene.bodies]
        places = [body.places for body in scene.bodies]
        size = np.abs(contact.force("slave")).max()
        assert np.abs(sum(total(f) for f in forces)).max() < 1e-12 * size
        turning = sum(moment(x, f) for x, f in zip(places, forces, strict=True))
        assert abs(turning) < 1e-12 * size
