"""Start of slip: constraints activated within a step, and bodies that have moved before."""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    WORLD,
    Pair,
    box,
    clamp,
    drag_top,
    elastic,
    largest,
    plane,
    raises_everywhere,
    vector_space,
)

from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.solve import onset

PENALTY, AUGMENTED = {"penalty": 500.0}, {"enforcement": "augmented-lagrangian"}

#: Displacement of the block, and its initial gap, which is not reached at the end of a step.
WAY, DISTANCE = np.array((0.02, -0.02)), 0.0151

LAWS = {
    "coulomb": lambda: qs.Coulomb(0.1),
    "tresca": lambda: qs.Tresca(2e-4),
    "norton": lambda: qs.Norton(0.3, 5e-4, 0.3),
    "sticking": lambda: qs.Sticking(),
}


class Landing:
    """Block that moves down and sideways until it is pressed on a floor or another block."""

    def __init__(self, law, kind="displacement", master="tool", **options):
        msh = box(WORLD, (4, 4), "quadrilateral", [0.0, DISTANCE], [1.0, 1.0 + DISTANCE])
        V = vector_space(msh)
        self.u, self.top = [fem.Function(V)], fem.Constant(msh, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0 + DISTANCE))
        F, bcs = [elastic(self.u[0])], [[fem.dirichletbc(self.top, dofs, V)]]
        if master == "tool":
            other = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        else:
            low = box(WORLD, (6, 3), "quadrilateral", [-0.5, -1.0], [1.5, 0.0], "backward")
            W = vector_space(low)
            self.u.append(fem.Function(W))
            F.append(elastic(self.u[1], E=2.0))
            bcs.append([clamp(W, plane(low, 1, -1.0))])
            other = qs.Surface(W, facets=plane(low, 1, 0.0))
        friction, self.kind = LAWS[law](), kind
        if kind == "velocity" or friction.needs_dt:
            options |= {"dt": 1.0}
        options = {"quadrature": "overlay", "search_radius": 0.2, "unknown": kind} | options
        surface = qs.Surface(V, facets=plane(msh, 1, DISTANCE))
        self.contact = qs.Contact(surface, other, friction=friction, **options)
        self.problem = qs.ContactProblem(F, self.u, [self.contact], bcs)

    def drive(self, t, dt):
        self.top.value[:] = WAY * (1.0 if self.kind == "velocity" else t)

    def run(self, steps, stepper):
        """Return T/N and the energy dissipated by friction."""
        if self.contact.dt is not None:
            self.contact.set_dt(1 / steps)
        if stepper:
            for _ in qs.TimeStepper(self.problem, 1 / steps, self.drive).run(1.0):
                pass
        else:
            for i in range(steps):
                self.drive((i + 1) / steps, 1 / steps)
                self.problem.solve()
        T, N = self.contact.force("slave")
        return np.array((abs(T) / N, self.contact.dissipated_energy()))


@pytest.mark.parametrize(
    "law, kind, master, options",
    [
        case
        for case in itertools.product(
            LAWS, ("displacement", "velocity"), ("tool", "body"), (PENALTY, AUGMENTED)
        )
        if case[0] == "coulomb" or (case[1], case[2]) in (("displacement", "tool"),)
    ]
    + [(law, "velocity", "body", AUGMENTED) for law in ("tresca", "norton", "sticking")]
    + [("coulomb", "displacement", "body", {"sliding": "finite"})],
)
@pytest.mark.parametrize("stepper", (False, True))
def test_steps_in_which_bodies_meet(law, kind, master, options, stepper):
    """One step, or a few, give T/N and energy of many; formerly the slip was the whole step's.

    For velocity-based bodies the energy is F · v Δt, as in the equilibrium, and of first order in
    the time step: see test_dissipation.py::test_energy_of_flow_that_closes.
    """
    if kind == "velocity" and not stepper:
        pytest.skip("the mesh has to move")
    many = Landing(law, kind, master, **options).run(30, stepper)
    compared = slice(None) if kind == "displacement" else slice(1)
    for steps in (1, 3):
        few = Landing(law, kind, master, **options).run(steps, stepper)
        np.testing.assert_allclose(few[compared], many[compared], rtol=0.1, atol=1e-12)


def test_sticking_and_energy_in_one_step():
    """With sticking, one step is exact where the path is straight and nothing slips."""
    one, many = (Landing("sticking", **AUGMENTED).run(n, False) for n in (1, 40))
    np.testing.assert_allclose(one, many, rtol=1e-6, atol=1e-12)


def test_coulomb_takes_half():
    """In Coulomb friction the pressure grows from zero: friction takes half of its final power."""
    case = Landing("coulomb", constraints="nodes", **AUGMENTED)
    case.run(1, False)
    contact, nodes = case.contact, case.contact.active()
    tau, slip = contact.tangential_multiplier()[nodes], contact.slip()[nodes]
    area = contact.slave.node_area[nodes]
    whole = WORLD.allreduce(float(area @ np.sum(tau * slip, axis=1)), op=MPI.SUM)
    assert whole > 0
    np.testing.assert_allclose(contact.step_dissipation(), 0.5 * whole, rtol=1e-6)


@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric", "double-pass"))
def test_other_formulations(formulation, constraints):
    """One step agrees with many for each formulation, and with constraints at points."""
    options = {"formulation": formulation, "constraints": constraints, "penalty": 500.0}
    one, many = (Landing("coulomb", master="body", **options).run(n, False) for n in (1, 30))
    np.testing.assert_allclose(one, many, rtol=0.1)


def test_no_second_step_without_closing_rows(monkeypatch):
    """Constraints active before, and scenes without contact, need no additional iteration."""
    case = Landing("coulomb", **PENALTY)
    closed = np.zeros(len(case.contact.active()), dtype=bool)
    closings = []

    def count(self, step):
        first = find(self, step)
        closings.append(first is None)
        return first

    find = onset.Onset.find
    monkeypatch.setattr(onset.Onset, "find", count)
    for t in (0.5, 0.75, 0.8, 1.0):  # inactive, inactive, becomes active, active
        case.drive(t, 0.0)
        before, closings[:] = closed, []
        case.problem.solve()
        closed = case.contact.active()
        closes = WORLD.allreduce(bool(np.any(closed & ~before)), op=MPI.LOR)
        assert any(closings) == closes == (t == 0.8)
        assert t > 0.75 or case.problem.num_iterations <= 2


# --- Constraints that become active one after another, beside an active one


def press_by_a_tilted_plane(steps, **options):
    """Return T and N: a plane slides along a block, touches its corner and comes down."""
    msh = box(WORLD, (20, 10), "quadrilateral", [0.0, 0.0], [2.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.6, 0.99], [np.sin(0.15), -np.cos(0.15)])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    options |= {"friction": qs.Coulomb(0.3), "initial_overclosure": "resolve"}
    contact = qs.Contact(surface, tool, **options)
    bcs = [clamp(V, plane(msh, 1, 0.0))]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])

    def drive(t, dt):
        tool.displacement = (-0.6 * dt, 0.0) if t < 1.001 else (0.0, -0.15 * dt)

    stepper = qs.TimeStepper(problem, 1.0, drive)
    for i in range(steps + 1):
        end = 1 + i / steps
        while stepper.t < end - 1e-9:
            stepper.step(end)
    return contact.force("slave")


@pytest.mark.filterwarnings("ignore:initial_overclosure")
@pytest.mark.parametrize(
    "options",
    [
        {"sliding": "small", "enforcement": "augmented-lagrangian"},
        {"sliding": "small", "enforcement": "penalty"},
        {"quadrature": "nodal", "enforcement": "augmented-lagrangian"},
        {"sliding": "finite"},
    ],
)
def test_rows_that_close_one_after_another(options):
    """One step nearly agrees with five, although each activation changes the others' slip path."""
    one, many = (press_by_a_tilted_plane(n, **options) for n in (1, 5))
    assert many[0] > 0.2 * abs(many[1])
    np.testing.assert_allclose(one, many, rtol=0.07 if options.get("sliding") == "finite" else 0.04)


@pytest.mark.parametrize("steps", (1, 2))
def test_points_that_close_before_the_mean_of_their_node(steps):
    """A wheel pressed and dragged at once slips in all of the contact: T/N is μ.

    Points within a facet become active one after another. Nodes whose mean gap closes late have had
    friction for longer.
    """
    msh = box(WORLD, (30, 3), "quadrilateral", [-1.0, 0.0], [1.0, 0.5])
    x = msh.geometry.x
    x[:, 1] += 0.5 * x[:, 0] ** 2
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    msh.topology.create_connectivity(1, 2)
    at = mesh.exterior_facet_indices(msh.topology)
    middle = mesh.compute_midpoints(msh, 1, at)
    height = middle[:, 1] - 0.5 * middle[:, 0] ** 2
    dofs = fem.locate_dofs_topological(V, 1, at[height > 0.49])
    surface = qs.Surface(V, facets=at[np.abs(height) < 0.01])
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"quadrature": "overlay", "constraints": "points", "penalty": 500.0}
    contact = qs.Contact(surface, tool, friction=qs.Coulomb(0.3), **options)
    bcs = [fem.dirichletbc(top, dofs, V)]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])
    for i in range(steps):
        top.value[:] = np.array((0.03, -0.02)) * (i + 1) / steps
        problem.solve()
    T, N = contact.force("slave")
    np.testing.assert_allclose(abs(T) / N, 0.3, rtol=2e-3)


# --- Bodies that have moved before the first solve


def test_bodies_that_are_elsewhere_at_first():
    """A block moved by 0.4 before the first solve, and pressed straight down, has no slip."""
    found = []
    for carried in (0.0, 0.4):
        pair = Pair("quadrilateral", contact_options={"friction": qs.Coulomb(0.3)})
        pair.u[1].x.array[0::2] = carried
        drag_top(pair, carried)
        pair.problem().solve()
        found.append(pair.contact.force("slave"))
    assert found[0][1] > 0.01
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8, atol=1e-10)


def test_conditions_on_contact_nodes_at_first():
    """Motion by conditions in the first solve is slip, also if they hold contact nodes."""
    pair = Pair("quadrilateral", contact_options={"friction": qs.Coulomb(0.3)})
    value = np.array((0.05, -0.01))
    near = plane(pair.meshes[1], 1, 0.0)
    pair.bcs[1].append(clamp(pair.V[1], near, value))
    pair.problem().solve()
    T, N = pair.contact.force("slave")
    np.testing.assert_allclose(abs(T), 0.3 * N, rtol=1e-6)


def test_tool_that_is_elsewhere_at_first():
    """The displacement of a tool when its contact is made is no slip."""
    found = []
    for carried in (0.0, 0.4):
        msh = box(WORLD, (4, 4), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
        V = vector_space(msh)
        u = fem.Function(V)
        tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        tool.displacement = (carried, 0.0)
        surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
        contact = qs.Contact(surface, tool, friction=qs.Coulomb(0.3), penalty=100.0)
        problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
        tool.displacement = (carried, -0.05)
        problem.solve()
        found.append(contact.force("slave"))
    assert found[0][1] < -0.01
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-12)


# --- One contact, two problems


def test_contact_goes_on_in_another_problem():
    """Another problem continues the contact's history; the previous problem is then refused."""
    found = []
    for again in (False, True):
        pair = Pair("quadrilateral", contact_options={"friction": qs.Coulomb(0.1)})
        top = fem.Constant(pair.meshes[1], (0.0, -0.1))
        dofs = fem.locate_dofs_topological(pair.V[1], 1, plane(pair.meshes[1], 1, 1.0))
        pair.bcs[1][:] = [fem.dirichletbc(top, dofs, pair.V[1])]
        problem = pair.problem()
        for shift in (0.0, 0.1, 0.05):
            top.value[0] = shift
            problem.solve()
            if again:
                before, problem = problem, pair.problem()
                problem.set_up()
                raises_everywhere(WORLD, ValueError, "part of another problem", before.solve)
                before.destroy()
        slip, energy = largest(pair.contact.slip()), pair.contact.dissipated_energy()
        found.append([*pair.contact.force("slave"), energy, slip])
    assert min(found[0][2:]) > 1e-5
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)


@pytest.mark.parametrize("options", (PENALTY, AUGMENTED))
def test_stiff_rates_converge(options, monkeypatch):
    """If rounding of slips exceeds the tolerance of τ, Newton's method still terminates."""
    monkeypatch.setitem(LAWS, "norton", lambda: qs.Norton(0.3, 0.02, 0.1, v0=1e-13))
    scene, counts = Landing("norton", master="block", **options), []
    for depth in (0.0004, 0.0014, 0.0024):
        scene.top.value[1] = -DISTANCE - depth
        scene.problem.solve()
        counts.append(scene.problem.snes.getIterationNumber())
    assert counts[0] > 0
    assert max(counts) <= 20
