"""Elastic bodies on any mesh, for the hard cases of geometry, motion and flow."""

import numpy as np
from hard.scenes import COMM, NU

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def lattice(cell, *lines):
    """Mesh of a box with its planes across each axis at given places."""
    n = [len(line) - 1 for line in lines]
    create = mesh.create_rectangle if len(n) == 2 else mesh.create_box
    msh = create(COMM, [[0.0] * len(n), [1.0] * len(n)], n, mesh.CellType[cell])
    x = msh.geometry.x
    for i, line in enumerate(lines):
        x[:, i] = np.interp(np.round(x[:, i] * n[i]), np.arange(n[i] + 1), line)
    return msh


class Body:
    """A linear elastic body; plane strain in 2D."""

    def __init__(self, msh, E=1.0, nu=NU):
        self.mesh, self.gdim = msh, msh.geometry.dim
        self.V = fem.functionspace(msh, ("Lagrange", 1, (self.gdim,)))
        self.u, v = fem.Function(self.V), ufl.TestFunction(self.V)
        # Constants, so that the forms of all bodies are the same.
        mu, lmbda = (
            fem.Constant(msh, c) for c in (E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu))
        )
        strain = ufl.sym(ufl.grad(self.u))
        stress = 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(self.gdim)
        self.F, self.bcs = ufl.inner(stress, ufl.grad(v)) * ufl.dx, []

    def facets(self, where):
        return mesh.locate_entities_boundary(self.mesh, self.gdim - 1, where)

    def at(self, axis, value):
        """Boundary facets on a plane across an axis."""
        return self.facets(lambda x: np.abs(x[axis] - value) < 1e-9)

    def hold(self, facets, value=None, axis=None):
        """Hold all components, or one; returns the Constant."""
        V = self.V if axis is None else self.V.sub(axis)
        zero = np.zeros(self.gdim) if axis is None else 0.0
        constant = fem.Constant(self.mesh, zero if value is None else value)
        dofs = fem.locate_dofs_topological(V, self.gdim - 1, facets)
        self.bcs.append(fem.dirichletbc(constant, dofs, V))
        return constant


def problem(bodies, contacts, **options):
    return qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], contacts, [b.bcs for b in bodies], **options
    )
