"""Make the blocks of the bridge bearing."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import facets_at

SIDE, BEYOND = 200.0, 40.0  # mm, edge of all blocks, and excess of the plate at each end
#: Range of each block along z (mm), and Young's moduli (MPa).
Z = {"pier": (-100.0, 0.0), "pad": (0.0, 20.0), "plate": (20.0, 60.0)}
YOUNG = {"pier": 3e4, "pad": 500.0, "plate": 2.1e5}
DOWN, ALONG, MU = 0.2, 20.0, {"pier": 0.4, "plate": 0.05}  # mm, mm, -


class Block:
    """A block of tetrahedra; the pier is fixed at its bottom, the plate is moved at its top.

    Args:
        comm: Communicator.
        name: Name of the block.
        cells: Number of cells along x and y.
    """

    def __init__(self, comm, name, cells):
        low, high = Z[name]
        beyond = BEYOND if name == "plate" else 0.0
        corners = [[-beyond, 0, low], [SIDE + beyond, SIDE, high]]
        n = [cells, cells, max(1, round(cells * (high - low) / SIDE))]
        self.mesh = mesh.create_box(comm, corners, n)
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (3,)))
        self.u, v = fem.Function(self.V), ufl.TestFunction(self.V)
        stress = qs.materials.linear_elastic(self.u, YOUNG[name], 0.0)
        self.F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
        at_ends = [facets_at(self.mesh, 2, z) for z in (low, high)]
        self.lower, self.upper = (qs.Surface(self.V, facets=facets) for facets in at_ends)
        #: Face in contact with the pad, and displacement of the opposite face.
        self.face = self.lower if name == "plate" else self.upper
        self.moved = fem.Constant(self.mesh, np.zeros(3))
        self.bcs = []
        if name != "pad":
            held = fem.locate_dofs_topological(self.V, 2, at_ends[name == "plate"])
            self.bcs = [fem.dirichletbc(self.moved, held, self.V)]
