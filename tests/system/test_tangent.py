"""The tangent is the exact derivative of the residual, and the residual that of the energy."""

from petsc4py import PETSc

import numpy as np
import pytest
from scenes import CELLS, FORMULATIONS, LAWS, WORLD, Pair, plane, slide

import qsdolfinx as qs

ALL_FORMULATIONS = (*FORMULATIONS, "two-half-pass")
OPTIONS = {
    "nodal": {},
    "overlay": {"quadrature": "overlay"},
    "averaged": {"quadrature": "overlay", "normals": "averaged"},
    # Two multipliers cannot close every gap: a tolerance that ends with some multipliers.
    "augmented": {
        "quadrature": "overlay",
        "enforcement": "augmented-lagrangian",
        "gap_tolerance": 0.02,
    },
    "augmented-nodal": {"enforcement": "augmented-lagrangian", "gap_tolerance": 1e-3},
}


def scene(cell, formulation, law, amplitude=0.05, options=None):
    """Curved surfaces with some rows open, some closed, and random displacements."""
    n = (3, 2) if cell in ("tetrahedron", "hexahedron") else (12, 9)
    pair = Pair(cell, formulation, law(), n=n, wave=0.05, contact_options=options)
    problem = pair.problem()
    problem.solve()
    x = problem.system.x.copy()
    rng = np.random.default_rng(8)
    for i, V in enumerate(pair.V):  # the same on any partition
        part = problem.system.part(x.array, i)
        positions = V.tabulate_dof_coordinates()[: len(part) // pair.gdim]
        waves, phases = rng.normal(size=(8, 3)) * 6, rng.random((8, pair.gdim)) * 6
        part += amplitude * np.sin((positions @ waves.T)[:, :, None] + phases).mean(axis=1).ravel()
    for i, body in enumerate(problem.bodies):  # conditions hold
        part = problem.system.part(x.array, i)
        part[:] = body.with_conditions(part)
    return pair, problem, x, rng


def direction(problem, x, rng):
    """Random change of the unknowns that have no Dirichlet condition."""
    low, high = x.owner_range
    d = x.duplicate()
    d.array[:] = rng.normal(size=x.size)[low:high]
    for i, body in enumerate(problem.bodies):
        problem.system.part(d.array, i)[body.owned_constrained] = 0
    return d


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", ALL_FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_finite_differences(cell, formulation, law, options):
    amplitude = 0.2
    pair, problem, x, rng = scene(cell, formulation, law, amplitude, OPTIONS[options])
    d = direction(problem, x, rng)
    problem.system.residual(x.array_r)
    active = WORLD.allreduce(pair.contact.num_active_local())
    rows = WORLD.allreduce(sum(len(p.values) for p in pair.contact.passes))
    problem.system._assembled = None
    problem.system.assemble()
    product, nested = d.duplicate(), d.duplicate()
    problem.system.matrix.mult(d, product)
    problem.blocks.nest.mult(d, nested)  # contact alone
    for i, body in enumerate(problem.bodies):
        part, force = body.create_vec(), body.create_vec()
        part.array[:] = problem.system.part(d.array_r, i)
        body.matrix().mult(part, force)
        problem.system.part(nested.array, i)[:] += force.array_r

    step = 1e-7
    residuals = [problem.system.residual(x.array_r + sign * step * d.array_r) for sign in (1, -1)]
    difference = d.duplicate()
    difference.array[:] = (residuals[0] - residuals[1]) / (2 * step)
    scale = product.norm()
    difference.axpy(-1, product)
    nested.axpy(-1, product)
    errors = difference.norm() / scale, nested.norm() / scale
    assert errors[0] < 1e-6
    assert errors[1] < 1e-14
    assert rows > 0
    assert active == rows if law is qs.Tied else 0 < active < rows


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", CELLS)
def test_symmetry(cell, formulation, law):
    """The matrix is symmetric, Dirichlet conditions on contact nodes included."""
    pair = Pair(cell, formulation, law(), n=(3, 2), wave=0.05)
    # Conditions on the edge of the contact surface, not on the far sides only.
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
    unit = matrix.getDiagonal()
    rows = np.concatenate(
        [
            sum(o.num_owned for o in problem.bodies[:i]) + b.owned_constrained
            for i, b in enumerate(problem.bodies)
        ]
    ).astype(int)
    assert min(touched) > 0
    assert error < 1e-14
    np.testing.assert_allclose(unit.array_r[rows], 1)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", ("tetrahedron", "quadrilateral"))
def test_forces_derive_from_the_energy(cell, formulation, law):
    """Contact residual in a direction = derivative of Φ."""
    pair, problem, x, rng = scene(cell, formulation, law)
    d = direction(problem, x, rng)
    step = 1e-6

    def energy(at):
        problem.system.residual(at)
        return pair.contact.energy

    slope = (energy(x.array_r + step * d.array_r) - energy(x.array_r - step * d.array_r)) / 2 / step
    problem.system.residual(x.array_r)
    forces = np.concatenate([body.force.array_r for body in problem.bodies])
    power = WORLD.allreduce(forces @ d.array_r)
    assert abs(power - slope) < 1e-6 * abs(power)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_energy_of_a_uniform_gap(formulation):
    """Φ = ½ ε S h² for uniform penetration h of matching meshes: ε means the same everywhere."""
    pair = Pair("hexahedron", formulation, qs.Unilateral(), penalty=7.0, n=(3, 3))
    problem = pair.problem()
    problem.set_up()
    h = 1e-3
    pair.u[1].interpolate(lambda x: np.stack([0 * x[0], 0 * x[0], 0 * x[0] - h]))
    for i, u in enumerate(pair.u):
        problem.bodies[i].x.array[:] = u.x.array[: problem.bodies[i].num_owned]
    contact = pair.contact
    contact.evaluate(problem.bodies[1].x, problem.bodies[0].x)
    energy, force = contact.energy, contact.force("slave")
    gap, multiplier = contact.gap(), contact.multiplier()
    assert np.isclose(energy, 0.5 * 7 * h**2, rtol=1e-12)
    np.testing.assert_allclose(force, [0, 0, 7 * h], atol=1e-15)
    np.testing.assert_allclose(gap, h, rtol=1e-12)
    np.testing.assert_allclose(multiplier, 7 * h, rtol=1e-12)


def test_tangent_where_the_residual_was_not_evaluated():
    """PETSc may ask for the tangent anywhere."""
    _, problem, x, rng = scene("quadrilateral", "quasi-symmetric", qs.Unilateral)
    matrix = problem.snes.getJacobian()[0]
    y = x.copy()
    y.axpy(1.0, direction(problem, x, rng))
    norms = []
    for evaluate in (True, False):
        problem.system.residual(y.array_r if evaluate else x.array_r)
        problem.snes.computeJacobian(y, matrix)
        norms.append(matrix.norm())
    problem.snes.computeJacobian(x, matrix)
    norms.append(matrix.norm())
    assert norms[0] == norms[1] != norms[2]
