"""Make shaft and hub of the press fit: elastic rings."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at, fix

E, NU = 210e3, 0.3  # MPa, -
A, B, LENGTH, INTERFERENCE = 20.0, 40.0, 40.0, 0.02  # mm


class Ring:
    """A ring of quadrilaterals; its end at z = LENGTH is fixed along z, except at the edge."""

    def __init__(self, comm, inner, outer, touching, n):
        corners, cells = [(inner, 0.0), (outer, LENGTH)], (max(3, n // 2), n)
        self.mesh = msh = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
        self.V = V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        self.stress = qs.materials.linear_elastic(self.u, E, NU, axisymmetric=True)
        work = ufl.inner(self.stress, qs.materials.strain(v, axisymmetric=True))
        self.F = qs.materials.axisymmetric_weight(msh) * work * ufl.dx
        self.end = mesh.locate_entities_boundary(
            msh, 1, lambda x: np.isclose(x[1], LENGTH) & (np.abs(x[0] - A) > 2.5)
        )
        self.pulled = fem.Constant(msh, 0.0)
        self.bcs = [fix(V, 1, self.end, self.pulled)]
        if inner == 0:
            self.bcs.append(fix(V, 0, facets_at(msh, 0, 0.0)))
        self.surface = qs.Surface(V, facets=facets_at(msh, 0, touching), axisymmetric=True)
