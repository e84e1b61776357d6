"""Motions without resistance: iterative solvers leave bodies in place, like a direct solver."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.linear.soft_motions import SoftMotions

SPEEDS = 1.0, 0.3, 2.0, 0.1
LOADS = 1.0, 0.3, 2.0


def uneven(msh, half):
    """Move nodes sideways within the mesh; otherwise all forces cancel by symmetry."""
    x = msh.geometry.x
    inside = np.prod(np.cos(0.5 * np.pi * x[:, :2] / half), axis=1)
    waves = np.sin(37 * x[:, 0] + 17 * x[:, 1] + 11 * x[:, 2])
    x[:, :2] += (0.04 * np.sqrt(np.clip(inside, 0.0, None)) * waves)[:, None]


def pressed(solver):
    """Press an elastic block on another, without friction, under a changing dead load."""
    lower = box(WORLD, (8, 8, 5), "hexahedron", [-0.8, -0.8, -1.0], [0.8, 0.8, 0.0])
    upper = box(WORLD, (6, 6, 5), "tetrahedron", [-0.5, -0.5, 0.0], [0.5, 0.5, 1.0])
    uneven(lower, 0.8)
    uneven(upper, 0.5)
    V, W = vector_space(lower), vector_space(upper)
    u, v = fem.Function(V), fem.Function(W)
    top = plane(upper, 2, 1.0)
    tags = mesh.meshtags(upper, 2, np.sort(top), np.ones(len(top), np.int32))
    load = fem.Constant(upper, np.zeros(3))
    F = elastic(v) - ufl.inner(load, ufl.TestFunction(W)) * ufl.ds(upper, subdomain_data=tags)(1)
    surfaces = (
        qs.Surface(W, facets=plane(upper, 2, 0.0)),
        qs.Surface(V, facets=plane(lower, 2, 0.0)),
    )
    contact = qs.Contact(*surfaces)
    bcs = [[], [clamp(V, plane(lower, 2, -1.0))]]
    problem = qs.ContactProblem([F, elastic(u)], [v, u], [contact], bcs, linear_solver=solver)
    forces, places = [], []
    for factor in LOADS:
        load.value[2] = -0.01 * factor
        problem.solve()
        forces.append(contact.force("slave"))
        places.append(
            [WORLD.allreduce(fem.assemble_scalar(fem.form(v[i] * ufl.dx))) for i in (0, 1)]
        )
    problem.destroy()
    return np.array(forces), np.array(places)


@pytest.mark.parametrize("solver", ["amg", "fieldsplit"])
def test_blocks(solver):
    """Blocks stay in place; formerly they moved away by many times their size."""
    (direct, there), (forces, here) = pressed("direct"), pressed(solver)
    assert largest(forces - direct) < 1e-7 * largest(direct)
    assert largest(there) < 1e-3 and largest(here) < 1e-3


def squeezed(solver):
    """Return velocities and pressures of a viscous block between planes at changing speeds."""
    msh = box(WORLD, (6, 9), "triangle", [0.0, 0.0], [1.0, 1.5])
    W = qs.materials.mini_space(msh)
    w = fem.Function(W)
    stress = qs.materials.norton_hoff(ufl.split(w)[0], 50.0, 0.3, 1e-3)
    F = qs.materials.incompressible(w, stress)
    planes = [qs.RigidSurface.plane(WORLD, [0.0, z], [0.0, s]) for z, s in ((0.0, 1), (1.5, -1))]
    surfaces = [qs.Surface(W.sub(0), facets=plane(msh, 1, z)) for z in (0.0, 1.5)]
    options = {"unknown": "velocity", "dt": 0.05, "enforcement": "augmented-lagrangian"}
    contacts = [qs.Contact(*pair, **options) for pair in zip(surfaces, planes, strict=True)]
    problem = qs.ContactProblem([F], [w], contacts, [[]], linear_solver=solver)
    found = []
    for speed in SPEEDS:
        planes[1].displacement = [0.0, -0.05 * speed]
        problem.solve()
        found.append(w.x.array.copy())
    problem.destroy()
    return found


def test_flow():
    """Velocities along the planes are the same, although nothing determines their mean."""
    for here, there in zip(squeezed("schur"), squeezed("direct"), strict=True):
        assert largest(here - there) < 1e-5 * largest(there)


@pytest.mark.parametrize("held", [True, False])
def test_only_where_they_are_free(monkeypatch, held):
    """Additional products with the tangent occur only where such a motion exists."""
    made, multiply = [], SoftMotions.product
    monkeypatch.setattr(
        SoftMotions, "product", lambda self, values: made.append(1) or multiply(self, values)
    )
    msh = box(WORLD, (3, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    contacts = [
        qs.Contact(
            qs.Surface(V, facets=plane(msh, 1, z)),
            qs.RigidSurface.plane(WORLD, [0.0, z + 0.01 * s], [0.0, s]),
        )
        for z, s in ((0.0, 1.0), (1.0, -1.0))
    ]
    bcs = [slide(V, 0, plane(msh, 0, 0.0))] if held else []
    problem = qs.ContactProblem([elastic(u)], [u], contacts, [bcs], linear_solver="amg")
    problem.solve()
    assert bool(made) != held
    assert problem.newton.linear.soft.count == (0 if held else 1)
    problem.destroy()


def test_velocities_beside_displacements():
    """A motion that two tied bodies make together is found, whatever Δt of one of them is."""
    F, u, bcs, surfaces = [], [], [], []
    for low, far, push in ((0.0, 1.0, -0.1), (-1.0, -1.0, 0.0)):
        msh = box(WORLD, (3, 3), "triangle", [0.0, low], [1.0, low + 1.0])
        V = vector_space(msh)
        u.append(fem.Function(V))
        F.append(elastic(u[-1]))
        bcs.append([slide(V, 1, plane(msh, 1, far), push)])
        surfaces.append(qs.Surface(V, facets=plane(msh, 1, 0.0)))
    contact = qs.Contact(*surfaces, law=qs.Tied(), unknown=("velocity", "displacement"), dt=0.1)
    problem = qs.ContactProblem(F, u, [contact], bcs, linear_solver="amg")
    problem.solve()
    assert problem.newton.linear.soft.count == 1
    problem.destroy()
