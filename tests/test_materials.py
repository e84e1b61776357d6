"""Test materials: stresses, energies, the MINI element and errors."""

import numpy as np
import pytest
from scenes import WORLD, box, plane, slide, vector_space

import ufl
from dolfinx import fem, la, mesh
from dolfinx.fem import petsc as fem_petsc

import qsdolfinx as qs
from qsdolfinx import materials

KINDS = ("plane", "axisymmetric", "3D")
E, NU = 210.0, 0.3
MU, LMBDA = E / 2 / (1 + NU), E * NU / (1 + NU) / (1 - 2 * NU)


def body(kind, n=3, size=(0.7, 1.3)):
    """Mesh of simplices with a width, from the axis if axisymmetric, and a height."""
    width, height = size
    if kind == "3D":
        return box(WORLD, (n,) * 3, "tetrahedron", [0.0] * 3, [width, width, height])
    return box(WORLD, (n, n), "triangle", [0.0] * 2, [width, height])


def integral(expression, msh, axisymmetric=False):
    weight = materials.axisymmetric_weight(msh) if axisymmetric else 1.0
    value = fem.assemble_scalar(fem.form(weight * expression * ufl.dx(msh)))
    return WORLD.allreduce(value)


def check_uniform(tensor, exact, msh, rtol=1e-10):
    """Check that the tensor has this value everywhere."""
    difference = tensor - ufl.as_tensor(np.asarray(exact).tolist())
    error = integral(ufl.inner(difference, difference), msh)
    assert np.sqrt(error / integral(1.0, msh)) < rtol * np.abs(exact).max()


def stretched(msh, slopes):
    """Make a field with the components slope · coordinate."""
    u = fem.Function(vector_space(msh))
    u.interpolate(lambda x: np.array(slopes)[:, None] * x[: len(slopes)])
    return u


def wavy(msh, amplitude):
    """Make a displacement without symmetries, zero on the axis x = 0."""
    u = fem.Function(vector_space(msh))
    u.interpolate(lambda x: amplitude * x[0] * [np.sin(x[1] + i) + x[2] for i in range(len(u))])
    return u


@pytest.mark.parametrize("kind", KINDS)
def test_elastic_uniaxial(kind):
    """Pulled in one direction, free in the others: E, or E / (1 − ν²) in plane strain."""
    msh, a, axisymmetric = body(kind), 1e-3, kind == "axisymmetric"
    if kind == "plane":
        slopes, exact = [-NU / (1 - NU) * a, a], np.diag([0, E / (1 - NU**2) * a])
    elif kind == "axisymmetric":
        slopes, exact = [-NU * a, a], np.diag([0, E * a, 0])
    else:
        slopes, exact = [-NU * a, -NU * a, a], np.diag([0, 0, E * a])
    u = stretched(msh, slopes)
    check_uniform(materials.linear_elastic(u, E, NU, axisymmetric), exact, msh)
    constants = [fem.Constant(msh, value) for value in (E, NU)]
    check_uniform(materials.linear_elastic(u, *constants, axisymmetric), exact, msh)


def test_hoop_strain():
    """A plug-like velocity v_r = r², v_z = 0 has the different strains 2r and r."""
    msh = body("axisymmetric")
    v = ufl.as_vector([ufl.SpatialCoordinate(msh)[0] ** 2, 0.0])
    rate, r = materials.strain(v, axisymmetric=True), ufl.SpatialCoordinate(msh)[0]
    assert integral((rate[0, 0] - 2 * r) ** 2 + (rate[2, 2] - r) ** 2, msh) < 1e-20
    assert np.isclose(integral(1.0, msh, axisymmetric=True), np.pi * 0.7**2 * 1.3)


@pytest.mark.parametrize("kind", KINDS)
def test_neo_hookean(kind):
    """P is the derivative of the energy, and Hooke's stress at small strains."""
    msh, axisymmetric = body(kind), kind == "axisymmetric"
    u, v = wavy(msh, 0.2), wavy(msh, 1.0)
    v.x.array[:] = np.cos(3 * v.x.array) * v.x.array

    def energy(s):
        W = materials.neo_hookean_energy(u + s * v, MU, LMBDA, axisymmetric)
        return integral(W, msh, axisymmetric)

    P = materials.neo_hookean(u, MU, LMBDA, axisymmetric)
    exact = integral(ufl.inner(P, materials.gradient(v, axisymmetric)), msh, axisymmetric)
    h = 1e-4
    quotient = (energy(h) - energy(-h)) / (2 * h)
    assert np.isclose(quotient, exact, rtol=1e-6), (quotient, exact)

    def distance(s):
        difference = materials.neo_hookean(s * u, MU, LMBDA, axisymmetric) / s
        difference -= materials.linear_elastic(u, E, NU, axisymmetric)
        return np.sqrt(integral(ufl.inner(difference, difference), msh))

    assert distance(1e-3) < 0.15 * distance(1e-2) < 0.1 * E * 0.2
    zero = materials.neo_hookean_energy(fem.Function(u.function_space), MU, LMBDA, axisymmetric)
    assert abs(integral(zero, msh)) < 1e-14


@pytest.mark.parametrize("kind", KINDS)
def test_norton_hoff_uniform(kind):
    """Closed form of the regularised law; without the regularisation the error vanishes as ε̇₀²."""
    msh, axisymmetric = body(kind), kind == "axisymmetric"
    a, K, m = 0.3, fem.Constant(msh, 5.0), fem.Constant(msh, 0.2)
    floor = fem.Constant(msh, 0.1)
    slopes = {"plane": [a, -a], "axisymmetric": [a / 2, -a], "3D": [a / 2, a / 2, -a]}[kind]
    rates = np.array([a / 2, -a, a / 2] if axisymmetric else slopes)
    v = stretched(msh, slopes)
    s = materials.norton_hoff(v, K, m, floor, axisymmetric)
    equivalent = np.sqrt(2 / 3 * rates @ rates)
    rate = materials.equivalent_strain_rate(v, axisymmetric)
    assert np.isclose(integral(rate, msh), equivalent * integral(1.0, msh), rtol=1e-12)

    factor = (np.sqrt(3) * np.hypot(equivalent, 0.1)) ** (0.2 - 1)
    check_uniform(s, 10 * factor * np.diag(rates), msh)
    unregularised = 10 * (np.sqrt(3) * equivalent) ** (0.2 - 1) * np.diag(rates)
    errors = []
    for floor.value in (1e-2, 1e-3):
        difference = s - ufl.as_tensor(unregularised.tolist())
        errors.append(np.sqrt(integral(ufl.inner(difference, difference), msh)))
    assert 95 < errors[0] / errors[1] < 105, errors
    floor.value = 1e-3 * equivalent
    check_uniform(s, unregularised, msh, rtol=1e-6)
    m.value = 1.0
    check_uniform(s, 10 * np.diag(rates), msh)
    check_uniform(materials.newtonian(v, K, axisymmetric), 10 * np.diag(rates), msh)


def test_material_fields():
    """K and m may be functions, or UFL expressions."""
    msh = body("plane")
    v, D = stretched(msh, [0.3, -0.3]), fem.functionspace(msh, ("DG", 0))
    K, m = fem.Function(D), fem.Function(D)
    K.x.array[:], m.x.array[:] = 5.0, 0.2
    exact = materials.norton_hoff(v, 10.0, 0.2, 1e-3)
    difference = materials.norton_hoff(v, 2 * K, m, 1e-3) - exact
    assert integral(ufl.inner(difference, difference), msh) < 1e-24 * integral(
        ufl.inner(exact, exact), msh
    )


def test_tangent_at_rest():
    """The tangent is finite, symmetric, and that of the largest viscosity, K (√3 ε̇₀)^{m−1}."""
    msh = body("plane")
    w = fem.Function(materials.mini_space(msh))

    def tangent(stress):
        F = materials.incompressible(w, stress)
        A = fem_petsc.assemble_matrix(fem.form(ufl.derivative(F, w)))
        A.assemble()
        return A

    v = ufl.split(w)[0]
    A = tangent(materials.norton_hoff(v, 2.0, 0.05, 1e-3))
    B = tangent(materials.newtonian(v, 2.0 * (np.sqrt(3) * 1e-3) ** (0.05 - 1)))
    norm = B.norm()
    assert np.isfinite(A.norm()) and norm > 100
    B.axpy(-1.0, A)
    assert B.norm() < 1e-10 * norm
    rng = np.random.default_rng(WORLD.rank)
    w.x.array[:] = rng.normal(size=w.x.array.size)
    w.x.scatter_forward()
    A = tangent(materials.norton_hoff(v, 2.0, 0.15, 1e-3))
    assert A.isSymmetric(1e-10 * A.norm())


def manufactured(n, cell):
    """Return the L2 error of the velocity in a unit square or cube with a traction on x = 1."""
    gdim = 2 if cell == "triangle" else 3
    msh = box(WORLD, (n,) * gdim, cell, [0.0] * gdim, [1.0] * gdim)

    def swirl(x, module):
        flow = [module.sin(3 * x[0]) * module.cos(3 * x[1])]
        flow += [-module.cos(3 * x[0]) * module.sin(3 * x[1])]
        if gdim == 3:
            flow[1] = flow[1] + module.sin(3 * x[1]) * module.cos(3 * x[2])
            flow += [-module.cos(3 * x[1]) * module.sin(3 * x[2])]
        return flow

    W = materials.mini_space(msh)
    w, K, x = fem.Function(W), 2.0, ufl.SpatialCoordinate(msh)
    exact, pressure = ufl.as_vector(swirl(x, ufl)), ufl.cos(3 * x[0]) * x[1]
    sigma = materials.newtonian(exact, K) - pressure * ufl.Identity(gdim)
    test = ufl.TestFunctions(W)[0]
    F = materials.incompressible(w, materials.newtonian(ufl.split(w)[0], K))
    F += ufl.inner(ufl.div(sigma), test) * ufl.dx
    tags = mesh.meshtags(msh, gdim - 1, *marked(plane(msh, 0, 1.0)))
    ds = ufl.Measure("ds", domain=msh, subdomain_data=tags)
    F -= ufl.inner(sigma * ufl.FacetNormal(msh), test) * ds(1)

    V = W.sub(0).collapse()[0]
    boundary = fem.Function(V)
    boundary.interpolate(lambda x: np.array(swirl(x, np)))
    held = [plane(msh, axis, at) for axis in range(gdim) for at in (0.0, 1.0)]
    facets = np.unique(np.concatenate([held[0], *held[2:]]))
    dofs = fem.locate_dofs_topological((W.sub(0), V), gdim - 1, facets)
    bcs = [fem.dirichletbc(boundary, dofs, W.sub(0))]
    problem = qs.ContactProblem([F], [w], [], [bcs])
    problem.solve()
    assert problem.num_iterations == 1  # detected as linear
    error = integral((ufl.split(w)[0] - exact) ** 2, msh)
    assert abs(integral(ufl.div(ufl.split(w)[0]), msh)) < 1e-11  # 1 is a test function of p
    problem.destroy()
    return np.sqrt(error)


def marked(facets):
    facets = np.sort(facets)
    return facets, np.ones_like(facets)


@pytest.mark.parametrize(("cell", "n"), (("triangle", 12), ("tetrahedron", 4)))
def test_mini_convergence(cell, n):
    """The velocity converges with order 2 in L2."""
    coarse, fine = manufactured(n, cell), manufactured(2 * n, cell)
    assert 1.8 < np.log2(coarse / fine) < 2.6, (coarse, fine)


def test_cylinder_force():
    """A cylinder pulled between frictionless plates: the force of the ring is E π R² a."""
    msh, a = body("axisymmetric"), 1e-6
    for law in ("Hooke", "neo-Hooke"):
        u = fem.Function(vector_space(msh))
        v = ufl.TestFunction(u.function_space)
        P = (
            materials.linear_elastic(u, E, NU, True)
            if law == "Hooke"
            else materials.neo_hookean(u, MU, LMBDA, True)
        )
        work = ufl.inner(P, materials.gradient(v, True))
        F = materials.axisymmetric_weight(msh) * work * ufl.dx
        V, top = u.function_space, plane(msh, 1, 1.3)
        bcs = [slide(V, 0, plane(msh, 0, 0.0)), slide(V, 1, plane(msh, 1, 0.0))]
        problem = qs.ContactProblem([F], [u], [], [[*bcs, slide(V, 1, top, 1.3 * a)]])
        problem.solve()
        reaction = fem.assemble_vector(fem.form(F))
        reaction.scatter_reverse(la.InsertMode.add)
        dofs = fem.locate_dofs_topological(V.sub(1), 1, top)
        force = reaction.array[dofs[dofs < problem.bodies[0].num_owned]].sum()
        assert np.isclose(WORLD.allreduce(force), E * np.pi * 0.7**2 * a, rtol=1e-5)
        problem.destroy()
