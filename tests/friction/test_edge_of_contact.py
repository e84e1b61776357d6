"""Nodes about to open under friction that jumps there have a part of it, see ``fill``."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, largest, plane, vector_space

from dolfinx import fem, la

import qsdolfinx as qs
from qsdolfinx.friction import filled
from qsdolfinx.friction.laws import Response

LAWS = {"tresca": lambda: qs.Tresca(2.0), "norton": lambda: qs.Norton(0.3, 10.0, 0.4)}

#: Largest number of iterations of a step in which the block is dragged. A dozen is usual. The worst
#: step takes 31 on one rank and 41 on two, where the line search stagnates as a constraint reaches
#: the edge of contact.
MOST = 50


def answer(T):
    """Return the response of a law with traction T, whatever the slip is."""
    n, gdim = T.shape
    stiffness, no = np.zeros((n, gdim, gdim)), np.zeros(n, dtype=bool)
    return Response(T, stiffness, np.zeros_like(T), no, np.zeros_like(T), np.zeros(n))


@pytest.mark.parametrize("a", (0.1, 100.0))
def test_filled_graph(monkeypatch, a):
    """τ agrees with the graph at all of its points, and nowhere else, whatever a is."""
    monkeypatch.setattr(filled, "OF_PRESSURE", a)
    rng, no = np.random.default_rng(1), np.zeros(30, dtype=bool)
    T = rng.normal(size=(30, 3))
    trial = np.repeat([0.4, 0.0, -0.4], 10)
    theta = np.where(trial > 0, 1.0, np.where(trial < 0, 0.0, rng.random(30)))
    found = filled.fill(answer(T), theta[:, None] * T, trial, no, no)
    np.testing.assert_allclose(found.response.traction, theta[:, None] * T, atol=1e-15)
    assert np.array_equal(found.edge, trial == 0)
    for other in (theta + 0.1, theta - 0.1):
        tau = other[:, None] * T
        outside = (trial != 0) | (other < 0) | (other > 1)
        wrong = filled.fill(answer(T), tau, trial, no, no).response.traction - tau
        assert np.linalg.norm(wrong, axis=1)[outside].min() > 1e-3


def dragged(law, enforcement, press=0.01, steps=8, **options):
    """Press a block slightly on a rigid plane and drag it by its top: its rear edge lifts.

    Yields:
        The problem, the contact, and the force at the top, after each step.
    """
    msh = box(WORLD, (16, 8), "quadrilateral", [0.0, 0.0], [2.0, 1.0])
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    held = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
    F = elastic(u, E=100.0, nu=0.3)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    bottom = qs.Surface(V, facets=plane(msh, 1, 0.0))
    options |= {"constraints": "nodes", "enforcement": enforcement, "friction": LAWS[law]()}
    if law == "norton":
        options["dt"] = 1.0
    contact = qs.Contact(bottom, floor, **options)
    problem = qs.ContactProblem([F], [u], [contact], [[fem.dirichletbc(top, held, V)]])
    owned = held[held < V.dofmap.index_map.size_local]
    form = fem.form(F)
    for step in range(steps + 1):
        top.value[:] = (0.05 * step, -press)
        problem.solve()
        b = fem.assemble_vector(form)
        b.scatter_reverse(la.InsertMode.add)
        force = WORLD.allreduce(b.array.reshape(-1, 2)[owned].sum(axis=0))
        yield problem, contact, force


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("press", (0.005, 0.01, 0.02))
def test_dragged_block(press, law, enforcement):
    """Forces balance after one Newton solve; friction is at most the law's.

    Nodes without pressure may have less friction. Where |τ| is smaller, the gap of the node is
    closed and its pressure is 0.
    """
    edges = 0
    for problem, contact, force in dragged(law, enforcement, press):
        assert problem.num_iterations <= MOST
        np.testing.assert_allclose(contact.force("slave"), -force, atol=1e-7 * largest(force))
        for slip, gap in zip(contact.model.slips, contact.model.gaps, strict=True):
            state, pressure = slip.state, gap.multiplier(contact.model.eps)[:, 0]
            rows = state.evaluated.rows._replace(closed=np.ones_like(state.closed))
            T = np.linalg.norm(slip.friction.respond(rows).traction, axis=1)
            tau, most = np.linalg.norm(state.response.traction, axis=1), largest(pressure)
            if law == "tresca":  # the trial value of an augmented Lagrangian is on the bound itself
                T = np.where(state.response.slipping, 2.0, T)
            assert largest(np.maximum(tau - T, 0.0)) <= 1e-9 * largest(T)
            part = (tau < (1 - 1e-6) * T - 2 * slip.rounding(state.response)) & (tau > 0)
            assert largest(pressure[part]) <= 1e-9 * most
            assert largest(gap.state.values[part, 0]) <= 1e-9
            edges += int(part.sum())
    if press == 0.005:  # its solutions contain such nodes
        assert WORLD.allreduce(edges) > 0


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_results_do_not_depend_on_the_way(monkeypatch, enforcement):
    """The weight of a stress in the criterion for the edge of contact does not change results."""
    forces = []
    for a in (3.0, 100.0):
        monkeypatch.setattr(filled, "OF_PRESSURE", a)
        *_, (_, contact, _) = dragged("norton", enforcement, press=0.02)
        forces.append(contact.force("slave"))
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-5)


@pytest.mark.parametrize(
    ("cell", "n", "friction"),
    (
        ("quadrilateral", 6, qs.Tresca(0.1)),
        ("triangle", 7, qs.Tresca(0.05)),
        ("quadrilateral", 3, qs.Sticking()),
        ("quadrilateral", 3, qs.Coulomb(0.3)),
    ),
)
def test_box(cell, n, friction):
    """Forces on a block in a box balance at the nodes that the solve leaves with λ = ḡ = 0.

    At its corners a node sticks to two tools, and multipliers exceed 1e10 during the solve.
    """
    msh = box(WORLD, (n, n), cell, [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    lid = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    tools = [
        qs.RigidSurface.plane(WORLD, [x, 0.0], normal)
        for x, normal in ((0.0, [0.0, 1.0]), (0.0, [1.0, 0.0]), (1.0, [-1.0, 0.0]))
    ]
    sides = zip(((1, 0.0), (0, 0.0), (0, 1.0), (1, 1.0)), (*tools, lid), strict=True)
    contacts = [
        qs.Contact(qs.Surface(V, facets=plane(msh, *side)), tool, friction=friction)
        for side, tool in sides
    ]
    problem = qs.ContactProblem([elastic(u, E=10.0, nu=0.3)], [u], contacts, [[]])
    lid.displacement = [0.0, -0.02]
    problem.solve()
    force = contacts[3].force("master")[1]
    assert np.abs(sum(c.force("slave") for c in contacts)).max() < 1e-9 * force


@pytest.mark.parametrize("friction", (1e-3, 0.3))
def test_driven_between_nodes(friction):
    """A force on a round tool between nodes: constraints that friction would open stay active."""
    msh = box(WORLD, (3, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    zero = np.zeros(2)
    bcs = [fem.dirichletbc(zero, fem.locate_dofs_topological(V, 1, plane(msh, 1, 0.0)), V)]
    tool = qs.RigidSurface.sphere(WORLD, [0.5, 1.7], 0.7)
    top = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(top, tool, friction=qs.Coulomb(friction))
    problem = qs.ContactProblem([elastic(u, E=20.0, nu=0.3)], [u], [contact], [bcs])
    tool.drive(0.02, [0.0, -1.0])
    problem.solve()
    np.testing.assert_allclose(contact.force("master"), [0.0, 0.02], atol=1e-9)
    assert problem.num_iterations < 10


def test_corner():
    """A block in a rigid corner: many delayed pivots, for which MUMPS needs more memory."""
    msh = box(WORLD, (2, 2, 2), "hexahedron", [0.0] * 3, [1.0] * 3)
    V = vector_space(msh)
    u = fem.Function(V)
    lid = qs.RigidSurface.plane(WORLD, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    sides = [(k, qs.RigidSurface.plane(WORLD, [0.0] * 3, np.eye(3)[k]), 0.0) for k in range(3)]
    contacts = [
        qs.Contact(qs.Surface(V, facets=plane(msh, k, at)), tool, friction=qs.Coulomb(0.3))
        for k, tool, at in (*sides, (2, lid, 1.0))
    ]
    problem = qs.ContactProblem([elastic(u, E=10.0, nu=0.3)], [u], contacts, [[]])
    lid.displacement = [0.0, 0.0, -0.02]
    problem.solve()
    force = contacts[3].force("master")[2]
    # Without friction it is 0.2198; friction on walls and floor increases it.
    assert 0.23 < force < 0.27
    assert np.abs(sum(c.force("slave") for c in contacts)).max() < 1e-8 * force
