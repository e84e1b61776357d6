"""One Newton's method on bodies, multipliers and tools: the results that updates around it give."""

import contextlib

import numpy as np
import pytest
from friction.test_friction import LAWS
from scenes import WORLD, Pair, clamp, largest, plane, raises_everywhere, slide

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.solve.at_once import AtOnce

EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
SOFT = {"enforcement": "penalty"}


@pytest.fixture
def updates(monkeypatch):
    """Lets the multipliers be updated around a penalty inside the block."""

    @contextlib.contextmanager
    def instead():
        with monkeypatch.context() as patch:
            patch.setattr(AtOnce, "fits", False)
            yield

    return instead


def pressed(options, shifts=(0.0, 0.02, 0.05), comm=WORLD, **kwargs):
    """Displacements of the blocks, and the last force, after presses and drags; iterations."""
    pair = Pair("triangle", contact_options=options, comm=comm, wave=0.02, **kwargs)
    value = np.array([0.0, -0.05])
    load = fem.Constant(pair.meshes[1], value)
    dofs = fem.locate_dofs_topological(pair.V[1], 1, plane(pair.meshes[1], 1, 1.0))
    pair.bcs[1][:] = [fem.dirichletbc(load, dofs, pair.V[1])]
    problem = pair.problem(solver="direct")
    counts = []
    for shift in shifts:
        load.value[0] = shift
        problem.solve()
        counts.append(problem.num_iterations)
    found = [u.x.array.copy() for u in problem.u], pair.contact.force("slave")
    problem.destroy()
    return *found, counts


@pytest.mark.parametrize("options", (EXACT, SOFT), ids=("exact", "soft"))
@pytest.mark.parametrize("law", (None, "coulomb", "tresca", "norton", "sticking", "tied"))
def test_same_results(law, options, updates):
    """As with the updates of multipliers around a penalty, to what these leave."""
    given, kwargs = dict(options), {}
    if law == "tied":
        kwargs["law"] = qs.Tied()
    elif law is not None:
        given["friction"] = LAWS[law]()
    if law == "norton":
        given |= {"dt": 0.5, "friction": qs.Norton(0.3, 0.4, 0.3, v0=1e-3)}
    if options is EXACT:
        given["gap_tolerance"] = 1e-9
    u, force, counts = pressed(given, **kwargs)
    with updates():
        v, other, before = pressed(given, **kwargs)
    for a, b in zip(u, v, strict=True):
        assert largest(a - b) < 1e-6 * largest(b)
    assert largest(force - other) < 1e-6 * largest(other)
    assert sum(counts) <= 1.25 * sum(before)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_ranks_do_not_matter(sliding):
    """One rank and all find the same."""
    options = EXACT | {"friction": qs.Coulomb(0.3), "sliding": sliding}
    forces = [pressed(options, comm=comm)[1] for comm in (WORLD, WORLD.Split(WORLD.rank))]
    assert largest(forces[0] - forces[1]) < 1e-9 * largest(forces[1])


def test_driven_tool(updates):
    """Its displacement is an unknown: the contact force balances the one that drives it."""
    forces = []
    for way in (contextlib.nullcontext, updates):
        pair = Pair("hexahedron")
        tool = qs.RigidSurface.plane(WORLD, np.zeros(3), [0.0, 0.0, 1.0])
        tool.drive(0.02, [0.0, 0.0, 1.0])
        contact = qs.Contact(pair.slave, tool, friction=qs.Coulomb(0.2), **EXACT)
        bcs = [clamp(pair.V[1], plane(pair.meshes[1], 2, 1.0))]
        problem = qs.ContactProblem([pair.F[1]], [pair.u[1]], [contact], [bcs], solver="direct")
        with way():
            problem.solve()
        assert np.isclose(contact.force("slave")[2], 0.02, rtol=1e-7)
        forces.append(np.append(contact.force("slave"), tool.displacement))
    np.testing.assert_allclose(*forces, rtol=1e-6, atol=1e-9)


def test_a_failed_solve_leaves_everything():
    """Nothing balances a load that lifts a block off the tool: unknowns are as before."""
    pair = Pair("triangle")
    load = fem.Constant(pair.meshes[1], -1.0)
    v = ufl.TestFunction(pair.V[1])
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(pair.slave, tool, **EXACT)
    F, bcs = pair.F[1] - load * v[1] * ufl.dx, [slide(pair.V[1], 0, plane(pair.meshes[1], 0, 0.0))]
    problem = qs.ContactProblem([F], [pair.u[1]], [contact], [bcs], solver="direct")
    problem.solve()
    assert np.isclose(contact.force("slave")[1], 1.0)
    before, load.value = pair.u[1].x.array.copy(), 1.0
    raises_everywhere(WORLD, qs.ConvergenceError, "", problem.solve)
    np.testing.assert_array_equal(pair.u[1].x.array, before)
