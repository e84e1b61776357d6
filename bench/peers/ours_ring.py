"""Run the half ring of ring.py with qsdolfinx: finite sliding, quasi-symmetric, overlay.

    python3 bench/peers/ours_ring.py --refine 1 --friction 0.2

Prints a table of the forces of the ring on the block, the displacements of ring.py's tracked nodes
and Newton iterations, and a line ``RESULT {json}``.
"""

import argparse
import json
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from mpi4py import MPI

import numpy as np
import ring

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs


class Body:
    """A body of ring.py or spring.py in DOLFINx, on one rank."""

    def __init__(self, given, moduli):
        self.given = given
        element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        cells = given.cells[:, [0, 1, 3, 2]].astype(np.int64)
        msh = self.mesh = mesh.create_mesh(
            MPI.COMM_WORLD, cells=cells, x=given.x, e=ufl.Mesh(element)
        )
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        stress = qs.materials.neo_hookean(self.u, *moduli)
        self.F = ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=3)
        self._form = fem.form(self.F)
        #: Nodes of the unknowns, in ring.py's numbering.
        x = V.tabulate_dof_coordinates()[:, :2]
        self.node = np.array([np.argmin(np.sum((x - p) ** 2, axis=1)) for p in given.x])
        self.ends = fem.Function(V)
        held = np.sort(self.node[given.held]).astype(np.int32)
        self.bcs = [fem.dirichletbc(self.ends, held)]

    def surface(self, edges):
        """Return the surface of the edges with these nodes."""
        msh, middle = self.V.mesh, self.given.x[edges].mean(axis=1)
        msh.topology.create_connectivity(1, 2)
        outer = mesh.exterior_facet_indices(msh.topology)
        found = mesh.compute_midpoints(msh, 1, outer)[:, :2]
        near = np.linalg.norm(found[:, None] - middle, axis=2).min(axis=1)
        return qs.Surface(self.V, facets=outer[near < 1e-9])

    def displacements(self):
        """Return the displacements of ring.py's nodes."""
        return self.u.x.array.reshape(-1, 2)[self.node]

    def forces(self):
        """Return the nodal forces of the stress."""
        b = fem.assemble_vector(self._form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array.reshape(-1, 2)[self.node]

    def reaction(self):
        """Return the force of the clamped nodes on the body."""
        return self.forces()[self.given.held].sum(axis=0)

    def tracked(self):
        """Return displacements by name."""
        u = self.displacements()
        return {name: u[n].tolist() for name, n in self.given.tracked.items()}


def run(p):
    """Run the path; return a row for each step."""
    made = {n: Body(given, ring.moduli(n)) for n, given in ring.bodies(p.refine).items()}
    upper, lower = made["ring"], made["block"]
    friction = qs.Coulomb(p.friction) if p.friction else None
    contact = qs.Contact(
        *(body.surface(body.given.touching) for body in (upper, lower)),
        formulation=p.formulation,
        friction=friction,
        sliding="finite",
        enforcement=p.enforcement,
    )
    bodies = list(made.values())
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )
    rows, start = [], time.perf_counter()
    for x, y in ring.path(not p.pressing_only):
        upper.ends.x.array[:] = np.tile([x, y], len(upper.ends.x.array) // 2)
        problem.solve()
        along, down = -lower.reaction()
        rows.append(
            {
                "end": [x, y],
                "down": -down,
                "along": along,
                "newton": problem.num_iterations,
                "updates": problem.num_augmentations,
                "balance": np.abs(upper.reaction() + lower.reaction()).max(),
                "tracked": upper.tracked() | lower.tracked(),
            }
        )
        row = rows[-1]
        print(
            f"{x:6.2f}{y:7.2f}{row['down']:10.4f}{row['along']:9.4f}"
            f"{row['tracked']['ring_outside'][1]:10.5f}{row['tracked']['block_middle'][1]:10.5f}"
            f"{row['newton']:5}{row['updates']:4}{row['balance']:9.0e}",
            flush=True,
        )
    return {"rows": rows, "seconds": time.perf_counter() - start}


def arguments(text):
    """Make a parser with the options of all our jobs."""
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--refine", type=int, default=1, help="refinement factor of all cells")
    add("--friction", type=float, default=0.0)
    add("--pressing-only", action="store_true")
    add("--formulation", default="quasi-symmetric")
    add("--enforcement", default="augmented-lagrangian")
    return parser


def main():
    parser = arguments(__doc__)
    p = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("on one rank")
    print("     x      y      down    along    ring y   block y    N  up  balance")
    result = run(p)
    print(f"{result['seconds']:.1f} s")
    print("RESULT", json.dumps(result, default=float))


if __name__ == "__main__":
    main()
