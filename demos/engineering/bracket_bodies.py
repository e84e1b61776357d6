"""Make the bracket of docs/howto/bracket.md, whole or in parts, one half of its width."""

import math

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at, fix, gmsh_mesh, integral, measure, per_area

LEG, THICK, HALF_WIDTH, FILLET, CUT = 40.0, 8.0, 8.0, 4.0, 16.0  # mm; CUT: where the corner ends
BOLT, AT = 3.0, 30.0  # mm, radius and height of the bolt
LOAD, E, NU = 1e3, 2.1e5, 0.3  # N, MPa
CENTRE = THICK + FILLET  # x and z of the axis of the fillet
#: Origin and size of the boxes that cut out the parts, in x and z.
PARTS = {
    "corner": (0.0, 0.0, CUT, CUT),
    "upright": (0.0, CUT, CUT, LEG),
    "shelf": (CUT, 0.0, LEG, CUT),
    "whole": (0.0, 0.0, LEG, LEG),
}


def part_mesh(comm, part, size):
    """Mesh a part with tetrahedra."""

    def draw(gmsh):
        occ = gmsh.model.occ
        outline = [(0, 0), (LEG, 0), (LEG, THICK), (CENTRE, THICK), (THICK, CENTRE), (THICK, LEG)]
        points = [occ.addPoint(x, 0, z) for x, z in [*outline, (0, LEG)]]
        middle = occ.addPoint(CENTRE, 0, CENTRE)
        pairs = list(zip(points, [*points[1:], points[0]], strict=True))
        curves = [occ.addLine(*pair) for pair in pairs]
        occ.remove([(1, curves[3])])
        curves[3] = occ.addCircleArc(pairs[3][0], middle, pairs[3][1])
        face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        solid = [entity for entity in occ.extrude([(2, face)], 0, HALF_WIDTH, 0) if entity[0] == 3]
        hole = [(3, occ.addCylinder(-1, 0, AT, THICK + 2, 0, 0, BOLT))]
        solid, _ = occ.cut(solid, hole)
        x, z, *more = PARTS[part]
        occ.intersect(solid, [(3, occ.addBox(x, 0, z, more[0], HALF_WIDTH, more[1]))])
        occ.remove([entity for entity in occ.getEntities(2)], recursive=False)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)

    return gmsh_mesh(comm, 3, draw)


class Part:
    """A part of the bracket, with the bolt's support and the load where the part has them.

    Args:
        comm: Communicator.
        part: Name of the part.
        size: Size of the cells (mm).
    """

    def __init__(self, comm, part, size):
        self.mesh = msh = part_mesh(comm, part, size)
        self.V = V = fem.functionspace(msh, ("Lagrange", 2, (3,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        self.stress = qs.materials.linear_elastic(self.u, E, NU)
        self.F = ufl.inner(self.stress, ufl.grad(v)) * ufl.dx
        self.bcs = [fix(V, 1, facets_at(msh, 1, 0.0))]
        if part in ("upright", "whole"):
            self.bcs += [fix(V, axis, around(msh, 1, AT, BOLT)) for axis in range(3)]
        if part in ("shelf", "whole"):
            self.end = measure(msh, facets_at(msh, 0, LEG))
            self.F += per_area(msh, LOAD / 2, self.end) * v[2] * self.end
        self.dofs = 3 * V.dofmap.index_map.size_global

    def surface(self, axis):
        """Return the contact surface at the end of the corner along an axis."""
        return qs.Surface(self.V, facets=facets_at(self.mesh, axis, CUT))

    def deflection(self):
        """Return the mean downward deflection of the loaded end. Collective."""
        area = integral(self.mesh, fem.Constant(self.mesh, 1.0) * self.end)
        return -integral(self.mesh, self.u[2] * self.end) / area

    def von_mises(self):
        """Return the von Mises stress, a UFL expression."""
        s = ufl.dev(self.stress)
        return ufl.sqrt(1.5 * ufl.inner(s, s))

    def fillet_stress(self):
        """Return von Mises stress along the fillet, averaged over half of its width. Collective.

        Returns:
            Angles from the shelf (degrees), and stresses (MPa): means over the 10° around each
                angle, in the middle half of the width.
        """
        x = ufl.SpatialCoordinate(self.mesh)
        angle = ufl.atan2(CENTRE - x[0], CENTRE - x[2])
        lowest, width = fem.Constant(self.mesh, 0.0), np.radians(10.0)
        inside = ufl.And(ufl.ge(angle, lowest), ufl.lt(angle, lowest + width))
        inside = ufl.conditional(ufl.And(inside, ufl.lt(x[1], HALF_WIDTH / 2)), 1.0, 0.0)
        ds = measure(self.mesh, around(self.mesh, 0, CENTRE, FILLET))(degree=8)
        forms = [fem.form(f * inside * ds) for f in (self.von_mises(), 1.0)]
        angles, stresses = np.arange(5.0, 90.0, 10.0), []
        for angle in angles:
            lowest.value = np.radians(angle) - width / 2
            stress, area = (integral(self.mesh, form) for form in forms)
            stresses.append(stress / area)
        return angles, np.array(stresses)


def around(msh, axis, z, radius):
    """Return boundary facets on a cylinder about (z, z), or (0, z), across x or y, and z."""
    middle = z if axis == 0 else 0.0
    return mesh.locate_entities_boundary(
        msh, 2, lambda x: np.isclose(np.hypot(x[axis] - middle, x[2] - z), radius, atol=1e-6)
    )


def beam_stress():
    """Return a beam's bending stress at the fillet's end, as von Mises stress in plane strain."""
    bending = 6 * LOAD * (LEG - CENTRE) / (2 * HALF_WIDTH * THICK**2)
    return math.sqrt(1 - NU + NU**2) * bending
