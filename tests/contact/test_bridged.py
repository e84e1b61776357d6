"""Inactive nodes between active ones are in contact if their gap is below the mesh resolution."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import bridged


def punch(gdim, n, load, hollow=0.0, **options):
    """Press a stiff block of edge 1 onto a larger soft block with cells twice as large."""
    size = [1.0] * (gdim - 1)
    cell = "hexahedron" if gdim == 3 else "quadrilateral"
    low = box(
        WORLD,
        [n] * (gdim - 1) + [n // 2],
        cell,
        [-v for v in size] + [-1.0],
        [*size, 0.0],
    )
    up = box(
        WORLD,
        [n] * (gdim - 1) + [n // 2],
        cell,
        [-v / 2 for v in size] + [0.0],
        [v / 2 for v in size] + [0.5],
    )
    x = up.geometry.x
    bottom = np.isclose(x[:, gdim - 1], 0.0)
    x[bottom, gdim - 1] += hollow * (np.abs(x[bottom, 0]) < 0.3)
    V = [vector_space(msh) for msh in (low, up)]
    u = [fem.Function(space) for space in V]
    F = [elastic(u[0], E=1.0), elastic(u[1], E=100.0)]
    top = fem.locate_dofs_topological(V[1], gdim - 1, plane(up, gdim - 1, 0.5))
    pressed = fem.Constant(up, [0.0] * (gdim - 1) + [-load])
    bcs = [[clamp(V[0], plane(low, gdim - 1, -1.0))], [fem.dirichletbc(pressed, top, V[1])]]
    facets = [plane(low, gdim - 1, 0.0), bottom_facets(up, gdim)]
    surfaces = [qs.Surface(space, facets=f) for space, f in zip(V, facets, strict=True)]
    contact = qs.Contact(surfaces[1], surfaces[0], **options)
    problem = qs.ContactProblem(F, u, [contact], bcs)
    problem.solve()
    return contact


def bottom_facets(msh, gdim):
    """Return the facets near height 0, whether the surface is hollow or not."""
    return mesh.locate_entities_boundary(msh, gdim - 1, lambda x: np.abs(x[gdim - 1]) < 1e-3)


OPTIONS = ({"constraints": "nodes"}, {"constraints": "nodes", "enforcement": "penalty"})


@pytest.mark.parametrize("options", OPTIONS, ids=("augmented", "penalty"))
@pytest.mark.parametrize(("gdim", "n"), ((2, 16), (3, 8)))
def test_flat_punch(gdim, n, options):
    """All of a flat punch is in contact, also near its edge, where weighted gaps alternate."""
    contact = punch(gdim, n, 0.01, **options)
    active = contact.active()
    assert WORLD.allreduce(int(np.sum(~active))) == 0
    assert contact.patch()[0] == pytest.approx(1.0, rel=1e-12)
    if (gdim, n) == (2, 16):  # the case for which this test was written
        zero = contact.multiplier() == 0
        assert WORLD.allreduce(int(np.sum(zero))) == 2


@pytest.mark.parametrize(("gdim", "n"), ((2, 16), (3, 8)))
def test_flat_punch_at_points(gdim, n):
    """Every node is in contact; the open part near the edge is a few hundredths of the area."""
    contact = punch(gdim, n, 0.01)
    assert WORLD.allreduce(int(np.sum(~contact.active()))) == 0
    assert 0.9 < contact.patch()[0] <= 1 + 1e-12


@pytest.mark.parametrize("sticks", (True, False))
def test_they_slip_as_their_neighbours(sticks):
    """The added nodes stick under a sticking punch and slip under a slipping punch."""
    friction = qs.Sticking() if sticks else qs.Coulomb(1e-6)
    contact = punch(2, 16, 0.01, constraints="nodes", friction=friction)
    active, slips = contact.active(), contact.slipping()
    assert WORLD.allreduce(int(np.sum(active & (contact.multiplier() == 0)))) == 2
    beside = np.abs(contact.slave.node_x[:, 0]) > 0.3
    assert WORLD.allreduce(int(np.sum(slips[beside] == sticks))) == 0


def test_hollow_is_open():
    """A hollow of many facets is not in contact, however flat it is."""
    n = 16
    contact = punch(2, n, 1e-9, hollow=2e-5, constraints="nodes")
    inside = np.abs(contact.slave.node_x[:, 0]) < 0.3 - 1.5 / n
    active = contact.active()
    assert WORLD.allreduce(int(np.sum(inside))) >= 6
    assert not active[inside].any()
    assert WORLD.allreduce(int(np.sum(active))) > 0


def test_rim_of_hertz():
    """At the rim of a Hertz contact gaps open gradually, and no node is added."""
    for h in (32, 64):
        low = box(WORLD, (2 * h, h), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
        V = vector_space(low)
        u = fem.Function(V)
        tool = qs.RigidSurface.sphere(WORLD, [0.0, 2.0], 2.0)
        contact = qs.Contact(qs.Surface(V, facets=plane(low, 1, 0.0)), tool, constraints="nodes")
        problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(low, 1, -1.0))]])
        tool.displacement = [0.0, -0.02]
        problem.solve()
        closed, active = contact.multiplier() > 0, contact.active()
        assert WORLD.allreduce(int(np.sum(closed))) > 3
        assert WORLD.allreduce(int(np.sum(closed != active))) == 0


@pytest.mark.parametrize("seed", range(4))
def test_between_closed(seed):
    """The nodes between active ones agree with a search over all facets of a serial mesh."""
    msh = box(WORLD, (7, 6, 2), "tetrahedron", [0.0] * 3, [7.0, 6.0, 1.0])
    surface = qs.Surface(vector_space(msh), facets=plane(msh, 2, 1.0))
    rng = np.random.default_rng(seed)
    share = (0.5, 0.42, 0.08) if seed < 2 else (0.6, 0.39, 0.01)
    at = rng.choice([bridged.CLOSED, bridged.NARROWLY_OPEN, bridged.OPEN], (8, 7), p=share)

    def place(x):
        return np.round(x[:, :2]).astype(int)

    nodes = place(surface.node_x)
    found = bridged.between_closed(surface, at[nodes[:, 0], nodes[:, 1]])
    corners = mesh.entities_to_geometry(msh, 2, surface.facets)
    facets = place(msh.geometry.x[corners.ravel()]).reshape(-1, 3, 2)
    facets = np.concatenate(WORLD.allgather(facets))
    expected = at.copy()
    on = expected[facets[..., 0], facets[..., 1]]
    beside = {tuple(v) for f, s in zip(facets, on, strict=True) if (s == 0).any() for v in f}
    for v in np.ndindex(at.shape):
        if at[v] == bridged.NARROWLY_OPEN and v not in beside:
            expected[v] = bridged.OPEN
    for _ in range(at.size):
        on = expected[facets[..., 0], facets[..., 1]]
        for f, s in zip(facets, on, strict=True):
            if (s == bridged.OPEN).any():
                for v, value in zip(f, s, strict=True):
                    if value == bridged.NARROWLY_OPEN:
                        expected[tuple(v)] = bridged.OPEN
    right = expected[nodes[:, 0], nodes[:, 1]] < bridged.OPEN
    assert np.array_equal(found > 0.5, right)
    assert WORLD.allreduce(int(np.sum(right & (at[nodes[:, 0], nodes[:, 1]] > 0)))) > 0
