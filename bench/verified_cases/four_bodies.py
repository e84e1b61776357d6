"""Two balls on top of each other between two plates, held only by their three contacts.

Balls of R = 5 mm (above) and 10 mm, an upper plate of R = 10 mm, 2 mm thick, a lower plate of 20 mm
and 4 mm, axisymmetric, E = 200000 MPa, ν = 0.3, no friction. The rim of the lower plate is fixed,
and the top of the upper plate is moved down by 2 mm. The references are means of Abaqus, Systus and
Samcef in Code_Aster's validation case SSNA102 (V6.01.102), with its tolerances. Rows with "again"
have the values of the axisymmetric models of Code_Aster as the reference, with the spread of these
values. The input of Code_Aster (ssna102a) has the geometry; there the poles of the balls are tied
to the bodies that they touch, whereas they are free here. Our model: triangles of degree 2 on
straight facets, small strains as in the reference, cells of 0.1 mm (small: 0.3 mm) at the contacts,
contact detection once.
"""

import itertools

import numpy as np
from common.bodies import facets_at, fix, gmsh_mesh
from verified_cases.probes import at_node
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Four bodies, three contacts, axisymmetric (SSNA102)"
FAR = 0.05

E, NU = 200000.0, 0.3
#: Lowest and highest z of each body, from below; radius for plates, None for balls.
BODIES = ((0.0, 4.0, 20.0), (4.0, 24.0, None), (24.0, 34.0, None), (34.0, 36.0, 10.0))
POLES = (4.0, 24.0, 34.0)


def create_mesh(low, high, radius, h, comm):
    """Create a mesh with cells of size h around the poles that touch, growing away from them."""

    def draw(gmsh):
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        occ, ball = gmsh.model.occ, (high - low) / 2
        box = occ.addRectangle(0, low, 0, radius or ball, high - low)
        if radius is None:
            occ.intersect([(2, occ.addDisk(0, low + ball, 0, ball, ball))], [(2, box)])
        points = [occ.addPoint(0, z, 0) for z in POLES if low <= z <= high]
        occ.synchronize()
        field = gmsh.model.mesh.field
        field.add("Distance", 1)
        field.setNumbers(1, "PointsList", points)
        field.add("MathEval", 2)
        field.setString(2, "F", f"Min({h} + 0.2 * Max(F1 - 2.5, 0), {4 * h} + 0.3)")
        field.setAsBackgroundMesh(2)

    return gmsh_mesh(comm, 2, draw)


class Body:
    """A body with its residual, conditions, and its lower and upper surface."""

    def __init__(self, low, high, radius, h, comm, degree=2):
        msh = create_mesh(low, high, radius, h, comm)
        V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        stress = qs.materials.linear_elastic(self.u, E, NU, axisymmetric=True)
        power = ufl.inner(stress, qs.materials.gradient(v, axisymmetric=True))
        self.F = power * qs.materials.axisymmetric_weight(msh) * ufl.dx(degree=5)
        self.bcs = [fix(V, 0, facets_at(msh, 0, 0.0))]
        if radius == 20.0:
            self.bcs += [fix(V, axis, facets_at(msh, 0, radius)) for axis in (0, 1)]
        elif radius == 10.0:
            self.bcs.append(fix(V, 1, facets_at(msh, 1, high), -2.0))
        self.surfaces = []
        for end in (low, high):
            if radius is None:
                side = mesh.locate_entities_boundary(
                    msh, 1, lambda x, z=end: on_half(x, low, high, z)
                )
            else:
                side = facets_at(msh, 1, end)
            self.surfaces.append(qs.Surface(V, facets=side, axisymmetric=True))


def on_half(x, low, high, z):
    """Whether points are on the lower or the upper half of a ball's circle."""
    middle, ball = (low + high) / 2, (high - low) / 2
    on = np.isclose(np.hypot(x[0], x[1] - middle), ball)
    return on & ((x[1] - middle) * (z - middle) >= -1e-9)


def run(small, comm):
    """Return rows of displacement and force."""
    bodies = [Body(*body, 0.3 if small else 0.1, comm) for body in BODIES]
    contacts = [
        qs.Contact(lower.surfaces[1], upper.surfaces[0])
        for lower, upper in itertools.pairwise(bodies)
    ]
    F, u, bcs = zip(*((body.F, body.u, body.bcs) for body in bodies), strict=True)
    qs.ContactProblem(F, u, contacts, bcs).solve()
    deflection = at_node(u[0], (0.0, 0.0))[1]
    force = contacts[0].force("master")[1] / (2 * np.pi)
    return [
        Row("u_z of the lower plate (mm)", -0.81, deflection, 0.04, "SSNA102"),
        Row("force per radian (N)", 17229.58, force, 0.016, "SSNA102"),
        Row("u_z of the lower plate (mm), again", -0.8413, deflection, 1.7e-4, "Code_Aster"),
        Row("force per radian (N), again", 17502.0, force, 4e-4, "Code_Aster"),
    ]
