"""Bodies of the curved beams demo: two arches, each the point reflection of the other."""

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import Reaction, facets_at, integral

#: 2 × 2 points in each cell; UFL would take many more for the logarithm.
DX = ufl.dx(degree=3)

E, NU = 1.0, 0.3
MU, LAMBDA = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
INNER, OUTER = 8.0, 10.0  # radii
#: Length of a cell over its height on the middle line; contact needs finer facets than bending.
ASPECT = 0.6


def create_half_ring(comm, n, centre, side):
    """Create a mesh of quadrilaterals, symmetric about the vertical through the centre.

    Args:
        comm: Communicator.
        n: Cells across.
        centre: Of the circles.
        side: 1: the arch is above its centre; −1: below.
    """
    x, cells = np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64)
    if comm.rank == 0:
        around = round(np.pi / 2 * (INNER + OUTER) / ASPECT / (OUTER - INNER) * n)
        r = np.linspace(INNER, OUTER, n + 1)
        angle = np.linspace(0, np.pi, around + 1)[:, None]
        ring = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)
        x = centre + side * ring.reshape(-1, 2)
        node = np.arange(len(x)).reshape(around + 1, n + 1)
        corners = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
        cells = np.stack(corners, axis=-1).reshape(-1, 4)
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=x, e=ufl.Mesh(element))


class Beam:
    """A neo-Hookean half-ring with held ends, and with contact on its outside.

    Args:
        comm: Communicator.
        n: Cells across.
        centre: Of the circles.
        side: 1: the arch is above its centre; −1: below.
    """

    def __init__(self, comm, n, centre, side):
        msh = self.mesh = create_half_ring(comm, n, np.array(centre), side)
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.stress = qs.materials.neo_hookean(self.u, MU, LAMBDA)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(V))) * DX
        self._energy = fem.form(qs.materials.neo_hookean_energy(self.u, MU, LAMBDA) * DX)
        x, y = self.centre = centre
        outside = mesh.locate_entities_boundary(
            msh, 1, lambda points: np.isclose(np.hypot(points[0] - x, points[1] - y), OUTER)
        )
        self.surface = qs.Surface(V, facets=outside)
        self.facet_size = self.surface.facet_size_range[0]
        ends = facets_at(msh, 1, y)
        #: Displacement of the ends, and the force there.
        self.displacement = fem.Constant(msh, (0.0, 0.0))
        self.reaction = Reaction(self.F, V, ends)
        self.bcs = [fem.dirichletbc(self.displacement, fem.locate_dofs_topological(V, 1, ends), V)]

    def energy(self):
        """Elastic energy. Collective."""
        return integral(self.mesh, self._energy)

    def fibre_stress(self):
        """Cauchy stress along the beam, of UFL."""
        x, y = ufl.SpatialCoordinate(self.mesh)
        F = ufl.Identity(2) + ufl.grad(self.u)
        along = F * ufl.as_vector([self.centre[1] - y, x - self.centre[0]])
        stress = self.stress * F.T / ufl.det(F)
        return ufl.dot(along, stress * along) / ufl.dot(along, along)
