"""Elastic bodies of the sliding demos: boxes, and strips between two lines."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import Reaction, facets_at, fix, measure, per_area


class Body:
    """A linear elastic body.

    Args:
        msh: Mesh.
        lower: Facets of its lower side.
        upper: Facets of its upper side.
        E: Young's modulus.
        nu: Poisson's ratio.
    """

    def __init__(self, msh, lower, upper, E, nu):
        self.mesh, self.lower, self.upper = msh, lower, upper
        self.V = fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        self.stress = qs.materials.linear_elastic(self.u, E, nu)
        self.F = ufl.inner(self.stress, ufl.grad(self.v)) * ufl.dx
        self.bcs = []

    def press(self, force):
        """Load the upper side by a uniform dead load downwards, this force in total."""
        ds = measure(self.mesh, self.upper)
        self.F += per_area(self.mesh, force, ds) * self.v[self.mesh.geometry.dim - 1] * ds

    def hold(self):
        """Hold the lower side."""
        self.bcs += [fix(self.V, axis, self.lower) for axis in range(self.mesh.geometry.dim)]

    def guide(self, facets):
        """Displace facets by ``shift`` along x; they are free to move along the last axis only.

        ``reaction()`` is the force on these facets, if all loads are set and none is in contact.
        """
        self.shift = fem.Constant(self.mesh, 0.0)
        self.reaction = Reaction(self.F, self.V, facets)
        across = range(1, self.mesh.geometry.dim - 1)
        self.bcs.append(fix(self.V, 0, facets, self.shift))
        self.bcs += [fix(self.V, axis, facets) for axis in across]


def create_box(comm, n, low, high, E, nu):
    """Create a box of n cells along x, y and z between two corners."""
    msh = mesh.create_box(comm, [low, high], n, mesh.CellType.hexahedron)
    return Body(msh, *(facets_at(msh, 2, z) for z in (low[2], high[2])), E, nu)


def create_strip(comm, n, ends, low, high, E, nu):
    """Create a body of n cells along x and y between two lines over an interval of x.

    ``back`` has the facets of its left end without the one next to the lower side.
    """
    corners = [[ends[0], 0.0], [ends[1], 1.0]]
    msh = mesh.create_rectangle(comm, corners, n, mesh.CellType.quadrilateral)
    lower, upper = (facets_at(msh, 1, s) for s in (0.0, 1.0))
    back = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[0], ends[0]) & (x[1] > 0.5 / n[1])
    )
    x, s = msh.geometry.x[:, 0], msh.geometry.x[:, 1].copy()
    msh.geometry.x[:, 1] = (1 - s) * low(x) + s * high(x)
    body = Body(msh, lower, upper, E, nu)
    body.back = back
    return body
