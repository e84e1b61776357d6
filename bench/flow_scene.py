"""Velocity–pressure scene of ``bench/solvers.py``: an elastic tool presses a flowing block.

The lower body is a Norton-Hoff block, a square or cube of MINI elements with velocity and pressure,
held by planes of symmetry. The elastic tool on it covers 0.6 of an edge, so that the flow is far
from uniform and its viscosity varies, for m = 0.15 by two orders of magnitude.
"""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
STEP, PRESS, WIDTH, TOP = 0.02, 0.02, 0.6, 1.4


def create(dim, n, low, high):
    make = mesh.create_rectangle if dim == 2 else mesh.create_box
    return make(COMM, [np.array(low), np.array(high)], [n] * dim)


def facets(msh, axis, value):
    fdim = msh.topology.dim - 1
    return mesh.locate_entities_boundary(msh, fdim, lambda x: np.isclose(x[axis], value))


def hold(V, axis, at_axis, at, value=0.0):
    """Make a Dirichlet condition on a component at a plane."""
    dofs = fem.locate_dofs_topological(
        V.sub(axis), V.mesh.topology.dim - 1, facets(V.mesh, at_axis, at)
    )
    return fem.dirichletbc(value, dofs, V.sub(axis))


def block(dim, n, m):
    """Return form, unknown, conditions, contact surface and rate sensitivity of the block.

    With m None the block is a Newtonian fluid, whose form is linear.
    """
    msh = create(dim, n, [0.0] * dim, [1.0] * dim)
    W = qs.materials.mini_space(msh)
    w, V = fem.Function(W), W.sub(0)
    velocity = ufl.split(w)[0]
    if m is None:
        stress = qs.materials.newtonian(velocity, 1.0)
    else:
        m = fem.Constant(msh, m)
        stress = qs.materials.norton_hoff(velocity, 1.0, m, 1e-3)
    bcs = [hold(V, axis, axis, 0.0) for axis in range(dim)]
    return (
        qs.materials.incompressible(w, stress),
        w,
        bcs,
        qs.Surface(V, facets=facets(msh, dim - 1, 1.0)),
        m,
    )


def tool(dim, n):
    """Return form, unknown, conditions and contact surface of the tool."""
    msh = create(dim, n, [0.0] * (dim - 1) + [1.0], [WIDTH] * (dim - 1) + [TOP])
    V = fem.functionspace(msh, ("Lagrange", 1, (dim,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.linear_elastic(u, 100.0, 0.3), ufl.grad(v)) * ufl.dx
    bcs = [hold(V, axis, axis, 0.0) for axis in range(dim - 1)]
    bcs += [hold(V, axis, dim - 1, TOP, -PRESS if axis == dim - 1 else 0.0) for axis in range(dim)]
    return F, u, bcs, qs.Surface(V, facets=facets(msh, dim - 1, 1.0))


def flow(dim, n, solver, enforcement, mu=0.0, m=1.0):
    """Return the problem, and the rate sensitivity of its block; None for a Newtonian fluid."""
    lower, upper = block(dim, n, m), tool(dim, max(4 * n // 5, 1))
    contact = qs.Contact(
        lower[3],
        upper[3],
        quadrature="nodal",
        enforcement=enforcement,
        unknown=("velocity", "displacement"),
        dt=STEP,
        friction=qs.Coulomb(mu) if mu > 0 else None,
    )
    forms, unknowns, bcs = ([lower[i], upper[i]] for i in range(3))
    damped = {"snes_linesearch_type": "bt"}  # as qs.solve_with_continuation does
    problem = qs.ContactProblem(
        forms, unknowns, [contact], bcs, linear_solver=solver, petsc_options=damped
    )
    return problem, lower[4]
