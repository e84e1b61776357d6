"""Light loads: the residual relative to the forces is as small as under other loads."""

import numpy as np
import pytest
from hard.bodies import Punch, solve
from hard.cases import Variant
from scenes import WORLD, Pair, box, clamp, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.solve.convergence import Convergence, Measures


@pytest.mark.parametrize("solver", ["direct", "amg", "fieldsplit"])
@pytest.mark.parametrize("friction", [None, qs.Coulomb(0.1)])
@pytest.mark.parametrize("size", [1e-2, 1e-12])
def test_residual(size, friction, solver):
    """The residual is small relative to a small load.

    It used to stop at the effect of coordinate rounding on the gaps, although the gaps change by
    less.
    """
    lower = box(WORLD, (5, 4), "triangle", [-0.8, -1.0], [0.8, 0.0])
    upper = box(WORLD, (3, 7), "quadrilateral", [-0.5, 0.0], [0.5, 1.0])
    V, W = vector_space(lower), vector_space(upper)
    u, v = fem.Function(V), fem.Function(W)
    top = plane(upper, 1, 1.0)
    tags = mesh.meshtags(upper, 1, np.sort(top), np.ones(len(top), np.int32))
    load = fem.Constant(upper, np.array([0.0, -size]))
    F = elastic(v, E=40.0)
    F -= ufl.inner(load, ufl.TestFunction(W)) * ufl.ds(upper, subdomain_data=tags)(1)
    surfaces = (
        qs.Surface(W, facets=plane(upper, 1, 0.0)),
        qs.Surface(V, facets=plane(lower, 1, 0.0)),
    )
    contact = qs.Contact(*surfaces, friction=friction)
    bcs = [[], [clamp(V, plane(lower, 1, -1.0))]]
    problem = qs.ContactProblem([F, elastic(u)], [v, u], [contact], bcs, linear_solver=solver)
    problem.solve()
    system = problem.system
    residual = system.norm(system.residual(system.x.array_r))
    assert residual < 2e-9 * size
    assert problem.num_iterations <= 15 and problem.num_linear_iterations <= 200
    np.testing.assert_allclose(contact.force("slave"), [0.0, size], rtol=1e-8, atol=1e-8 * size)
    problem.destroy()


def test_rounding_does_not_end_other_solves():
    """The rounding estimate is a small part of the tolerance of a solve."""
    scene = Punch(Variant(), n=((16, 6), (7, 3)))
    problem = scene.problem()
    solve(problem)
    measures, limits = problem.newton.measure()
    assert np.all(measures.rounding < 1e-2 * 1e-9 * measures.sizes)
    assert np.all(limits <= 1e-9 * measures.sizes) and np.all(measures.residuals <= limits)


@pytest.mark.parametrize("options", ({}, {"petsc_options": {"snes_type": "newtonls"}}))
def test_moved_far(options):
    """A light block that has moved 1e4 of its sizes: rounding is a large part of its weight."""
    pair, far, weight = Pair("triangle", n=(8, 6)), 1e4, 1e-6
    pair.bcs = [
        [clamp(pair.V[0], plane(pair.meshes[0], 1, -1.0), np.array([far, 0.0]))],
        [slide(pair.V[1], 0, plane(pair.meshes[1], 1, 1.0), far)],
    ]
    pair.F[1] += fem.Constant(pair.meshes[1], weight) * ufl.TestFunction(pair.V[1])[1] * ufl.dx
    for u in pair.u:
        u.x.array[::2] = far
    nodal = {"quadrature": "nodal", "enforcement": "penalty", "penalty": 30.0, "sliding": "small"}
    pair.contact = qs.Contact(pair.slave, pair.master, **nodal)
    problem = pair.problem(solver="direct", **options)
    problem.solve()
    assert problem.num_iterations <= 5
    np.testing.assert_allclose(pair.contact.force("slave")[1], weight, rtol=1e-2)


@pytest.mark.parametrize(
    "size, undeformed, flown",
    ((1e-6, True, False), (1e-2, False, False), (1e3, False, False), (1e9, False, True)),
)
def test_sizes_of_displacements(size, undeformed, flown):
    """Bodies are as they were made, deformed, or far away, in units of their cells."""
    problem = Punch(Variant(), n=((4, 2), (3, 2))).problem()
    problem.set_up()
    problem.system.x.array[:] = 0.2 * size
    problem.system.residual(problem.system.x.array_r)
    measures, _ = problem.newton.measure()
    assert np.all(measures.undeformed == undeformed) and np.all(measures.flown == flown)


@pytest.mark.parametrize(
    "least, rounding, undeformed, flown, rests, raised",
    [
        (1.0, 1e-9, False, False, False, True),  # small next to the forces
        (9.0, 1e-9, False, False, False, True),
        (90.0, 1e-9, False, False, False, False),  # the residual still falls
        (1.0, 1e-3, False, False, False, False),  # rounding hides the forces
        (1.0, 1e-3, False, False, True, True),  # but nothing changes any more
        (1.0, 1e-3, False, True, True, False),  # far away
        (1.0, 1e-3, True, False, False, True),  # the body is as it was made
    ],
)
def test_when_rounding_decides(least, rounding, undeformed, flown, rests, raised):
    """Limits are raised to rounding level where an iteration no longer reduces the residual."""
    one = np.ones(1)
    flags = np.array([undeformed]), np.array([flown])
    at = Measures(10 * one, one, rounding * one, rounding * one, 0 * one, *flags)
    found = at.with_rounding(1e-12 * one, least * one, one, rests)
    np.testing.assert_array_equal(found, rounding if raised else 1e-12)


@pytest.mark.parametrize("dt", (1.0, 1e-4))
def test_displacements_of_velocities(dt):
    """Whether a body is undeformed depends on its displacement in the step, not on the velocity."""
    msh = box(WORLD, (4, 4), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, tool = fem.Function(V), qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(surface, tool, unknown="velocity", dt=dt)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
    problem.set_up()
    for displacement, undeformed in ((1e-6, True), (1e-2, False)):
        x = problem.system.x.array_r * 0 + displacement / dt
        problem.system.residual(x)
        assert Convergence(problem.system).measure().undeformed.tolist() == [undeformed]
