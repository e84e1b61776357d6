"""The body of the fold demo: a spring in the shape of a U."""

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import fix, integral
from common.drawing import node_values

#: 2 × 2 points in each cell; UFL would take many more for the logarithm.
DX = ufl.dx(degree=3)

E, NU = 1.0, 0.3
MU, LAMBDA = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
LEG, LENGTH = 1.0, 10.0  # thickness and length of the legs
BEND, RADIUS = 0.6, 2.0  # thickness of the bend, and its radius inside
TAPER = 3.0  # length on which the bend's thickness becomes the legs'
#: Length and radius of the inner rounding of the legs' ends; sharp edges would slip off each other.
ROUNDED, ROUNDING = 3.5, 10.0
#: Half the distance between the planes when they touch the undeformed spring.
OPEN = RADIUS + LEG


def points_of_strip(s, depth, longer):
    """Map points of a straight strip to the spring.

    Args:
        s: Distance from the middle along the inside, shape (n,).
        depth: From 0 inside to 1 outside, shape (m,).
        longer: Additional length of the lower leg, in which s is negative.

    Returns:
        Points, shape (n, m, 2).
    """
    quarter = RADIUS * np.pi / 2
    length = np.where(s < 0, LENGTH + longer, LENGTH)[:, None]
    along = np.abs(s)[:, None]
    along = along + np.maximum(along - quarter, 0) * (length / LENGTH - 1)
    part = np.clip((along - quarter) / TAPER, 0, 1)
    outside = BEND + (LEG - BEND) * part**2 * (3 - 2 * part)
    inside = np.maximum(along - quarter - length + ROUNDED, 0) ** 2 / (2 * ROUNDING)
    r = RADIUS + inside + depth * (outside - inside)
    angle = np.clip(s, -quarter, quarter)[:, None] / RADIUS
    x = np.maximum(along - quarter, 0) - r * np.cos(angle)
    return np.stack([x, r * np.sin(angle)], axis=-1)


def stations(n):
    """Return the positions of the cross-sections for n cells in the thickness of the legs."""
    quarter = RADIUS * np.pi / 2
    bend = np.linspace(0, quarter, round(n * (quarter + BEND)) + 1)
    leg = quarter + np.linspace(0, LENGTH, round(n * LENGTH) + 1)[1:]
    half = np.concatenate([bend, leg])
    return np.concatenate([-half[:0:-1], half])


class Spring:
    """A neo-Hookean spring, open to the right, symmetric about y = 0.

    Args:
        comm: Communicator.
        n: Cells across.
        longer: Additional length of the lower leg.
        touching: Part of the surface for self-contact, "boundary" or "inside".
    """

    def __init__(self, comm, n, longer, touching):
        s = stations(n)
        self.shape = len(s), n + 1
        x, cells = np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64)
        if comm.rank == 0:
            x = points_of_strip(s, np.linspace(0, 1, n + 1), longer).reshape(-1, 2)
            node = np.arange(len(x)).reshape(self.shape)
            corners = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
            cells = np.stack(corners, axis=-1).reshape(-1, 4)
        element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        msh = self.mesh = mesh.create_mesh(comm, cells=cells, x=x, e=ufl.Mesh(element))
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.stress = qs.materials.neo_hookean(self.u, MU, LAMBDA)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(V))) * DX
        self._energy = fem.form(qs.materials.neo_hookean_energy(self.u, MU, LAMBDA) * DX)
        for dim in (0, 1):
            msh.topology.create_connectivity(dim, 2)
        self.bcs = self._hold()
        facets = mesh.exterior_facet_indices(msh.topology)
        self.boundary = self.surface = qs.Surface(V, facets=facets)
        if touching == "inside":
            nodes = self.numbers()[mesh.entities_to_geometry(msh, 1, facets)]
            self.surface = qs.Surface(V, facets=facets[np.all(nodes % (n + 1) == 0, axis=1)])
        self.facet_size = self.boundary.facet_size_range[0]

    def _hold(self):
        """Hold the middle of the bend on y = 0, and fix its inner node.

        In a symmetric state these conditions carry no force.
        """
        middle = mesh.locate_entities(self.mesh, 1, lambda x: np.isclose(x[1], 0))
        inside = mesh.locate_entities(
            self.mesh, 0, lambda x: np.isclose(x[1], 0) & np.isclose(x[0], -RADIUS)
        )
        V_x = self.V.sub(0)
        dof = fem.locate_dofs_topological(V_x, 0, inside)
        return [fix(self.V, 1, middle), fem.dirichletbc(0.0, dof, V_x)]

    def numbers(self):
        """Return the original numbers, along the strip, of the nodes of the mesh."""
        return self.mesh.geometry.input_global_indices

    def energy(self):
        """Elastic energy. Collective."""
        return integral(self.mesh, self._energy)

    def fibre_stress(self):
        """Cauchy stress along the spring, of UFL."""
        x, y = ufl.SpatialCoordinate(self.mesh)
        F = ufl.Identity(2) + ufl.grad(self.u)
        in_bend = ufl.lt(x, 0)
        along = F * ufl.as_vector([ufl.conditional(in_bend, -y, 1), ufl.conditional(in_bend, x, 0)])
        stress = self.stress * F.T / ufl.det(F)
        return ufl.dot(along, stress * along) / ufl.dot(along, along)

    def asymmetry(self):
        """Compute the largest difference of displacements to their mirror image. Collective."""
        own = self.mesh.geometry.index_map().size_local
        u = np.zeros((self.shape[0] * self.shape[1], 2))
        u[self.numbers()[:own]] = node_values(self.u)[:own]
        u = self.mesh.comm.allreduce(u).reshape(*self.shape, 2)
        return np.abs(u - u[::-1] * [1, -1]).max()
