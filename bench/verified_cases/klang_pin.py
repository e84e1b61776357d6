"""Klang's problem: a pin is pressed into one side of a bore.

Pin of R = 59.99 mm, bore of 60 mm, plate fixed at r = 1 m, plane stress, E = 2.1e11 Pa, ν = 0.3, μ
= 0.4, a force of 18.75e5 N/m on the axis of the pin. The references are pressures as a function of
the angle from the lowest point. Code_Aster's validation case SSNV127 (V6.04.127) read them from
Klang's solution in a paper of P. Alart and A. Curnier. The input of the test (ssnv127d, f) has the
geometry and the tolerances. It names nodes of a mesh of 3°, which we take as 0° to 51° in the same
order; its models slip from 27° to 33° on. Our model: half of the problem in one step as in
Code_Aster (in eight steps, pressures increase by up to 2 % and slip begins at 39°), triangles of
degree 1, facets of 0.75° (small: 3°) on the pin and 5/4 of this size on the bore, with both circles
as shapes of qs.elevate. The force is spread as a Gaussian of 3 mm, whereas in Code_Aster it acts
at a point; a Gaussian of 6 mm changes the pressures by 0.1 %.
"""

import itertools

import numpy as np
from common.bodies import facets_at, fix, gmsh_mesh, integral
from verified_cases.probes import along
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Pin in a bore with friction (Klang, SSNV127)"
FAR = 0.1

E, NU, MU, FORCE, SPREAD = 2.1e11, 0.3, 0.4, 9.375e5, 0.003
PIN, BORE, OUTER = 0.05999, 0.06, 1.0
#: Distance of the centres; the pin is 10 nm off the bore, so that no point is in contact at first.
DROP = 0.999e-5
#: Pressure (MPa) and tolerance of SSNV127, from 0° on in steps of 3°.
PRESSURES = (
    (17.813, 0.0054),
    (17.813, 0.0582),
    (17.750, 0.07),
    (17.688, 0.064),
    (17.594, 0.0562),
    (17.470, 0.05),
    (17.312, 0.033),
    (17.125, 0.0203),
    (16.906, 0.0107),
    (16.656, 0.034),
    (16.343, 0.041),
    (15.937, 0.012),
    (15.406, 0.011),
    (14.781, 0.024),
    (14.031, 0.02),
    (13.094, 0.023),
    (11.169, 0.115),
    (10.593, 0.053),
)


def add_arc(geo, centre, middle, r, size):
    """Add half a circle around (0, middle); return its three points, from below, and two arcs."""
    places = (0, middle - r), (r, middle), (0, middle + r)
    points = [geo.addPoint(x, y, 0, size) for x, y in places]
    return points, [geo.addCircleArc(a, centre, b) for a, b in itertools.pairwise(points)]


def create_mesh(radii, middle, n, comm):
    """Mesh the right half of a disc or a ring, with n facets on a quarter of the first circle."""

    def draw(gmsh):
        geo, h = gmsh.model.geo, np.pi / 2 * radii[0] / n
        centre = geo.addPoint(0, middle, 0, 2 * h)
        points, arcs = add_arc(geo, centre, middle, radii[0], h)
        for arc in arcs:
            geo.mesh.setTransfiniteCurve(arc, n + 1)
        if len(radii) == 1:
            loop = [*arcs, geo.addLine(points[2], centre), geo.addLine(centre, points[0])]
        else:
            far, outer = add_arc(geo, centre, middle, radii[1], np.pi / 20 * radii[1])
            ends = geo.addLine(far[2], points[2]), geo.addLine(points[0], far[0])
            loop = [*outer, ends[0], -arcs[1], -arcs[0], ends[1]]
        geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.synchronize()

    return gmsh_mesh(comm, 2, draw)


def body(radii, middle, n, comm):
    """Return the residual, displacement, conditions and contact surface of a body."""
    msh = create_mesh(radii, middle, n, comm)
    facets = [
        mesh.locate_entities_boundary(
            msh, 1, lambda x, r=r: np.isclose(np.hypot(x[0], x[1] - middle), r, rtol=1e-7)
        )
        for r in radii
    ]
    circle = qs.smooth.Cylinder([0.0, middle], None, radii[0])
    msh = qs.elevate(msh, facets=facets[0], shape=circle)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    plane_stress = E * (1 + 2 * NU) / (1 + NU) ** 2, NU / (1 + NU)
    dx = ufl.dx(domain=msh, degree=4)
    F = ufl.inner(qs.materials.linear_elastic(u, *plane_stress), ufl.grad(v)) * dx
    if len(radii) == 1:
        x = ufl.SpatialCoordinate(msh)
        spread = ufl.exp(-(x[0] ** 2 + (x[1] - middle) ** 2) / (2 * SPREAD**2))
        F += FORCE / integral(msh, spread * dx) * spread * v[1] * dx
    bcs = [fix(V, 0, facets_at(msh, 0, 0.0))]
    if len(radii) == 2:
        bcs += [fix(V, axis, facets[1]) for axis in (0, 1)]
    return F, u, bcs, qs.Surface(V, facets=facets[0])


def solve(n, comm):
    """Solve with n facets on a quarter of the pin; return the contact."""
    F, u, bcs, (slave, master) = zip(
        body([PIN], -DROP, n, comm), body([BORE, OUTER], 0.0, 4 * n // 5, comm), strict=True
    )
    contact = qs.Contact(slave, master, friction=qs.Coulomb(MU))
    qs.ContactProblem(F, u, [contact], bcs).solve()
    return contact


def run(small, comm):
    """Return rows of pressures and of the angle where slip begins."""
    contact = solve(30 if small else 120, comm)
    pin = contact.slave
    t, normal = pin.node_values(contact.traction("slave")), pin.node_normal[:, :2]
    pressure = -np.sum(t * normal, axis=1) / 1e6
    x, pressure, closed, slips = along(pin, pressure, contact.active(), contact.slipping())
    angle = np.degrees(np.arctan2(x[:, 0], -x[:, 1] - DROP))
    order = np.argsort(angle)
    ours = np.interp(3.0 * np.arange(len(PRESSURES)), angle[order], pressure[order])
    rows = [
        Row(f"pressure at {3 * k}° (MPa)", reference, ours[k], scatter, "SSNV127")
        for k, (reference, scatter) in enumerate(PRESSURES)
    ]
    first = np.min(angle[closed & slips & (angle > 1e-6)], initial=90.0)
    return [*rows, Row("angle from which it slips (°)", 30.0, first, 0.1, "SSNV127")]
