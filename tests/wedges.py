"""Wedges: cubes that stand on an edge."""

from petsc4py import PETSc

import numpy as np
from scenes import WORLD, box, elastic

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix

import qsdolfinx as qs

E, EDGE = 1e3, 0.6


class Wedge:
    """A cube that stands on an edge along y, or has this edge on top, held at the opposite faces.

    Args:
        n: Number of cells along an edge.
        cell: Type of the cells.
        up: Whether the edge is on top.
        yaw: Angle by which it is rotated about z (degrees).
        shift: Translation after the rotation.
        degree: Degree of the displacements.
    """

    def __init__(self, n, cell, up=False, yaw=0.0, shift=(0.0, 0.0, 0.0), degree=1):
        self.h, self.shift = EDGE / n, np.array(shift)
        low, high = [0.0, -EDGE / 2, 0.0], [EDGE, EDGE / 2, EDGE]
        self.msh = box(WORLD, (n, n, n), cell, low, high, "scattered")
        s, w = np.sqrt(0.5), np.radians(yaw)
        R = np.array([[s, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, s]])
        R = np.diag([-1.0, 1.0, -1.0]) @ R if up else R
        turn = [[np.cos(w), -np.sin(w), 0.0], [np.sin(w), np.cos(w), 0.0], [0.0, 0.0, 1.0]]
        self.R = np.array(turn) @ R
        self.msh.geometry.x[:] = self.msh.geometry.x @ self.R.T + self.shift
        self.V = fem.functionspace(self.msh, ("Lagrange", degree, (3,)))
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E=E, nu=0.3)
        self.bcs = []

    def local(self, x):
        """Return positions in the frame of the cube; on its edge the first and last are 0."""
        return self.R.T @ (x - self.shift[:, None])

    def facets(self, found):
        return mesh.locate_entities_boundary(self.msh, 2, lambda x: found(self.local(x)))

    def hold(self, up):
        """Move the faces away from the edge by a displacement along z."""
        far = self.facets(lambda x: np.isclose(x[0], EDGE) | np.isclose(x[2], EDGE))
        dofs = fem.locate_dofs_topological(self.V, 2, far)
        self.moved = fem.Constant(self.msh, [0.0, 0.0, up])
        self.bcs = [fem.dirichletbc(self.moved, dofs, self.V)]
        return self

    def surface(self):
        """Return the contact surface: all faces but the two that are held."""

        def found(x):
            ends = np.isclose(np.abs(x[1]), EDGE / 2)
            return np.isclose(x[0], 0.0) | np.isclose(x[2], 0.0) | ends

        return qs.Surface(self.V, facets=self.facets(found))

    def compliance(self, y):
        """Return the displacement by a unit force along z on the edge at y, without contact."""
        zero = self.hold(0.0).bcs
        A = assemble_matrix(fem.form(ufl.derivative(self.F, self.u)), bcs=zero)
        A.assemble()
        b, x = A.createVecs()
        owned = self.V.dofmap.index_map.size_local
        at = self.local(self.V.tabulate_dof_coordinates()[:owned].T)
        on_edge = np.isclose(at[0], 0.0) & np.isclose(at[2], 0.0)
        share = np.maximum(1 - np.abs(at[1] - y) / self.h, 0.0) * on_edge
        b.array[2::3] = share
        ksp = PETSc.KSP().create(WORLD)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        ksp.setOperators(A)
        ksp.solve(b, x)
        return b.dot(x)


def crossed(n, cell, depth, yaw=90.0):
    """Return two wedges whose edges cross between nodes, and the contact force at the crossing."""
    y, x = 0.47 * EDGE / n[0], 0.3 * EDGE / n[1]
    upper = Wedge(n[0], cell)
    lower = Wedge(n[1], cell, up=True, yaw=yaw, shift=(x, -y, 0.0))
    along = lower.R[:, 1]
    place = -x / along[0]  # on the lower edge, where its x is 0
    on_upper = -y + place * along[1]
    force = depth * upper.h / (upper.compliance(on_upper) + lower.compliance(place))
    return [upper.hold(-depth * upper.h), lower.hold(0.0)], force
