"""Bodies of the shaft demo: two elastic rings, one pressed into the other."""

import typing

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

from common.bodies import integral

#: 2 × 2 points in each cell; UFL would take many more for the logarithm.
DX = ufl.dx(degree=3)

CELLS = ("quadrilateral", "triangle")
E_SHAFT, E_BORE, NU = 2.0, 1.0, 0.3
R = 1.0  # of the shaft
CORE, RIM = 0.3, 2.0  # radii at which shaft and bore are held
RATIO = 1.4  # facets of the bore for each of the shaft


def create_ring(comm, inner, outer, layers, n, cell, start):
    """Create a ring about the origin.

    Args:
        comm: Communicator.
        inner: Inner radius.
        outer: Outer radius.
        layers: Cells across.
        n: Cells around.
        cell: Name of their kind.
        start: Angle of the first node.
    """
    x, cells = np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64)
    if comm.rank == 0:
        r = np.linspace(inner, outer, layers + 1)[:, None]
        angle = start + 2 * np.pi * np.arange(n) / n
        x = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1).reshape(-1, 2)
        node = np.arange((layers + 1) * n).reshape(layers + 1, n)
        after = np.roll(node, -1, axis=1)
        cells = np.stack([node[:-1], after[:-1], node[1:], after[1:]], axis=-1).reshape(-1, 4)
    if cell == "triangle":
        cells = cells[:, [0, 1, 3, 0, 3, 2]].reshape(-1, 3)
    element = basix.ufl.element("Lagrange", cell, 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=x, e=ufl.Mesh(element))


class Load(typing.NamedTuple):
    """Load on some nodes of a body, at their deformed positions."""

    force: np.ndarray
    moment: float  # about the origin
    outwards: float  # sum of the radial forces
    radius: float  # mean radius of the nodes


class Body:
    """A neo-Hookean ring in contact at one radius and held at the other, where it can be turned.

    Args:
        comm: Communicator.
        E: Young's modulus.
        touching: Contact radius, mean over the facets.
        held: Radius at which the ring is held.
        n: Cells around.
        cell: Name of their kind.
        start: Angle of the first node.
    """

    def __init__(self, comm, E, touching, held, n, cell, start):
        #: Mean radius of facets over the radius of their vertices.
        self.chord = 1 - (np.pi / n) ** 2 / 3
        self.start = start
        touching /= self.chord
        inner, outer = sorted((touching, held))
        layers = max(2, round(n * (outer - inner) / (2 * np.pi * R)))
        msh = self.mesh = create_ring(comm, inner, outer, layers, n, cell, start)
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.stress = qs.materials.neo_hookean(self.u, *lame(E))
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(V))) * DX
        self.residual = fem.form(self.F)
        self._energy = fem.form(qs.materials.neo_hookean_energy(self.u, *lame(E)) * DX)
        facets = [
            mesh.locate_entities_boundary(msh, 1, lambda x, r=r: np.isclose(np.hypot(*x[:2]), r))
            for r in (touching, held)
        ]
        self.surface = qs.Surface(V, facets=facets[0])
        #: Nodes that touch and nodes that are held.
        self.touching, self.held = (fem.locate_dofs_topological(V, 1, f) for f in facets)
        self.displacement = fem.Function(V)
        self.bcs = [fem.dirichletbc(self.displacement, self.held)]

    def positions(self):
        """Return the positions of the nodes, ghosts included, shape (nodes, 2)."""
        return self.V.tabulate_dof_coordinates()[:, :2] + self.u.x.array.reshape(-1, 2)

    def turn(self, angle, by):
        """Hold the body at an angle, and rotate the first guess of the whole body."""
        x = self.V.tabulate_dof_coordinates()[:, :2]
        self.displacement.x.array[:] = (rotated(x, angle) - x).ravel()
        self.u.x.array[:] = (rotated(self.positions(), by) - x).ravel()

    def load(self, nodes):
        """Compute the external load on nodes: sums over their residuals. Collective."""
        b = fem.assemble_vector(self.residual)
        b.scatter_reverse(la.InsertMode.add)
        nodes = nodes[nodes < self.V.dofmap.index_map.size_local]
        f, x = b.array.reshape(-1, 2)[nodes], self.positions()[nodes]
        r = np.hypot(*x.T)
        moment, outwards = np.sum(x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]), np.sum(f * x / r[:, None])
        parts = [*f.sum(axis=0), moment, outwards, r.sum(), len(r)]
        *force, moment, outwards, total, number = self.mesh.comm.allreduce(np.array(parts))
        return Load(np.array(force), moment, outwards, total / number)

    def energy(self):
        """Elastic energy. Collective."""
        return integral(self.mesh, self._energy)


def rotated(x, angle):
    """Points turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, s], [-s, c]])


def create_bodies(comm, facets, cell, interference):
    """Create the shaft and the bore, which overlap by the interference.

    Args:
        comm: Communicator.
        facets: Number of facets of the shaft.
        cell: Name of the cell type.
        interference: Interference (length).
    """
    shaft = Body(comm, E_SHAFT, R, CORE, facets, cell, start=0.05)
    bore = Body(comm, E_BORE, R - interference, RIM, round(RATIO * facets), cell, start=0.0)
    return shaft, bore


# --- Closed forms, in small strains and plane strain


def lame(E):
    """Shear modulus and Lamé's first parameter."""
    return E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))


def lame_pressure(interference):
    """Pressure between the rings."""

    def compliance(E, held):  # u(R) over the radial stress there, u = A (r − held²/r)
        mu, lmbda = lame(E)
        square = (held / R) ** 2
        return R * (1 - square) / (2 * (lmbda + mu) + 2 * mu * square)

    return interference / (compliance(E_SHAFT, CORE) - compliance(E_BORE, RIM))


def slip_angle(friction, interference):
    """Compute the angle of the core at which the shaft slips, for a coefficient of friction."""
    torque = 2 * np.pi * R**2 * friction * lame_pressure(interference)
    return torque * sum(
        abs(1 / held**2 - 1 / R**2) / (4 * np.pi * lame(E)[0])
        for E, held in ((E_SHAFT, CORE), (E_BORE, RIM))
    )
