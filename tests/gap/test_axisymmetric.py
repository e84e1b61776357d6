"""Axisymmetric contact: facets represent rings."""

from functools import partial

import numpy as np
import pytest
from scenes import WORLD, box, largest, plane, raises_everywhere, slide, vector_space
from tangents import direction, tangent_errors

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points

E = (2.0, 3.0)
DEPTH, EPS = 0.02, 1e3


@pytest.mark.parametrize("slope", [0.0, 0.5])
@pytest.mark.parametrize("inner", [0.0, 0.4])
def test_areas(inner, slope):
    """The areas of a conical frustum are π (r₁ + r₂) times the slant height."""
    msh = box(WORLD, (5, 2), "triangle", [inner, 0.0], [1.5, 1.0])
    facets = plane(msh, 1, 1.0)
    msh.geometry.x[:, 1] += slope * msh.geometry.x[:, 0] * msh.geometry.x[:, 1]
    surface = qs.Surface(vector_space(msh), facets=facets, axisymmetric=True)
    expected = np.pi * (inner + 1.5) * (1.5 - inner) * np.hypot(1, slope)
    assert np.isclose(surface.area, expected, rtol=1e-13)


class Stack:
    """Two stacked rings or discs; the upper one is the slave, with ν = 0 or ring-free.

    Args:
        inner: Radius of the hole.
        tool: Makes a rigid tool that replaces the lower body.
    """

    def __init__(self, cell="triangle", inner=0.0, tool=None, law=None, **options):
        self.u, F, bcs, surfaces, self.meshes = [], [], [], [], []
        for n, low, e in zip((5, 3), (-1.0, 0.0), E, strict=True):
            if tool is not None and low < 0:
                surfaces.append(tool)
                continue
            msh = box(WORLD, (n, 2), cell, [inner, low], [1.2, low + 1.0])
            V = vector_space(msh)
            u = fem.Function(V)
            stress = qs.materials.linear_elastic(u, e, 0.0, axisymmetric=True)
            v = qs.materials.gradient(ufl.TestFunction(V), axisymmetric=True)
            F.append(qs.materials.axisymmetric_weight(msh) * ufl.inner(stress, v) * ufl.dx)
            far, value = (-1.0, 0.0) if low < 0 else (1.0, -DEPTH)
            conditions = [slide(V, 1, plane(msh, 1, far), value)]
            if inner == 0:
                conditions.append(slide(V, 0, plane(msh, 0, 0.0)))
            bcs.append(conditions)
            surfaces.append(qs.Surface(V, facets=plane(msh, 1, 0.0), axisymmetric=True))
            self.u.append(u)
            self.meshes.append(msh)
        options = {"enforcement": "penalty", "penalty": EPS, "law": law} | options
        self.contact = qs.Contact(surfaces[1], surfaces[0], **options)
        self.problem = qs.ContactProblem(F, self.u, [self.contact], bcs)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("inner", [0.0, 0.4])
@pytest.mark.parametrize("law", [qs.Tied, qs.Unilateral])
@pytest.mark.parametrize("formulation", ["master-slave", "quasi-symmetric"])
def test_patch(cell, inner, law, formulation):
    """Uniform σ_zz with 1/ε in series on non-matching meshes; nodal forces are σ_zz S_k."""
    case = Stack(cell, inner, law=law(), formulation=formulation)
    case.problem.solve()
    stress = -DEPTH / (1 / E[0] + 1 / E[1] + 1 / EPS)
    for u, msh, e in zip(case.u, case.meshes, E, strict=True):
        space = fem.functionspace(msh, ("DG", 0))
        found = fem.Function(space)
        sigma = qs.materials.linear_elastic(u, e, 0.0, axisymmetric=True)
        found.interpolate(fem.Expression(sigma[1, 1], interpolation_points(space)))
        assert largest(found.x.array - stress) < 1e-9 * abs(stress)
    total = np.pi * (1.2**2 - inner**2) * stress
    np.testing.assert_allclose(case.contact.force("slave"), [0, -total], atol=1e-9 * abs(total))
    np.testing.assert_allclose(case.contact.force("master"), [0, total], atol=1e-9 * abs(total))
    for side, sign in (("slave", -1), ("master", 1)):
        surface = getattr(case.contact, side)
        traction = case.contact.traction(side)
        expected = np.tile([0.0, sign * stress], (len(surface.node_area), 1))
        difference = traction.x.array - surface.function(expected).x.array
        assert largest(difference) < 1e-8 * abs(stress)


@pytest.mark.parametrize("quadrature", ["nodal", "overlay"])
def test_finite_differences(quadrature):
    problem = Stack(quadrature=quadrature).problem
    problem.solve()
    x, d = problem.system.x.copy(), direction(problem, np.random.default_rng(3))
    assert tangent_errors(problem, x, d, 1e-6).difference < 1e-6


def facets():
    x = np.column_stack([np.linspace(0.0, 2.0, 8), np.zeros(8)])
    i = np.arange(7)
    return qs.RigidSurface.triangulated(WORLD, x, np.stack([i + 1, i], axis=1))


@pytest.mark.parametrize("quadrature", ["nodal", "overlay"])
def test_rigid_planes(quadrature):
    """Analytic rigid planes and planes of facets give the same result."""
    stress = -DEPTH / (1 / E[1] + 1 / EPS)
    for tool in (qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0]), facets()):
        case = Stack(tool=tool, quadrature=quadrature, formulation="master-slave")
        case.problem.solve()
        force = -np.pi * 1.2**2 * stress
        np.testing.assert_allclose(case.contact.force("slave"), [0, force], atol=1e-9 * force)


def test_bad_input():
    """Rings in 3D, and rings on both sides of the axis, are refused."""
    for cell, low in (("tetrahedron", [0.0] * 3), ("triangle", [-0.5, 0.0])):
        msh = box(WORLD, [3] * len(low), cell, low, [1.0] * len(low))
        V, facets = vector_space(msh), plane(msh, len(low) - 1, 0.0)
        surface = partial(qs.Surface, V, facets=facets, axisymmetric=True)
        raises_everywhere(WORLD, ValueError, "axisymmetric", surface)
