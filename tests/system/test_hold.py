"""Bodies supported by contact only, which may slide or spin between frictionless tools."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, elastic, largest, plane, raises_everywhere, vector_space
from step_scenes import Upset

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points
from qsdolfinx.contact import motion
from qsdolfinx.system import free_motion
from qsdolfinx.system.free_motion import Hold

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
DEPTH, E, NU = 0.02, 3.0, 0.3


class Pressed:
    """Elastic block without any Dirichlet condition between two rigid planes.

    Args:
        force: Body force.
        wavy: Whether the upper face is curved, so that it is only partly in contact.
    """

    def __init__(self, cell, force=None, wavy=False, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        up = np.eye(gdim)[-1]
        self.mesh = box(WORLD, (4,) * gdim, cell, [0.0] * gdim, [1.0] * gdim, "forward")
        faces = [plane(self.mesh, gdim - 1, z) for z in (0.0, 1.0)]
        if wavy:
            x = self.mesh.geometry.x
            x[:, gdim - 1] -= 8 * DEPTH * x[:, gdim - 1] * (x[:, 0] - 0.4) ** 2
        V = vector_space(self.mesh)
        self.u = fem.Function(V)
        force = None if force is None else fem.Constant(self.mesh, np.array(force[:gdim]))
        self.tools = [
            qs.RigidSurface.plane(WORLD, z * up, sign * up) for z, sign in ((0.0, 1), (1.0, -1))
        ]
        options = {"penalty": 1e4} | options
        self.contacts = [
            qs.Contact(qs.Surface(V, facets=f), tool, **options)
            for f, tool in zip(faces, self.tools, strict=True)
        ]
        self.tools[1].displacement = -DEPTH * up
        F = elastic(self.u, E, NU, force)
        tight = {"snes_rtol": 1e-15, "snes_atol": 1e-11, "snes_stol": 1e-15}
        self.problem = qs.ContactProblem([F], [self.u], self.contacts, petsc_options=tight)

    def forces(self):
        return np.array([c.force("slave") for c in self.contacts])

    def strains(self):
        """Return the strains of the cells owned by this rank."""
        space = fem.functionspace(self.mesh, ("DG", 0, (self.gdim, self.gdim)))
        points = interpolation_points(space)
        out = fem.Function(space)
        out.interpolate(fem.Expression(ufl.sym(ufl.grad(self.u)), points))
        owned = space.dofmap.index_map.size_local * self.gdim**2
        return out.x.array[:owned].copy()


@pytest.mark.parametrize("cell", CELLS)
def test_uniform(cell):
    """Stress is uniaxial; 1/ε of both contacts is in series with the block."""
    case = Pressed(cell, enforcement="penalty")
    case.problem.solve()
    assert case.problem.num_iterations <= 6
    modulus = E / (1 - NU**2) if case.gdim == 2 else E
    stress = DEPTH / (1 / modulus + 2 / 1e4)
    expected = np.zeros((2, case.gdim))
    expected[:, -1] = stress, -stress
    np.testing.assert_allclose(case.forces(), expected, atol=1e-9 * stress)
    case.problem.destroy()


@pytest.mark.parametrize("enforcement", ["penalty", "augmented-lagrangian"])
@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_shift_does_not_matter(cell, enforcement, monkeypatch):
    found = []
    for shift in (1e-6, 1e-9, 1e-11):
        monkeypatch.setattr(free_motion, "SHIFT", shift)
        case = Pressed(cell, wavy=True, enforcement=enforcement, penalty=100.0)
        case.problem.solve()
        assert case.problem.num_iterations <= 40
        active = WORLD.allreduce(case.contacts[1].active().sum())
        assert 0 < active < WORLD.allreduce(len(case.contacts[1].active()))
        forces = case.forces()
        assert largest(forces.sum(axis=0)) < 1e-9 * largest(forces)
        moments = sum(c.moment("slave", np.zeros(case.gdim)) for c in case.contacts)
        assert largest(moments) < 1e-8 * largest(forces)
        found.append((forces, case.strains()))
        case.problem.destroy()
    for forces, strains in found[1:]:
        assert largest(forces - found[0][0]) < 1e-8 * largest(forces)
        assert largest(strains - found[0][1]) < 1e-8 * largest(strains)


@pytest.mark.parametrize("cell", CELLS)
def test_free_motions(cell):
    """Free motions: sliding, in 3D along two axes, and spinning; without contact all motions."""
    case = Pressed(cell)
    case.problem.set_up()
    assert count_free(case.problem, [np.zeros(case.gdim)]) == (3 if case.gdim == 2 else 6)
    case.problem.solve()
    assert count_free(case.problem) == (1 if case.gdim == 2 else 3)
    case.problem.destroy()


def count_free(problem, start=None):
    if start is not None:
        problem.set_up()
        for tool in {id(c.master): c.master for c in problem.contacts}.values():
            tool.displacement = np.zeros(tool.gdim)
        for u in problem.u:
            u.x.array[:] = 0
        for c in problem.contacts:
            motion.move_tool(c.model)
        problem.bodies[0].x.array[:] = 0
        for c in problem.contacts:
            for p in c.model.gaps:
                p.evaluate((problem.bodies[0].x, None))
                p.state.values[:] = -1.0
    made = Hold(problem.system.made.rigid, problem.bodies, problem.system.contacts, problem.sides)
    return made.free_motions().shape[1]


def changes_by_shift(problem, monkeypatch):
    """Return each body's relative change of a product with the tangent under a large shift."""
    system, products = problem.system, []
    a = system.x.duplicate()
    a.array[:] = np.sin(np.arange(len(a.array)) + 1.0)
    for shift in (0.0, 1e-3):
        monkeypatch.setattr(free_motion, "SHIFT", shift)
        products.append(a.duplicate())
        system.tangent(system.x.array_r.copy()).mult(a, products[-1])
    parts = (system.parts(product.array_r) for product in products)
    return [largest(there - here) / largest(here) for here, there in zip(*parts, strict=True)]


@pytest.mark.parametrize("held", [True, False])
def test_supported_bodies_get_no_shift(held, monkeypatch):
    """Conditions or closed contacts support bodies: the stabilisation leaves the matrix as is."""
    law = qs.Tied() if held else qs.Unilateral()
    pair = Pair("triangle", law=law)
    if held:
        problem = qs.ContactProblem(pair.F, pair.u, [pair.contact], [pair.bcs[0], []])
    else:  # with conditions on both bodies contact need not support any
        problem = pair.problem()
    problem.solve()
    assert max(changes_by_shift(problem, monkeypatch)) < 1e-12


def test_only_the_body_that_moves_gets_a_shift(monkeypatch):
    """Only the sliding block gets a shift; the die below has its usual matrix."""
    case = Upset(die=True, held=False)
    case.problem.solve()
    block, die = changes_by_shift(case.problem, monkeypatch)
    assert block > 1e-6 and die < 1e-12


def test_viscous_block_without_conditions():
    """A viscous block without conditions flows like a held one, except for its sliding."""
    found = []
    for held in (True, False):
        case = Upset(held=held, dt=0.05)
        for _ in case.stepper.run(0.1):
            assert case.stepper.num_iterations < 20
        found.append([*case.forces()[1::2], *case.size()])
        assert abs(case.stepper.motions[0].volume() - 1) < 1e-2
        case.problem.destroy()
    np.testing.assert_allclose(*found, rtol=1e-8)


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_load_that_nothing_balances(cell):
    """A sideways load without friction has no solution: the solve ends and changes nothing."""
    case = Pressed(cell, force=[0.1, 0.0, 0.0])
    case.u.interpolate(lambda x: 0.001 * x[: case.gdim])
    before = case.u.x.array.copy()
    raises_everywhere(WORLD, qs.ConvergenceError, "did not converge", case.problem.solve)
    assert np.array_equal(before, case.u.x.array)
    case.problem.destroy()
