"""Newton iterations of unilateral contact with PETSc's line searches: why full steps are default.

A curved punch (slave, coarser) comes down on a block, by a displacement or a pressure of its top,
with and without an initial gap, with a moderate and a very stiff penalty. Printed are the
iterations until convergence for each line search, without the second attempt that ContactProblem
makes after a failure; "-" means no convergence in 50 iterations.

    python3 bench/line_search.py
"""

import itertools

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

COMM = MPI.COMM_WORLD
E, NU, PRESSURE, STROKE, RADIUS = 200.0, 0.3, 10.0, 0.2, 8.0
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
SEARCHES = ("basic", "l2", "bt", "cp")


class Body:
    """Make an elastic body in plane strain, a rectangle between two corners."""

    def __init__(self, cells, low, high):
        quadrilateral = mesh.CellType.quadrilateral
        self.mesh = mesh.create_rectangle(COMM, [low, high], cells, quadrilateral)
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        eps = ufl.sym(ufl.grad(self.u))
        sigma = E / (1 + NU) * (eps + NU / (1 - 2 * NU) * ufl.tr(eps) * ufl.Identity(2))
        self.F = ufl.inner(sigma, ufl.grad(self.v)) * ufl.dx

    def facets(self, y):
        return mesh.locate_entities_boundary(self.mesh, 1, lambda x: np.isclose(x[1], y))

    def clamp(self, facets, value):
        dofs = fem.locate_dofs_topological(self.V, 1, facets)
        return fem.dirichletbc(np.array(value, dtype=float), dofs, self.V)

    def guide(self, facets):
        V = self.V.sub(0)
        return fem.dirichletbc(0.0, fem.locate_dofs_topological(V, 1, facets), V)


def iterations(formulation, penalty, load, gap, search):
    """Return the iterations until convergence, or None."""
    block, punch = Body([60, 20], [-4, -4], [4, 0]), Body([30, 10], [-3, 0], [3, 3])
    bottom, top = punch.facets(0.0), punch.facets(3.0)
    x = punch.mesh.geometry.x
    x[:, 1] += x[:, 0] ** 2 / (2 * RADIUS) * (1 - x[:, 1] / 3) + gap
    if load == "stroke":
        condition = punch.clamp(top, [0, -gap - STROKE])
    else:
        condition = punch.guide(top)
        top = np.sort(top)
        tags = mesh.meshtags(punch.mesh, 1, top, np.full(len(top), 1, dtype=np.int32))
        ds = ufl.Measure("ds", domain=punch.mesh, subdomain_data=tags)
        punch.F += PRESSURE * punch.v[1] * ds(1)
    contact = qs.Contact(
        qs.Surface(punch.V, facets=bottom),
        qs.Surface(block.V, facets=block.facets(0.0)),
        formulation=formulation,
        law=qs.Unilateral(),
        penalty=penalty,
        search_radius=2.0,
        quadrature="nodal",
        enforcement="penalty",
    )
    bodies = (block, punch)
    problem = qs.ContactProblem(
        [b.F for b in bodies],
        [b.u for b in bodies],
        [contact],
        [[block.clamp(block.facets(-4.0), [0, 0])], [condition]],
        # Naming any line search, even the default one, prevents the second attempt.
        petsc_options={"snes_linesearch_type": search, "snes_max_it": 50},
    )
    try:
        problem.solve()
    except qs.ConvergenceError:
        return None
    return problem.snes.getIterationNumber()


def main():
    if COMM.rank == 0:
        print(f"{'formulation':17}{'ε':>8} {'load':>9}{'gap':>5}", *(f"{s:>6}" for s in SEARCHES))
    for case in itertools.product(FORMULATIONS, (2e5, 2e8), ("stroke", "pressure"), (0.0, 0.3)):
        counts = [iterations(*case, search) for search in SEARCHES]
        if COMM.rank == 0:
            text = " ".join(f"{'-' if c is None else c:>6}" for c in counts)
            print("{:17}{:8.0e} {:>9}{:5.1f} {}".format(*case, text), flush=True)


if __name__ == "__main__":
    main()
