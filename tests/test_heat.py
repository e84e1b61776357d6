"""Test heat and thermal strain: closed forms, balances, convergence orders, and errors."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import WORLD, box, plane, slide, vector_space

import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

import qsdolfinx as qs
from qsdolfinx import materials

E, NU, ALPHA = 210.0, 0.3, 1e-3


def block(dim, n=4, size=(1.0, 2.0)):
    """Mesh of simplices, in 2D starting at the axis."""
    cell = {2: "triangle", 3: "tetrahedron"}[dim]
    corner = [size[0]] * (dim - 1) + [size[1]]
    return box(WORLD, (n,) * dim, cell, [0.0] * dim, corner)


def total(form):
    return WORLD.allreduce(fem.assemble_scalar(fem.form(form)))


def solve(F, T, bcs=()):
    """Solve a form that is linear in T."""
    a, b = fem.form(ufl.derivative(F, T)), fem.form(F)
    A = fem_petsc.assemble_matrix(a, bcs=list(bcs))
    A.assemble()
    r = fem_petsc.assemble_vector(b)
    fem_petsc.apply_lifting(r, [a], [list(bcs)], x0=[T.x.petsc_vec], alpha=-1.0)
    r.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    fem_petsc.set_bc(r, list(bcs), x0=T.x.petsc_vec, alpha=-1.0)
    solver = PETSc.KSP().create(A.comm)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    step = r.duplicate()
    solver.solve(r, step)
    T.x.petsc_vec.axpy(-1.0, step)
    T.x.scatter_forward()


@pytest.mark.parametrize("kind, expansion", [("3D", 1.0), ("axisymmetric", 1.0), ("2D", 1 + NU)])
def test_free_expansion_has_no_stress(kind, expansion):
    """Displacements of α ΔT in all directions, in plane strain (1 + ν) α ΔT, cause no stress."""
    msh = block(3 if kind == "3D" else 2)
    u = fem.Function(vector_space(msh))
    gdim = msh.geometry.dim
    u.interpolate(lambda x: expansion * ALPHA * 5.0 * x[:gdim])
    stress = materials.linear_elastic(
        u, E, NU, axisymmetric=kind == "axisymmetric", thermal_strain=ALPHA * 5.0
    )
    assert total(ufl.inner(stress, stress) * ufl.dx(msh)) < (1e-12 * E * ALPHA) ** 2


@pytest.mark.parametrize("rise", [1.0, 3.0])
def test_rod_that_expands_between_walls(rise):
    """p = E (α ΔT − g/L) if α ΔT L is more than the gap g, otherwise 0; the sides are free."""
    msh, gap = block(3), 2.0 * 2 * ALPHA
    V = vector_space(msh)
    u, v = fem.Function(V), ufl.TestFunction(V)
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    T.x.array[:] = 20.0 + rise
    stress = materials.linear_elastic(u, E, NU, thermal_strain=ALPHA * (T - 20.0))
    F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
    bcs = [slide(V, axis, plane(msh, axis, 0.0)) for axis in range(3)]
    wall = qs.RigidSurface.plane(WORLD, [0.0, 0.0, 2.0 + gap], [0.0, 0.0, -1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 2, 2.0)), wall)
    qs.ContactProblem([F], [u], [contact], [bcs]).solve()
    force = max(E * (ALPHA * rise - gap / 2), 0.0)
    assert contact.force("master")[2] == pytest.approx(force, rel=1e-6, abs=1e-12)


def test_steady_conduction():
    """Between 100 and 20 degrees, with k = 3: a linear profile, and a flux of k ΔT / L."""
    msh = block(2)
    V = fem.functionspace(msh, ("Lagrange", 1))
    T, k = fem.Function(V), 3.0
    ends = [(0.0, 100.0), (2.0, 20.0)]
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, plane(msh, 1, y)), V)
        for y, value in ends
    ]
    solve(materials.heat(T, k), T, bcs)
    exact = 100.0 - 40.0 * ufl.SpatialCoordinate(msh)[1]
    assert total((T - exact) ** 2 * ufl.dx) < 1e-18
    assert total(k * ufl.grad(T)[1] * ufl.dx) == pytest.approx(-k * 40.0 * 2.0)


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_heat_balance(axisymmetric):
    """A body stores exactly the heat of its source, for any time step, to rounding."""
    msh = block(2)
    V = fem.functionspace(msh, ("Lagrange", 1))
    T, before = fem.Function(V), fem.Function(V)
    before.interpolate(lambda x: 20.0 + 5.0 * np.sin(x[0] + 2 * x[1]))
    x = ufl.SpatialCoordinate(msh)
    source, c, dt = 7.0 * x[1] ** 2 + x[0], 2.5, fem.Constant(msh, 0.3)
    dx = ufl.dx(msh, metadata={"quadrature_degree": 4})
    F = materials.heat(T, 1.5, c, before, dt, source, axisymmetric, dx)
    solve(F, T)
    weight = materials.axisymmetric_weight(msh) if axisymmetric else 1.0
    taken = total(weight * c * (T - before) * dx)
    assert taken == pytest.approx(0.3 * total(weight * source * dx), rel=1e-11)


def test_order_in_time():
    """A mode of a rod decays as exp(−k π² t / (c L²)); errors are halved with the step."""
    msh = box(WORLD, (1, 200), "triangle", [0.0, 0.0], [0.01, 1.0])
    V = fem.functionspace(msh, ("Lagrange", 1))
    k, c, end, errors = 2.0, 4.0, 0.1, []
    for steps in (8, 16, 32):
        T, before = fem.Function(V), fem.Function(V)
        T.interpolate(lambda x: np.cos(np.pi * x[1]))
        F = materials.heat(T, k, c, before, end / steps)
        for _ in range(steps):
            before.x.array[:] = T.x.array
            solve(F, T)
        exact = np.exp(-k * np.pi**2 * end / c) * ufl.cos(np.pi * ufl.SpatialCoordinate(msh)[1])
        errors.append(np.sqrt(total((T - exact) ** 2 * ufl.dx)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 1.0, atol=0.1)


def test_hot_billet():
    """A Norton-Hoff body whose K and m depend on T: stress at each point, and its heat."""
    msh = block(3)
    v = fem.Function(vector_space(msh))
    v.interpolate(lambda x: np.array([0.5 * x[0], 0.5 * x[1], -x[2]]))
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    T.interpolate(lambda x: 1000.0 + 100.0 * x[2])
    K, m = 50.0 * ufl.exp(-(T - 1000.0) / 300.0), 0.1 + 1e-4 * (T - 1000.0)
    stress = materials.norton_hoff(v, K, m, 1e-9)
    tension = K * np.sqrt(3.0) ** (m + 1)  # at a strain rate of 1
    assert total((stress[2, 2] + 2 / 3 * tension) ** 2 * ufl.dx) < 1e-12
    heat = materials.plastic_heat(stress, v, share=0.9)
    assert total(heat * ufl.dx) == pytest.approx(total(0.9 * tension * ufl.dx), rel=1e-10)


def test_refused():
    msh = block(2)
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    u = fem.Function(vector_space(msh))
    with pytest.raises(ValueError, match="before, dt: must be given with a capacity"):
        materials.heat(T, 1.0, 2.0)
    with pytest.raises(ValueError, match="conductivity: must be a positive"):
        materials.heat(T, -1.0)
    with pytest.raises(ValueError, match="T: must be a scalar field"):
        materials.heat(u, 1.0)
    with pytest.raises(ValueError, match="share: must be a number from 0 to 1"):
        materials.plastic_heat(materials.newtonian(u, 1.0), u, share=1.5)
    with pytest.raises(ValueError, match="thermal_strain: must be a finite number"):
        materials.linear_elastic(u, E, NU, thermal_strain=np.nan)
