"""Gaps and penetration are signed distances of the deformed surfaces: check by brute force."""

from mpi4py import MPI

import numpy as np
import pytest
from audit.distance import Meshed
from audit.state import BodyState, everywhere, padded, read_surface
from curved_scenes import ShrinkFit
from rigid_scenes import Pressed, flat, flat_facets
from scenes import (
    CELLS,
    FORMULATIONS,
    WORLD,
    Pair,
    box,
    gathered,
    raises_everywhere,
    vector_space,
)
from slanted import slanted_block
from step_scenes import Upset

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.contact import motion
from qsdolfinx.contact.motion import set_offset


def meshed(surface, displacement):
    """Make a surface with displacements of its body, shape (owned nodes, gdim), on every rank."""
    V = surface.V if surface.V.dofmap.bs > 1 else surface.collapsed_space
    owned = V.dofmap.index_map.size_local
    x = everywhere(WORLD, V.tabulate_dof_coordinates()[:owned])
    u = everywhere(WORLD, padded(displacement.reshape(-1, surface.gdim)[:owned]))
    body = BodyState(x, u, np.zeros_like(x), np.zeros(x.shape, dtype=bool))
    return Meshed(body, read_surface(V, surface.facets, x))


def nodes_now(side, surface):
    """Return the deformed positions of the contact nodes of this rank."""
    away = np.linalg.norm(surface.node_x[:, None] - side.body.x, axis=2)
    index = np.argmin(away, axis=1)
    return (side.body.x + side.body.u)[index]


def compare(gap, found, radius, least):
    """Compare gaps at nodes in front of the other side, at least so many over all ranks."""
    known = found.facing & (np.abs(found.distance) < 0.999 * radius)
    np.testing.assert_allclose(gap[known], -found.distance[known], rtol=1e-7, atol=1e-10)
    assert WORLD.allreduce(int(np.count_nonzero(known))) >= least


def depth_of_nodes(side, opponent):
    """Return the depth of the deepest node of one side, nodes between vertices included."""
    found = opponent.find((side.body.x + side.body.u)[side.surface.nodes])
    return max(-found.distance[found.facing].min(initial=0.0), 0.0)


def check(contact, slave, master, is_overlay, least):
    """Check all measured values against brute force."""
    radius, sides = contact.settings.search_radius, {"slave": slave, "master": master}
    for name, surface in (("slave", contact.slave), ("master", contact.master)):
        opponent = sides["master" if name == "slave" else "slave"]
        found = opponent.find(nodes_now(sides[name], surface))
        compare(contact.gap(name), found, radius, least)
    deepest = max(depth_of_nodes(slave, master), depth_of_nodes(master, slave))
    penetration = contact.penetration()
    assert penetration > 1e-3
    if is_overlay:
        assert penetration >= deepest * (1 - 1e-9)
    else:
        np.testing.assert_allclose(penetration, deepest, rtol=1e-7)
    places = contact.report().deepest
    assert places[0].depth == penetration
    for place in places:
        x = np.pad(place.x, (0, 3 - len(place.x)))[None]
        found = sides["master" if place.side == "slave" else "slave"].find(x)
        np.testing.assert_allclose(place.depth, -found.distance[0], rtol=1e-5)


def everything(contact):
    """Return everything that measuring must not change."""
    out = [np.array([contact.model.num_pairings, contact.stored_energy()])]
    for surface in (contact.slave, contact.master):
        out += [surface.node_x, surface.node_normal, surface.node_area, *surface.coordinates[:2]]
    for p in contact.model.pairings:
        out += [p.slave.x, p.master.x, p.normal, p.gap, p.weight]
    out += [contact.weighted_gap(), contact.multiplier(), contact.force("slave")]
    if contact.friction is not None:
        out += [contact.slip(), contact.tangential_multiplier(), contact.dissipation()]
    return [np.array(a) for a in out]


# --- Two bodies


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_soft_contact_of_other_meshes(cell, quadrature, formulation):
    """Curved blocks of 5 and 3 cells that penetrate each other under a soft penalty."""
    options = {"quadrature": quadrature, "enforcement": "penalty"}
    pair = Pair(cell, formulation, n=(5, 3), wave=0.05, load=-0.12, contact_options=options)
    pair.problem().solve()
    sides = [meshed(s, u.x.array) for s, u in zip((pair.master, pair.slave), pair.u, strict=True)]
    check(pair.contact, sides[1], sides[0], quadrature == "overlay", 3)


def test_where_nothing_has_been_solved():
    """Before a solve gaps are those of the meshes, with or without a gap, and NaN out of reach."""
    for gap in (0.05, -0.05, 2.0):
        pair = Pair("triangle", gap=0.0, n=(4, 3))
        pair.meshes[1].geometry.x[:, 1] += gap
        pair.contact.update()
        expected = np.nan if gap > 1 else -gap
        for side in ("slave", "master"):
            found = pair.contact.gap(side)
            np.testing.assert_allclose(found, np.full(len(found), expected), atol=1e-14)
        np.testing.assert_allclose(pair.contact.penetration(), max(np.nan_to_num(expected), 0))


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
def test_degree_2(cell):
    """Bent facets are taken as flat between their nodes, nodes between vertices included."""

    def space(msh):
        return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))

    options = {"quadrature": "overlay"}
    pair = Pair(cell, n=(3, 2), wave=0.06, load=-0.15, space=space, contact_options=options)
    pair.problem().solve()
    sides = [meshed(s, u.x.array) for s, u in zip((pair.master, pair.slave), pair.u, strict=True)]
    check(pair.contact, sides[1], sides[0], True, 2)


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
@pytest.mark.parametrize("partitions", (("first", "last"), ("scattered", "backward")))
def test_ranks_without_facets(cell, partitions):
    """Gaps do not depend on the distribution of cells over ranks."""
    options = {"quadrature": "overlay"}
    pair = Pair(cell, n=(5, 3), wave=0.05, partitions=partitions, contact_options=options)
    pair.problem().solve()
    sides = [meshed(s, u.x.array) for s, u in zip((pair.master, pair.slave), pair.u, strict=True)]
    check(pair.contact, sides[1], sides[0], True, 3)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_rings(quadrature):
    """Axisymmetric bodies that reach the axis, in the plane (r, z)."""
    meshes = [box(WORLD, (n, 2), "triangle", [0, z], [1, z + 1]) for n, z in ((5, -1.0), (3, 0.0))]
    for msh in meshes:
        msh.geometry.x[:, 1] += 0.03 * np.cos(5 * msh.geometry.x[:, 0])
    spaces = [vector_space(msh) for msh in meshes]
    facets = [mesh.locate_entities_boundary(m, 1, touching) for m in meshes]
    master, slave = (
        qs.Surface(V, facets=f, axisymmetric=True) for V, f in zip(spaces, facets, strict=True)
    )
    contact = qs.Contact(slave, master, quadrature=quadrature)
    u = [fem.Function(V) for V in spaces]
    u[1].interpolate(lambda x: np.stack([0.02 * x[0], -0.03 + 0.01 * x[0]]))
    contact.set_penalty(1.0)
    motion.show(contact.model, u[1], u[0])
    sides = [meshed(s, w.x.array) for s, w in zip((master, slave), u, strict=True)]
    check(contact, sides[1], sides[0], quadrature == "overlay", 3)


def touching(x):
    """Mark the curve between the rings."""
    return np.isclose(x[1], 0.03 * np.cos(5 * x[0]))


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_velocities(quadrature):
    """Velocities of one body: u = v Δt; displacements of the other, added to an offset."""
    options = {"unknown": ("velocity", "displacement"), "dt": 0.25, "quadrature": quadrature}
    pair = Pair("triangle", n=(5, 4), wave=0.04, load=-0.6, contact_options=options)
    offset = fem.Function(pair.V[0])
    offset.interpolate(lambda x: np.stack([0.01 * x[0], 0.02 + 0.03 * x[0]]))
    set_offset(pair.contact.model, None, offset)
    pair.problem().solve()
    master = meshed(pair.master, pair.u[0].x.array + offset.x.array)
    slave = meshed(pair.slave, 0.25 * pair.u[1].x.array)
    check(pair.contact, slave, master, quadrature == "overlay", 4)


def measured(contact):
    return np.nan_to_num(contact.gap()), contact.penetration(), contact.report().deepest


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)))
def test_measuring_changes_nothing(friction):
    """Measuring changes no results, nor does a contact update of another contact of a body."""
    options = {"quadrature": "overlay", "friction": friction}
    pairs = [Pair("quadrilateral", n=(5, 3), wave=0.05, contact_options=options) for _ in range(2)]
    for pair in pairs:
        pair.problem().solve()
    contact, moved = pairs[0].contact, pairs[1]
    before = everything(contact)
    first = measured(contact)
    for a, b in zip(before, everything(contact), strict=True):
        assert np.array_equal(a, b, equal_nan=True)
    other = qs.Contact(moved.slave, moved.master)
    moved.meshes[1].geometry.x[:, 1] += 0.01
    other.update()
    again = measured(moved.contact)
    # On several ranks, two solves of one scene differ by rounding.
    assert np.allclose(first[0], again[0], rtol=0, atol=1e-13)
    assert np.isclose(first[1], again[1], rtol=0, atol=1e-13)
    for a, b in zip(first[2], again[2], strict=True):
        assert (
            np.allclose((*a.x, a.depth), (*b.x, b.depth), rtol=0, atol=1e-13) and a.side == b.side
        )
    as_they_are = not np.allclose(measured(other)[0], first[0], atol=1e-3)  # undeformed meshes
    assert WORLD.allreduce(as_they_are, op=MPI.LOR)


def test_facets_without_area_are_refused():
    """Facets without area are refused on all ranks, and the report tells about them."""
    pair = Pair("triangle", n=(4, 3))
    flat_, nan = fem.Function(pair.V[1]), fem.Function(pair.V[1])
    flat_.interpolate(lambda x: np.stack([-x[0], 0 * x[1]]))
    nan.x.array[:] = np.nan
    for offset, text in ((flat_, "degenerate"), (nan, "not finite")):
        set_offset(pair.contact.model, offset, None)
        motion.show(pair.contact.model, None, None)
        for call in (pair.contact.gap, pair.contact.penetration):
            raises_everywhere(WORLD, ValueError, text, call)
    assert pair.contact.report().penetration is None
    assert "no area" in str(pair.contact.report())


def test_tied_surfaces_have_jumps():
    pair = Pair("triangle", law=qs.Tied(), n=(4, 3))
    pair.problem().solve()
    assert np.array_equal(pair.contact.gap(), pair.contact.weighted_gap())
    assert pair.contact.penetration() == pair.contact.weighted_penetration() > 0


@pytest.mark.filterwarnings("ignore:facets:qsdolfinx.base.messages.ContactWarning")
@pytest.mark.parametrize("degree", (1, 2))
def test_curved_facets(degree):
    """The depth between curved facets is the misfit; between flat facets it is not."""
    curved = ShrinkFit(((16, 5), (22, 7)), degrees=("elevated", degree), sliding="small")
    np.testing.assert_allclose(curved.contact.penetration(), 0.01, rtol=0.02)
    assert ShrinkFit(((16, 5), (22, 7))).contact.penetration() > 0.015


# --- Depth that weighted gaps do not show

AUGMENTED = {"enforcement": "augmented-lagrangian"}
SOFT = {"enforcement": "penalty", "penalty": 20.0}


@pytest.mark.parametrize("gdim, n", ((2, 8), (3, 4)))
@pytest.mark.parametrize("tool", ("plane", "facets"))
def test_slanted_block(gdim, n, tool):
    """Open sides let the corner penetrate, although the weighted gaps are closed."""
    contact, depth = slanted_block(gdim, n, tool, constraints="nodes", **AUGMENTED)
    size = contact.model.paired.facet_size
    assert contact.weighted_penetration() <= contact.settings.allowed_gap
    np.testing.assert_allclose(contact.penetration(), depth, rtol=1e-9)
    np.testing.assert_allclose(np.nanmax(gathered(WORLD, contact.gap())), depth, rtol=1e-9)
    assert depth > 0.05 * size
    report = contact.report()
    assert report.penetration == contact.penetration() == report.deepest[0].depth
    assert report.deepest[0].side == "slave" and len(report.deepest) == 3
    np.testing.assert_allclose(np.abs(report.deepest[0].x[:-1]), 0.5, atol=0.02)
    np.testing.assert_allclose(report.deepest[0].x[-1], -depth)
    distances = [
        np.linalg.norm(np.subtract(a.x, b.x))
        for i, a in enumerate(report.deepest)
        for b in report.deepest[:i]
    ]
    assert min(distances) > size
    assert 'constraints="points"' in report.advice and report.advice in str(report)


def test_initial_overclosure_that_stays():
    """Allowed initial overclosure is measured, though not in weighted gaps, and is accepted."""
    scene = Pressed("triangle", flat, initial_overclosure="ignore")
    scene.mesh.geometry.x[:, 1] += 0.03 * (scene.mesh.geometry.x[:, 1] == 1.0)
    scene.surface.update()
    options = {"penalty": 1e3, "initial_overclosure": "ignore"}
    contact = qs.Contact(scene.surface, scene.tool, **options)
    problem = qs.ContactProblem([scene.F], [scene.u], [contact], [scene.bcs])
    stepper = qs.TimeStepper(problem, 1.0, max_penetration=1e-3)
    stepper.step()
    np.testing.assert_allclose(contact.penetration(), 0.03, rtol=1e-9)
    assert contact.weighted_penetration() < 1e-12


# --- Tools that move


def under_plane(scene, x):
    """Return the depth of points of the block in the tool at its current position."""
    R, t = scene.tool.position[:, :-1], scene.tool.position[:, -1]
    point, normal = np.full(scene.gdim, 0.5), np.zeros(scene.gdim)
    point[-1], normal[-1] = 1.0, -1.0
    return -(x[:, : scene.gdim] - (R @ point + t)) @ (R @ normal)


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
@pytest.mark.parametrize("tool", (flat, flat_facets))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_tool_that_turns(cell, tool, quadrature):
    """Gaps are distances to the tool as displaced and rotated."""
    scene = Pressed(cell, tool, quadrature=quadrature, **SOFT)
    scene.tool.displacement[-1] = -0.06
    scene.tool.rotation[0] = 0.03
    scene.problem.solve()
    gap, penetration = scene.contact.gap(), scene.contact.penetration()
    scene.tool.advance()  # the results stay, wherever the tool goes
    x = nodes_now(meshed(scene.surface, scene.u.x.array), scene.surface)
    expected = under_plane(scene, x)
    assert np.ptp(gathered(WORLD, expected)) > 0.01
    np.testing.assert_allclose(gap, expected, atol=1e-12)
    np.testing.assert_allclose(penetration, gathered(WORLD, gap).max(), rtol=1e-9)
    assert np.array_equal(gap, scene.contact.gap())
    scene.contact.update()  # pairs on the undeformed mesh, where nothing is in equilibrium
    np.testing.assert_allclose(scene.contact.gap(), gap, atol=1e-12)


@pytest.mark.parametrize("tool", (flat, flat_facets))
def test_driven_tool_after_steps(tool):
    """Tool and body are at the end of the step, also after a contact update there."""
    scene = Pressed("quadrilateral", tool, search_radius=0.4, **SOFT)
    scene.tool.drive(0.3, [0.0, -1.0])

    def drive(t, dt):
        scene.tool.rotation = [0.01 * dt]

    stepper = qs.TimeStepper(scene.problem, 1.0, drive, max_penetration=1.0)
    for _ in range(2):
        stepper.step()
        side = meshed(scene.surface, scene.u.x.array)
        expected = under_plane(scene, nodes_now(side, scene.surface))
        gap, penetration = scene.contact.gap(), scene.contact.penetration()
        assert 5e-3 < gathered(WORLD, gap).max() < 0.1 and np.ptp(gathered(WORLD, gap)) > 1e-3
        np.testing.assert_allclose(gap, expected, atol=1e-12)
        np.testing.assert_allclose(penetration, gathered(WORLD, gap).max(), rtol=1e-9)
        scene.problem.set_up()
        np.testing.assert_allclose(scene.contact.gap(), gap, atol=1e-12)
        np.testing.assert_allclose(scene.contact.penetration(), penetration, rtol=1e-9)


@pytest.mark.parametrize("theta, num_pairings", ((0.0, 1), (0.5, 1), (0.5, 2)))
def test_flowing_body_after_steps(theta, num_pairings):
    """A velocity-based body on an elastic die: its mesh has moved, the die has displacements."""
    soft = {"penalty": 40.0, "enforcement": "penalty"}
    case = Upset(die=True, dt=0.04, contact=soft, theta=theta, num_pairings=num_pairings)
    contact = case.contacts[0]
    for _ in range(2):
        case.stepper.step()
        surface = contact.slave
        owned = surface.collapsed_space.dofmap.index_map.size_local
        slave = meshed(surface, np.zeros(2 * owned))
        master = meshed(contact.master, case.u[1].x.array)
        gap, penetration = contact.gap(), contact.penetration()
        compare(gap, master.find(nodes_now(slave, surface)), contact.settings.search_radius, 4)
        depth = max(depth_of_nodes(slave, master), depth_of_nodes(master, slave))
        assert depth > 1e-3
        np.testing.assert_allclose(penetration, depth, rtol=1e-7)
        case.problem.set_up()
        np.testing.assert_allclose(contact.gap(), gap, atol=1e-12)
        np.testing.assert_allclose(contact.penetration(), penetration, rtol=1e-9)
