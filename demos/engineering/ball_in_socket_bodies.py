"""Make ball and socket: axisymmetric elastic bodies with nearly conforming surfaces."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at, fix, gmsh_mesh, measure

E, NU, BALL, SOCKET = 210e3, 0.3, 10.0, 10.1  # MPa, -, mm, mm
RADIUS = 2.0  # mm, contact radius of Hertz' theory
CONFORMING = BALL * SOCKET / (SOCKET - BALL)
LOAD = 4 / 3 * E / (2 * (1 - NU**2)) * RADIUS**3 / CONFORMING
P0 = 3 * LOAD / (2 * np.pi * RADIUS**2)


def create_mesh(comm, of_ball, h, degree):
    """Make triangles, of size h where the bodies touch, 1.6 mm (or h) away from there."""

    def draw(gmsh):
        occ, field = gmsh.model.occ, gmsh.model.mesh.field
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", max(h, 1.6))
        gmsh.option.setNumber("Mesh.ElementOrder", degree)
        if of_ball:
            corner = (2, occ.addRectangle(0, 0, 0, BALL, BALL))
            occ.intersect([(2, occ.addDisk(0, BALL, 0, BALL, BALL))], [corner])
        else:
            ball = (2, occ.addDisk(0, SOCKET, 0, SOCKET, SOCKET))
            occ.cut([(2, occ.addRectangle(0, -10, 0, 20, 16))], [ball])
        pole = occ.addPoint(0, 0, 0)
        occ.synchronize()
        field.add("Distance", 1)
        field.setNumbers(1, "PointsList", [pole])
        field.add("MathEval", 2)
        field.setString(2, "F", f"{h} + 0.15 * (F1 - 3 + Fabs(F1 - 3))")
        field.setAsBackgroundMesh(2)

    return gmsh_mesh(comm, 2, draw)


class Body:
    """The ball, or the block with the socket."""

    def __init__(self, comm, radius, h, degrees):
        of_ball = radius == BALL
        msh = create_mesh(comm, of_ball, h, 2 if degrees[0] == 2 else 1)
        round_side = mesh.locate_entities_boundary(
            msh, 1, lambda x: np.isclose(np.hypot(x[0], x[1] - radius), radius)
        )
        if degrees[0] == "elevated":
            msh = qs.elevate(msh, facets=round_side)
        self.mesh = msh
        V = fem.functionspace(msh, ("Lagrange", degrees[1], (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        self.stress = qs.materials.linear_elastic(self.u, E, NU, axisymmetric=True)
        work = ufl.inner(self.stress, qs.materials.strain(v, axisymmetric=True))
        weight = qs.materials.axisymmetric_weight(msh)
        self.F = weight * work * ufl.dx
        self.bcs = [fix(V, 0, facets_at(msh, 0, 0.0))]
        if of_ball:
            flat = measure(msh, facets_at(msh, 1, BALL))
            self.F += weight * LOAD / (np.pi * BALL**2) * v[1] * flat
        else:
            self.bcs.append(fix(V, 1, facets_at(msh, 1, -10.0)))
        self.surface = qs.Surface(V, facets=round_side, axisymmetric=True)
