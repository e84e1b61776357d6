"""Inexact intermediate solves leave no errors, compared with exact solves by a direct solver.

Linear solves are only as accurate as a Newton iteration needs. Bodies are pressed and dragged back
and forth, or released and pressed again.
"""

import numpy as np
import pytest
from scenes import Pair, clamp, elastic, largest, plane, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs

SIZE = 0.04  # the largest prescribed displacement
#: Shift and press of the top, in units of SIZE.
DRAGGED = [(0.0, 0.5), (0.0, 1.0), (0.3, 1.0), (0.6, 1.0), (0.9, 1.0), (0.5, 1.0), (0.1, 1.0)]
PRESSED = [(0.0, 0.1), (0.0, 1.0), (0.0, 0.4), (0.0, 1.0), (0.0, -0.5), (0.0, 0.01)]
LAWS = {"Coulomb": qs.Coulomb(0.3), "hardly": qs.Coulomb(1e-6), "Tresca": qs.Tresca(0.005)}
MODULI = 1.0, 20.0


def quadratic_space(msh):
    return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))


def neo_hookean(u, E):
    """Return the virtual work, ν = 0.3."""
    F = ufl.Identity(len(u)) + ufl.grad(u)
    J, mu, lame = ufl.det(F), E / 2.6, E * 0.3 / 0.52
    energy = mu / 2 * (ufl.inner(F, F) - len(u) - 2 * ufl.ln(J)) + lame / 2 * ufl.ln(J) ** 2
    return ufl.derivative(energy * ufl.dx(degree=4), u)


def history(cell, path, solver, degree=1, body=elastic, **contact_options):
    """Return forces and displacements along a path; the solver "exact" is a direct one."""
    exact = solver == "exact"
    contact_options["gap_tolerance"] = 1e-12 if exact else 1e-8
    space = vector_space if degree == 1 else quadratic_space
    options = {"wave": 0.01, "penalty": "auto", "contact_options": contact_options}
    pair = Pair(cell, n=(5, 4), space=space, **options)
    gdim, V = pair.gdim, pair.V[1]
    pair.F = [body(u, E) for u, E in zip(pair.u, MODULI, strict=True)]
    top = fem.Constant(V.mesh, np.zeros(gdim))
    held = clamp(V, plane(V.mesh, gdim - 1, 1.0)).dof_indices()[0][::gdim] // gdim
    pair.bcs[1] = [fem.dirichletbc(top, held, V)]
    options = {"petsc_options": {"snes_rtol": 1e-12}} if exact else {}
    problem, found = pair.problem(solver="direct" if exact else solver, **options), []
    for shift, press in path:
        top.value[0], top.value[-1] = SIZE * shift, -SIZE * press
        problem.solve()
        found.append([pair.contact.force("slave"), *(u.x.array.copy() for u in pair.u)])
    problem.destroy()
    return found


def check(found, wanted):
    """Assert equal forces and displacements, relative to the largest force and the given motion."""
    force = max(np.abs(step[0]).max() for step in wanted)
    for (f, *u), (g, *v) in zip(found, wanted, strict=True):
        assert np.abs(f - g).max() < 1e-6 * force
        assert all(largest(a - b) < 1e-5 * SIZE for a, b in zip(u, v, strict=True))


@pytest.mark.parametrize("body", (elastic, neo_hookean))
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "cell, degree",
    (
        ("triangle", 2),
        pytest.param("hexahedron", 1, marks=pytest.mark.long),
        pytest.param("tetrahedron", 1, marks=pytest.mark.long),
    ),
)
def test_friction(cell, degree, law, body):
    friction = {"friction": LAWS[law], "degree": degree, "body": body}
    wanted = history(cell, DRAGGED, "exact", **friction)
    for solver in ("direct", "amg"):
        check(history(cell, DRAGGED, solver, **friction), wanted)


@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("enforcement", ("augmented-lagrangian", "penalty"))
@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
def test_active_sets_that_change(cell, enforcement, constraints):
    options = {"enforcement": enforcement, "constraints": constraints}
    wanted = history(cell, PRESSED, "exact", **options)
    check(history(cell, PRESSED, "amg", **options), wanted)
    assert np.all(wanted[4][0] == 0) and np.any(wanted[5][0] != 0)
