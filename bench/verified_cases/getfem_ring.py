"""An elastic half ring is pressed on a block and drawn along it, compared with GetFEM.

Neo-Hookean bodies, plane strain, quadrilaterals of degree 1, without friction and with Coulomb
friction, μ = 0.2 (`bench/peers/ring.py`). The reference is the result of GetFEM's large sliding
contact with ray tracing on the same meshes, as recorded in `bench/peers/README.md`
([Peers](peers.md)). The augmentation parameter, the quadrature and the choice of the slave in
GetFEM change the force on the coarse mesh by 0.3 %, which is the scatter. 1161 and 2037 nodes
(small run: 325 and 539). Our model: quasi-symmetric, overlay, augmented Lagrangian, finite sliding.
The displacement is the y displacement of the lowest node of the ring; its difference is relative to
the displacement of the ends. The difference of the force along the block is relative to the force
down.
"""

import pathlib
import sys

import numpy as np
from verified_cases.row import Row

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "peers"))

import ring

TITLE = "Half ring on a block (GetFEM)"
FAR = 0.01

#: Results of GetFEM by refinement and friction, and by displacement of the ends: force down, force
#: along, y displacement of the lowest node of the ring.
RECORDED = {
    (1, 0.2): {
        (0.0, -0.2): (8.1214, 0.0, -0.01431),
        (0.0, -0.4): (23.0443, 0.0, -0.00404),
        (0.15, -0.4): (21.8130, 4.3198, -0.00356),
    },
    (2, 0.0): {
        (0.0, -0.2): (7.7469, 0.0, -0.01292),
        (0.0, -0.4): (21.2080, 0.0, -0.00178),
        (0.3, -0.4): (21.1768, -0.0127, -0.00184),
    },
    (2, 0.2): {
        (0.0, -0.2): (7.9153, 0.0, -0.01394),
        (0.0, -0.4): (22.2588, 0.0, -0.00378),
        (0.15, -0.4): (20.9291, 4.1398, -0.00338),
        (0.3, -0.4): (20.9228, 4.1378, -0.00342),
    },
}
SCATTER = {1: 0.003, 2: 0.0}
SOURCE = "GetFEM, `bench/peers/README.md`"


class Body:
    """The ring or the block of ring.py, on any number of ranks.

    Args:
        comm: Communicator.
        name: "ring" or "block".
        refine: Refinement of all cells.
    """

    def __init__(self, comm, name, refine):
        given = ring.bodies(refine)[name]
        element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        cells = given.cells[:, [0, 1, 3, 2]].astype(np.int64)
        here = slice(None) if comm.rank == 0 else slice(0)
        self.mesh = msh = mesh.create_mesh(
            comm, cells=cells[here], x=given.x[here], e=ufl.Mesh(element)
        )
        self.V = V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        stress = qs.materials.neo_hookean(self.u, *ring.moduli(name))
        self.F = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=3)
        self.moved = fem.Constant(msh, (0.0, 0.0))
        held = self.nodes(given.x[given.held])
        self.bcs = [fem.dirichletbc(self.moved, held, V)]
        edges = given.x[given.touching].mean(axis=1)
        msh.topology.create_connectivity(1, 2)
        outer = mesh.exterior_facet_indices(msh.topology)
        middle = mesh.compute_midpoints(msh, 1, outer)[:, :2]
        near = np.linalg.norm(middle[:, None] - edges, axis=2).min(axis=1)
        self.surface = qs.Surface(V, facets=outer[near < 1e-9])
        self.tracked = {n: self.nodes(given.x[[i]]) for n, i in given.tracked.items()}

    def nodes(self, points):
        """Return the nodes of the unknowns at some points, on this rank with its ghosts."""

        def near(x):
            return np.linalg.norm(x[:2].T[:, None] - points, axis=2).min(axis=1) < 1e-9

        return fem.locate_dofs_geometrical(self.V, near)

    def displacement(self, name):
        """Return the displacement of a tracked node. Collective."""
        u = self.u.x.array.reshape(-1, 2)[self.tracked[name]]
        return np.concatenate(self.mesh.comm.allgather(u))[0]


def solve(comm, refine, friction):
    """Return the rows for one table of GetFEM."""
    upper, lower = (Body(comm, name, refine) for name in ("ring", "block"))
    contact = qs.Contact(
        upper.surface,
        lower.surface,
        friction=qs.Coulomb(friction) if friction else None,
        sliding="finite",
    )
    problem = qs.ContactProblem(
        [upper.F, lower.F], [upper.u, lower.u], [contact], [upper.bcs, lower.bcs]
    )
    recorded, rows = RECORDED[refine, friction], []
    for x, y in ring.path():
        upper.moved.value = (x, y)
        problem.solve()
        at = round(x, 6), round(y, 6)
        if at not in recorded:
            continue
        along, down = contact.force("slave") * (-1, 1)
        theirs = recorded[at]
        name = f"μ = {friction}, ends at ({x:.2f}, {y:.2f}): "
        lowest = upper.displacement("ring_outside")[1]
        rows.append(Row(name + "force down", theirs[0], down, SCATTER[refine], SOURCE))
        if theirs[1]:
            rows.append(Row(name + "force along", theirs[1], along, 0.0, SOURCE, of=theirs[0]))
        rows.append(Row(name + "displacement", theirs[2], lowest, 0.0, SOURCE, of=y))
        if at == list(recorded)[-1]:
            break
    return rows


def run(small, comm):
    """Rows of the case."""
    if small:
        return solve(comm, 1, 0.2)
    return solve(comm, 2, 0.0) + solve(comm, 2, 0.2)
