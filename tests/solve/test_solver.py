"""ContactProblem: assembly, linear solvers, options and failure."""

import gc
import weakref

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import (
    CELLS,
    WORLD,
    Pair,
    elastic,
    largest,
    raises_everywhere,
)

import ufl
from dolfinx import fem

import qsdolfinx as qs


def test_linear_bodies_are_assembled_once():
    """K is assembled once over solves, loads and Newton steps, until its coefficients change."""
    pair = Pair("quadrilateral", n=(6, 5), wave=0.05)
    msh = pair.meshes[1]
    stiffness, load = fem.Constant(msh, 2.0), fem.Constant(msh, (0.0, 0.0))
    u = pair.u[1]
    pair.F[1] = elastic(u, E=stiffness, force=load)
    problem = pair.problem()
    counts, solutions = [], []
    for _ in range(2):
        problem.solve()
        counts.append([body.num_assemblies for body in problem.bodies])
    load.value[1] = -0.5
    problem.solve()
    counts.append([body.num_assemblies for body in problem.bodies])
    stiffness.value = 3.0
    problem.solve()
    counts.append([body.num_assemblies for body in problem.bodies])
    solutions.append(u.x.array.copy())
    linear = [body.linear for body in problem.bodies]

    # The same solve with a new problem.
    other = Pair("quadrilateral", n=(6, 5), wave=0.05)
    f = ufl.as_vector([0.0, -0.5])
    other.F[1] = elastic(other.u[1], E=3.0, force=f)
    other.problem().solve()
    error = largest(other.u[1].x.array - solutions[0])
    assert linear == [True, True]
    assert counts == [[1, 1], [1, 1], [1, 1], [1, 2]]
    assert error < 1e-11


def test_stale_matrices_are_noticed():
    """A moved mesh and a changed coefficient count as changes."""
    pair = Pair("triangle", n=(3, 2), law=qs.Tied())
    Q = fem.functionspace(pair.meshes[0], ("DG", 0))
    E = fem.Function(Q)
    E.x.array[:] = 1.0
    pair.F[0] = elastic(pair.u[0], E=E)
    problem = pair.problem()
    problem.solve()
    E.x.array[:] = 2.0
    problem.solve()
    pair.meshes[0].geometry.x[:, 0] *= 2
    problem.solve()
    counts = [body.num_assemblies for body in problem.bodies]
    assert counts == [3, 1]


def rubber(**options):
    """Make two neo-Hookean blocks with a penalty."""
    pair = Pair("quadrilateral", contact_options={"enforcement": "penalty"}, **options)
    for i, u in enumerate(pair.u):
        stress = qs.materials.neo_hookean(u, (0.4, 0.8)[i], 0.6)
        pair.F[i] = ufl.inner(stress, ufl.grad(ufl.TestFunction(pair.V[i]))) * ufl.dx(degree=3)
    return pair


def test_each_tangent_once():
    """The first tangent serves both for the matrices of new pairs and for the first iteration."""
    pair = rubber(n=(5, 4), wave=0.02, load=-0.02)
    problem, before = pair.problem(), 0
    for load in (-0.02, -0.03):
        pair.bcs[1][0].g.value[1] = load
        problem.solve()
        assert problem.bodies[0].num_assemblies <= before + problem.num_iterations + 1
        before = problem.bodies[0].num_assemblies
        pair.contact.update()


def test_what_holds_a_free_body_is_not_left():
    """The diagonal shift of a body without support does not accumulate over tangents."""
    pair = rubber(gap=0.1)
    pair.bcs[1] = []
    problem = pair.problem()
    problem.set_up()
    system, found = problem.system, []
    x = system.x.array_r.copy()
    for _ in range(3):
        system.tangent(x)
        found.append(system.made.tangent.diagonal(1))
    assert largest(found[1] - found[0]) == largest(found[2] - found[0]) == 0
    bulk = system.bodies[1].matrix().getDiagonal().array_r
    assert largest(found[0] - bulk) > 0


def test_constant_tangent_is_factorised_once():
    """All bodies linear, all contacts tied: a second load costs no new matrix."""
    pair = Pair("hexahedron", law=qs.Tied())
    top = pair.bcs[1][0].g
    problem = pair.problem()
    states, tops = [], []
    for load in (-0.1, -0.2):
        top.value[2] = load
        problem.solve()
        states.append(problem.system.matrix.stateGet())
        tops.append(pair.contact.force("slave")[2])
    assert states[0] == states[1]
    assert np.isclose(tops[1], 2 * tops[0])


@pytest.mark.parametrize("formulation", ("double-pass", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("tetrahedron", "quadrilateral"))
def test_no_allocation(cell, formulation):
    """Insertion stays within the sparsity pattern, also if constraints become active late.

    PETSc would raise an error otherwise.
    """
    pair = Pair(cell, formulation, n=(4, 3), wave=0.05, gap=0.02)
    problem = pair.problem()
    problem.set_up()
    blocks = [problem.blocks.block(i, j) for i in range(2) for j in range(2)]
    matrices = [*blocks, problem.system.matrix]
    nonzeros = [m.getInfo()["nz_allocated"] for m in matrices]
    problem.solve()
    after = [m.getInfo() for m in matrices]
    active = problem.active_history
    raises = []
    for m in matrices:
        low, high = m.owner_range
        if low == high:
            continue
        columns = set(range(m.getSize()[1])) - set(m.getRow(low)[0])
        try:
            m.setValue(low, min(columns), 1.0)
            raises.append(False)
        except PETSc.Error:
            raises.append(True)
    assert active[0] == [0] and active[-1][0] > 0
    assert [info["mallocs"] for info in after] == [0] * 5
    assert [info["nz_allocated"] for info in after] == nonzeros
    assert all(raises)


KRYLOV = {"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-12}
SPLIT = {
    "ksp_type": "gmres",
    "ksp_rtol": 1e-12,
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "multiplicative",
    "fieldsplit_0_ksp_type": "preonly",
    "fieldsplit_0_pc_type": "bjacobi",
    "fieldsplit_0_sub_pc_type": "lu",
    "fieldsplit_1_ksp_type": "preonly",
    "fieldsplit_1_pc_type": "bjacobi",
    "fieldsplit_1_sub_pc_type": "lu",
}


@pytest.mark.parametrize(
    "kind, options",
    (("mpi", KRYLOV), ("mpi", SPLIT), ("nest", SPLIT)),
    ids=("gamg", "split", "nest"),
)
def test_linear_solvers(kind, options):
    """Any PETSc solver gives the solution of MUMPS."""
    solutions = []
    for k, o in (("mpi", {}), (kind, options)):
        closed = {"gap_tolerance": 1e-10}
        pair = Pair("tetrahedron", n=(4, 3), wave=0.03, contact_options=closed)
        problem = pair.problem(kind=k, petsc_options=o | {"snes_rtol": 1e-11})
        problem.solve()
        solutions.append(np.concatenate([u.x.array for u in pair.u]))
    error, size = largest(solutions[0] - solutions[1]), largest(solutions[0])
    modes = [problem.blocks.block(i, i).getNearNullSpace().getVecs() for i in range(2)]
    if kind == "mpi":
        modes.append(problem.system.matrix.getNearNullSpace().getVecs())
    assert error < 1e-8 * size
    assert [len(m) for m in modes] == [6] * len(modes)


@pytest.mark.parametrize("cell", CELLS)
def test_near_nullspace(cell, monkeypatch):
    """Rigid modes (no Dirichlet conditions) are in the null space of bulk and tied contact."""
    monkeypatch.setattr("qsdolfinx.system.free_motion.SHIFT", 0.0)
    pair = Pair(cell, law=qs.Tied())
    pair.bcs = [[], []]
    problem = pair.problem()
    problem.set_up()
    problem.system.residual(problem.system.x.array_r)
    problem.system.assemble()
    null, residuals = problem.system.matrix.getNearNullSpace(), []
    for vec in null.getVecs():
        out = vec.duplicate()
        problem.system.matrix.mult(vec, out)
        residuals.append(out.norm() / problem.system.matrix.norm())
    assert len(residuals) == (3 if pair.gdim == 2 else 6)
    # Rotations of a relative displacement over zero distance: zero too, as the surfaces coincide.
    assert max(residuals) < 1e-13


def test_failure_keeps_the_last_state():
    """If iterations are too few, the error has all details, and the unknowns are as before."""
    pair = Pair("quadrilateral", n=(9, 7), wave=0.05, load=-0.05)
    problem = pair.problem()
    problem.solve()
    force, multiplier = pair.contact.force("slave"), pair.contact.multiplier()
    kept = [u.x.array.copy() for u in pair.u]
    pair.bcs[1][0].g.value[1] = -0.2
    problem.snes.setTolerances(max_it=1)
    error = raises_everywhere(WORLD, qs.ConvergenceError, "MAX_IT", problem.solve)
    problem.snes.setTolerances(max_it=50)
    changes = [largest(u.x.array - k) for u, k in zip(pair.u, kept, strict=True)]
    force_after, multiplier_after = pair.contact.force("slave"), pair.contact.multiplier()
    problem.solve()  # the problem can still be solved
    assert error.reason == PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT
    assert "MAX_IT" in error.reason_name and error.reason_name in str(error)
    assert len(error.residual_history) >= 2 and error.residual_history[0] > 0
    assert len(error.active_history[0]) == 1
    assert changes == [0, 0] and force[1] > 0
    np.testing.assert_allclose(force_after, force, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(multiplier_after, multiplier, rtol=1e-6, atol=1e-9)


def test_body_that_nothing_holds():
    """For a body without support and without contact, the error says so."""
    pair = Pair("triangle", load=0.0, gap=0.5)
    pair.bcs[1] = []
    pair.F[1] = elastic(pair.u[1], force=ufl.as_vector([0.0, 1.0]))  # upwards
    options = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_max_it": 3}
    problem = pair.problem(petsc_options=options)
    raises_everywhere(WORLD, qs.ConvergenceError, "only contact holds", problem.solve)


def test_goes_on_after_a_failed_factorisation():
    """A matrix that cannot be factorised does not affect later solves."""
    pair = Pair("quadrilateral", n=(6, 5))
    stiffness = fem.Constant(pair.meshes[1], 1.0)
    pair.F[1] = elastic(pair.u[1], E=stiffness)
    problem = pair.problem()
    problem.solve()
    solution = pair.u[1].x.array.copy()
    stiffness.value = 0.0
    with pytest.raises(qs.ConvergenceError, match="PCSETUP_FAILED"):
        problem.solve()
    stiffness.value = 1.0
    problem.solve()
    error = largest(pair.u[1].x.array - solution)
    assert error < 1e-10


def test_options_of_one_problem_do_not_reach_another():
    pairs = [Pair("triangle") for _ in range(3)]
    first = pairs[0].problem(petsc_options_prefix="same_", petsc_options={"snes_max_it": 7})
    second = pairs[1].problem(petsc_options_prefix="same_")
    own = pairs[2].problem(petsc_options={"snes_rtol": 1e-3})
    tolerances = [p.snes.getTolerances() for p in (first, second, own)]
    assert [t[3] for t in tolerances] == [7, 50, 50]
    assert np.isclose(tolerances[2][0], 1e-3)
    assert first.snes.getOptionsPrefix() == "same_"


def test_field_split_keeps_its_options_when_paired_anew():
    pair = Pair("tetrahedron", n=(5, 4), contact_options={"enforcement": "penalty"})
    problem = pair.problem(petsc_options=SPLIT, kind="nest")
    counts = []
    for _ in range(2):
        problem.solve()
        counts.append(problem.snes.getLinearSolveIterations())
        pair.contact.update()
        for u in pair.u:
            u.x.array[:] = 0
    assert abs(counts[1] - counts[0]) <= 1


def test_ghosts_need_not_be_up_to_date():
    """The initial guess may be written to the owned unknowns alone."""
    forces = []
    for amplitude in (0.0, 0.1):
        pair = Pair("quadrilateral", n=(6, 5))
        problem = pair.problem()
        for u, V in zip(pair.u, pair.V, strict=True):
            owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
            u.x.array[:owned] = amplitude * np.sin(np.arange(owned))
        problem.solve()
        forces.append(pair.contact.force("slave"))
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-10, atol=1e-14)


def test_destroy():
    """destroy() removes options; a new problem with the same prefix has the defaults."""
    prefix = "destroyed_"
    problem = Pair("quadrilateral").problem(
        petsc_options_prefix=prefix, petsc_options={"snes_max_it": 7}
    )
    problem.solve()
    assert problem.snes.getTolerances()[3] == 7
    problem.destroy()
    assert not PETSc.Options(prefix).getAll()
    problem = Pair("quadrilateral").problem(petsc_options_prefix=prefix)
    problem.solve()
    assert problem.snes.getTolerances()[3] == 50


@pytest.mark.parametrize("solved", (False, True))
def test_after_destroy(solved):
    """After destroy(), calls raise a clear error; contacts still return their results."""
    pair = Pair("quadrilateral")
    problem = pair.problem()
    stepper = qs.TimeStepper(problem, 1.0)
    if solved:
        problem.solve()
    force = pair.contact.force("slave")
    problem.destroy()
    problem.destroy()
    m, system = fem.Constant(pair.meshes[0], 0.5), problem.system
    calls = [
        problem.solve,
        problem.set_up,
        lambda: problem.one_step().__enter__(),
        lambda: problem.snes,
        problem.newton.solve,
        problem.newton.update_matrices,
        lambda: problem.newton.measure(),
        lambda: system.x,
        lambda: system.residual(np.zeros(3)),
        lambda: system.tangent(np.zeros(3)),
        system.assemble,
        lambda: system.matrix,
        stepper.step,
        lambda: qs.solve_with_continuation(problem, m, 0.5),
    ]
    for call in calls:
        raises_everywhere(WORLD, RuntimeError, "destroyed", call)
    assert problem.blocks is None and len(problem.timings) == 6
    np.testing.assert_array_equal(pair.contact.force("slave"), force)
    again = pair.problem()
    again.solve()


def test_unknown_types_leave_no_options():
    """The error names the option that PETSc refuses; its prefix has no options afterwards."""
    pair = Pair("triangle")
    options = {"pc_type": "incomplete", "ksp_max_it": 7}
    wrong = {"petsc_options_prefix": "wrong_", "petsc_options": options}
    match = "petsc_options: PETSc has no pc_type='incomplete'"
    raises_everywhere(WORLD, ValueError, match, lambda: pair.problem(**wrong))
    assert not PETSc.Options("wrong_").getAll()
    pair.problem(petsc_options_prefix="wrong_").solve()


@pytest.mark.parametrize("count", (0, 2, 7, 8, 60))
def test_messages_are_short(count):
    """Of long histories, the text shows only the ends."""
    residuals, active = [10.0**-i for i in range(count)], [[i, 2 * i] for i in range(count)]
    error = qs.ConvergenceError(-5, residuals, active, violation_history=residuals)
    assert error.residual_history == error.violation_history == residuals
    assert error.active_history == active and len(str(error)) < 500
    shown = [f"{r:.3g}" in str(error) for r in residuals]
    assert all(shown[:1]) and all(shown[-1:])


def test_counts_of_both_sides():
    """Active constraints of a contact are those of both of its integration sides."""
    options = {"sliding": "finite"}
    pair = Pair("triangle", formulation="double-pass", wave=0.02, contact_options=options)
    problem = pair.problem()
    problem.solve()
    assert list(problem.active_history[-1]) == [pair.contact.report().active]


def test_freed(destroy_problems):
    """A problem that is dropped without destroy() is not kept alive by PETSc's callbacks."""
    problem = Pair("triangle").problem()
    problem.solve()
    alive = weakref.ref(problem)
    del problem
    destroy_problems.clear()
    gc.collect()
    assert alive() is None
