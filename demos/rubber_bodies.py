"""The bodies of the rubber demo: an O-ring's section, and a sheet."""

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at, fix, gmsh_mesh, integral

#: Shear modulus, and Lamé's first parameter: Poisson's ratio is 0.49.
MU, LAMBDA = 1.0, 50.0
RADIUS = 1.0  # of the O-ring's section
LENGTH, HEIGHT, MARGIN = 260.0, 20.0, 40.0  # of the sheet, and of its part behind the roller


def two_rules(msh, degree):
    """Return measures of all cells: with enough points for some degree, and for one degree less.

    With two rules on one subdomain FFCx 0.9 would confuse a one-point rule with the other rule.
    """
    cells = np.arange(msh.topology.index_map(2).size_local, dtype=np.int32)
    dx = ufl.Measure("dx", msh, subdomain_data=[(1, cells), (2, cells)])
    return dx(1, degree=2 * degree + 1), dx(2, degree=degree)


class Rubber:
    """A nearly incompressible neo-Hookean body in plane strain.

    The pressure is integrated with fewer points than the rest, as many as elements of one degree
    less have: with all points the cells would lock.

    Args:
        msh: Mesh of the body.
        degree: Degree of the displacement.
        facets: Facets that may touch.
        held: Facets that are clamped, if any.
        lmbda: Lamé's first parameter.
        reduced: Whether the pressure is integrated with fewer points.
    """

    def __init__(self, msh, degree, facets, held=None, lmbda=LAMBDA, reduced=True):
        self.mesh = msh
        V = self.V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        u = self.u
        F = ufl.Identity(2) + ufl.grad(u)
        inverse = ufl.inv(F).T
        shear, pressure = MU * (F - inverse), lmbda * ufl.ln(ufl.det(F)) * inverse
        in_full, in_few = two_rules(msh, degree)
        self.F = ufl.inner(shear, ufl.grad(v)) * in_full
        self.F += ufl.inner(pressure, ufl.grad(v)) * (in_few if reduced else in_full)
        self.stress = (shear + pressure) * F.T / ufl.det(F)
        self.surface = qs.Surface(V, facets=facets)
        self.bcs = [] if held is None else [fix(V, axis, held) for axis in (0, 1)]
        self.facet_size = self.surface.facet_size_range[0]
        self.area = integral(msh, fem.Constant(msh, 1.0) * ufl.dx)
        self._moved = fem.form(u[0] * ufl.dx)

    def moved(self):
        """Mean displacement along x. Collective."""
        return integral(self.mesh, self._moved) / self.area


class MixedRubber:
    """The same body of degree 2, with a continuous unknown pressure of degree 1 (Taylor-Hood).

    ln J = p / λ holds in the mean around each vertex, not at each point, which avoids locking.

    Args:
        msh: Mesh of the body, with triangles.
        facets: Facets that may touch.
        lmbda: Lamé's first parameter.
    """

    def __init__(self, msh, facets, lmbda):
        self.mesh, cell = msh, msh.basix_cell()
        displacement = basix.ufl.element("Lagrange", cell, 2, shape=(2,))
        pressure = basix.ufl.element("Lagrange", cell, 1)
        W = fem.functionspace(msh, basix.ufl.mixed_element([displacement, pressure]))
        self.u, self.V = fem.Function(W), W.sub(0)
        (u, p), (v, q) = ufl.split(self.u), ufl.TestFunctions(W)
        F = ufl.Identity(2) + ufl.grad(u)
        inverse = ufl.inv(F).T
        stress = MU * (F - inverse) + p * inverse
        self.stress = stress * F.T / ufl.det(F)
        self.F = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=5)
        self.F += q * (ufl.ln(ufl.det(F)) - p / lmbda) * ufl.dx(degree=5)
        self.surface = qs.Surface(self.V, facets=facets)


def o_ring(comm, facet):
    """Create an O-ring's section: triangles of degree 2; the whole boundary may touch."""

    def draw(gmsh):
        gmsh.model.occ.addDisk(0, 0, 0, RADIUS, RADIUS)
        gmsh.model.occ.synchronize()
        for option in ("Mesh.MeshSizeMin", "Mesh.MeshSizeMax"):
            gmsh.option.setNumber(option, facet)

    msh = gmsh_mesh(comm, 2, draw)
    msh.topology.create_connectivity(1, 2)
    return Rubber(msh, 2, mesh.exterior_facet_indices(msh.topology))


def sheet(comm, facet):
    """Create a sheet, clamped below: quadrilaterals, twice as high as long, finer at the top."""
    n = round(LENGTH / facet), max(3, round(HEIGHT / (2 * facet)))
    corners = [(MARGIN - LENGTH, -HEIGHT), (MARGIN, 0.0)]
    msh = mesh.create_rectangle(comm, corners, n, mesh.CellType.quadrilateral)
    bottom, top = (facets_at(msh, 1, y) for y in (-HEIGHT, 0.0))
    y = msh.geometry.x[:, 1]
    msh.geometry.x[:, 1] = -HEIGHT * np.maximum(-y / HEIGHT, 0) ** 1.3
    return Rubber(msh, 1, top, held=bottom)
