"""The bodies of the ironing demo: a slab, and an indenter with a round edge."""

import math

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import Reaction, facets_at, integral

#: 2 × 2 points in each cell; UFL would take many more for the logarithm.
DX = ufl.dx(degree=3)

E_SLAB, E_INDENTER, NU = 1.0, 10.0, 0.3
HEIGHT = 1.0  # of the slab
WIDTH, THICKNESS, RADIUS = 1.6, 0.8, 4.0  # of the indenter and its edge
MARGIN = 3.0  # length of the slab beside the indenter, at the start and at the end


class Body:
    """A neo-Hookean rectangle, bent to a shape, with one edge in contact and the other held.

    Args:
        comm: Communicator.
        E: Young's modulus.
        n: Cells along x and y.
        corners: The lower left and the upper right corner.
        shape: Maps x, y to the shape.
        contact: Edge in contact: 0 the lower, 1 the upper.
    """

    def __init__(self, comm, E, n, corners, shape, contact):
        msh = self.mesh = mesh.create_rectangle(comm, corners, n, mesh.CellType.quadrilateral)
        edges = [facets_at(msh, 1, y) for _, y in corners]
        msh.geometry.x[:, :2] = np.column_stack(shape(*msh.geometry.x.T[:2]))
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        lame = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
        self.stress = qs.materials.neo_hookean(self.u, *lame)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(V))) * DX
        self._energy = fem.form(qs.materials.neo_hookean_energy(self.u, *lame) * DX)
        self.surface = qs.Surface(V, facets=edges[contact])
        #: Displacement of the held edge, and the force there.
        self.displacement = fem.Constant(msh, (0.0, 0.0))
        self.reaction = Reaction(self.F, V, edges[1 - contact])
        held = fem.locate_dofs_topological(V, 1, edges[1 - contact])
        self.bcs = [fem.dirichletbc(self.displacement, held, V)]

    def energy(self):
        """Elastic energy. Collective."""
        return integral(self.mesh, self._energy)


def create_bodies(comm, h, ratio, slide):
    """Create the indenter, at the start of its slide, and the slab.

    Args:
        comm: Communicator.
        h: Facet size of the slab.
        ratio: Facet size of the indenter over h.
        slide: Length of the slide.
    """
    n = math.ceil((slide + WIDTH + 2 * MARGIN) / h)
    slab = Body(
        comm,
        E_SLAB,
        [n, max(3, round(0.7 * HEIGHT / h))],
        [(0.0, -HEIGHT), (n * h, 0.0)],
        lambda x, y: (x, -HEIGHT * (-y / HEIGHT) ** 1.4),  # finer towards the contact
        contact=1,
    )
    start = (n * h - slide) / 2
    m = round(WIDTH / (ratio * h))
    width = m * ratio * h  # facets of exactly this size; nearly WIDTH

    def rounded(x, y):
        low = RADIUS - np.sqrt(RADIUS**2 - x**2)
        return start + x, low + (1 - low / THICKNESS) * y

    indenter = Body(
        comm,
        E_INDENTER,
        [m, max(3, round(0.7 * m * THICKNESS / WIDTH))],
        [(-width / 2, 0.0), (width / 2, THICKNESS)],
        rounded,
        contact=0,
    )
    return indenter, slab
