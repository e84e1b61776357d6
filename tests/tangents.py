"""Check tangents: they must equal central differences of the residual."""

import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.friction import filled


def near_solution(problem, rng, amplitude):
    """Return unknowns near the solution, the same on any partition; conditions hold. Collective."""
    x = problem.system.x.copy()
    for body, part in zip(problem.bodies, problem.system.parts(x.array), strict=True):
        gdim = body.V.mesh.geometry.dim
        positions = body.V.tabulate_dof_coordinates()[: len(part) // gdim]
        waves, phases = rng.normal(size=(8, 3)) * 6, rng.random((8, gdim)) * 6
        part += amplitude * np.sin((positions @ waves.T)[:, :, None] + phases).mean(axis=1).ravel()
        part[:] = body.with_conditions(part)
    return x


def direction(problem, rng):
    """Return a random change of the unknowns that have no Dirichlet condition. Collective."""
    d = problem.system.x.duplicate()
    low, high = d.owner_range
    d.array[:] = rng.normal(size=d.size)[low:high]
    for body, part in zip(problem.bodies, problem.system.parts(d.array), strict=True):
        part[body.owned_constrained] = 0
    return d


class Errors(typing.NamedTuple):
    """Errors of the tangent K in a direction d, relative to |K d|.

    Attributes:
        difference: |K d − (R(x + h d) − R(x − h d)) / 2h|.
        asymmetry: |K d − Kᵀ d|, for the unknowns that have no Dirichlet condition.
    """

    difference: float
    asymmetry: float


def tangent_errors(problem, x, d, step):
    """Check the tangent at x; the problem is left in this state. Collective."""
    system = problem.system
    system.residual(x.array_r)
    matrix = system.tangent(x.array_r)
    product, transposed = d.duplicate(), d.duplicate()
    matrix.mult(d, product)
    matrix.multTranspose(d, transposed)
    plus, minus = (system.residual(x.array_r + s * step * d.array_r) for s in (1, -1))
    system.residual(x.array_r)
    skew = product.array_r - transposed.array_r
    for body, part in zip(problem.bodies, system.parts(skew), strict=True):
        part[body.owned_constrained] = 0
    size = system.norm(product.array_r)
    error = system.norm(product.array_r - (plus - minus) / (2 * step))
    return Errors(error / size, system.norm(skew) / size)


def on_edge(equations, z, seed=3):
    """Return unknowns with λ such that all friction constraints with a jump are on the edge.

    There τ·d + a y_n is between 0.1 and 0.9 of the traction of the law. Collective.
    """
    z = z.copy()
    at, rng = equations.evaluate(z), np.random.default_rng((seed, equations.system.comm.rank))
    parts = zip(equations.passes, at.passes, equations.multipliers(z), strict=True)
    for p, e, values in parts:
        closed = e.tangential.told._replace(closed=np.ones_like(e.active))
        T = p.slip.respond(closed, False).traction
        size = np.linalg.norm(T, axis=1)
        along = np.sum(values.tangential * T, axis=1) / size
        wanted = (rng.uniform(0.1, 0.9, len(size)) * size - along) / filled.OF_PRESSURE
        by_pressure = p.rows.nodal.by_trial()[1]
        values.normal[:, 0] += (wanted - e.normal.trial[:, 0]) / by_pressure
    return z


def full_steps(equations, z, num):
    """Return the norms of the residual in this number of full Newton steps from z. Collective."""
    comm, norms = equations.system.comm, []
    ksp = PETSc.KSP().create(comm)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    for k in range(num + 1):
        R = equations.residual(z)
        norms.append(np.sqrt(comm.allreduce(R @ R)))
        if k < num:
            ksp.setOperators(equations.tangent(z, exact=False))
            b, x = ksp.getOperators()[0].createVecs()
            b.array[:] = -R
            ksp.solve(b, x)
            z = z + x.array
    ksp.destroy()
    return np.array(norms)
