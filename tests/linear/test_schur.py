"""The linear solver "schur": the same flow as a factorisation, and unsupported uses."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, Pair, box, largest, mini_space, plane, raises_everywhere, slide

import basix.ufl
import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.linear import presets
from qsdolfinx.linear.condensed import Condensed

DT = 0.05

#: Difference of two solutions with friction, whose final slips are up to 1e-4 of the penalty's.
OF_FRICTION = 1e-6


def flow_body(cell, n, low, m=1.0, axisymmetric=False, space=materials.mini_space):
    """Make form, unknown, contact surface and velocity space of a velocity-pressure block."""
    gdim = 2 if cell == "triangle" else 3
    corner = np.array([0.0] * (gdim - 1) + [low])
    partition = "forward" if low == 0 else "backward"
    msh = box(WORLD, [n] * gdim, cell, corner, corner + 1, partition)
    W = space(msh)
    w, m = fem.Function(W), fem.Constant(msh, m)
    stress = materials.norton_hoff(ufl.split(w)[0], 2.0 + low, m, 1e-2, axisymmetric)
    V, up = W.sub(0), gdim - 1
    # Symmetry on one side, and an end without sliding.
    bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in range(up)]
    end = plane(msh, up, 0.0 if low == 0 else 2.0)
    bcs += [slide(V, axis, end) for axis in range(up)]
    bcs.append(slide(V, up, end, 0.0 if low == 0 else -0.4))
    surface = qs.Surface(V, facets=plane(msh, up, 1.0), axisymmetric=axisymmetric)
    return materials.incompressible(w, stress), w, bcs, surface, m


def elastic_body(cell, n):
    """Make the same for a displacement-based elastic block, from height 1 on."""
    gdim = 2 if cell == "triangle" else 3
    corner = np.array([0.0] * (gdim - 1) + [1.0])
    msh = box(WORLD, [n] * gdim, cell, corner, corner + 1, "backward")
    V = fem.functionspace(msh, ("Lagrange", 1, (gdim,)))
    u, v, up = fem.Function(V), ufl.TestFunction(V), gdim - 1
    F = ufl.inner(materials.linear_elastic(u, 300.0, 0.3), ufl.grad(v)) * ufl.dx
    end = plane(msh, up, 2.0)
    bcs = [slide(V, axis, end, -0.4 * DT if axis == up else 0.0) for axis in range(gdim)]
    return F, u, bcs, qs.Surface(V, facets=plane(msh, up, 1.0)), None


def problem_of(bodies, solver, friction=None, tight=True, **options):
    """Make a problem of two bodies in contact, with the lower one as slave."""
    unknown = tuple("displacement" if body[4] is None else "velocity" for body in bodies)
    contact = qs.Contact(
        bodies[0][3],
        bodies[1][3],
        enforcement="augmented-lagrangian",
        unknown=unknown,
        dt=DT,
        friction=friction,
        quadrature="nodal" if all(body[3].degree == 1 for body in bodies) else "overlay",
    )
    tight = {"ksp_rtol": 1e-11, "snes_rtol": 1e-11} if solver == "schur" and tight else {}
    forms, unknowns, bcs = ([body[i] for body in bodies] for i in range(3))
    return qs.ContactProblem(
        forms, unknowns, [contact], bcs, linear_solver=solver, petsc_options=tight, **options
    )


def taylor_hood(msh):
    velocity = basix.ufl.element("Lagrange", msh.basix_cell(), 2, shape=(msh.geometry.dim,))
    pressure = basix.ufl.element("Lagrange", msh.basix_cell(), 1)
    return fem.functionspace(msh, basix.ufl.mixed_element([velocity, pressure]))


SCENES = {
    "two-flows": lambda: [flow_body("triangle", 6, 0.0), flow_body("triangle", 5, 1.0)],
    "elastic-tool": lambda: [flow_body("triangle", 6, 0.0), elastic_body("triangle", 5)],
    "3D": lambda: [flow_body("tetrahedron", 3, 0.0), elastic_body("tetrahedron", 2)],
    "axisymmetric": lambda: [
        flow_body("triangle", 6, 0.0, axisymmetric=True),
        flow_body("triangle", 5, 1.0, axisymmetric=True),
    ],
    "taylor-hood": lambda: [
        flow_body("triangle", 4, 0.0, space=taylor_hood),
        flow_body("triangle", 3, 1.0, space=taylor_hood),
    ],
}


def compare(make, friction=None, m=None, **options):
    """Return the largest relative difference from the direct solution, and the problem."""
    found = []
    for solver in ("direct", "schur"):
        bodies = make()
        problem = problem_of(bodies, solver, friction, **(options if solver == "schur" else {}))
        if m is None:
            problem.solve()
        else:
            constants = [body[4] for body in bodies if body[4] is not None]
            qs.solve_with_continuation(problem, constants, [m] * len(constants))
        found.append([u.x.array.copy() for u in problem.u])
    errors = [largest(a - b) / largest(a) for a, b in zip(*found, strict=True)]
    return max(errors), problem


@pytest.mark.parametrize("scene", SCENES)
def test_same_solution(scene):
    check(*compare(SCENES[scene]))


@pytest.mark.parametrize("scene", ("two-flows", "elastic-tool"))
def test_friction(scene):
    """The solver works for tangents that are not symmetric."""
    error, problem = compare(SCENES[scene], qs.Coulomb(0.2))
    assert not problem.symmetric
    check(error, problem, OF_FRICTION)


def check(error, problem, most=1e-7):
    """Assert that the requested solver was used, in contact, with few iterations and exact."""
    ksp = problem.snes.getKSP()
    kinds = ksp.getType(), ksp.getPC().getType()
    per_step = problem.num_linear_iterations / problem.num_iterations
    active = sum(problem.active_history[-1])
    assert kinds == ("fgmres", "python") and active > 0
    assert error < most
    assert 1 < per_step < 100


def test_small_rate_sensitivity():
    """The solver works for viscosities that differ by orders of magnitude."""
    error, problem = compare(SCENES["elastic-tool"], m=0.15)
    assert error < 1e-7
    assert problem.num_linear_iterations < 100 * problem.num_iterations


def test_straight_to_small_rate_sensitivities():
    """Without continuation inexact velocities would make Newton's method diverge by viscosities.

    The first solve of the augmented Lagrangian with them has to be exact, too.
    """
    found = []
    for solver in ("direct", "schur"):
        bodies = [flow_body("tetrahedron", 4, 0.0), flow_body("tetrahedron", 3, 1.0, m=0.15)]
        surfaces = [body[3] for body in bodies]
        contact = qs.Contact(*surfaces, unknown="velocity", dt=DT)
        forms, u, bcs = ([body[i] for body in bodies] for i in range(3))
        problem = qs.ContactProblem(forms, u, [contact], bcs, linear_solver=solver)
        problem.solve()
        assert problem.num_restarts == 0
        found.append([w.x.array.copy() for w in u])
    assert all(largest(a - b) < 1e-6 * largest(a) for a, b in zip(*found, strict=True))


def test_interior_facets(monkeypatch):
    """Jumps of pressure gradients couple cells: bubbles cannot be eliminated one by one."""
    monkeypatch.setitem(presets.LARGE_FLOW, 3, 10)
    bodies = SCENES["3D"]()
    w = bodies[0][1]
    p, q = ufl.split(w)[1], ufl.TestFunctions(w.function_space)[1]
    jumps = 1e-3 * ufl.inner(ufl.jump(ufl.grad(p)), ufl.jump(ufl.grad(q))) * ufl.dS
    bodies[0] = (bodies[0][0] - jumps, *bodies[0][1:])
    raises_everywhere(WORLD, ValueError, "interior facets", lambda: problem_of(bodies, "schur"))
    if WORLD.size == 1:  # ghosts required by dS are missing
        assert problem_of(bodies, "auto").linear_solver == "direct"


def test_later_solves():
    """After a contact update with another load and viscosity, the result is that of a new solve."""
    found = []
    for solver in ("direct", "schur"):
        bodies = SCENES["elastic-tool"]()
        problem = problem_of(bodies, solver)
        problem.solve()
        problem.contacts[0].update()
        bodies[0][4].value = 0.5
        problem.solve()
        problem.solve()
        found.append([u.x.array.copy() for u in problem.u])
    assert max(largest(a - b) / largest(a) for a, b in zip(*found, strict=True)) < 1e-7


def test_another_time_step():
    """Δt changes the gap change due to velocities, although the contact pairs stay."""
    found = []
    for solver in ("direct", "schur"):
        problem = problem_of(SCENES["elastic-tool"](), solver, qs.Coulomb(0.2))
        problem.solve()
        problem.contacts[0].set_dt(0.6 * DT)
        problem.solve()
        found.append([u.x.array.copy() for u in problem.u])
        problem.destroy()
    errors = [largest(a - b) / largest(a) for a, b in zip(*found, strict=True)]
    assert max(errors) < OF_FRICTION


def test_after_a_rescue():
    """The direct solver takes over, and the Schur complement returns at the next contact update."""
    found = []
    for solver in ("direct", "schur"):
        problem = problem_of(SCENES["elastic-tool"](), solver, qs.Coulomb(0.2))
        problem.solve()
        if solver == "schur":
            assert problem.newton.linear.give_up("test")
        kinds = []
        for _ in range(2):
            problem.contacts[0].update()
            problem.solve()
            kinds.append(problem.snes.getKSP().getPC().getType())
        found.append([u.x.array.copy() for u in problem.u])
        problem.destroy()
    assert kinds == ["python", "python"]
    assert max(largest(a - b) / largest(a) for a, b in zip(*found, strict=True)) < 1e-7


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
def test_refinement(cell):
    """Krylov iterations do not grow with refinement."""
    counts = []
    for n in (8, 16) if cell == "triangle" else (3, 6):
        problem = problem_of([flow_body(cell, n, 0.0), elastic_body(cell, n - 1)], "schur")
        problem.solve()
        counts.append(problem.num_linear_iterations / problem.num_iterations)
    assert max(counts) < 90 and counts[1] < 1.6 * counts[0], counts


def test_bubbles_are_eliminated_exactly():
    """Velocities found without bubbles, and bubbles from these, satisfy all equations."""
    problem = problem_of([flow_body("triangle", 4, 0.0), elastic_body("triangle", 3)], "direct")
    problem.solve()
    body = problem.bodies[0]
    K, first = body.matrix(), body.x.owner_range[0]
    pressures = body.V.sub(1).dofmap.list.ravel()
    pressures = np.unique(pressures[pressures < body.num_owned])
    condensed = Condensed(body, K, pressures, 1.0)
    velocities = np.setdiff1d(np.arange(body.num_owned), pressures)
    r, out = np.zeros(body.num_owned), np.zeros(body.num_owned)
    r[velocities] = np.sin(1.0 + (first + velocities))
    ksp, (b, y) = PETSc.KSP().create(WORLD), condensed.A.createVecs()
    ksp.setOperators(condensed.A)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    b.array[:] = condensed.reduce(r)
    ksp.solve(b, y)
    condensed.expand(y.array_r, out)
    there, product = body.create_vec(), body.create_vec()
    there.array[:] = out
    K.mult(there, product)
    assert largest(out[condensed.bubbles]) > 0
    assert largest((product.array_r - r)[velocities]) < 1e-10
    for thing in (ksp, b, y, there, product, condensed):
        thing.destroy()


@pytest.mark.parametrize("axisymmetric", (False, True))
def test_weight(axisymmetric):
    """The automatic mass matrix is -1/(2η) p q, with 2πr in rings; units of p enter squared."""
    viscosity, unit = 2.0, 7.0
    (F, w, bcs, surface, _), other = (
        flow_body("triangle", 4, z, 1.0, axisymmetric) for z in (0.0, 1.0)
    )
    v, p = ufl.split(w)
    scaled = ufl.replace(F, {w: ufl.as_vector([v[0], v[1], unit * p])})
    test = ufl.TestFunction(w.function_space)
    scaled = ufl.replace(scaled, {test: ufl.as_vector([test[0], test[1], unit * test[2]])})
    problem = problem_of([(scaled, w, bcs, surface, 1.0), other], "schur")
    problem.set_up()
    mass = problem.newton.linear.schur.pressures[0].mass
    mass.assemble()
    one = mass.matrix.createVecs()[0]
    one.set(1.0)
    total = one.dot(mass.matrix * one)
    weight = 2 * np.pi * 0.5 if axisymmetric else 1.0  # at the mean radius
    expected = -(unit**2) / (2 * viscosity) * weight
    assert np.isclose(total, expected, rtol=0.05 if axisymmetric else 1e-12)


def test_given_form():
    """A form given by the user on the body's space may have either sign."""
    bodies = SCENES["elastic-tool"]()
    counts = []
    for sign in (1, -1):

        def make():
            return bodies

        W = bodies[0][1].function_space
        p, q = ufl.TrialFunctions(W)[1], ufl.TestFunctions(W)[1]
        forms = [sign / 4.0 * p * q * ufl.dx, None]
        for body in bodies:
            body[1].x.array[:] = 0
        problem = problem_of(make(), "schur", pressure_preconditioner=forms)
        problem.solve()
        counts.append(problem.num_linear_iterations / problem.num_iterations)
    assert counts[0] == counts[1] < 100


def test_auto(monkeypatch, caplog):
    """The choice is by size and is logged; a user's form has no influence on it."""
    names = [problem_of(SCENES["3D"](), "auto").linear_solver]
    monkeypatch.setitem(presets.LARGE_FLOW, 3, 10)
    names.append(problem_of(SCENES["3D"](), "auto").linear_solver)
    printed = caplog.text
    assert names == ["direct", "schur"]
    assert WORLD.rank > 0 or ("schur" in printed and "or more" in printed)


def test_bad_input():
    """No pressure, other mixed spaces and a wrong matrix or form are refused by name."""
    pair = Pair("triangle")
    bubbles = Pair("triangle", space=mini_space)
    for scene in (pair, bubbles):
        raises_everywhere(WORLD, ValueError, "pressure", lambda s=scene: s.problem(solver="schur"))

    def refuse(match, error=ValueError, solver="schur", **options):
        bodies = SCENES["elastic-tool"]()
        raises_everywhere(WORLD, error, match, lambda: problem_of(bodies, solver, **options))

    refuse("kind", kind="nest")
    refuse("pressure_preconditioner", pressure_preconditioner=[None])
    refuse("pressure_preconditioner", TypeError, pressure_preconditioner=["mass", None])
    refuse("pressure_preconditioner", solver="direct", pressure_preconditioner=[None, None])
    bodies = SCENES["elastic-tool"]()
    wrong = [None, bodies[0][0]]
    raises_everywhere(
        WORLD,
        ValueError,
        "bilinear",
        lambda: problem_of(bodies, "schur", pressure_preconditioner=wrong),
    )


def test_tiny_viscosities():
    """With more room for pivots MUMPS solves tiny viscosities, too, as the limits page says."""
    forces, room = [], {"mat_mumps_icntl_14": 1000}
    for scale in (1.0, 1e-7):
        bodies = [flow_body("triangle", 6, 0.0), flow_body("triangle", 5, 1.0)]
        u, bcs, surfaces = ([body[i] for body in bodies] for i in (1, 2, 3))
        stresses = [materials.newtonian(ufl.split(w)[0], scale) for w in u]
        F = [materials.incompressible(w, stress) for w, stress in zip(u, stresses, strict=True)]
        contact = qs.Contact(*surfaces, unknown="velocity", dt=DT)
        qs.ContactProblem(F, u, [contact], bcs, linear_solver="direct", petsc_options=room).solve()
        forces.append(contact.force("slave") / scale)
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-5 * largest(forces[0]))
