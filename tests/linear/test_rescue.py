"""A direct solver takes over from an iterative one that fails."""

import logging

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, box, plane

import ufl
from dolfinx import fem

import qsdolfinx as qs

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
    """It stays until contact pairs anew, which gives the iterative one another chance."""
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
    caplog.clear()
    pair.contact.update()
    for u in problem.u:
        u.x.array[:] = 0
    problem.solve()
    assert problem.num_restarts == 1
    np.testing.assert_allclose(pair.contact.force("slave"), expected[-1], rtol=1e-7)
    said = caplog.text
    if problem.comm.rank == 0:
        assert "a direct solver takes over" in said
    problem.destroy()


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
