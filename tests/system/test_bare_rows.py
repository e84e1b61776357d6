"""Forms over a part of a mesh: unknowns outside of it must be held, and then have no effect."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, plane, raises_everywhere

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

MODULUS = 100.0


def problem(material, part="half", held=False, solver="direct"):
    """Press the lower half of a block on a floor; the upper half has no stiffness or no form."""
    height = 0.5 if part == "alone" else 1.0
    count = 3 if part == "alone" else 6
    msh = box(WORLD, (6, count), "quadrilateral", [0.0, 0.0], [1.0, height])
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    strain = ufl.grad(ufl.TestFunction(V))
    if material == "linear":
        stress = qs.materials.linear_elastic(u, MODULUS, 0.3)
    else:
        stress = qs.materials.neo_hookean(u, MODULUS, MODULUS)
    low = mesh.locate_entities(msh, 2, lambda x: x[1] < 0.5 + 1e-9)
    tags = mesh.meshtags(msh, 2, np.sort(low), np.ones(len(low), dtype=np.int32))
    dx = ufl.Measure("dx", domain=msh, subdomain_data=tags)
    F = ufl.inner(stress, strain) * (dx(1) if part == "half" else dx)
    if part == "zero":
        D = fem.functionspace(msh, ("DG", 0))
        factor = fem.Function(D)
        factor.x.array[low] = 1.0
        F = factor * ufl.inner(stress, strain) * dx
    msh.topology.create_connectivity(1, 2)
    msh.topology.create_connectivity(0, 2)
    middle = mesh.locate_entities(msh, 1, lambda x: np.isclose(x[1], 0.5))
    bcs = [clamp(V, middle, [0.0, -0.02])]
    if held:
        rest = mesh.locate_entities(msh, 0, lambda x: x[1] > 0.5 + 1e-9)
        bcs.append(fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 0, rest), V))
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), floor, penalty=1e4)
    return qs.ContactProblem([F], [u], [contact], [bcs], linear_solver=solver)


@pytest.mark.parametrize(
    "material, part", [("linear", "half"), ("neo", "half"), ("linear", "zero")]
)
def test_free_unknowns_without_equations(material, part):
    """The error names number, place and remedy; u does not change, and the error is repeated."""
    case = problem(material, part)
    for _ in range(2):
        raises_everywhere(
            WORLD, ValueError, "entry 0 gives no equation for 42 of the 84", case.solve
        )
    assert not case.u[0].x.array.any()


@pytest.mark.parametrize("material", ("linear", "neo"))
@pytest.mark.parametrize("solver", ("direct", "amg", "fieldsplit"))
def test_held_ones_do_not_matter(material, solver):
    """Held unknowns have no effect: the force is that of the lower half alone."""
    case, alone = problem(material, held=True, solver=solver), problem(material, "alone")
    for each in (case, alone):
        each.solve()
    forces = [each.contacts[0].force("slave")[1] for each in (case, alone)]
    assert forces[1] > 0.5 and np.isclose(*forces, rtol=1e-6)
