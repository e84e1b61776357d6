"""Slip of a node is a mean over its covered support, whether this is all of its area or a part."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

H, DT = 0.01, 0.5
SAMPLINGS = {
    "nodal": {"quadrature": "nodal"},
    "overlay": {"quadrature": "overlay", "constraints": "nodes"},
    "points": {"quadrature": "overlay", "constraints": "points"},
}
pytestmark = pytest.mark.filterwarnings("ignore:quadrature")  # the master is finer


class Translated:
    """Block that is moved as a whole on a block that ends within one of its cells."""

    def __init__(self, cell, friction, **options):
        self.gdim = gdim = 2 if cell == "quadrilateral" else 3
        axis, V, facets = gdim - 1, [], []
        for n, low, length in ((4, 0.0, 1.0), (7, -1.0, 0.6)):
            corner, end = [0.0] * axis + [low], [length, *[1.0] * (axis - 1), low + 1.0]
            msh = box(WORLD, [n] + [2] * (axis - 1) + [1], cell, corner, end)
            V.append(vector_space(msh))
            facets.append(plane(msh, axis, 0.0))
        self.slave, master = (
            qs.Surface(space, facets=f) for space, f in zip(V, facets, strict=True)
        )
        options = {"friction": friction, "penalty": 1.0} | options
        if friction.needs_dt:
            options["dt"] = DT
        self.contact = qs.Contact(self.slave, master, formulation="quasi-symmetric", **options)
        u = [fem.Function(space) for space in V]
        self.motion, bcs = fem.Constant(V[0].mesh, np.zeros(gdim)), []
        for value, space in zip((self.motion, np.zeros(gdim)), V, strict=True):
            index_map = space.dofmap.index_map
            every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
            bcs.append([fem.dirichletbc(value, every, space)])
        self.problem = qs.ContactProblem([elastic(w) for w in u], u, [self.contact], bcs)

    def move(self, shift):
        self.motion.value[0], self.motion.value[-1] = shift, -H
        self.problem.solve()


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_norton(cell, sampling):
    """At every active node τ = α K v^q of the mean slip rate, at the rim as well."""
    scene = Translated(cell, qs.Norton(0.3, 0.2, 0.4, v0=1e-9), **SAMPLINGS[sampling])
    scene.move(0.0)
    scene.move(0.06)
    contact, closed = scene.contact, scene.contact.active()
    counts = WORLD.allreduce(np.array([np.count_nonzero(closed), np.count_nonzero(~closed)]))
    tau, slip = contact.tangential_multiplier()[closed], contact.slip()[closed]
    expected = np.zeros(scene.gdim)
    expected[0] = 0.3 * 0.2 * (0.06 / DT) ** 0.4
    assert min(counts) > 0
    np.testing.assert_allclose(tau, np.tile(expected, (len(tau), 1)), rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(slip[:, 0], 0.06, rtol=1e-9)


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_coulomb(cell, sampling):
    """Slip is the path minus the penalty's elastic part; after a closed path it is zero."""
    scene = Translated(cell, qs.Coulomb(0.3), enforcement="penalty", **SAMPLINGS[sampling])
    slips, energies = [], []
    for shift in (0.0, 0.06, 0.02):
        scene.move(shift)
        slips.append(scene.contact.slip())
        energies.append(scene.contact.dissipated_energy())
    contact, closed = scene.contact, scene.contact.active()
    pressure, tau = contact.multiplier(), contact.tangential_multiplier()
    force = contact.force("slave")
    np.testing.assert_allclose(tau[closed, 0], -0.3 * pressure[closed], rtol=1e-9)
    elastic_part = 0.3 * H  # μ ε ḡ / ε over the support of a node
    np.testing.assert_allclose(slips[1][closed, 0], 0.06 - elastic_part, rtol=1e-9)
    np.testing.assert_allclose(slips[2][closed, 0], 0.02 + elastic_part, rtol=1e-9)
    ways = np.array([0.06 - elastic_part, 0.04 - 2 * elastic_part])
    np.testing.assert_allclose(np.diff(energies), 0.3 * force[-1] * ways, rtol=1e-9)


class Clock:
    """Δt, and a path at a speed that does not depend on Δt."""

    def __init__(self, scene, dt):
        self.scene, self.dt, self.way = scene, dt, 0.0
        scene.contact.set_dt(dt)

    def go(self, speed, steps=1):
        """Take steps at a speed and return τ at the active nodes."""
        for _ in range(steps):
            self.way += speed * self.dt
            self.scene.move(self.way)
        closed = self.scene.contact.active()
        return self.scene.contact.tangential_multiplier()[closed, 0]


@pytest.mark.parametrize("dt", (1.0, 1e-2, 3e-4, 1e-6))
def test_norton_does_not_know_dt(dt):
    """The default v₀ is a part of the slip rate of the bodies, not of a facet in each Δt."""
    law = qs.Norton(0.3, 0.1, 0.2)  # friction of some pressures; at points at most three
    scene = Translated("quadrilateral", law, quadrature="overlay")
    clock = Clock(scene, dt)
    clock.go(0.0)
    for speed in (0.06, 0.06, 0.2, 0.001, 0.03):
        expected = 0.3 * 0.1 * speed**0.2
        np.testing.assert_allclose(clock.go(speed), expected, rtol=2e-5)


def test_norton_in_smaller_steps():
    """A step in parts, as after a cut-back, has the friction of the whole step."""
    found = []
    for parts in (1, 4):
        scene = Translated("quadrilateral", qs.Norton(0.3, 2.0, 0.2), quadrature="overlay")
        clock = Clock(scene, 0.1)
        clock.go(0.06)
        rate = scene.contact.model.friction.rate
        clock.dt /= parts
        scene.contact.set_dt(clock.dt)
        found.append(clock.go(0.05, parts))
        assert scene.contact.model.friction.rate == rate
    np.testing.assert_allclose(found[1], found[0], rtol=1e-13)


def test_norton_at_rest():
    """A step without motion leaves the law's reference rate unchanged."""
    scene = Translated("quadrilateral", qs.Norton(0.3, 2.0, 0.2), quadrature="overlay")
    clock = Clock(scene, 1.0)
    clock.go(0.06)
    rate = scene.contact.model.friction.rate
    tau = clock.go(0.0)
    assert scene.contact.model.friction.rate == rate > 0
    assert np.max(np.abs(tau), initial=0.0) < 1e-12
