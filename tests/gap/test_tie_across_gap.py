"""Ties across a gap: the vector across the gap rotates with the facets of the master."""

import numpy as np
import pytest
from friction.test_friction import quadratic_space
from scenes import CELLS, WORLD, Pair, clamp, elastic, gathered, largest, plane, slide, vector_space
from system.test_equations import HalfTied, Spring, away, equations_of, errors
from tangents import direction, full_steps, near_solution, tangent_errors

import qsdolfinx as qs

GAP = 0.3


def tied(cell, wave=0.0, law=None, space=vector_space, **options):
    options = {"search_radius": 1.0} | options
    law, formulation = law or qs.Tied(), options.pop("formulation", "quasi-symmetric")
    return Pair(cell, formulation, law, gap=GAP, wave=wave, space=space, contact_options=options)


def turned(angle):
    """Displacements of a rotation in the plane of the first and the last coordinate."""

    def displacement(x, axis):
        out, (c, s) = np.zeros((axis + 1, x.shape[1])), (np.cos(angle) - 1, np.sin(angle))
        out[0], out[axis] = c * x[0] - s * x[axis], s * x[0] + c * x[axis]
        return out

    return displacement


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize(
    "cell, wave", [*((cell, 0.0) for cell in CELLS), ("tetrahedron", 0.05), ("hexahedron", 0.05)]
)
def test_moment(cell, wave, quadrature):
    """The moments of both sides are opposite: couples balance the force across the gap.

    Between wavy surfaces gaps are not normal to the facets.
    """
    pair = tied(cell, wave, quadrature=quadrature)
    shift = np.zeros(pair.gdim)
    shift[0] = 0.05
    pair.bcs[1][:] = [clamp(pair.V[1], plane(pair.meshes[1], pair.gdim - 1, 1.0 + GAP), shift)]
    pair.problem(solver="direct").solve()
    moments = [pair.contact.moment(side, np.zeros(pair.gdim)) for side in ("slave", "master")]
    force = pair.contact.force("slave")
    assert abs(force[0]) * GAP > 1e-3
    np.testing.assert_allclose(moments[0], -moments[1], atol=1e-9)


@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_patch(cell, sliding):
    """Tied bars in series across a gap have uniform tractions."""
    pair = tied(cell, quadrature="overlay", enforcement="augmented-lagrangian", sliding=sliding)
    pair.F[:] = [elastic(u, E=1.0 + i, nu=0.0) for i, u in enumerate(pair.u)]
    pair.problem(solver="direct").solve()
    traction = gathered(WORLD, pair.slave.node_values(pair.contact.traction("slave")))
    expected = np.zeros(pair.gdim)
    expected[-1] = 0.1 / (1 + 1 / 2)
    np.testing.assert_allclose(traction, np.broadcast_to(expected, traction.shape), atol=1e-8)


@pytest.mark.parametrize("held", (False, True))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_tangent(cell, held):
    """The tangent is symmetric and agrees with differences of the residual.

    Conditions on both sides may hold a component of tied nodes.
    """
    pair = tied(cell, quadrature="overlay")
    for V, bcs in zip(pair.V, pair.bcs, strict=True) if held else ():
        bcs.append(slide(V, 0, plane(V.mesh, 0, 0.0)))
    problem = pair.problem()
    problem.solve()
    rng = np.random.default_rng(1)
    x = near_solution(problem, rng, 0.01)
    errors = tangent_errors(problem, x, direction(problem, rng), 1e-4)
    assert errors.difference < 1e-8 and errors.asymmetry < 1e-12


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_meshes_that_have_been_stretched(quadrature):
    """A slave mesh moved by t and displaced by -t has no jump, whatever the change of its area."""
    pair = tied("triangle", quadrature=quadrature)
    t = np.array([0.0, 0.05])
    pair.bcs[1][:] = [clamp(pair.V[1], plane(pair.meshes[1], 1, 1.0 + GAP), -t)]
    for msh in pair.meshes:
        msh.geometry.x[:, 0] *= 1.5
    pair.meshes[1].geometry.x[:, :2] += t
    pair.contact.update()
    pair.problem(solver="direct").solve()
    assert largest(pair.u[1].x.array.reshape(-1, 2) + t, pair.u[0].x.array) < 1e-12


def turned_apart(pair, equations):
    """Random unknowns near bodies that turn by different angles, with facets that are bent."""
    z, scale = away(equations)
    for i, (u, angle) in enumerate(zip(pair.u, (0.4, 0.7), strict=True)):
        place = u.x.petsc_vec.owner_range
        u.interpolate(lambda x, angle=angle: turned(angle)(x, pair.gdim - 1))
        equations.part(z, i)[:] += u.x.array[: place[1] - place[0]]
        equations.part(z, i)[:] = equations.system.bodies[i].with_conditions(equations.part(z, i))
        u.x.array[:] = 0.0
    return z, scale


def asymmetry(equations, z):
    """|K x − Kᵀ x|∞ over |K x|∞ for a random direction x that meets the conditions. Collective."""
    K, rng = equations.tangent(z), np.random.default_rng((3, WORLD.rank))
    x, product = K.createVecs()
    transposed = product.duplicate()
    x.array[:] = rng.uniform(-1, 1, equations.num_local)

    def free(values):
        for i, body in enumerate(equations.system.bodies):
            equations.part(values, i)[body.owned_constrained] = 0.0
        return values

    x.array[:] = free(x.array)
    K.mult(x, product)
    K.multTranspose(x, transposed)
    found = free(product.array_r - transposed.array_r), product.array_r
    return largest(found[0]) / largest(found[1])


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("space", (vector_space, quadratic_space), ids=("P1", "P2"))
@pytest.mark.parametrize("cell", CELLS)
def test_derivative(cell, space, formulation):
    """The derivative has that of the couples; it is symmetric, as a tie has an energy."""
    pair = tied(cell, 0.02, space=space, sliding="finite", formulation=formulation)
    _, equations = equations_of(pair)
    z, scale = turned_apart(pair, equations)
    assert errors(equations, z, scale) < 1e-8
    assert asymmetry(equations, z) < 1e-12


@pytest.mark.parametrize("law", (HalfTied, Spring))
@pytest.mark.parametrize("options", ({}, {"enforcement": "augmented-lagrangian"}, {"held": True}))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_derivative_of_other_laws(cell, options, law):
    """The same holds for a user's law, with and without multipliers, and with conditions."""
    options = options | {"sliding": "finite"}
    held = options.pop("held", False)
    pair = tied(cell, 0.02, law(), **options)
    for V, bcs in zip(pair.V, pair.bcs, strict=True) if held else ():
        bcs.append(slide(V, 0, plane(V.mesh, 0, 0.0)))
    _, equations = equations_of(pair)
    assert errors(equations, *turned_apart(pair, equations)) < 1e-8


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_quadratic_end(cell, enforcement):
    """Full Newton steps converge quadratically where tied bodies turn."""
    pair = tied(cell, 0.02, sliding="finite", enforcement=enforcement)
    far = plane(pair.meshes[1], pair.gdim - 1, 1.0 + GAP)
    shift = np.zeros(pair.gdim)
    shift[0] = 0.5
    pair.bcs[1][:] = [clamp(pair.V[1], far, shift)]
    _, equations = equations_of(pair)
    norms = full_steps(equations, equations.first(), 5)
    assert norms[-1] < 1e-13 * norms[0]
    assert np.all(norms[0] * norms[2:] < norms[1:-1] ** 2 + 1e-13 * norms[0] ** 2)
