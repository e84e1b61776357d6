"""Bodies stretched by a dead pressure: uniform on any non-matching meshes."""

import numpy as np
import pytest
from following import Boxes
from scenes import WORLD, largest

import ufl
from dolfinx import fem

import qsdolfinx as qs

PRESSURE = 30.0
#: Stress and stretch in plane strain, from another program.
PLANE = -27.15648123, 1.10470866
#: Options of the contacts.
KINDS = {
    "quasi-symmetric": {},
    "master-slave": {"formulation": "master-slave"},
    "penalty": {"enforcement": "penalty", "penalty": 1e3},
    "soft": {"enforcement": "penalty", "penalty": 50.0},
    "double-pass": {"formulation": "double-pass", "penalty": 1e3},
}


def uniaxial(num_across):
    """Return true stress and transverse stretch of a neo-Hookean bar under a dead pressure.

    Args:
        num_across: Number of stress-free directions.
    """
    mu, lmbda = 100 / 2.6, 100 * 0.3 / 1.3 / 0.4

    def along(across):
        """Return the stretch along the bar without transverse stress."""
        J = np.exp(-mu * (across**2 - 1) / lmbda)
        return J / across**num_across

    def nominal(across):
        a = along(across)
        return mu * (a - 1 / a) + lmbda * np.log(a * across**num_across) / a

    low, high = 1.0, 1.5
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if nominal(middle) > -PRESSURE else (low, middle)
    return -PRESSURE / low**num_across, low


def stretched(cell, degree, axisymmetric, options):
    """Solve; return the largest errors of stress and of transverse stretch over all cells."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    n = ((3, 3), (4, 4)) if gdim == 2 else ((2, 2, 2), (3, 3, 3))
    ones = (1.0,) * gdim
    scene = Boxes(cell, n, (ones, ones), degree=degree, axisymmetric=axisymmetric, skew=1.0)
    for body in scene.bodies:
        for axis in range(gdim - 1):
            body.hold(axis, axis, 0.0)
    scene.lower.hold(gdim - 1, gdim - 1, -1.0)
    scene.upper.press(gdim - 1, 1.0, PRESSURE)
    contact = qs.Contact(scene.above, scene.below, sliding="finite", **options)
    tight = {"snes_rtol": 5e-13}
    scene.problem(contact, solver="direct", petsc_options=tight).solve()
    stress, stretch = uniaxial(2 if axisymmetric or gdim == 3 else 1)
    errors, spread = [], []
    for body in scene.bodies:
        grad = qs.materials.gradient(body.u, axisymmetric)
        F = ufl.Identity(grad.ufl_shape[0]) + grad
        sigma = body.P * F.T / ufl.det(F)
        for value, expected in ((sigma[gdim - 1, gdim - 1], stress), (F[0, 0], stretch)):
            found = at_points(body, value) / expected
            errors.append(found - 1)
            spread.append((found.min(initial=1e9), found.max(initial=-1e9)))
    ends = np.array(WORLD.allgather(spread))
    return largest(*errors), np.max(ends[..., 1].max(axis=0) - ends[..., 0].min(axis=0))


def at_points(body, value):
    """Return values at a point of each cell of this rank."""
    V = fem.functionspace(body.mesh, ("DG", 0))
    points = V.element.interpolation_points
    out = fem.Function(V)
    out.interpolate(fem.Expression(value, points() if callable(points) else points))
    return out.x.array[: V.dofmap.index_map.size_local]


def test_closed_form():
    stress, stretch = uniaxial(1)
    assert abs(stress / PLANE[0] - 1) < 1e-9
    assert abs(stretch / PLANE[1] - 1) < 1e-8


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_plane_strain(cell, degree, options):
    error, deviation = stretched(cell, degree, False, options)
    assert error < 3e-9
    assert deviation < 1e-10


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize(("cell", "degree"), [("triangle", 1), ("quadrilateral", 2)])
def test_axisymmetric(cell, degree, options):
    error, deviation = stretched(cell, degree, True, options)
    assert error < 3e-9
    assert deviation < 1e-10


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_three_dimensions(cell, options):
    error, deviation = stretched(cell, 1, False, options)
    assert error < 3e-9
    assert deviation < 1e-10


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
def test_second_degree_in_three_dimensions(cell):
    error, deviation = stretched(cell, 2, False, {})
    assert error < 3e-9
    assert deviation < 1e-10
