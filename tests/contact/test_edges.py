"""Crossing edges: no edge passes through another edge without a contact force."""

import numpy as np
import pytest
from scenes import WORLD, box, elastic, largest, plane, vector_space
from wedges import E, Wedge, crossed

from dolfinx import fem, mesh

import qsdolfinx as qs


def problem_of(bodies, surfaces, solver="auto", **options):
    contact = qs.Contact(*surfaces, **options)
    forms, unknowns, bcs = ([getattr(b, name) for b in bodies] for name in ("F", "u", "bcs"))
    return contact, qs.ContactProblem(forms, unknowns, [contact], bcs, linear_solver=solver)


@pytest.mark.parametrize("depth", (0.01, 0.2))
@pytest.mark.parametrize("yaw", (90.0, 40.0))
@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
def test_crossed(cell, yaw, depth):
    """From first contact on, the force is the force at the point where the edges cross."""
    for formulation in ("quasi-symmetric", "master-slave"):
        bodies, expected = crossed((4, 5), cell, depth, yaw)
        surfaces = [body.surface() for body in bodies]
        contact, problem = problem_of(bodies, surfaces, formulation=formulation)
        problem.solve()
        np.testing.assert_allclose(contact.force("slave")[2], expected, rtol=1e-8)
        np.testing.assert_allclose(contact.force("master"), -contact.force("slave"), atol=1e-10)
        assert problem.num_iterations <= 4


@pytest.mark.parametrize("law", (qs.Coulomb(0.3), qs.Sticking()))
def test_friction(law):
    """Pressed and drawn along one edge, the force is Coulomb's limit or the sticking force."""
    bodies, expected = crossed((4, 5), "hexahedron", 0.2)
    surfaces = [body.surface() for body in bodies]
    contact, problem = problem_of(bodies, surfaces, friction=law)
    problem.solve()
    pressed = contact.force("slave")
    np.testing.assert_allclose(pressed[2], expected, rtol=0.05)
    bodies[0].moved.value[0] = 0.3 * bodies[0].h
    problem.solve()
    T, N = np.linalg.norm(contact.force("slave")[:2]), contact.force("slave")[2]
    assert problem.num_iterations <= 10
    if isinstance(law, qs.Coulomb):
        np.testing.assert_allclose(T, 0.3 * N, rtol=2e-3)  # other crossings touch slanted faces
        assert contact.step_dissipation() > 0
    else:
        assert T > 0.3 * N and contact.step_dissipation() < 1e-9 * N * bodies[0].h


class Plate:
    """Plate below z = 0, clamped at its bottom."""

    def __init__(self, n, cell):
        self.msh = box(WORLD, (n, n, 4), cell, [-0.75, -0.8, -0.5], [0.85, 0.8, 0.0])
        self.V = vector_space(self.msh)
        self.u = fem.Function(self.V)
        self.F = elastic(self.u, E=E, nu=0.3)
        dofs = fem.locate_dofs_topological(self.V, 2, plane(self.msh, 2, -0.5))
        self.bcs = [fem.dirichletbc(np.zeros(3), dofs, self.V)]

    def surface(self):
        return qs.Surface(self.V, facets=plane(self.msh, 2, 0.0))


@pytest.mark.parametrize(
    ("cell", "cells", "yaw", "solver"),
    [
        ("hexahedron", (2, 12), 20.0, "direct"),
        ("tetrahedron", (2, 12), 20.0, "direct"),
        # Crossings near nodes: with points of both sets the iterations did not end.
        ("hexahedron", (12, 16), 45.0, "amg"),
    ],
)
def test_wedge_on_a_plate(cell, cells, yaw, solver):
    """An edge on a plate: vertices and crossings set the depth, and the roles do not matter."""
    forces = []
    for swap in (False, True):
        wedge, plate = (
            Wedge(cells[0], cell, yaw=yaw, shift=(0.05, 0.03, 0.0)),
            Plate(cells[1], cell),
        )
        bodies = [wedge.hold(-0.1 * wedge.h), plate]
        surfaces = [body.surface() for body in bodies]
        contact, problem = problem_of(bodies, surfaces[:: -1 if swap else 1], solver=solver)
        problem.solve()
        forces.append(contact.force("master" if swap else "slave")[2])
        assert contact.penetration() < 0.02 * wedge.h
        assert problem.num_iterations <= 12
    np.testing.assert_allclose(*forces, rtol=1e-6)


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
def test_crossings_near_nodes(cell):
    """Mesh lines that cross an edge beside its nodes give no second constraint beside the node's.

    With both, multipliers would be hardly determined, and take more than ten iterations.
    """
    forces = []
    for beside in (0.0, 1e-4):
        wedge = Wedge(2, cell, yaw=20.0, shift=(0.05 + beside, beside, 0.0))
        bodies = [wedge.hold(-0.02), Plate(8, cell)]
        contact, problem = problem_of(bodies, [body.surface() for body in bodies])
        problem.solve()
        forces.append(contact.force("slave")[2])
        assert problem.num_iterations <= 5
    np.testing.assert_allclose(*forces, rtol=1e-4)


def test_between_crossings():
    """An edge of degree 2 along quadrilateral diagonals does not penetrate between its points."""
    forces = []
    for swap in (False, True):
        wedge = Wedge(2, "hexahedron", yaw=45.0, shift=(0.05, 0.0, 0.0), degree=2)
        bodies = [wedge.hold(-0.02), Plate(4, "hexahedron")]
        surfaces = [body.surface() for body in bodies][:: -1 if swap else 1]
        contact, problem = problem_of(bodies, surfaces)
        problem.solve()
        forces.append(contact.force("master" if swap else "slave")[2])
        assert contact.penetration() < 0.01 * 0.02 and problem.num_iterations <= 10
    np.testing.assert_allclose(*forces, rtol=1e-6)
    assert forces[0] > 3.5  # with points at nodes and mesh lines alone: force 1.55 and depth .017


def test_flat_on_a_block():
    """A cube flat on a block: its sharp edges get no constraints, and the patch test is exact."""
    bodies = []
    for n, low, high in ((5, (-0.4, -0.4, -1.0), (1.4, 1.4, 0.0)), (3, (0.0,) * 3, (1.0,) * 3)):
        msh = box(WORLD, (n, n, n), "hexahedron", low, high)
        V = vector_space(msh)
        bodies.append((V, fem.Function(V)))
    (V, u), (W, w) = bodies
    top = fem.locate_dofs_topological(W, 2, plane(W.mesh, 2, 1.0))
    bottom = fem.locate_dofs_topological(V, 2, plane(V.mesh, 2, -1.0))
    bcs = [[fem.dirichletbc(np.zeros(3), bottom, V)]]
    bcs.append([fem.dirichletbc(np.array([0.0, 0.0, -0.01]), top, W)])
    every = mesh.exterior_facet_indices(W.mesh.topology)
    slave = qs.Surface(W, facets=np.setdiff1d(every, plane(W.mesh, 2, 1.0)))
    master = qs.Surface(V, facets=plane(V.mesh, 2, 0.0))
    contact = qs.Contact(slave, master)
    assert WORLD.allreduce(sum(gap.points.size for gap in contact.model.gaps[1:])) == 0
    qs.ContactProblem([elastic(u), elastic(w)], [u, w], [contact], bcs).solve()
    assert contact.force("slave")[2] > 0
    assert largest(contact.force("slave") + contact.force("master")) < 1e-12


def test_restart(tmp_path):
    """After a restart, friction at edges continues as in an uninterrupted run."""
    folder = WORLD.bcast(tmp_path)

    def made():
        bodies, _ = crossed((4, 5), "hexahedron", 0.0)
        surfaces = [body.surface() for body in bodies]
        contact, problem = problem_of(bodies, surfaces, friction=qs.Coulomb(0.3))
        h = bodies[0].h

        def drive(t, dt):
            along = max(t - 1, 0.0)
            bodies[0].moved.value[:] = 0.15 * h * along, 0.1 * h * along, -0.1 * h * min(t, 2.0)

        return contact, qs.TimeStepper(problem, 0.5, drive)

    (contact, stepper), forces = made(), []
    for _ in stepper.run(3.0):
        forces.append(contact.force("slave"))
        if stepper.num_steps == 4:
            qs.save_run(stepper, folder / "run")
    contact, stepper = made()
    qs.load_run(stepper, folder / "run")
    again = [contact.force("slave") for _ in stepper.run(3.0)]
    np.testing.assert_allclose(again, forces[4:], rtol=1e-8, atol=1e-10)
    assert largest(forces[-1][:2]) > 0.05
