"""Elastic half spaces, fine at the contact, cut off where the contact acts as a point force.

The outer boundary is displaced as in a half space under a point force (Boussinesq). This force is
the contact force, which is found by a few solves. The error of cutting off the half space is of the
order (a/L)³ of the approach, with the contact radius a and the radius L of the outer boundary.
"""

import itertools

from mpi4py import MPI

import numpy as np
from common.bodies import facets_at, fix, gmsh_mesh

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def point_force(r, depth, E, nu):
    """Return the displacement of a half space under a unit force: outwards and along the force."""
    distance = np.maximum(np.hypot(r, depth), 1e-30)
    outwards = r * depth / distance**3
    outwards = outwards - (1 - 2 * nu) * r / (distance * (distance + depth))
    along = depth**2 / distance**3 + 2 * (1 - nu) / distance
    factor = (1 + nu) / (2 * np.pi * E)
    return factor * outwards, factor * along


def quarter_disc(comm, sign, radius, size, marks=()):
    """Mesh triangles of degree 2 in the half plane (r, z): z < 0 with sign -1, z > 0 with sign 1.

    Args:
        comm: Communicator.
        sign: See above.
        radius: Radius of the outer boundary.
        size: Size of the cells at r, z.
        marks: Radii at which the surface must have vertices.
    """

    def draw(gmsh):
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        geo = gmsh.model.geo
        on_surface = [geo.addPoint(r, 0, 0) for r in (0, *marks, radius)]
        below = geo.addPoint(0, sign * radius, 0)
        lines = [geo.addLine(*pair) for pair in itertools.pairwise(on_surface)]
        lines.append(geo.addCircleArc(on_surface[-1], on_surface[0], below))
        lines.append(geo.addLine(below, on_surface[0]))
        geo.addPlaneSurface([geo.addCurveLoop(lines if sign > 0 else [-c for c in lines[::-1]])])
        geo.synchronize()
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, lc: size(x, y))

    return gmsh_mesh(comm, 2, draw)


def graded(reach, h, growth=0.2, edge=None, finest=None):
    """Return a cell size function: h up to the radius `reach`, then growing; finer at an edge.

    Args:
        reach: Radius.
        h: Size.
        growth: Growth of the size with the distance.
        edge: Radius of a point on the surface at which stresses are singular.
        finest: Size of the cells at this edge.
    """

    def size(r, z):
        away = h + growth * max(np.hypot(max(r - reach, 0), z) - 2 * h, 0)
        return away if edge is None else min(away, finest + growth * np.hypot(r - edge, z))

    return size


def axisymmetric(comm, sign, E, nu, radius, size, marks=(), **options):
    """Create a half space cut off at a radius; arguments as for quarter_disc and HalfSpace."""

    def outside(x):
        return np.isclose(np.hypot(x[0], x[1]), radius)

    msh = quarter_disc(comm, sign, radius, size, marks)
    return HalfSpace(msh, sign, E, nu, outside, **options)


class HalfSpace:
    """Form, unknowns, conditions and contact surface of a half space, axisymmetric or 3D quarter.

    Args:
        msh: A mesh of the part with positive coordinates, except the last one; flat at the top.
        sign: 1 above the contact, -1 below.
        E: Young's modulus.
        nu: Poisson's ratio.
        outside: Whether points are on the outer boundary.
        profile: Distance of the surface from the plane, a function of the coordinates; the mesh is
            moved by it.
        degree: Degree of the displacement.
        within: Radius of the contact surface, by default the whole surface.
    """

    def __init__(self, msh, sign, E, nu, outside, profile=None, degree=2, within=np.inf):
        self.mesh, self.sign, self.E, self.nu = msh, sign, E, nu
        self.axis = axis = msh.geometry.dim - 1
        ring = axis == 1
        touching = mesh.locate_entities_boundary(
            msh, axis, lambda x: np.isclose(x[axis], 0) & (x[0] < within + 1e-9)
        )
        planes = [facets_at(msh, i, 0.0) for i in range(axis)]
        outer = mesh.locate_entities_boundary(msh, axis, outside)
        self.V = V = fem.functionspace(msh, ("Lagrange", degree, (axis + 1,)))
        self._unit, self._far = fem.Function(V), fem.Function(V)
        self._unit.interpolate(self._displacement)
        if profile is not None:
            msh.geometry.x[:, axis] += sign * profile(msh.geometry.x.T)
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        # Constants, so that all cases have one form to compile.
        moduli = (fem.Constant(msh, value) for value in (E, nu))
        stress = qs.materials.linear_elastic(self.u, *moduli, axisymmetric=ring)
        work = ufl.inner(stress, qs.materials.gradient(v, axisymmetric=ring))
        if ring:
            work *= qs.materials.axisymmetric_weight(msh)
        self.F = work * ufl.dx
        self.bcs = [fix(V, i, facets) for i, facets in enumerate(planes)]
        self.bcs.append(fem.dirichletbc(self._far, fem.locate_dofs_topological(V, axis, outer)))
        self.surface = qs.Surface(V, facets=touching, axisymmetric=ring)

    def _displacement(self, x):
        """Return the displacement due to a unit force that pushes the body off the contact."""
        r = np.hypot(*x[:2]) if self.axis == 2 else x[0]
        outwards, along = point_force(r, np.abs(x[self.axis]), self.E, self.nu)
        across = x[: self.axis] / np.maximum(r, 1e-30) * outwards
        return np.vstack([across, self.sign * along[None]])

    def hold(self, force, approach=0.0):
        """Displace the outer boundary as by this force, and by the approach to the other body."""
        self._far.x.array[:] = force * self._unit.x.array
        self._far.x.array[self.axis :: self.axis + 1] -= self.sign * approach


def settle(problem, contact, force, parts=1):
    """Solve until the outer boundaries are displaced as by the contact force; return the force.

    Args:
        problem: The problem.
        contact: Its contact.
        force: Function of the force that displaces the outer boundaries.
        parts: Number of symmetric parts, of which the model is one.
    """
    given, found, before = 0.0, 0.0, None
    for _ in range(8):
        force(given)
        problem.solve()
        found = parts * abs(contact.force("slave")[-1])
        if abs(found - given) < 1e-6 * found:
            break
        after = (given, found)
        slope = (found - before[1]) / (given - before[0]) if before else 0.0
        given, before = (found - slope * given) / (1 - slope), after
    return found


def pressures(surface, contact, side):
    """Return the pressures at the nodes of a side on this rank. Collective."""
    t = surface.node_values(contact.traction(side))
    return -np.sum(t * surface.node_normal[:, : t.shape[1]], axis=1)


def value_at(surface, values, r):
    """Return the value at a radius, linear between the nodes of all ranks. Collective."""
    radii = surface.node_x[:, 0]
    radii, values = (np.concatenate(surface.comm.allgather(a)) for a in (radii, values))
    order = np.argsort(radii)
    return np.interp(r, radii[order], values[order])


def peak(surface, pressure):
    """Return the largest pressure at a node. Collective."""
    return surface.comm.allreduce(np.max(pressure, initial=0.0), op=MPI.MAX)


def moment_radius(surface, pressure, axis=None):
    """Return the radius of a Hertz pressure from its moment, √(5/2 ∫ p r² / ∫ p). Collective.

    Args:
        surface: Contact surface.
        pressure: Pressure at its nodes.
        axis: If given, return the half axis along this axis in 3D, √(5 ∫ p x² / ∫ p).
    """
    load, x = surface.node_area * pressure, surface.node_x[:, axis or 0]
    total, second = surface.comm.allreduce(np.array([load.sum(), load @ x**2]))
    return np.sqrt((2.5 if axis is None else 5.0) * second / total)
