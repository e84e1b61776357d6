"""The tangent as a sum, and the first coarse space of multigrid: Galerkin, rigid modes."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, drag_top, elastic, largest, plane, vector_space
from solve.test_problem import hyperelastic

import ufl
from dolfinx import fem
from dolfinx.fem import petsc

import qsdolfinx as qs
from qsdolfinx.system.symmetry import halved, is_halved, is_symmetric

SCENES = {
    "linear": {},
    "friction": {"friction": qs.Coulomb(0.2)},
    "nonlinear": {},
}


def scene(cell, name, solver):
    """Solve two blocks and evaluate the tangent there."""
    pair = Pair(cell, n=(6, 4), wave=0.02)
    options = {"enforcement": "penalty", "sliding": "small"} | SCENES[name]
    pair.contact = qs.Contact(pair.slave, pair.master, penalty=30.0, **options)
    if name == "friction":
        drag_top(pair, 0.02)
    if name == "nonlinear":
        pair.F[1] = hyperelastic(pair.u[1])
    tight = {} if solver == "direct" else {"ksp_rtol": 1e-12}
    problem = pair.problem(solver=solver, petsc_options=tight)
    problem.solve()
    return problem


def waves(vec, factor):
    """Fill a vector with numbers that do not depend on the partition."""
    vec.array[:] = np.sin(factor * np.arange(*vec.owner_range) + 1.0)
    return vec


def refresh(problem, x):
    """Evaluate the residual and assemble the tangent at x."""
    problem.system.tangent(x)
    problem.newton.linear.follow()


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_sum(cell, name):
    """Products, also with the transpose, and the diagonal are those of the AIJ matrix."""
    direct, amg = scene(cell, name, "direct"), scene(cell, name, "amg")
    x = 1.05 * direct.system.x.array_r  # where friction slips instead of being at rest
    refresh(direct, x)
    refresh(amg, x)
    assert amg.system.matrix.getType() == "python"
    results = []
    for problem in (direct, amg):
        A = problem.system.matrix
        x, y = A.createVecs()
        waves(x, 1.7)
        A.mult(x, y)
        found = [y.array_r.copy()]
        A.multTranspose(x, y)
        found += [y.array_r.copy(), A.getDiagonal().array_r.copy()]
        results.append(found)
        problem.destroy()
    for expected, found in zip(*results, strict=True):
        assert largest(found - expected) < 1e-6 * largest(expected)  # of two different solutions


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_galerkin(cell, name):
    """The coarse matrix is PᵀAP, also after changes since P was made; PᵀP = 1."""
    problem = scene(cell, name, "amg")
    refresh(problem, 0.7 * problem.system.x.array_r)
    errors = galerkin_errors(problem)
    problem.destroy()
    assert max(errors) < 1e-11


def galerkin_errors(problem):
    pc = problem.snes.getKSP().getPC()
    P, coarse = pc.getMGInterpolation(1), pc.getMGCoarseSolve().getOperators()[0]
    fine, product = P.createVecLeft(), P.createVecLeft()
    c, expected, found = (P.createVecRight() for _ in range(3))
    waves(c, 1.3)
    P.mult(c, fine)
    P.multTranspose(fine, found)
    identity = (found - c).norm() / c.norm()
    problem.system.matrix.mult(fine, product)
    P.multTranspose(product, expected)
    coarse.mult(c, found)
    return identity, (found - expected).norm() / expected.norm()


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_spaces(cell):
    """A coarse function belongs to one body; each body's rigid modes are coarse functions."""
    problem = scene(cell, "linear", "amg")
    P = problem.snes.getKSP().getPC().getMGInterpolation(1)
    c, fine, back = P.createVecRight(), P.createVecLeft(), P.createVecLeft()
    outside, errors = [], []
    for i, (body, modes) in enumerate(
        zip(problem.bodies, problem.system.made.rigid.modes, strict=True)
    ):
        for mode in modes:
            fine.array[:] = 0
            problem.system.part(fine.array, i)[body.free] = mode.array_r[body.free]
            P.multTranspose(fine, c)
            P.mult(c, back)
            outside.append(largest(problem.system.part(back.array_r, 1 - i)))
            errors.append((back - fine).norm() / fine.norm())
    problem.destroy()
    assert max(outside) == 0
    assert max(errors) < 1e-12


@pytest.mark.parallel
def test_shift_in_the_coarse_matrix():
    """The stabilisation of a block between frictionless planes acts on the coarse level, too."""
    msh = box(WORLD, (4, 4, 4), "hexahedron", [0.0] * 3, [1.0] * 3, "forward")
    u = fem.Function(vector_space(msh))
    tools = [qs.RigidSurface.plane(WORLD, [0, 0, z], [0, 0, s]) for z, s in ((0, 1), (1, -1))]
    contacts = [
        qs.Contact(
            qs.Surface(u.function_space, facets=plane(msh, 2, z)),
            tool,
            penalty=50.0,
            enforcement="penalty",
        )
        for z, tool in zip((0.0, 1.0), tools, strict=True)
    ]
    tools[1].displacement = [0, 0, -0.02]
    problem = qs.ContactProblem([elastic(u)], [u], contacts, linear_solver="amg")
    problem.solve()
    shifted = problem.system.made.tangent.sum.shift is not None
    errors = galerkin_errors(problem)
    force = contacts[0].force("slave")
    problem.destroy()
    assert shifted and max(errors) < 1e-11
    assert np.isclose(abs(force[2]), 0.02 / (1 + 2 / 50.0), rtol=1e-6)  # E = 1


def test_material_of_one_rank():
    """A material that changes on one rank changes the coarse spaces on all ranks."""
    found = []
    for solver in ("direct", "amg"):
        pair = Pair("hexahedron", n=(4, 3), wave=0.02)
        E = fem.Function(fem.functionspace(pair.meshes[0], ("DG", 0)))
        E.x.array[:] = 1.0
        u, v = pair.u[0], ufl.TestFunction(pair.V[0])
        stress = qs.materials.linear_elastic(u, E, 0.3)
        pair.F[0] = ufl.inner(stress, ufl.grad(v)) * ufl.dx
        problem = pair.problem(solver=solver)
        problem.solve()
        x = pair.meshes[0].geometry.x
        corner = np.linalg.norm(x - np.array([0.0, 0.0, -1.0]), axis=1) < 1e-8
        cells = np.any(corner[pair.meshes[0].geometry.dofmap], axis=1)
        E.x.array[: cells.size][cells] = 50.0
        problem.solve()
        found.append([u.x.array.copy() for u in problem.u])
        problem.destroy()
    assert all(largest(a - b) < 1e-6 * largest(a) for a, b in zip(*found, strict=True))


@pytest.mark.parametrize("solver", ("amg", "fieldsplit", "direct"))
def test_no_more_symmetric(solver):
    """A Constant adds convection to a linear body after the first solve: asymmetry is detected."""
    found = []
    for again in (False, True):
        pair = Pair("hexahedron", n=(6, 5), wave=0.02)
        c = fem.Constant(pair.meshes[1], 0.0 if again else 0.5)
        u, v = pair.u[1], ufl.TestFunction(pair.V[1])
        pair.F[1] += c * ufl.inner(ufl.grad(u) * ufl.as_vector([1.0, 0.5, 0.0]), v) * ufl.dx
        problem = pair.problem(solver=solver)
        problem.solve()
        if again:
            assert problem.symmetric
            c.value = 0.5
            problem.solve()
        assert not problem.symmetric and problem.num_restarts == 0
        found.append([u.x.array.copy() for u in problem.u])
        problem.destroy()
    assert all(largest(a - b) < 1e-6 * largest(a) for a, b in zip(*found, strict=True))


@pytest.mark.parallel
def test_storage():
    """A linear body's matrix is stored by half if it is symmetric, until it changes."""
    pair = Pair("hexahedron", n=(6, 5))
    modulus, along = fem.Constant(pair.meshes[0], 1.0), ufl.as_vector([1.0, 0.5, 0.0])
    pair.F[0] = elastic(pair.u[0], modulus)
    u, v = pair.u[1], ufl.TestFunction(pair.V[1])
    pair.F[1] += ufl.inner(ufl.grad(u) * along, v) * ufl.dx
    problem = pair.problem(solver="amg")
    for value, kinds in ((1.0, ["sbaij", "baij"]), (2.0, ["baij", "baij"])):
        modulus.value = value
        problem.solve()
        found = [body.matrix().getType()[3:] for body in problem.system.bodies]
        assert found == kinds
        assert problem.system.made.tangent.are_symmetric == [True, False]
    problem.destroy()


@pytest.mark.parallel
@pytest.mark.parametrize("speed", (0.0, 1e-3))
def test_storage_of_a_soft_part(speed):
    """Asymmetry of a soft part beside a stiff one is not lost, though all in all it is rounding."""
    u = fem.Function(vector_space(box(WORLD, [8, 3, 3], "hexahedron", [0, 0, 0], [3, 1, 1])))
    x, v = ufl.SpatialCoordinate(u.function_space.mesh), ufl.TestFunction(u.function_space)
    soft = ufl.conditional(x[0] < 1, 1.0, 0.0)
    rate = ufl.dot(ufl.grad(u), ufl.as_vector([1.0, 0.5, 0.0]))
    moved = fem.Constant(u.function_space.mesh, speed) * soft * ufl.inner(rate, v) * ufl.dx
    form = fem.form(ufl.derivative(elastic(u, soft + 1e12 * (1 - soft)) + moved, u))
    matrix = petsc.create_matrix(form, "baij")
    petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    assert is_symmetric(matrix)
    assert is_halved(halved(matrix)) == (speed == 0)


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_symmetric_at_rest_alone(cell):
    """A tangent that is symmetric only at rest, as with convection, is detected."""
    found = []
    for solver in ("direct", "amg"):
        pair = Pair(cell, n=(6, 4), wave=0.02)
        u, v = pair.u[1], ufl.TestFunction(pair.V[1])
        pair.F[1] += ufl.inner(3.0 * ufl.grad(u) * u, v) * ufl.dx
        drag_top(pair, 0.1)
        problem = pair.problem(solver=solver)
        problem.solve()
        found.append([u.x.array.copy() for u in problem.u])
        symmetric, restarts = problem.symmetric, problem.num_restarts
        problem.destroy()
    assert not symmetric and restarts == 0
    assert all(largest(a - b) < 1e-6 * largest(a) for a, b in zip(*found, strict=True))
