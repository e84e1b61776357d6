"""Constraints at points with finite sliding."""

import numpy as np
import pytest
from following import Body, Boxes, Nested, problem_of, ring, rotation
from scenes import WORLD, Pair, box, plane
from system.test_equations import away

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.system.equations import Equations

FINITE = {"sliding": "finite"}


def half_ring(start, center):
    """Make half a neo-Hookean ring about a center, from an angle on: body, rim and hub."""
    msh = box(WORLD, (24, 2), "quadrilateral", (0.0, 0.0), (1.0, 1.0), "scattered")
    x = msh.geometry.x
    angle, radius = start + np.pi * x[:, 0], 0.8 + 0.2 * x[:, 1]
    ends = [plane(msh, 0, end) for end in (0.0, 1.0)]
    rim = plane(msh, 1, 1.0)
    x[:, 0], x[:, 1] = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    return Body(msh), rim, np.concatenate(ends)


class Passing:
    """Half ring whose hub is moved over another half ring by two facets per step.

    Args:
        mu: Coefficient of friction.
        slave: Ring whose facets carry multipliers, the lower one (0) or the upper one (1).
    """

    def __init__(self, mu, slave):
        made = [half_ring(0.0, (0.0, 0.0)), half_ring(np.pi, (-1.5, 1.8))]
        self.bodies = [body for body, *_ in made]
        hubs = [body.clamp(hub) for body, _, hub in made]
        rims = [body.surface(rim) for body, rim, _ in made]
        friction = qs.Coulomb(mu) if mu else None
        contact = qs.Contact(rims[slave], rims[1 - slave], friction=friction, **FINITE)
        problem = problem_of(self.bodies, [contact])

        def drive(t, dt):
            hubs[1].value[0] = t

        stepper = qs.TimeStepper(problem, 0.25, drive, dt_max=0.25)
        side = "master" if slave == 0 else "slave"
        #: Position of the hub, force on the upper ring, energy of both, and dissipated energy.
        self.rows = [(0.0, np.zeros(2), 0.0, 0.0)]
        for t in stepper.run(3.0):
            energy = sum(body.energy for body in self.bodies)
            self.rows.append((t, contact.force(side), energy, contact.dissipated_energy()))
        self.log = stepper.log

    def work(self):
        """Return the work of the hub."""
        total = 0.0
        for (a, before, *_), (b, now, *_) in zip(self.rows, self.rows[1:], strict=False):
            total -= (b - a) * (before[0] + now[0]) / 2
        return total


@pytest.mark.parametrize("slave", (0, 1))
def test_passing(slave):
    """Without friction work is stored and recovered, and there is no force along the crest."""
    scene = Passing(0.0, slave)
    peak = max(row[2] for row in scene.rows)
    crest = next(row for row in scene.rows if abs(row[0] - 1.5) < 1e-9)
    assert abs(scene.work()) < 1e-3 * peak and abs(scene.rows[-1][2]) < 1e-9 * peak
    assert abs(crest[1][0]) < 1e-3 * abs(crest[1][1])


@pytest.mark.parametrize("slave", (0, 1))
def test_energy_of_friction(slave):
    """In steps of two facets the friction energy is the hub's work that is not stored."""
    scene = Passing(0.3, slave)
    work, taken = scene.work(), scene.rows[-1][3]
    assert taken > 0 and abs(taken / work - 1) < 0.03


@pytest.mark.parametrize("shape", ("plane", "facets"))
def test_driven_tool(shape):
    """The tool's own equation has the force on the body, wherever both are."""
    pair = Pair("triangle", wave=0.02)
    along = np.array([0.6, -0.8])
    if shape == "plane":
        tool = qs.RigidSurface.plane(WORLD, np.zeros(2), [0.0, -1.0])
    else:
        x = np.array([[-0.5, 0.0], [0.3, 0.01], [0.6, 0.0], [1.5, 0.02]])
        ends = np.array([[0, 1], [1, 2], [2, 3]])
        tool = qs.RigidSurface.triangulated(WORLD, x, ends, [0.5, 3.0])
    tool.drive(0.1, along)
    contact = qs.Contact(pair.master, tool, friction=qs.Coulomb(0.3), **FINITE)
    problem = qs.ContactProblem(pair.F[:1], pair.u[:1], [contact], pair.bcs[:1])
    problem.set_up()
    equations = Equations(problem.system)
    z, _ = away(equations)
    equations.evaluate(z)
    at = equations.evaluate(z + 0.01 * away(equations, seed=3)[0])
    forces = equations.bodies_of(at.contact).reshape(-1, 2)
    total = WORLD.allreduce(forces.sum(axis=0))
    assert abs(total @ along) > 1e-3
    assert abs(at.tools[0] + 0.1 + total @ along) < 1e-10


def turned_disc(degrees):
    """Press a disc in a ring, then rotate it in one solve, with an initial guess."""
    scene = Nested("quadrilateral", n=(40, 56), misfit=0.01, friction=qs.Coulomb(0.2), **FINITE)
    disc = scene.bodies[0]
    held = fem.Function(disc.V)
    dofs = fem.locate_dofs_topological(disc.V, 1, scene.far[0])
    disc.bcs[:] = [fem.dirichletbc(held, dofs)]
    problem = scene.problem(solver="direct")
    problem.solve()
    R = rotation(np.radians(degrees))
    x, u = disc.V.tabulate_dof_coordinates()[:, :2], disc.u.x.array.reshape(-1, 2)
    u[:] = (x + u) @ R.T - x
    held.x.array[:] = (x @ R.T - x).ravel()
    problem.solve()
    return scene.contact, problem


def turned_pin(degrees, kind):
    """Press a rigid pin in a ring, then rotate it in one solve."""
    body = Body(ring((56, 2), (0.99, 1.4)))
    body.clamp(body.boundary(lambda x: np.hypot(x[0], x[1]) > 1.3))
    if kind == "shape":
        pin = qs.RigidSurface.sphere(WORLD, [0.0, 0.0], 1.0)
    else:
        i = np.arange(70)
        x = np.stack([np.cos(2 * np.pi * i / 70), np.sin(2 * np.pi * i / 70)], axis=1)
        pin = qs.RigidSurface.triangulated(WORLD, x, np.stack([i, (i + 1) % 70], axis=1), [0.0] * 2)
    surface = body.surface(body.boundary(lambda x: np.hypot(x[0], x[1]) < 1.0))
    contact = qs.Contact(surface, pin, friction=qs.Coulomb(0.2), **FINITE)
    problem = problem_of([body], [contact])
    problem.solve()
    pin.rotation = np.radians(degrees)
    problem.solve()
    return contact, problem


@pytest.mark.parametrize("degrees", (10.0, 30.0))
def test_guess(degrees):
    """A disc rotated in a ring with a guess: parts that slip in the guess do not stick."""
    contact, problem = turned_disc(degrees)
    assert problem.num_iterations <= 8
    moments = [contact.moment(side)[0] for side in ("slave", "master")]
    assert abs(sum(moments)) < 1e-8 * abs(moments[0])


@pytest.mark.parametrize("kind", ("disc", "shape", "facets"))
def test_energy_of_a_turn(kind):
    """Slip is a chord, energy that of the arc: moment times angle in one step of 100°."""
    contact, problem = turned_disc(100.0) if kind == "disc" else turned_pin(100.0, kind)
    work = abs(contact.moment("slave")[0]) * np.radians(100)
    # The bodies deform before they slip.
    assert abs(contact.dissipated_energy() / work - 1) < 5e-3
    assert problem.num_iterations <= 12


def test_turned_too_far():
    """Beyond 149° the direction of slip is ambiguous, and a warning is given."""
    with pytest.warns(qs.ContactWarning, match="not known which way friction acts"):
        turned_pin(170.0, "facets")


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_gaps_of_the_master(cell):
    """The gap field of each side is the gap of flat boxes, and 0 with nothing opposite."""
    across, n = ((), ()) if cell == "triangle" else ((1.0,), (2,))
    sizes = (2.0, *across, 0.5), (0.8, *across, 0.6)
    scene = Boxes(cell, ((10, *n, 2), (3, *n, 2)), sizes, start=0.53, gap=0.01)
    scene.clamp_far()
    contact = qs.Contact(scene.above, scene.below, **FINITE)
    scene.problem(contact, solver="direct").solve()
    for side, surface in (("slave", scene.above), ("master", scene.below)):
        values = surface.linear.node_values(contact.fields(side)["gap"])
        faced = values != 0
        assert np.allclose(values[faced], -0.01, rtol=1e-9)  # an open gap
        assert WORLD.allreduce(np.count_nonzero(faced)) > 3


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_what_slides_goes_on(cell):
    """A block dragged by half a facet per step; 48 or more iterations if all started in stick."""
    case = Boxes(cell, ((24, 6), (8, 4)), ((4.0, 1.0), (1.0, 0.5)), start=0.5)
    moved = case.clamp_far()
    contact = qs.Contact(case.above, case.below, friction=qs.Coulomb(0.3))
    problem, iterations = case.problem(contact), []
    for step in range(9):
        moved.value[:] = 0.06 * step, -0.02
        problem.solve()
        iterations.append(problem.num_iterations)
    assert sum(iterations[2:]) <= 40
    T, N = np.abs(contact.force("slave"))
    assert np.isclose(T, 0.3 * N, rtol=1e-2)


def test_nothing_creeps():
    """Without load and solved again, hexahedra with warped facets do not change."""
    case = Boxes("hexahedron", ((5, 3, 2), (2, 1, 2)), ((2.0, 1.2, 0.7), (0.7, 0.5, 0.5)), 0.5)
    moved = case.clamp_far()
    contact = qs.Contact(case.above, case.below, friction=qs.Coulomb(0.5))
    problem = case.problem(contact)
    for displacement in ((0.0, 0.0, -0.02), (0.08, 0.04, -0.02)):
        moved.value[:] = displacement
        problem.solve()
    force = contact.force("slave")
    problem.solve()
    assert problem.num_iterations == 0
    assert np.abs(contact.force("slave") - force).max() < 1e-12 * np.abs(force).max()
