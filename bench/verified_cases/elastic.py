"""Elastic bodies of degree 2 and graded meshes for the cases that follow NAFEMS R0094."""

import numpy as np
from common.bodies import fix, gmsh_mesh, measure, per_area

import ufl
from dolfinx import fem

import qsdolfinx as qs


class Body:
    """A body of St. Venant-Kirchhoff material, or of Hooke's material at small strains.

    Args:
        msh: Its mesh.
        E: Young's modulus.
        nu: Poisson's ratio.
        facets: Facets that may touch the other body.
        axisymmetric: Whether the coordinates are (r, z); plane strain otherwise.
        small: Whether strains are small.
    """

    def __init__(self, msh, E, nu, facets, *, axisymmetric=False, small=False):
        self.mesh, self.axisymmetric = msh, axisymmetric
        self.V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        around = qs.materials.axisymmetric_weight(msh) if axisymmetric else 1.0
        grad_u, grad_v = (qs.materials.gradient(f, axisymmetric) for f in (self.u, self.v))
        one = ufl.Identity(grad_u.ufl_shape[0])
        F = one if small else one + grad_u
        strain = ufl.sym(grad_u) if small else (F.T * F - one) / 2
        mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
        stress = F * (lmbda * ufl.tr(strain) * one + 2 * mu * strain)
        self.F = around * ufl.inner(stress, grad_v) * ufl.dx(degree=4)
        self.around, self.bcs = around, []
        self.surface = qs.Surface(self.V, facets=facets, axisymmetric=axisymmetric)

    def hold(self, facets, *axes):
        """Fix facets along some axes."""
        self.bcs += [fix(self.V, axis, facets) for axis in axes]

    def press(self, facets, traction):
        """Load facets by a dead downward traction (stress); return its factor, initially 1."""
        factor = fem.Constant(self.mesh, 1.0)
        self.F += factor * traction * self.around * self.v[1] * measure(self.mesh, facets)
        return factor

    def force_as_traction(self, facets, force):
        """Return the uniform traction on facets of a total force, for a body in plane strain."""
        return per_area(self.mesh, force, measure(self.mesh, facets))

    def displacement_at(self, *point):
        """Return the displacement of the node at a point, the same on all ranks. Collective."""
        at = fem.locate_dofs_geometrical(
            self.V, lambda x: np.all(np.isclose(x[:2].T, point, atol=1e-9), axis=1)
        )
        own = at[at < self.V.dofmap.index_map.size_local]
        values = self.u.x.array.reshape(-1, 2)[own].sum(axis=0)
        return self.mesh.comm.allreduce(values)


def graded(comm, draw, size, reach, slope):
    """Create a mesh of triangles of degree 2, fine near points and coarser away from them.

    Args:
        comm: Communicator.
        draw: Called with gmsh's CAD kernel, on rank 0; returns points.
        size: Size of the cells up to the distance ``reach`` from the points.
        reach: Distance (length).
        slope: Growth of the cell size per length.
    """

    def everything(gmsh):
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        occ, field = gmsh.model.occ, gmsh.model.mesh.field
        points = [occ.addPoint(*x, 0) for x in draw(occ)]
        occ.synchronize()
        field.add("Distance", 1)
        field.setNumbers(1, "PointsList", points)
        field.add("MathEval", 2)
        field.setString(2, "F", f"{size} + {slope} * max(F1 - {reach}, 0)")
        field.setAsBackgroundMesh(2)

    return gmsh_mesh(comm, 2, everything)
