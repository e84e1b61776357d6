"""Linear solvers by name give the solution of a factorisation; automatic choice of solver."""

import numpy as np
import pytest
from scenes import WORLD, Pair, drag_top, largest, mini_space

import qsdolfinx as qs
from qsdolfinx.linear import presets
from qsdolfinx.solve import problem

#: Options that do not name a solver.
LOOKING = {"ksp_converged_reason": None, "ksp_monitor": "ascii:/dev/null", "ksp_rtol": 1e-9}


def solution(cell, solver, friction=None, options=None, enforcement="augmented-lagrangian"):
    """Return the unknowns of two blocks, and their problem."""
    more = {"friction": friction, "enforcement": enforcement, "penalty": "auto"}
    pair = Pair(cell, n=(6, 4), wave=0.02, contact_options={})
    pair.contact = qs.Contact(pair.slave, pair.master, **more)
    drag_top(pair, 0.1 if friction else 0.0)
    tight = {"ksp_rtol": 1e-12} if solver not in ("direct", "auto") else {}
    problem = pair.problem(solver=solver, petsc_options=tight | (options or {}))
    problem.solve()
    return problem.system.x.array_r.copy(), problem


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)), ids=("frictionless", "coulomb"))
@pytest.mark.parametrize("solver", ("amg", "fieldsplit"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_same_solution(cell, solver, friction):
    expected, direct = solution(cell, "direct", friction)
    found, problem = solution(cell, solver, friction)
    ksp = problem.snes.getKSP()
    kinds = direct.snes.getKSP().getPC().getType(), ksp.getPC().getType()
    error = largest(found - expected) / largest(expected)
    per_step = problem.num_linear_iterations / problem.num_iterations
    assert kinds == ("lu", "mg" if solver == "amg" else "fieldsplit")
    assert error < 1e-7
    assert 1 < per_step < 100


def test_pick(monkeypatch, caplog):
    """The choice is by size, logged if it is not direct; given options take precedence."""
    monkeypatch.setattr(problem, "told", set())
    names = []
    for limit in (10**6, 10, 10):
        monkeypatch.setitem(presets.LARGE, 3, limit)
        names.append(solution("hexahedron", "auto", enforcement="penalty")[1].linear_solver)
    options = {"ksp_type": "gmres", "pc_type": "jacobi", "ksp_rtol": 1e-10}
    names.append(
        solution("hexahedron", "auto", options=options, enforcement="penalty")[1].linear_solver
    )
    printed = caplog.text
    mixed = Pair("triangle", space=mini_space).problem().linear_solver
    other = solution("hexahedron", "auto", options=LOOKING, enforcement="penalty")[1]
    assert other.linear_solver == "amg" and other.snes.getKSP().getTolerances()[0] == 1e-9
    assert names == ["direct", "amg", "amg", "options"] and mixed == "direct"
    assert (printed.count("solver") == 1 and "10 or more" in printed) or WORLD.rank > 0
    assert presets.pick(10**9, 3, True, "nest")[0] == "fieldsplit"
    by_dimension = [presets.pick(10_000, dim, True, "mpi")[0] for dim in (2, 3)]
    assert by_dimension == ["direct", "amg"]
    of_flow = [presets.pick(n, 3, False, "mpi", True)[0] for n in (9_000, 11_000)]
    assert of_flow == ["direct", "schur"]
    reason = presets.pick(10**9, 3, False, "mpi")
    assert reason[0] == "direct" and "displacements" in reason[1]


def test_options_on_top():
    """Given options override the options of a preset."""
    _, problem = solution("triangle", "amg", options={"ksp_type": "fgmres", "ksp_rtol": 1e-9})
    ksp = problem.snes.getKSP()
    assert ksp.getType() == "fgmres" and np.isclose(ksp.getTolerances()[0], 1e-9)


@pytest.mark.parametrize("law", (qs.Tied, qs.Unilateral))
def test_multigrid_over_the_size(law):
    """Krylov iterations per Newton step hardly grow; bulk matrices are assembled once."""
    most, assemblies = [], []
    for n in ((5, 4), (15, 12)):
        pair = Pair("hexahedron", n=n, contact_options={})
        options = {"law": law(), "quadrature": "overlay", "enforcement": "augmented-lagrangian"}
        pair.contact = qs.Contact(pair.slave, pair.master, **options)
        problem = pair.problem(solver="amg", petsc_options={"ksp_rtol": 1e-8})
        problem.solve()
        most.append(problem.num_linear_iterations / problem.num_iterations)
        assemblies += [body.num_assemblies for body in problem.bodies]
        problem.destroy()
    assert 3 < most[0] and most[1] < min(2.2 * most[0], 60)  # cells are flat
    assert set(assemblies) == {1}


def test_inexact_steps():
    """Inexact steps need fewer Krylov iterations than exact steps, for the same solution."""
    counts, found = [], []
    for options in ({}, {"ksp_rtol": 1e-10}):
        pair = Pair("hexahedron", n=(8, 6), wave=0.02, contact_options={})
        pair.contact = qs.Contact(pair.slave, pair.master, enforcement="augmented-lagrangian")
        problem = pair.problem(solver="amg", petsc_options=options)
        problem.solve()
        counts.append(problem.num_linear_iterations)
        found.append(problem.system.x.array_r.copy())
        problem.destroy()
    error = largest(found[0] - found[1]) / largest(found[1])
    assert counts[0] < 0.75 * counts[1]
    assert error < 1e-7
