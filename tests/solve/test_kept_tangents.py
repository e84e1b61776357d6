"""Tangents that are kept for several iterations, and tangents that are assembled only once."""

import numpy as np
import pytest
from scenes import Pair, largest, plane

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.solve import newton


class Rubber(Pair):
    """Two neo-Hookean blocks, the lower one of a given shear modulus; the top is displaced."""

    def __init__(self, cell, **options):
        super().__init__(cell, n=(5, 4), wave=0.02, load=-0.02, **options)
        self.mu = fem.Constant(self.meshes[0], 0.4)
        self.top = fem.Constant(self.meshes[1], np.append(np.zeros(self.gdim - 1), -0.02))
        facets = plane(self.meshes[1], self.gdim - 1, 1.0)
        dofs = fem.locate_dofs_topological(self.V[1], self.gdim - 1, facets)
        self.bcs[1] = [fem.dirichletbc(self.top, dofs, self.V[1])]
        for i, u in enumerate(self.u):
            stress = qs.materials.neo_hookean(u, (self.mu, 0.8)[i], 0.6)
            dx = ufl.dx(degree=3)
            self.F[i] = ufl.inner(stress, ufl.grad(ufl.TestFunction(u.function_space))) * dx


OPTIONS = {
    "penalty": {"enforcement": "penalty"},
    "augmented": {"enforcement": "augmented-lagrangian"},
    "friction": {"enforcement": "penalty", "friction": qs.Coulomb(0.3)},
}


def history(cell, options, exact, monkeypatch, solver="direct"):
    """Solve for a sequence of loads; returns displacements, iterations and assembled tangents."""
    pair = Rubber(cell, contact_options=options)
    problem, found, iterations = pair.problem(solver=solver), [], 0
    with monkeypatch.context() as patch:
        if exact:
            patch.setattr(newton, "SLOWER", np.inf)
        for step in range(4):
            pair.top.value[-1] = -0.02 - 0.001 * step
            pair.top.value[0] = 0.002 * step
            if step == 3:
                pair.mu.value *= 1e3  # an old tangent would not help
            problem.solve()
            found.append(np.concatenate([u.x.array for u in problem.u]))
            iterations += problem.num_iterations
    return found, iterations, problem.system.bodies[0].num_assemblies


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_iterative_solvers(options, monkeypatch):
    """Iterative solvers keep tangents as well, if one more iteration is enough."""
    found, _, fewer = history("tetrahedron", options, False, monkeypatch, "amg")
    expected, _, assemblies = history("tetrahedron", options, True, monkeypatch, "amg")
    for a, b in zip(found, expected, strict=True):
        assert largest(a - b) < 1e-7 * largest(b)
    assert fewer <= assemblies


def test_each_tangent_once(monkeypatch):
    """The first tangent serves both for the matrices of new pairs and for the first iteration."""
    monkeypatch.setattr(newton, "SLOWER", np.inf)
    pair = Rubber("quadrilateral", contact_options=OPTIONS["penalty"])
    problem = pair.problem(solver="direct")
    problem.solve()
    assert problem.system.bodies[0].num_assemblies <= problem.num_iterations + 1
    pair.top.value[:] = 0.01, -0.03
    pair.contact.update()
    before = problem.system.bodies[0].num_assemblies
    problem.solve()
    assert problem.system.bodies[0].num_assemblies <= before + problem.num_iterations + 1


def test_what_holds_a_free_body_is_not_left():
    """The diagonal shift of a body without support does not accumulate over tangents."""
    pair = Rubber("quadrilateral", contact_options=OPTIONS["penalty"], gap=0.1)
    pair.bcs[1] = []
    problem = pair.problem(solver="direct")
    problem.set_up()
    system, found = problem.system, []
    x = system.x.array_r.copy()
    for _ in range(3):
        system.tangent(x)
        found.append(system.made.tangent.diagonal(1))
    assert largest(found[1] - found[0]) == largest(found[2] - found[0]) == 0
    bulk = system.bodies[1].matrix().getDiagonal().array_r
    assert largest(found[0] - bulk) > 0
