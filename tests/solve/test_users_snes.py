"""PETSc's SNES with the user's options: types, line searches, convergence tests and monitors."""

import functools

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, largest, plane, raises_everywhere

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.linear.saddle_factors import SaddleFactors

EXACT = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
PAPERS = {"quadrature": "nodal", "enforcement": "penalty"}

#: Newton's method as inner solver of a SNES that accelerates it.
INNER = {"npc_snes_type": "newtonls", "npc_snes_linesearch_type": "basic"}


class Dragged:
    """Two blocks, the upper block pressed and then dragged with friction.

    Args:
        options: Options of PETSc.
        solver: Linear solver.
        given: Options of the contact.
    """

    def __init__(self, options=None, solver="direct", **given):
        given = EXACT | {"friction": qs.Coulomb(0.3)} | given
        self.pair = pair = Pair("triangle", wave=0.02, contact_options=given)
        self.load = fem.Constant(pair.meshes[1], np.array([0.0, -0.05]))
        dofs = fem.locate_dofs_topological(pair.V[1], 1, plane(pair.meshes[1], 1, 1.0))
        pair.bcs[1][:] = [fem.dirichletbc(self.load, dofs, pair.V[1])]
        self.problem = pair.problem(solver=solver, petsc_options=options)

    def solve(self):
        """Press and drag; returns displacements of the blocks, and the last force."""
        for shift in (0.0, 0.02, 0.05):
            self.load.value[0] = shift
            self.problem.solve()
        return [u.x.array.copy() for u in self.problem.u], self.pair.contact.force("slave")


@functools.cache
def by_default(solver="direct"):
    """Results with the default options."""
    return Dragged(solver=solver).solve()


@pytest.mark.parametrize(
    "solver, options",
    (
        ("direct", {"snes_linesearch_type": "basic"}),
        ("direct", {"snes_linesearch_type": "bt"}),
        ("direct", {"snes_linesearch_type": "l2"}),
        ("direct", {"snes_linesearch_type": "nleqerr"}),
        ("direct", {"snes_type": "newtontr"}),
        ("direct", {"snes_type": "newtonls", "snes_lag_jacobian": 2}),
        ("direct", {"snes_type": "ngmres", **INNER}),
        ("direct", {"snes_type": "anderson", **INNER}),
        ("direct", {"snes_type": "nrichardson", **INNER}),
        ("direct", {"snes_type": "qn", **INNER}),
        ("amg", {"snes_linesearch_type": "bt"}),
        ("amg", {"snes_type": "ngmres", **INNER}),
    ),
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values())),
)
def test_same_results(solver, options):
    """Results are the same as with the default solver."""
    u, force = by_default(solver)
    dragged = Dragged(options, solver)
    v, other = dragged.solve()
    for a, b in zip(u, v, strict=True):
        assert largest(a - b) < 1e-8 * largest(a)
    assert largest(force - other) < 1e-7 * largest(force)
    reasons, snes = PETSc.SNES.ConvergedReason, dragged.problem.snes
    assert snes.getConvergedReason() == reasons.CONVERGED_FNORM_RELATIVE
    assert snes.getType() == options.get("snes_type", "newtonls")
    dragged.problem.destroy()


def test_gaps_that_follow():
    """With finite sliding results are the same, up to the change of the contact areas."""
    force = Dragged(sliding="finite").solve()[1]
    other = Dragged({"snes_linesearch_type": "bt"}, sliding="finite").solve()[1]
    assert largest(force - other) < 1e-4 * largest(force)


def test_monitors_and_tests():
    """Monitors see the SNES that solves, and a user's convergence test is used."""
    dragged = Dragged({"snes_type": "newtonls"})
    problem, seen, ends = dragged.problem, [], []

    def ends_at(snes, iteration, norms):
        ends.append(norms[2])
        return PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS if iteration == 2 else 0

    problem.snes.setMonitor(lambda snes, iteration, norm: seen.append(norm))
    problem.snes.setConvergenceTest(ends_at)
    problem.solve()
    assert problem.snes.getIterationNumber() == 2 and len(ends) == len(seen) == 3
    assert problem.snes.getConvergedReason() == PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS
    np.testing.assert_allclose(seen, ends)
    assert len(problem.residual_history) == len(problem.active_history) == 3
    assert all(r <= norm for r, norm in zip(problem.residual_history, seen, strict=True))


def test_a_test_by_name():
    """PETSc's default test uses the norm of the whole residual, relative to the first norm."""
    options = {"snes_convergence_test": "default", "snes_rtol": 1e-3, "snes_atol": 1e30}
    dragged = Dragged(options)
    dragged.problem.solve()
    reasons = PETSc.SNES.ConvergedReason
    assert dragged.problem.snes.getConvergedReason() == reasons.CONVERGED_FNORM_ABS
    assert dragged.problem.snes.getIterationNumber() == 0


@pytest.mark.parametrize("given", (EXACT, PAPERS), ids=("all unknowns", "condensed"))
def test_one_step_is_judged(given):
    """A type that ends by its number of iterations has not converged if forces do not balance.

    Tied linear bodies are solved in one step.
    """
    for law in (qs.Tied(), qs.Unilateral()):
        pair = Pair("quadrilateral", n=(5, 3), law=law, wave=0.05, contact_options=given)
        problem = pair.problem(petsc_options={"snes_type": "ksponly"})
        if law.jump:
            problem.solve()
            assert abs(pair.contact.force("slave")[1]) > 0.01
        else:
            raises_everywhere(WORLD, qs.ConvergenceError, "DIVERGED_MAX_IT", problem.solve)


def test_a_failure_is_final():
    """If the solve fails, no other method is tried, and the solve can be repeated."""
    dragged = Dragged({"snes_linesearch_type": "bt", "snes_max_it": 0})
    dragged.load.value[0] = 0.05
    raises_everywhere(WORLD, qs.ConvergenceError, "DIVERGED_MAX_IT", dragged.problem.solve)
    assert all(largest(u.x.array) == 0 for u in dragged.problem.u)
    dragged.problem.snes.setTolerances(max_it=20)
    dragged.problem.solve()
    assert dragged.problem.num_restarts == 0


@pytest.mark.parametrize("first", (0, 2))
def test_a_singular_matrix(first, monkeypatch):
    """A singular matrix gives a ConvergenceError, not a PETSc error; the next solve works."""
    expected = by_default()[1]
    dragged, calls, solve = Dragged({"snes_linesearch_type": "bt"}), [], SaddleFactors.solve

    def singular(self, rhs):
        calls.append(1)
        return None if len(calls) > first else solve(self, rhs)

    dragged.load.value[0] = 0.05
    with monkeypatch.context() as patch:
        patch.setattr(SaddleFactors, "solve", singular)
        solve_ = dragged.problem.solve
        raises_everywhere(WORLD, qs.ConvergenceError, "DIVERGED_LINEAR_SOLVE", solve_)
    assert largest(dragged.solve()[1] - expected) < 1e-7 * largest(expected)


def test_errors_of_forms(monkeypatch):
    """An exception in a callback is raised unchanged, and the next solve finds the solution."""
    expected = by_default()[1]
    dragged = Dragged({"snes_linesearch_type": "bt"})
    body, calls = dragged.problem.bodies[0], []
    residual = body.residual

    def failing(x):
        calls.append(1)
        if len(calls) == 6:
            raise ZeroDivisionError("of the user's")
        return residual(x)

    with monkeypatch.context() as patch:
        patch.setattr(body, "residual", failing)
        raises_everywhere(WORLD, ZeroDivisionError, "of the user's", dragged.problem.solve)
    force = dragged.solve()[1]
    assert largest(force - expected) < 1e-7 * largest(expected)


@pytest.mark.parametrize(
    "options, remedy",
    (
        ({"snes_type": "vinewtonrsls"}, "'newtonls'"),
        ({"snes_type": "fas"}, "'newtonls'"),
        ({"snes_type": "ngmres"}, "npc_snes_type='newtonls'"),
        ({"snes_type": "qn", "npc_snes_type": "ngs"}, "npc_snes_type='newtonls'"),
        ({"snes_type": "newtontr", "ksp_type": "gmres", "pc_type": "jacobi"}, "solver='direct'"),
    ),
    ids=str,
)
def test_types_that_cannot_solve(options, remedy):
    """SNES types that cannot solve are refused; the error names an alternative."""
    pair = Pair("triangle", contact_options=EXACT)
    with pytest.raises(ValueError, match="does not solve") as error:
        pair.problem(petsc_options=options)
    assert remedy in str(error.value)


def test_papers_penalty():
    """With the paper's penalty, SNES solves for the bodies' unknowns alone.

    Any SNES type that solves for them is accepted.
    """
    pair = Pair("triangle", contact_options=PAPERS)
    pair.problem(petsc_options={"snes_type": "newtontrdc"})
