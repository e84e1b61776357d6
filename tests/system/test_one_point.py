"""Forms with several quadrature rules: those accepted have the residuals of their parts."""

import numpy as np
import pytest
from scenes import WORLD

import ufl
from dolfinx import fem, mesh

from qsdolfinx.system.one_point import mixes_one_point

CELLS = {"triangle": mesh.CellType.triangle, "quadrilateral": mesh.CellType.quadrilateral}


def parts(cell, degree):
    """Two integrands of nearly incompressible rubber, in a state, and the unknown."""
    msh = mesh.create_unit_square(WORLD, 3, 3, CELLS[cell])
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    u.interpolate(lambda x: 0.05 * np.array([np.sin(3 * x[0] * x[1]), np.cos(2 * x[0] + x[1])]))
    F = ufl.Identity(2) + ufl.grad(u)
    inverse = ufl.inv(F).T
    shear, pressure = F - inverse, 50 * ufl.ln(ufl.det(F)) * inverse
    return [ufl.inner(stress, ufl.grad(v)) for stress in (shear, pressure)], u


def apart(msh):
    """Measures of all cells, twice."""
    cells = np.arange(msh.topology.index_map(2).size_local, dtype=np.int32)
    dx = ufl.Measure("dx", msh, subdomain_data=[(1, cells), (2, cells)])
    return dx(1), dx(2)


def differences(forms, u):
    """Residual and tangent of the sum against the sum of those of the parts."""
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
    ("triangle", 1, (2, 1), False),
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
    """Cells of their own, facets, and one rule that is everywhere."""
    (f, g), u = parts("quadrilateral", 1)
    dx, _ = apart(u.function_space.mesh)
    assert not mixes_one_point(f * ufl.dx(degree=1))
    assert not mixes_one_point(f * dx(degree=1) + g * ufl.dx(7, degree=3))
    assert not mixes_one_point(f * ufl.dx(degree=3) + ufl.inner(u, u) * ufl.ds(degree=1))
    assert mixes_one_point(f * dx(degree=1) + g * ufl.dx(degree=3))
    assert mixes_one_point(f * dx(degree=1) + g * ufl.dx((1, 4), degree=3))
    assert mixes_one_point(f * ufl.dx(degree=1) + g * ufl.dx)
