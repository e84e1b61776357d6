"""A direct solver takes over from an iterative one that fails."""

import logging

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, box, drag_top, elastic, largest, plane

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact.penalty import STIFFEST_FOR_MULTIGRID
from qsdolfinx.linear import presets, solver
from qsdolfinx.linear.solver import LinearSolver

#: So few iterations that no iterative solver can do with them.
HOPELESS = {"ksp_max_it": 2, "ksp_rtol": 1e-10}


def solved(solver, **options):
    """Force on the slave after two steps."""
    pair = Pair("hexahedron", n=(4, 3), wave=0.02, load=-0.05)
    problem = pair.problem(solver=solver, **options)
    forces = []
    for _ in range(2):
        problem.solve()
        forces.append(pair.contact.force("slave"))
    return pair, problem, np.array(forces)


@pytest.mark.parametrize("solver", ("amg", "fieldsplit"))
def test_the_answer_is_that_of_a_direct_solver(solver, caplog):
    """It stays until contact pairs anew, which gives the iterative one another chance.

    After the second failure it stays for one pairing more.
    """
    caplog.set_level(logging.INFO, "qsdolfinx")
    _, _, expected = solved("direct")
    pair, problem, forces = solved(solver, petsc_options=HOPELESS, verbose=True)
    np.testing.assert_allclose(forces, expected, rtol=1e-7)
    said = caplog.text
    if problem.comm.rank == 0:
        assert said.count("DIVERGED_MAX_IT; a direct solver takes over") == 1
        assert "1 restart" in said
    assert problem.newton.linear.ksp.getPC().getType() == "lu"
    assert problem.num_restarts == 0  # of the second solve
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
    """An iterative solver that works again has all its chances again."""
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
    assert ksp.getPC().getType() == "mg"
    problem.destroy()


def tied(name, stiffer, **options):
    """A block tied to one with larger facets: their problem, solved, and displacements."""
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


def test_gaps_that_close_slowly(monkeypatch, caplog):
    """A penalty stiffer than multigrid bears closes gaps soon: a direct solver takes over."""
    monkeypatch.setattr(LinearSolver, "has_saddle_point", property(lambda self: False))
    caplog.set_level(logging.INFO, "qsdolfinx")
    direct, expected = tied("direct", 500.0)
    iterative, found = tied("amg", 500.0)
    assert largest(found - expected) < 1e-6 * largest(expected)
    assert iterative.newton.linear.is_direct
    assert iterative.num_augmentations <= direct.num_augmentations + 15
    assert "gaps close slowly; a direct solver takes over" in caplog.text or WORLD.rank > 0


def test_patience(monkeypatch, caplog):
    """Of "auto": iterations that take longer than a direct solver are not waited for."""
    monkeypatch.setitem(presets.LARGE, 3, 10)
    caplog.set_level(logging.INFO, "qsdolfinx")
    found, iterations = [], []
    for name in ("direct", "auto", "amg"):
        pair = Pair("hexahedron", n=(8, 6), wave=0.02, load=-0.05)
        pair.F = [elastic(u, nu=0.4999) for u in pair.u]
        problem = pair.problem(solver=name)
        problem.solve()
        found.append(np.concatenate([u.x.array for u in problem.u]))
        assert problem.newton.linear.is_direct == (name != "amg")
        assert problem.solver_in_use == ("amg" if name == "amg" else "direct")
        iterations.append(problem.num_iterations)
        if name == "auto":
            assert problem.solver == "amg" and problem.num_linear_iterations < 120
    assert largest(found[1] - found[0]) < 1e-6 * largest(found[0])
    assert iterations[1] <= iterations[0] + 4  # from before what multigrid has made of it
    assert "linear solver: crawls; a direct" in caplog.text or WORLD.rank > 0


def test_soft_penalties_are_raised():
    """Up to what multigrid bears, which then is not given up."""
    problem, found = tied("amg", 1.0, penalty=0.01)
    expected = tied("direct", 1.0)[1]
    penalty = problem.system.contacts[0].penalty
    assert 1 < penalty.ratio <= STIFFEST_FOR_MULTIGRID and "raised" in penalty.source
    assert largest(found - expected) < 1e-6 * largest(expected)
    assert not problem.newton.linear.is_direct


def test_points_keep_their_penalty():
    """It is part of their result: the same whatever the linear solver."""
    options = {"law": qs.Unilateral(), "penalty": 0.3, "constraints": "points"}
    (direct, expected), (iterative, found) = (tied(s, 1.0, **options) for s in ("direct", "amg"))
    for problem in (direct, iterative):
        assert problem.system.contacts[0].eps == 0.3
    assert largest(found - expected) < 1e-6 * largest(expected)


@pytest.mark.parametrize("penalty, is_direct", ((30.0, False), (1e5, True)))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_stiff_penalties(penalty, is_direct, enforcement, monkeypatch):
    """Where a small problem has one, "auto" takes a direct solver; "amg" by name stays."""
    monkeypatch.setitem(presets.LARGE, 3, 10)
    options = {"penalty": penalty, "enforcement": enforcement}
    problem, found = tied("auto", 1.0, **options)
    assert problem.solver == "amg" and problem.newton.linear.is_direct == is_direct
    named, expected = tied("amg", 1.0, **options)
    assert not named.newton.linear.is_direct
    assert largest(found - expected) < 1e-6 * largest(expected)
    monkeypatch.setattr(solver, "LARGE_IF_STIFF", 10)
    late = tied("auto", 1.0, **options)[0]  # iterations tell
    assert late.newton.linear.is_direct == is_direct == bool(late.num_restarts)


def test_conjugate_gradients_after_gmres():
    """They precondition from the left, also if a rescue from GMRES has given back their type."""
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
    """Who names the linear solver is told that it fails."""
    pair = Pair("hexahedron", n=(4, 3), wave=0.02, load=-0.05)
    problem = pair.problem(solver="amg", petsc_options=HOPELESS | {"ksp_type": "cg"})
    with pytest.raises(qs.ConvergenceError, match="DIVERGED_MAX_IT"):
        problem.solve()


def test_rotation_of_a_quadratic_block():
    """The tangent is indefinite on the way: conjugate gradients fail, the solve does not."""
    msh = box(WORLD, [4, 4, 4], "tetrahedron", [0.0] * 3, [1.0] * 3)
    V = fem.functionspace(msh, ("Lagrange", 2, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight = fem.Constant(msh, np.array([0.0, 0.0, -0.01]))
    stress = qs.materials.neo_hookean(u, 1 / 2.6, 0.3 / 1.3 / 0.4)
    F = ufl.inner(stress, ufl.grad(v)) * ufl.dx - ufl.inner(weight, v) * ufl.dx
    tool = qs.RigidSurface.plane(WORLD, [0.0] * 3, [0.0, 0.0, 1.0])
    surface = qs.Surface(V, facets=plane(msh, 2, 0.0))
    contact = qs.Contact(surface, tool, enforcement="augmented-lagrangian", quadrature="overlay")
    qs.ContactProblem([F], [u], [contact], solver="amg").solve()
    np.testing.assert_allclose(contact.force("slave"), [0, 0, 0.01], atol=1e-9)
