"""Forms with several quadrature rules: accepted forms have the sum of the parts' residuals."""

import numpy as np
import pytest
from scenes import WORLD

import ufl
from dolfinx import fem, mesh

from qsdolfinx.system.one_point import mixes_one_point

CELLS = {"triangle": mesh.CellType.triangle, "quadrilateral": mesh.CellType.quadrilateral}


def parts(cell, degree):
    """Make two integrands of nearly incompressible rubber at a state, and the unknown."""
    msh = mesh.create_unit_square(WORLD, 3, 3, CELLS[cell])
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    u.interpolate(lambda x: 0.05 * np.array([np.sin(3 * x[0] * x[1]), np.cos(2 * x[0] + x[1])]))
    F = ufl.Identity(2) + ufl.grad(u)
    inverse = ufl.inv(F).T
    shear, pressure = F - inverse, 50 * ufl.ln(ufl.det(F)) * inverse
    return [ufl.inner(stress, ufl.grad(v)) for stress in (shear, pressure)], u


def apart(msh):
    """Make two measures that both cover all cells."""
    cells = np.arange(msh.topology.index_map(2).size_local, dtype=np.int32)
    dx = ufl.Measure("dx", msh, subdomain_data=[(1, cells), (2, cells)])
    return dx(1), dx(2)


def differences(forms, u):
    """Return differences of residual and tangent between the sum and the separate parts."""
    out = []
    for turn in (lambda form: form, lambda form: ufl.derivative(form, u)):
        rank = len(turn(forms[0]).arguments())
        assemble = fem.assemble_vector if rank == 1 else fem.assemble_matrix
        array = (lambda made: made.array) if rank == 1 else (lambda made: made.data)
        whole, *single = (
            array(assemble(fem.form(turn(form)))).copy() for form in (sum(forms), *forms)
        )
        out.append(np.abs(whole - sum(single)).max() / np.abs(whole).max())
    return out


@pytest.mark.parametrize("cell, degree, rules, wrong", [
    ("quadrilateral", 1, (3, 1), True),
    ("quadrilateral", 1, (3, 0), True),
    ("quadrilateral", 1, (3, 2), False),
    ("triangle", 2, (4, 1), True),
    ("triangle", 2, (4, 2), False),
    ("triangle", 1, (2, 1), True),
    ("triangle", 1, (3, 2), False),
])  # fmt: skip
def test_accepted_forms_are_the_sum_of_their_parts(cell, degree, rules, wrong):
    integrands, u = parts(cell, degree)
    forms = [f * ufl.dx(degree=rule) for f, rule in zip(integrands, rules, strict=True)]
    assert mixes_one_point(sum(forms)) == wrong
    assert mixes_one_point(ufl.derivative(sum(forms), u)) == wrong
    if wrong:
        measures = apart(u.function_space.mesh)
        parted = zip(integrands, measures, rules, strict=True)
        forms = [f * dx(degree=rule) for f, dx, rule in parted]
        assert not mixes_one_point(sum(forms))
    assert max(differences(forms, u)) < 1e-13


def test_rules_elsewhere_do_not_matter():
    """Rules on separate cells, on facets, or one rule everywhere, are accepted."""
    (f, g), u = parts("quadrilateral", 1)
    dx, _ = apart(u.function_space.mesh)
    pressed = ufl.inner(u, ufl.TestFunction(u.function_space))
    assert not mixes_one_point(f * ufl.dx(degree=1))
    assert not mixes_one_point(f * dx(degree=1) + g * ufl.dx(7, degree=3))
    assert not mixes_one_point(f * ufl.dx(degree=3) + pressed * ufl.ds(degree=1))
    assert not mixes_one_point(f * ufl.dx + g * ufl.dx)
    assert mixes_one_point(f * ufl.dx(degree=1) + g * ufl.dx)


def facet_forms(msh):
    """Make a pressure and a spring with different rules."""
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    u.interpolate(lambda x: 0.05 * np.array([np.sin(3 * x[0] * x[1]), np.cos(2 * x[0] + x[1])]))
    factor = ufl.exp(ufl.SpatialCoordinate(msh)[0])
    return factor * ufl.dot(ufl.FacetNormal(msh), v), factor * ufl.inner(u, v), u


@pytest.mark.parametrize("rules, wrong", [((1, 4), True), ((2, 4), False), ((4, 4), False)])
def test_facets(rules, wrong):
    pressure, spring, _ = facet_forms(mesh.create_unit_square(WORLD, 3, 3))
    forms = [pressure * ufl.ds(degree=rules[0]), spring * ufl.ds(degree=rules[1])]
    assert mixes_one_point(sum(forms)) == wrong
    if not wrong:
        whole, *single = (fem.assemble_vector(fem.form(f)).array for f in (sum(forms), *forms))
        assert np.abs(whole - sum(single)).max() < 1e-13 * np.abs(whole).max()


def test_two_rules_of_one_degree():
    """Points at the vertices also have degree 1."""
    _, spring, _ = facet_forms(mesh.create_unit_square(WORLD, 3, 3))
    vertices = ufl.dx(metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
    assert mixes_one_point(spring * vertices + 2 * spring * ufl.dx(degree=1))
    assert mixes_one_point(spring * vertices + 2 * spring * ufl.dx(degree=3))
    assert not mixes_one_point(spring * vertices)
