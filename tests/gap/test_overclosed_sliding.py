"""Ignored overclosure in sliding under pressure gives the result without overclosure."""

import itertools

import numpy as np
import pytest
from contact.test_warnings import warned
from following import Boxes
from scenes import FORMULATIONS, WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

E, N, LONG, PENALTY = 1000.0, 4, 36, 1e5
SAMPLING = {
    "nodal": {"quadrature": "nodal"},
    "overlay": {"quadrature": "overlay"},
    "points": {"quadrature": "overlay", "constraints": "points"},
    "finite": {"sliding": "finite"},
}
PAIRS = [
    (floor, formulation)
    for floor in ("plane", "facets", "block")
    for formulation in FORMULATIONS
    if floor == "block" or formulation != "double-pass"
]


class Slider:
    """Block that is pressed on a floor and slides along it, over other nodes in each step.

    Args:
        floor: A rigid ``"plane"``, rigid ``"facets"``, or an elastic ``"block"``.
        depth: Initial depth of the block in the floor.
        is_slave: Whether the block is the slave.
        bumps: Height of the bumps on its bottom.
        options: Options of the contact.
    """

    def __init__(self, floor, depth, is_slave=True, bumps=0.0, **options):
        self.msh = box(WORLD, (N, N), "quadrilateral", [0.0, -depth], [1.0, 1.0 - depth])
        x = self.msh.geometry.x
        self.V = vector_space(self.msh)
        bottom, top = plane(self.msh, 1, -depth), plane(self.msh, 1, 1.0 - depth)
        x[:, 1] += bumps * np.cos(np.pi * x[:, 0]) * (1 - depth - x[:, 1])
        self.u = [fem.Function(self.V)]
        self.motion = fem.Constant(self.msh, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(self.V, 1, top)
        bcs = [[fem.dirichletbc(self.motion, dofs, self.V)]]
        surfaces = [qs.Surface(self.V, facets=bottom)]
        if floor == "plane":
            surfaces.append(qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0]))
        elif floor == "facets":
            x = np.linspace(-1.0, 3.0, LONG + 1)
            i = np.arange(LONG)
            points, cells = np.stack([x, 0 * x], axis=1), np.stack([i + 1, i], axis=1)
            surfaces.append(qs.RigidSurface.triangulated(WORLD, points, cells))
        else:
            lower = box(WORLD, (LONG, 2), "triangle", [-1.0, -1.0], [3.0, 0.0], "backward")
            W = vector_space(lower)
            self.u.append(fem.Function(W))
            bcs.append([clamp(W, plane(lower, 1, -1.0))])
            surfaces.append(qs.Surface(W, facets=plane(lower, 1, 0.0)))
        if not is_slave:
            surfaces.reverse()
        options = {"initial_overclosure": "ignore", "search_radius": 0.3} | options
        options = {"enforcement": "penalty"} | options
        self.contact = qs.Contact(*surfaces, penalty=PENALTY, **options)
        forms = [elastic(u, E * 10**i, nu=0.0) for i, u in enumerate(self.u)]
        self.problem = qs.ContactProblem(forms, self.u, [self.contact], bcs)
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.move)

    def move(self, t, dt):
        self.motion.value = 0.3 * (t - 1), -0.005 * (t + 1)

    def run(self, steps=3):
        """Return the force on the block in each step."""
        forces = [abs(self.contact.force("slave")[1]) for _ in self.stepper.run(float(steps))]
        return np.array(forces)


def compare(floor, formulation, sampling, is_slave, depth, rtol):
    options = SAMPLING[sampling] | {"formulation": formulation, "is_slave": is_slave}
    known = Slider(floor, 0.0, **options).run()
    found = []
    texts = warned(lambda: found.append(Slider(floor, depth, **options).run()))
    np.testing.assert_allclose(found[0], known, rtol=rtol)
    assert not any("have slid" in text for text in texts), texts
    return known


@pytest.mark.parametrize("sampling", SAMPLING)
@pytest.mark.parametrize(("floor", "formulation"), PAIRS)
def test_a_block_slides(floor, formulation, sampling):
    """The forces are those without overclosure; on rigid floors also those of the closed form."""
    known = compare(floor, formulation, sampling, True, 0.05, 1e-3)
    if floor != "block" and sampling != "nodal":
        exact = 0.005 * np.array([2, 3, 4]) / (1 / E + 1 / PENALTY)
        np.testing.assert_allclose(known, exact, rtol=1e-6)


@pytest.mark.parametrize("sampling", SAMPLING)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_nodes_that_had_no_partner(formulation, sampling):
    """With the floor as slave, the block slides onto floor nodes that had no partner initially."""
    compare("block", formulation, sampling, False, 0.02, 2e-3)


def test_given_up_gradually():
    """The resolved part of the overclosure also counts at nodes that had no partner initially."""
    for part in (1.0, 0.5, 0.0):
        scene = Slider("block", 0.01, False, sliding="small", **SAMPLING["overlay"])
        scene.contact.allow_overclosure(0.0)
        scene.run(2)
        scene.contact.update()
        scene.contact.allow_overclosure(part)
        rows = scene.contact.model.gaps[0]  # results are still those of the last solve
        gap = rows.state.values
        scene.contact.allow_overclosure(0.0)
        change = rows.state.values - gap
        assert WORLD.allreduce(len(change)) > 5
        assert largest(change - part * 0.01) < 1e-12


def test_uneven():
    """Uneven depths of the block are right on a flat floor; on an uneven slave floor they warn."""
    kinds = (SAMPLING["overlay"], SAMPLING["nodal"], SAMPLING["finite"])
    for options, bumps in itertools.product(kinds, (0.0, 0.004)):
        known = Slider("plane", 0.0, bumps=0.0, **options).run()
        found = []
        scene = Slider("plane", 0.02, bumps=bumps, **options)
        texts = warned(lambda s=scene, f=found: f.append(s.run()))
        assert scene.contact.model.overclosure.is_even == (bumps == 0)
        assert texts == []
        np.testing.assert_allclose(found[0], known, rtol=0.02)
        scene = Slider("block", 0.02, False, bumps=bumps, **options)
        texts = warned(scene.run)
        assert len([t for t in texts if "have slid" in t]) == (bumps > 0), texts


def test_uneven_depths_are_not_for_others():
    """A node that had no partner initially is allowed the depth of the others if it is even."""
    for bumps in (0.0, 0.004):
        scene = Slider("block", 0.01, False, bumps=bumps, **SAMPLING["finite"])
        scene.run(2)
        contact, gaps = scene.contact, []
        rows = contact.model.gaps[0]
        for part in (1.0, 0.0):
            contact.allow_overclosure(part)
            gaps.append(rows.rows.on_nodes(rows.state.values[:, 0], 0.0).astype(float).ravel())
        allowed, x = gaps[1] - gaps[0], contact.slave.node_x[:, 0]
        beside = (x > 1.0 + 2.5 * 4.0 / LONG) & (x < 1.4)
        assert WORLD.allreduce(np.count_nonzero(beside)) > 0
        assert largest(allowed[beside] - (0.0 if bumps else 0.01)) < 1e-12


def test_a_round_tool_slides():
    """A round tool that slides gives a warning: its initial depths would have to move with it."""

    def slide(dx, **options):
        V = vector_space(box(WORLD, (12, 3), "triangle", [0.0, -0.5], [3.0, 0.0]))
        surface = qs.Surface(V, facets=plane(V.mesh, 1, 0.0))
        tool = qs.RigidSurface.sphere(WORLD, [1.0, 2.0 - 0.05], 2.0)
        contact = qs.Contact(surface, tool, **({"initial_overclosure": "ignore"} | options))
        tool.displacement = [dx, 0.0]
        tool.advance()
        contact.update()
        contact.update()

    kind = {"search_radius": 0.5}
    texts = warned(lambda: slide(0.5, **kind))
    assert len(texts) == 1 and texts[0].startswith(
        "initial_overclosure: the bodies have slid by 0.5"
    )
    assert warned(lambda: slide(0.05, **kind)) == []
    assert warned(lambda: slide(0.5, initial_overclosure="resolve", **kind)) == []


def test_the_other_face_of_a_die():
    """Points out of reach initially, such as another face of a die, get no allowed overclosure."""
    V = vector_space(box(WORLD, (4, 4), "triangle", [0.0, -0.02], [1.0, 0.98]))
    both = np.concatenate([plane(V.mesh, 1, y) for y in (-0.02, 0.98)])
    surface = qs.Surface(V, facets=both)
    x = np.array([[-0.5, 0.0], [1.5, 0.0], [-0.5, 2.0], [1.5, 2.0]])
    die = qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 3]])
    contact = qs.Contact(
        surface,
        die,
        formulation="master-slave",
        search_radius=0.3,
        initial_overclosure="ignore",
        penalty=1.0,
    )
    V.mesh.geometry.x[:, 1] *= np.where(V.mesh.geometry.x[:, 1] > 0, 2.0 / 0.98, 1.0)
    contact.update()
    upper = surface.node_x[:, 1] > 1.0
    assert WORLD.allreduce(upper.sum()) == 5
    assert largest(contact.weighted_gap()) < 1e-12


def slid(over, lower, is_slave, gdim=2, slide=0.3, steps=4):
    """Return the ratio of friction to pressure, and the pressure, of a sliding block, μ = 0.2."""
    n, m, axis = 6 if gdim == 2 else 3, 14 if gdim == 2 else 7, gdim - 1
    low, high = [0.0] * axis + [-over], [1.0] * axis + [1 - over]
    cell = "quadrilateral" if gdim == 2 else "hexahedron"
    msh = box(WORLD, [n] * axis + [n if gdim == 2 else 2], cell, low, high)
    V = vector_space(msh)
    u, motion = [fem.Function(V)], fem.Constant(msh, (0.0,) * gdim)
    dofs = fem.locate_dofs_topological(V, axis, plane(msh, axis, 1 - over))
    bcs = [[fem.dirichletbc(motion, dofs, V)]]
    surfaces = [qs.Surface(V, facets=plane(msh, axis, -over))]
    if lower == "facets":
        x, i = np.linspace(-1.0, 2.0, m + 1), np.arange(m)
        points, cells = np.stack([x, 0 * x], axis=1), np.stack([i + 1, i], axis=1)
        surfaces.append(qs.RigidSurface.triangulated(WORLD, points, cells))
    else:
        low, high = [-1.0] * gdim, [2.0] * axis + [0.0]
        below = box(WORLD, [m] * axis + [5 if gdim == 2 else 2], cell, low, high)
        W = vector_space(below)
        u.append(fem.Function(W))
        bcs.append([clamp(W, plane(below, axis, -1.0))])
        surfaces.append(qs.Surface(W, facets=plane(below, axis, 0.0)))
    options = {"initial_overclosure": "ignore", "friction": qs.Coulomb(0.2)}
    pair = surfaces if is_slave else surfaces[::-1]
    contact = qs.Contact(*pair, sliding="finite", **options)
    problem = qs.ContactProblem([elastic(f, E) for f in u], u, [contact], bcs)
    out = []
    for step in range(steps + 1):
        motion.value[0], motion.value[-1] = slide * step / steps, -0.01
        problem.solve()
        force = contact.force("slave" if is_slave else "master")
        out.append((-force[0] / force[-1], force[-1]))
    return np.array(out)


@pytest.mark.one_rank
@pytest.mark.parametrize(
    ("lower", "is_slave"), [("facets", True), ("block", True), ("block", False)]
)
def test_friction_of_bodies_that_are_in_each_other(lower, is_slave):
    """Ignored overclosure adds no tangential force, also at nodes reached only by sliding."""
    none, some = (slid(over, lower, is_slave) for over in (0.0, 0.02))
    np.testing.assert_allclose(some[1:, 0], 0.2, rtol=0.01)
    np.testing.assert_allclose(some[:, 1], none[:, 1], rtol=3e-3)


@pytest.mark.one_rank
@pytest.mark.parametrize("is_slave", (True, False))
def test_friction_of_blocks_that_are_in_each_other(is_slave):
    """The same holds in 3D with quadrilaterals."""
    none, some = (slid(over, "block", is_slave, 3, 0.06, 2) for over in (0.0, 0.02))
    np.testing.assert_allclose(some[1:, 0], none[1:, 0], rtol=0.01)
    np.testing.assert_allclose(some[:, 1], none[:, 1], rtol=5e-3)


@pytest.mark.parametrize("is_slave", (True, False))
def test_uneven_depths_where_bodies_follow(is_slave):
    """With finite sliding and uneven depths no point has pressure initially; solves converge."""
    scene = Boxes("quadrilateral", ((9, 3), (6, 3)), ((2.0, 0.6), (1.0, 0.6)), 0.5, -0.02)
    x, low = scene.upper.mesh.geometry.x, scene.lows[1, 1]
    x[:, 1] += 0.004 * np.cos(9 * x[:, 0]) * (1 - (x[:, 1] - low) / 0.6)
    top = scene.clamp_far()
    pair = (scene.above, scene.below) if is_slave else (scene.below, scene.above)
    options = {"initial_overclosure": "ignore", "friction": qs.Coulomb(0.2), "sliding": "finite"}
    contact = qs.Contact(*pair, **options)
    problem = scene.problem(contact, solver="direct")
    problem.solve()
    assert largest(contact.force("slave")) < 1e-10 and problem.num_iterations <= 5
    for step in range(3):
        top.value[:] = 0.06 * step, -0.01
        problem.solve()
        assert problem.num_iterations <= 15
    assert abs(contact.force("slave")[1]) > 0.5


@pytest.mark.parallel
def test_depths_of_other_ranks():
    """Whether the overclosure is even, and its least depth, are the same on all ranks."""
    msh = box(WORLD, (2, 8), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "forward")
    side, x = plane(msh, 0, 0.0), msh.geometry.x
    x[:, 0] -= np.where(x[:, 1] > 0.55, 0.04, 0.02) * (1 - x[:, 0])
    wall = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [1.0, 0.0])
    options = {"quadrature": "nodal", "initial_overclosure": "ignore", "search_radius": 0.2}
    contact = qs.Contact(qs.Surface(vector_space(msh), facets=side), wall, penalty=1.0, **options)
    overclosure = contact.model.overclosure
    assert WORLD.allgather(overclosure.is_even) == [False] * WORLD.size
    np.testing.assert_allclose(WORLD.allgather(overclosure.least), 0.02, atol=1e-12)
