"""The derivative of R(z) where contact follows the bodies, against differences."""

import numpy as np
import pytest
from following import Body, problem_of
from friction.test_friction import quadratic_space
from scenes import WORLD, Pair, box, plane, vector_space
from system.test_equations import away, equations_of, errors

import qsdolfinx as qs
from qsdolfinx.system.equations import Equations

#: Cells, spaces, and the largest error.
KINDS = {
    "triangle": (vector_space, 1e-7),
    "quadrilateral": (vector_space, 1e-7),
    "tetrahedron": (vector_space, 1e-7),
    "hexahedron": (vector_space, 2e-3),  # rules are not exact on warped facets
    "quadrilateral, P2": (quadratic_space, 1e-2),  # facets are cut as their vertices have it
}


def closed(equations):
    """Unknowns where all points are in contact: none is where a pressure has a kink."""
    z, scale = away(equations, size=0.01)
    for i, body in enumerate(equations.system.bodies):
        equations.part(z, i)[:] = body.with_conditions(equations.part(z, i))
    for values in equations.multipliers(z):
        values.normal[:] += 5.0
    return z, scale


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("kind", KINDS)
def test_derivative(kind, formulation):
    """By all unknowns, areas held: at open ends, and where functions of nodes move."""
    (cell, _, _), (space, tolerance) = kind.partition(","), KINDS[kind]
    options = {"sliding": "finite"}
    pair = Pair(cell, formulation=formulation, space=space, contact_options=options, wave=0.02)
    _, equations = equations_of(pair)
    z, scale = closed(equations)
    assert all(np.all(e.active) for e in equations.evaluate(z).passes)
    assert errors(equations, z, scale) < tolerance


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron"))
def test_friction(cell, formulation):
    """Of forces by all unknowns, but for how tractions of nodes turn with the facets."""
    options = {"sliding": "finite", "friction": qs.Coulomb(0.3)}
    pair = Pair(cell, formulation=formulation, contact_options=options, wave=0.02)
    _, equations = equations_of(pair)
    assert errors(equations, *closed(equations), of=equations.bodies_of) < 3e-3


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_round_tool(cell):
    """Gaps to a tool of known shape have its curvature."""
    gdim = 2 if cell == "triangle" else 3
    body = Body(box(WORLD, [3] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered"))
    body.clamp(plane(body.mesh, gdim - 1, 0.0))
    tool = qs.RigidSurface.sphere(WORLD, [0.4] * (gdim - 1) + [1.9], 1.0)
    contact = qs.Contact(body.side(gdim - 1, 1.0), tool, sliding="finite")
    problem = problem_of([body], [contact], solver="direct")
    problem.set_up()
    equations = Equations(problem.system)
    z, scale = closed(equations)
    assert WORLD.allreduce(int(np.count_nonzero(equations.evaluate(z).passes[0].active))) > 3
    assert errors(equations, z, scale) < 1e-7
