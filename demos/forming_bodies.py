"""Bodies of the forming demos: velocity-based Norton-Hoff bodies, quarter cylinders."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import gmsh_mesh, integral


class NortonHoff:
    """A Norton-Hoff body, with the MINI element for velocity and pressure.

    Args:
        msh: Mesh; in 2D half a section along the axis.
        K: Consistency.
        m: Rate sensitivity.
        slow: Strain rate below which the viscosity is regularised.
    """

    def __init__(self, msh, K, m, slow):
        self.mesh, self.axisymmetric = msh, msh.geometry.dim == 2
        self.W = qs.materials.mini_space(msh)
        self.w = fem.Function(self.W)
        self.m = fem.Constant(msh, m)
        velocity, self.pressure = ufl.split(self.w)
        self.stress = qs.materials.norton_hoff(velocity, K, self.m, slow, self.axisymmetric)
        self.F = qs.materials.incompressible(self.w, self.stress)
        self.strain_rate = qs.materials.strain(velocity, self.axisymmetric)
        self.rate = qs.materials.equivalent_strain_rate(velocity, self.axisymmetric)

    def surface(self, facets):
        """The surface of some facets."""
        return qs.Surface(self.W.sub(0), facets=facets, axisymmetric=self.axisymmetric)

    def integral(self, f):
        """Integral of a function, all around the axis if axisymmetric. Collective."""
        metadata = {"quadrature_degree": 5} if self.axisymmetric else {}  # that of F
        weight = qs.materials.axisymmetric_weight(self.mesh) if self.axisymmetric else 1.0
        return integral(self.mesh, f * weight * ufl.Measure("dx", self.mesh, metadata=metadata))

    def power(self):
        """Compute the power that the body dissipates. Collective."""
        return self.integral(ufl.inner(self.stress, self.strain_rate))

    def volume(self):
        """Compute the volume of the body. Collective."""
        return self.integral(fem.Constant(self.mesh, 1.0))


def quarter_cylinder(comm, radius, bottom, height, size):
    """Mesh a quarter of a cylinder, x, y ≥ 0, with tetrahedra.

    Args:
        comm: Communicator.
        radius: Radius of the cylinder.
        bottom: Its lowest z.
        height: Height along z.
        size: Largest size of the cells; or a formula of gmsh for the size.
    """

    def draw(gmsh):
        gmsh.model.occ.addCylinder(0, 0, bottom, 0, 0, height, radius, angle=np.pi / 2)
        gmsh.model.occ.synchronize()
        if not isinstance(size, str):
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
            return
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.model.mesh.field.add("MathEval", 1)
        gmsh.model.mesh.field.setString(1, "F", size)
        gmsh.model.mesh.field.setAsBackgroundMesh(1)

    return gmsh_mesh(comm, 3, draw)


def cylinder(comm, dim, radius, height):
    """Mesh half a meridian section of a cylinder (2D), or a quarter of it (3D), in a few cells."""
    if dim == 2:
        return mesh.create_rectangle(comm, [[0, 0], [radius, height]], [6, 9])
    return quarter_cylinder(comm, radius, 0, height, 3.0)
