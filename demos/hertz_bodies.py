"""Meshes and elastic bodies of demos/hertz.py and demos/cattaneo_mindlin.py."""

import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.compat import model_to_mesh

E, NU, R, LOAD, SIZE = 200.0, 0.3, 8.0, 10.0, 20.0
E_STAR = E / (2 * (1 - NU**2))


def create_mesh(comm, shape, sign, dim, h, a):
    """Part of a body with positive coordinates, apart from the last one; or a half disc.

    Args:
        comm: Communicator.
        shape: "round": quarter disc or an eighth of a ball; "half disc"; "block".
        sign: 1 above the contact, -1 below.
        dim: 2 or 3.
        h: Size of the cells at the contact.
        a: Radius of the contact; the cells keep their size up to 1.6 a, and then grow.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    if comm.rank == 0:
        occ, low = gmsh.model.occ, (0 if sign > 0 else -SIZE)
        if shape == "block":
            half = SIZE / 2
            if dim == 2:
                occ.addRectangle(0, low, 0, half, SIZE)
            else:
                occ.addBox(0, 0, low, half, half, SIZE)
        elif dim == 2:
            body = [(2, occ.addDisk(0, sign * R, 0, R, R))]
            left = -R if shape == "half disc" else 0
            tool = [(2, occ.addRectangle(left, 0 if sign > 0 else -R, 0, R - left, R))]
            occ.intersect(body, tool)
        else:
            body = [(3, occ.addSphere(0, 0, sign * R, R))]
            tool = [(3, occ.addBox(0, 0, 0 if sign > 0 else -R, R, R, R))]
            occ.intersect(body, tool)
        origin = occ.addPoint(0, 0, 0)
        occ.synchronize()
        field = gmsh.model.mesh.field
        field.add("Distance", 1)
        field.setNumbers(1, "PointsList", [origin])
        field.add("Threshold", 2)
        slope = 0.15 if dim == 2 else 0.3
        reach = 1.6 * a if dim == 2 else 1.3 * a
        for name, value in (
            ("InField", 1),
            ("SizeMin", h),
            ("SizeMax", h + slope * SIZE),
            ("DistMin", reach),
            ("DistMax", reach + SIZE),
        ):
            field.setNumber(2, name, value)
        field.setAsBackgroundMesh(2)
        gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)], 1)
        gmsh.model.mesh.generate(dim)
    out = model_to_mesh(gmsh.model, comm, 0, gdim=dim)[0]
    gmsh.finalize()
    return out


class Body:
    """An elastic body with a contact surface, and symmetry conditions unless it is a half disc."""

    def __init__(self, msh, shape, sign):
        self.mesh, self.dim = msh, msh.geometry.dim
        self.V = fem.functionspace(msh, ("Lagrange", 1, (self.dim,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        strain = ufl.sym(ufl.grad(self.u))
        stress = (
            E / (1 + NU) * (strain + NU / (1 - 2 * NU) * ufl.tr(strain) * ufl.Identity(self.dim))
        )
        self.F = ufl.inner(stress, ufl.grad(self.v)) * ufl.dx
        self.bcs = [
            self.condition(axis, self.facets(lambda x, a=axis: np.isclose(x[a], 0)))
            for axis in range(self.dim - 1 if shape != "half disc" else 0)
        ]
        up = self.dim - 1
        if shape == "block":
            contact = self.facets(lambda x: np.isclose(x[up], 0))
            self.far = self.facets(lambda x: np.isclose(x[up], sign * SIZE))
        else:

            def on_arc(x):
                squares = sum(x[i] ** 2 for i in range(up)) + (x[up] - sign * R) ** 2
                return np.isclose(squares, R**2)

            contact = self.facets(on_arc)
            self.far = self.facets(lambda x: np.isclose(x[up], sign * R))
        self.surface = qs.Surface(self.V, facets=contact)
        self.ds = self.measure(contact)

    def facets(self, where):
        """Boundary facets with all vertices where a function of x says."""
        return mesh.locate_entities_boundary(self.mesh, self.dim - 1, where)

    def measure(self, facets):
        """Measure on some facets."""
        facets = np.sort(facets)
        tags = mesh.meshtags(self.mesh, self.dim - 1, facets, np.ones_like(facets))
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)

    def condition(self, axis, facets):
        """No displacement along an axis."""
        V = self.V.sub(axis)
        return fem.dirichletbc(0.0, fem.locate_dofs_topological(V, self.dim - 1, facets), V)

    def hold(self):
        """Hold the far side."""
        self.bcs += [self.condition(axis, self.far) for axis in range(self.dim)]

    def pin(self, sign):
        """Hold one point of the far side along the load, which is in balance without it."""
        V = self.V.sub(self.dim - 1)
        dofs = fem.locate_dofs_geometrical(
            (V, V.collapse()[0]), lambda x: np.isclose(x[0], 0) & np.isclose(x[1], sign * R)
        )
        value = fem.Function(V.collapse()[0])
        self.bcs.append(fem.dirichletbc(value, dofs, V))

    def press(self, sign):
        """Load the far side by a uniform pressure."""
        ds = self.measure(self.far)
        area = fem.assemble_scalar(fem.form(fem.Constant(self.mesh, 1.0) * ds))
        area = self.mesh.comm.allreduce(area)
        load = LOAD / 2 ** (self.dim - 1) / area
        self.F += sign * load * self.v[self.dim - 1] * ds
