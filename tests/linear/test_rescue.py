"""Solver fallback: a direct solver replaces an iterative one that fails."""

import logging

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, box, drag_top, elastic, largest, plane

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.linear import presets

#: Too few iterations for any iterative solver.
HOPELESS = {"ksp_max_it": 2, "ksp_rtol": 1e-10}


def solved(solver, **options):
    """Return the force on the slave after two steps."""
    pair = Pair("hexahedron", n=(4, 3), wave=0.02, load=-0.05)
    problem = pair.problem(solver=solver, **options)
    forces = []
    for _ in range(2):
        problem.solve()
        forces.append(pair.contact.force("slave"))
    return pair, problem, np.array(forces)


@pytest.mark.parametrize("solver", ("amg", "fieldsplit"))
def test_the_answer_is_that_of_a_direct_solver(solver, caplog):
    """The direct solver stays until a contact update, which gives the iterative one a new chance.

    After the second failure it stays for one more contact update.
    """
    caplog.set_level(logging.INFO, "qsdolfinx")
    _, _, expected = solved("direct")
    pair, problem, forces = solved(solver, petsc_options=HOPELESS, verbose=True)
    np.testing.assert_allclose(forces, expected, rtol=1e-7)
    said = caplog.text
    if problem.comm.rank == 0:
        assert said.count("DIVERGED_MAX_IT; a direct solver takes over") == 1
        assert "1 restart" in said
    assert problem.linear_solver == solver and problem.solver_in_use == "direct"
    assert problem.num_restarts == 0  # in the second solve
    for restarts in (1, 0, 1, 0, 0, 0, 1):
        caplog.clear()
        pair.contact.update()
        for u in problem.u:
            u.x.array[:] = 0
        problem.solve()
        assert problem.num_restarts == restarts
        np.testing.assert_allclose(pair.contact.force("slave"), expected[-1], rtol=1e-7)
        said = caplog.text
        if problem.comm.rank == 0:
            assert ("a direct solver takes over" in said) == bool(restarts)
    problem.destroy()


def test_failures_are_forgotten_after_a_success():
    """An iterative solver that works again gets all its chances back."""
    pair = Pair("hexahedron", n=(4, 3), wave=0.02, load=-0.05)
    problem = pair.problem(solver="amg", petsc_options={"ksp_max_it": 2})
    ksp, restarts = problem.snes.getKSP(), []
    for most in (2, 2, 1000, 1000, 2, 1000):
        pair.contact.update()
        for u in problem.u:
            u.x.array[:] = 0
        problem.set_up()
        ksp.setTolerances(max_it=most)
        problem.solve()
        restarts.append(problem.num_restarts)
    assert restarts == [1, 1, 0, 0, 1, 0]
    assert problem.solver_in_use == "amg"
    problem.destroy()


def tied(name, stiffer, **options):
    """Tie a block to one with larger facets; return the solved problem and displacements."""
    options = {"enforcement": "augmented-lagrangian", "quadrature": "overlay"} | options
    penalty = options.pop("penalty", "auto")
    law = options.pop("law", qs.Tied())
    pair = Pair("hexahedron", law=law, penalty=penalty, n=(6, 9), contact_options=options)
    drag_top(pair, 0.05)
    pair.F[1] = stiffer * pair.F[1]
    problem = pair.problem(solver=name)
    problem.solve()
    x = problem.system.x.array_r.copy()
    return problem, x


def test_patience(monkeypatch, caplog):
    """With "auto", iterations that take longer than a direct solver are stopped."""
    monkeypatch.setitem(presets.LARGE, 3, 10)
    caplog.set_level(logging.INFO, "qsdolfinx")
    found, iterations = [], []
    for name in ("direct", "auto", "amg"):
        nodes = {"constraints": "nodes"}
        pair = Pair("hexahedron", n=(8, 6), wave=0.02, load=-0.05, contact_options=nodes)
        pair.F = [elastic(u, nu=0.4999) for u in pair.u]
        problem = pair.problem(solver=name)
        problem.solve()
        found.append(np.concatenate([u.x.array for u in problem.u]))
        assert problem.solver_in_use == ("amg" if name == "amg" else "direct")
        iterations.append(problem.num_iterations)
        if name == "auto":
            assert problem.linear_solver == "amg" and problem.num_linear_iterations < 200
    assert largest(found[1] - found[0]) < 1e-6 * largest(found[0])
    assert iterations[1] <= iterations[0] + 8  # restarted from the state before multigrid
    assert "DIVERGED_MAX_IT; a direct" in caplog.text or WORLD.rank > 0


def test_soft_penalties():
    """Multipliers do not depend on the penalty, and the iterations hardly do."""
    counts, expected = [], tied("direct", 1.0)[1]
    for penalty in (0.1, "auto"):
        problem, found = tied("amg", 1.0, penalty=penalty)
        assert largest(found - expected) < 1e-6 * largest(expected)
        counts.append(problem.num_linear_iterations)
        assert problem.solver_in_use == "amg"
    assert counts[0] < 4 * counts[1]


def test_points_have_their_own_penalty():
    """The penalty at points is part of their result, whatever solver or penalty is given."""
    found = []
    for solver, penalty in (("direct", 0.3), ("amg", 0.3), ("direct", 1e6)):
        options = {"law": qs.Unilateral(), "penalty": penalty, "constraints": "points"}
        problem, x = tied(solver, 1.0, **options)
        assert problem.system.contacts[0].penalty.value == penalty
        found.append((problem.system.contacts[0].eps, x))
    for eps, x in found[1:]:
        np.testing.assert_allclose(eps, found[0][0], rtol=1e-12)
        assert largest(x - found[0][1]) < 1e-6 * largest(found[0][1])


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_stiff_penalties(enforcement):
    """Multigrid uses no penalty stiffer than the usual one."""
    counts = []
    for penalty in (30.0, 1e5):
        options = {"penalty": penalty, "enforcement": enforcement}
        (problem, found), (_, expected) = (tied(name, 1.0, **options) for name in ("amg", "direct"))
        assert largest(found - expected) < 1e-6 * largest(expected)
        assert problem.solver_in_use == "amg"
        counts.append(problem.num_linear_iterations)
    assert counts[1] < 6 * counts[0]


def test_conjugate_gradients_after_gmres():
    """Conjugate gradients are preconditioned from the left, also after a fallback from GMRES."""
    pair = Pair("hexahedron", n=(4, 3), wave=0.02, load=-0.05)
    problem = pair.problem(solver="amg")
    problem.solve()
    linear = problem.newton.linear
    linear.krylov.choose_type(False)
    assert linear.ksp.getPCSide() == PETSc.PC.Side.RIGHT
    linear.ksp.setType(PETSc.KSP.Type.CG)
    linear.krylov.choose_type(True)
    assert linear.ksp.getPCSide() == PETSc.PC.Side.LEFT


def test_a_choice_of_the_user_stays():
    """If a linear solver that the user named fails, an error reports it."""
    pair = Pair("hexahedron", n=(8, 6), wave=0.02, load=-0.05)
    options = {"ksp_type": "cg", "pc_type": "none", "ksp_max_it": 1}
    problem = pair.problem(petsc_options=options)
    with pytest.raises(qs.ConvergenceError, match="DIVERGED_MAX_IT"):
        problem.solve()


def test_few_iterations_of_a_named_solver():
    """Few iterations of a named solver precondition the iterations on the whole system."""
    _, problem, forces = solved("amg", petsc_options=HOPELESS | {"ksp_type": "cg"})
    np.testing.assert_allclose(forces, solved("direct")[2], rtol=1e-7)
    assert problem.num_restarts == 0


def test_rotation_of_a_quadratic_block():
    """The tangent becomes indefinite: conjugate gradients fail, and the solve still succeeds."""
    msh = box(WORLD, [4, 4, 4], "tetrahedron", [0.0] * 3, [1.0] * 3)
    V = fem.functionspace(msh, ("Lagrange", 2, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight = fem.Constant(msh, np.array([0.0, 0.0, -0.01]))
    stress = qs.materials.neo_hookean(u, 1 / 2.6, 0.3 / 1.3 / 0.4)
    F = ufl.inner(stress, ufl.grad(v)) * ufl.dx - ufl.inner(weight, v) * ufl.dx
    tool = qs.RigidSurface.plane(WORLD, [0.0] * 3, [0.0, 0.0, 1.0])
    surface = qs.Surface(V, facets=plane(msh, 2, 0.0))
    contact = qs.Contact(surface, tool, enforcement="augmented-lagrangian", quadrature="overlay")
    qs.ContactProblem([F], [u], [contact], linear_solver="amg").solve()
    np.testing.assert_allclose(contact.force("slave"), [0, 0, 0.01], atol=1e-9)
