"""Monolithic Newton's method for bodies, multipliers and tools: ranks, driven tools, failures."""

import numpy as np
import pytest
from scenes import WORLD, Pair, clamp, largest, plane, raises_everywhere, slide

import ufl
from dolfinx import fem

import qsdolfinx as qs

EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
SOFT = {"enforcement": "penalty"}


def pressed(options, shifts=(0.0, 0.02, 0.05), comm=WORLD, **kwargs):
    """Press and drag the blocks; returns displacements, the last force, and iterations."""
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


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_ranks_do_not_matter(sliding):
    """The contact force does not depend on the number of ranks."""
    options = EXACT | {"friction": qs.Coulomb(0.3), "sliding": sliding}
    forces = [pressed(options, comm=comm)[1] for comm in (WORLD, WORLD.Split(WORLD.rank))]
    assert largest(forces[0] - forces[1]) < 1e-9 * largest(forces[1])


def test_driven_tool():
    """The tool's displacement is an unknown: the contact force balances the driving force."""
    pair = Pair("hexahedron")
    tool = qs.RigidSurface.plane(WORLD, np.zeros(3), [0.0, 0.0, 1.0])
    tool.drive(0.02, [0.0, 0.0, 1.0])
    contact = qs.Contact(pair.slave, tool, friction=qs.Coulomb(0.2), **EXACT)
    bcs = [clamp(pair.V[1], plane(pair.meshes[1], 2, 1.0))]
    problem = qs.ContactProblem([pair.F[1]], [pair.u[1]], [contact], [bcs], linear_solver="direct")
    problem.solve()
    assert np.isclose(contact.force("slave")[2], 0.02, rtol=1e-7)


def test_a_failed_solve_leaves_everything():
    """If a load lifts a block off the tool, the solve fails and the unknowns are as before."""
    pair = Pair("triangle")
    load = fem.Constant(pair.meshes[1], -1.0)
    v = ufl.TestFunction(pair.V[1])
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(pair.slave, tool, **EXACT)
    F, bcs = pair.F[1] - load * v[1] * ufl.dx, [slide(pair.V[1], 0, plane(pair.meshes[1], 0, 0.0))]
    problem = qs.ContactProblem([F], [pair.u[1]], [contact], [bcs], linear_solver="direct")
    problem.solve()
    assert np.isclose(contact.force("slave")[1], 1.0)
    before, load.value = pair.u[1].x.array.copy(), 1.0
    raises_everywhere(WORLD, qs.ConvergenceError, "", problem.solve)
    np.testing.assert_array_equal(pair.u[1].x.array, before)
