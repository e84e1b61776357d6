"""Elastic bodies with a round or a flat contact surface, and closed forms for them."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at, fix, gmsh_mesh, measure, per_area

E, NU, R, LOAD, SIZE = 200.0, 0.3, 8.0, 10.0, 20.0
E_STAR = E / (2 * (1 - NU**2))


class Hertz:
    """The closed form: half width or radius of the contact, and pressure.

    With a block a = 0.9628, p0 = 6.612 in 2D and a = 0.8173, p0 = 7.147 in 3D; with two cylinders
    a = 0.6808, p0 = 9.351.
    """

    def __init__(self, dim, case):
        radius = R if case == "block" else R / 2
        if dim == 2:
            self.a = np.sqrt(4 * LOAD * radius / (np.pi * E_STAR))
            self.p0 = 2 * LOAD / (np.pi * self.a)
        else:
            self.a = (3 * LOAD * radius / (4 * E_STAR)) ** (1 / 3)
            self.p0 = 3 * LOAD / (2 * np.pi * self.a**2)

    def pressure(self, r, sqrt=np.sqrt, larger=np.maximum):
        """Return the pressure at a distance from the middle, numbers or UFL."""
        return self.p0 * sqrt(larger(1 - (r / self.a) ** 2, 0))


class CattaneoMindlin:
    """The closed form for partial slip of two cylinders.

    Args:
        mu: Coefficient of friction.
        shear: Tangential load Q.
    """

    def __init__(self, mu, shear):
        hertz = Hertz(2, "cylinders")
        self.a, self.p0, self.normal = hertz.a, hertz.p0, hertz.pressure
        self.limit = mu * self.p0  # of the tangential traction
        self.c = self.a * np.sqrt(1 - shear / (mu * LOAD))

    def tangential(self, x):
        """Tangential traction at x."""
        root = np.sqrt(np.maximum(self.a**2 - x**2, 0)) - np.sqrt(np.maximum(self.c**2 - x**2, 0))
        return self.limit / self.a * root


def create_mesh(comm, shape, sign, dim, h, a):
    """Mesh the part of a body with positive coordinates, except the last one; or a half disc.

    Args:
        comm: Communicator.
        shape: "round": quarter disc or an eighth of a ball; "half disc"; "block".
        sign: 1 above the contact, -1 below.
        dim: 2 or 3.
        h: Size of the cells at the contact.
        a: Radius of the contact; the cells keep their size up to 1.6 a, and then grow.
    """

    def draw(gmsh):
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        occ, bottom = gmsh.model.occ, (0 if sign > 0 else -1)
        if shape == "block" and dim == 2:
            occ.addRectangle(0, bottom * SIZE, 0, SIZE / 2, SIZE)
        elif shape == "block":
            occ.addBox(0, 0, bottom * SIZE, SIZE / 2, SIZE / 2, SIZE)
        elif dim == 2:
            left = -R if shape == "half disc" else 0
            tool = occ.addRectangle(left, bottom * R, 0, R - left, R)
            occ.intersect([(2, occ.addDisk(0, sign * R, 0, R, R))], [(2, tool)])
        else:
            tool = occ.addBox(0, 0, bottom * R, R, R, R)
            occ.intersect([(3, occ.addSphere(0, 0, sign * R, R))], [(3, tool)])
        origin = occ.addPoint(0, 0, 0)
        occ.synchronize()
        slope, reach = (0.15, 1.6 * a) if dim == 2 else (0.3, 1.3 * a)
        sizes = {"SizeMin": h, "SizeMax": h + slope * SIZE}
        sizes |= {"DistMin": reach, "DistMax": reach + SIZE}
        field = gmsh.model.mesh.field
        field.add("Distance", 1)
        field.setNumbers(1, "PointsList", [origin])
        field.add("Threshold", 2)
        for name, value in ({"InField": 1} | sizes).items():
            field.setNumber(2, name, value)
        field.setAsBackgroundMesh(2)

    return gmsh_mesh(comm, dim, draw)


def create_half_discs(comm, sizes, a):
    """Create the upper and the lower half disc, with given cell sizes at a contact of half width a.

    The lower half disc is held at points, which carry no force.
    """
    upper, lower = (
        Body(create_mesh(comm, "half disc", sign, 2, h, a), "half disc", sign)
        for sign, h in zip((1, -1), sizes, strict=True)
    )
    for axis, side in ((0, -1), (1, -1), (1, 1)):
        lower.pin(axis, side * R, -R)
    return upper, lower


class Body:
    """An elastic body with a contact surface, and symmetry conditions unless it is a half disc."""

    def __init__(self, msh, shape, sign):
        self.mesh, self.dim, self.sign = msh, msh.geometry.dim, sign
        self.V = fem.functionspace(msh, ("Lagrange", 1, (self.dim,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        stress = qs.materials.linear_elastic(self.u, E, NU)
        self.F = ufl.inner(stress, ufl.grad(self.v)) * ufl.dx
        up = self.dim - 1
        symmetric = range(up if shape != "half disc" else 0)
        self.bcs = [fix(self.V, axis, facets_at(msh, axis, 0.0)) for axis in symmetric]
        #: Number of symmetric parts, one of which is modelled.
        self.parts = 2 ** len(symmetric)
        self.far = facets_at(msh, up, sign * (SIZE if shape == "block" else R))
        if shape == "block":
            contact = facets_at(msh, up, 0.0)
        else:

            def on_arc(x):
                squares = sum(x[i] ** 2 for i in range(up)) + (x[up] - sign * R) ** 2
                return np.isclose(squares, R**2)

            contact = mesh.locate_entities_boundary(msh, up, on_arc)
        self.surface = qs.Surface(self.V, facets=contact)
        #: Measures on the contact surface and on the far side.
        self.ds, self.far_ds = measure(msh, contact), measure(msh, self.far)

    def hold(self):
        """Hold the far side."""
        self.bcs += [fix(self.V, axis, self.far) for axis in range(self.dim)]

    def pin(self, axis, *point):
        """Hold one point along an axis in which the loads balance."""
        component = self.V.sub(axis), self.V.sub(axis).collapse()[0]
        dofs = fem.locate_dofs_geometrical(
            component,
            lambda x: np.all([np.isclose(x[i], at) for i, at in enumerate(point)], axis=0),
        )
        self.bcs.append(fem.dirichletbc(fem.Function(component[1]), dofs, component[0]))

    def press(self, sign):
        """Load the far side by a uniform pressure, LOAD in total on the whole body."""
        pressure = per_area(self.mesh, LOAD / self.parts, self.far_ds)
        self.F += sign * pressure * self.v[self.dim - 1] * self.far_ds

    def press_and_shear(self, force, tilting):
        """Load the flat of a half disc by a pressure, and by a traction along x.

        The traction is uniform, with the given total force, opposite to that of the other body. A
        linear pressure balances its moment about the contact, unless the body may tilt.

        Returns:
            Load factor of the traction, 0 at first.
        """
        self.press(self.sign)
        factor = fem.Constant(self.mesh, 0.0)
        q, ds = factor * force / (2 * R), self.far_ds
        self.F -= self.sign * q * self.v[0] * ds
        if not tilting:
            self.F -= 3 * q * ufl.SpatialCoordinate(self.mesh)[0] / R * self.v[1] * ds
        return factor
