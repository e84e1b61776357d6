"""Bodies of the forming demos: Norton-Hoff ones in velocities, elastic dies, quarter cylinders."""

import numpy as np
from common.bodies import facets_at, fix, gmsh_mesh, integral

import ufl
from dolfinx import fem

import qsdolfinx as qs


class NortonHoff:
    """A Norton-Hoff body, with the MINI element in velocity and pressure.

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
        """What the body dissipates. Collective."""
        return self.integral(ufl.inner(self.stress, self.strain_rate))

    def volume(self):
        """Its volume. Collective."""
        return self.integral(fem.Constant(self.mesh, 1.0))


class Die:
    """Elastic die, a quarter of a cylinder, in total displacements.

    Args:
        comm: Communicator.
        z: Height of the face.
        sign: 1: the die is above the face, -1: below it.
        h: Size of the cells on the face; they grow away from it.
        reach: Radius within which contact may come.
        E: Young's modulus.
        nu: Poisson's ratio.
    """

    RADIUS, HEIGHT = 18.0, 9.0

    def __init__(self, comm, z, sign, h, reach, E, nu):
        beyond = f"(sqrt(x*x+y*y)-{reach})"
        size = f"{h}+0.35*(abs(z-{z})+0.5*({beyond}+abs({beyond})))"
        bottom = z if sign > 0 else z - self.HEIGHT
        self.mesh = msh = quarter_cylinder(comm, self.RADIUS, bottom, self.HEIGHT, size)
        self.V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        self.u = fem.Function(self.V)
        self.stress = qs.materials.linear_elastic(self.u, E, nu)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        #: Displacement of the back along z.
        self.height = fem.Constant(msh, 0.0)
        back = facets_at(msh, 2, z + sign * self.HEIGHT)
        self.bcs = [fix(self.V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
        self.bcs.append(fix(self.V, 2, back, self.height))
        self.surface = qs.Surface(self.V, facets=facets_at(msh, 2, z))


def quarter_cylinder(comm, radius, bottom, height, size):
    """Tetrahedra of a quarter of a cylinder, x, y ≥ 0.

    Args:
        comm: Communicator.
        radius: Of the cylinder.
        bottom: Its lowest z.
        height: Along z.
        size: Of the cells, at most; or gmsh's formula for it.
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
