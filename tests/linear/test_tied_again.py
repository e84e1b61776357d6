"""Tied contact with multigrid, solved again for other loads from its present multipliers."""

import numpy as np
import pytest
from scenes import Pair, clamp, largest, plane

from dolfinx import fem

import qsdolfinx as qs

#: Largest number of linear solver iterations: some 30 on triangles; up to twice as many on
#: hexahedra without a part of its preconditioner.
ITERATIONS = {"nodal": 40, "overlay": 60}
LOADS = ((0.0, -0.1), (0.02, -0.1), (-0.05, 0.1))


class Tied:
    """Two tied blocks; the top of the upper one is moved along x and up.

    The lower one is clamped on its bottom and on one side, up to a corner of the contact.
    """

    def __init__(self, cell, quadrature, solver):
        self.pair = pair = Pair(cell, n=(4, 3) if cell == "hexahedron" else (8, 6), wave=0.02)
        options = {"quadrature": quadrature, "enforcement": "augmented-lagrangian"}
        self.contact = pair.contact = qs.Contact(
            pair.slave, pair.master, law=qs.Tied(), penalty=20.0, **options
        )
        axis = pair.gdim - 1
        self.motion = fem.Constant(pair.meshes[1], np.zeros(pair.gdim))
        top = fem.locate_dofs_topological(pair.V[1], axis, plane(pair.meshes[1], axis, 1.0))
        pair.bcs[0].append(clamp(pair.V[0], plane(pair.meshes[0], 0, 0.0)))
        pair.bcs[1][:] = [fem.dirichletbc(self.motion, top, pair.V[1])]
        self.problem = pair.problem(solver=solver)

    def solve(self, load):
        self.motion.value[0], self.motion.value[-1] = load
        self.problem.solve()

    def results(self):
        """Return unknowns, multipliers and forces."""
        u = [u.x.array.copy() for u in self.pair.u]
        return [*u, self.contact.multiplier(), self.contact.force("slave")]


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_one_iteration_from_any_multipliers(cell, quadrature):
    """Unknowns and multipliers are one system: one iteration solves it from any multipliers."""
    scene = Tied(cell, quadrature, "amg")
    for i, load in enumerate(LOADS):
        scene.solve(load)
        assert scene.problem.num_iterations <= 2
        assert scene.problem.num_linear_iterations <= ITERATIONS[quadrature]
        found = scene.results()
        for solver in ("amg", "direct") if i else ():
            other = Tied(cell, quadrature, solver)  # starts without multipliers
            other.solve(load)
            for a, b in zip(found, other.results(), strict=True):
                assert largest(a - b) < 1e-5 * largest(b)
