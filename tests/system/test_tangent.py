"""The tangent is the exact derivative of the residual, and the residual that of the energy."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import CELLS, FORMULATIONS, LAWS, WORLD, Pair, allowed, plane, slide
from tangents import direction, near_solution, tangent_errors

import qsdolfinx as qs
from qsdolfinx.contact import active_set, terms

OPTIONS = {
    "nodal": {"quadrature": "nodal"},
    "overlay": {"quadrature": "overlay"},
    "facet": {"quadrature": "overlay", "normals": "facet"},
    "augmented": {
        "quadrature": "overlay",
        "enforcement": "augmented-lagrangian",
        "gap_tolerance": 0.02,
    },
    "augmented-nodal": {
        "quadrature": "nodal",
        "enforcement": "augmented-lagrangian",
        "gap_tolerance": 1e-3,
    },
}
KINDS = allowed(FORMULATIONS, OPTIONS)


def scene(cell, formulation, law, amplitude=0.05, options=None):
    """Make curved surfaces with random displacements, some constraints open and some closed."""
    n = (3, 2) if cell in ("tetrahedron", "hexahedron") else (12, 9)
    pair = Pair(cell, formulation, law(), n=n, wave=0.05, contact_options=options)
    problem = pair.problem()
    problem.solve()
    rng = np.random.default_rng(8)
    return pair, problem, near_solution(problem, rng, amplitude), direction(problem, rng)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("formulation", "options"), KINDS)
@pytest.mark.parametrize("cell", CELLS)
def test_finite_differences(cell, formulation, law, options):
    pair, problem, x, d = scene(cell, formulation, law, 0.2, OPTIONS[options])
    errors = tangent_errors(problem, x, d, 1e-7)
    active = WORLD.allreduce(active_set.num_closed(pair.contact.model))
    rows = WORLD.allreduce(sum(gap.num_rows for gap in pair.contact.model.gaps))
    assert errors.difference < 1e-6
    assert rows > 0
    assert active == rows if law is qs.Tied else 0 < active < rows

    product, nested = d.duplicate(), d.duplicate()
    problem.system.matrix.mult(d, product)
    problem.blocks.nest.mult(d, nested)  # contact only
    parts = problem.system.parts(d.array_r), problem.system.parts(nested.array)
    for body, given, sums in zip(problem.bodies, *parts, strict=True):
        part, force = body.create_vec(), body.create_vec()
        part.array[:] = given
        body.matrix().mult(part, force)
        sums += force.array_r
    nested.axpy(-1, product)
    assert nested.norm() < 1e-14 * product.norm()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_symmetry(cell, formulation, law):
    """The matrix is symmetric, with Dirichlet conditions on contact nodes included."""
    pair = Pair(cell, formulation, law(), n=(3, 2), wave=0.05)
    # Conditions on the edge of the contact surface, not only on the far sides.
    for V, msh, bcs in zip(pair.V, pair.meshes, pair.bcs, strict=True):
        bcs.append(slide(V, 0, plane(msh, 0, 0.0), 0.01))
    problem = pair.problem()
    problem.solve()
    touched = []
    for body, surface in zip(problem.bodies, (pair.master, pair.slave), strict=True):
        local = surface.node_dofs - body.x.owner_range[0]
        touched.append(WORLD.allreduce(len(np.intersect1d(local, body.owned_constrained))))
    matrix = problem.system.matrix
    transposed = matrix.transpose(PETSc.Mat())
    transposed.axpy(-1, matrix)
    error = transposed.norm() / matrix.norm()
    units = problem.system.parts(matrix.getDiagonal().array_r)
    ones = [
        unit[b.owned_constrained] / b.condition_stiffness
        for b, unit in zip(problem.bodies, units, strict=True)
    ]
    assert min(touched) > 0
    assert error < 1e-14
    np.testing.assert_allclose(np.concatenate(ones), 1)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", ("tetrahedron", "quadrilateral"))
def test_forces_derive_from_the_energy(cell, formulation, law):
    """The contact residual in a direction is the derivative of Φ."""
    pair, problem, x, d = scene(cell, formulation, law)
    step = 1e-6

    def energy(at):
        problem.system.residual(at)
        return pair.contact.stored_energy()

    slope = (energy(x.array_r + step * d.array_r) - energy(x.array_r - step * d.array_r)) / 2 / step
    problem.system.residual(x.array_r)
    forces = np.concatenate([body.force.array_r for body in problem.bodies])
    power = WORLD.allreduce(forces @ d.array_r)
    assert abs(power - slope) < 1e-6 * abs(power)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_energy_of_a_uniform_gap(formulation):
    """Φ = ½ ε S h² for uniform penetration h of matching meshes: ε means the same everywhere."""
    options = {"constraints": "nodes"}
    pair = Pair("hexahedron", formulation, penalty=7.0, n=(3, 3), contact_options=options)
    problem = pair.problem()
    problem.set_up()
    h = 1e-3
    pair.u[1].interpolate(lambda x: np.stack([0 * x[0], 0 * x[0], 0 * x[0] - h]))
    for i, u in enumerate(pair.u):
        problem.bodies[i].x.array[:] = u.x.array[: problem.bodies[i].num_owned]
    contact = pair.contact
    terms.evaluate(contact.model, problem.bodies[1].x, problem.bodies[0].x)
    energy, force = contact.stored_energy(), contact.force("slave")
    gap, multiplier = contact.weighted_gap(), contact.multiplier()
    assert np.isclose(energy, 0.5 * 7 * h**2, rtol=1e-12)
    np.testing.assert_allclose(force, [0, 0, 7 * h], atol=1e-15)
    np.testing.assert_allclose(gap, h, rtol=1e-12)
    np.testing.assert_allclose(multiplier, 7 * h, rtol=1e-12)


def test_tangent_where_the_residual_was_not_evaluated():
    """The tangent is right without an evaluation of the residual there, as PETSc may request."""
    _, problem, x, d = scene("quadrilateral", "quasi-symmetric", qs.Unilateral)
    matrix = problem.snes.getJacobian()[0]
    y = x + d
    norms = []
    for evaluate in (True, False):
        problem.system.residual(y.array_r if evaluate else x.array_r)
        problem.snes.computeJacobian(y, matrix)
        norms.append(matrix.norm())
    problem.snes.computeJacobian(x, matrix)
    norms.append(matrix.norm())
    assert norms[0] == norms[1] != norms[2]
