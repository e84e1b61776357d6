"""Energy dissipated by friction: of second order in Δt, with slip and release within a step."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, plane, vector_space

import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs
from qsdolfinx.friction.dissipation import Evaluated, slip_and_energy
from qsdolfinx.friction.laws import Response, Rows

H, RADIUS, DOWN, WAY = 0.1, 1.5, 0.05, 0.8


def slide(facets, **options):
    """Press a cylinder on a block and slide it by this number of facets per step.

    Returns:
        The tool's work, by the trapezoidal rule; the friction energy; the energy left, all summed.
    """
    msh = box(WORLD, (30, 10), "quadrilateral", [0.0, -1.0], [3.0, 0.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.cylinder(WORLD, [1.1, RADIUS], None, RADIUS)
    options |= {"quadrature": "overlay", "friction": qs.Coulomb(0.2)}
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), tool, **options)
    bcs = [clamp(V, plane(msh, 1, -1.0))]
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])
    strain = ufl.sym(ufl.grad(u))
    energy = fem.form(0.5 * ufl.inner(qs.materials.linear_elastic(u, 1.0, 0.3), strain) * ufl.dx)
    velocities = np.array([(0.0, -DOWN), (WAY, 0.0)])

    def drive(t, dt):
        tool.displacement = velocities[int(t > 1 + 1e-9)] * dt

    steps = round(WAY / (facets * H))
    stepper = qs.TimeStepper(problem, 1 / steps, drive, max_penetration=None)
    work, before = 0.0, np.zeros(2)
    for end in (1.0, 2.0):
        for _ in stepper.run(end):
            force = contact.force("slave")
            work += 0.5 * (before + force) @ velocities[int(end > 1)] * stepper.last_dt
            before = force
    stored = WORLD.allreduce(fem.assemble_scalar(energy), op=MPI.SUM)
    if not contact.model.augmented:
        stored += contact.stored_energy()
    return work, contact.dissipated_energy(), stored


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_energy_balance_of_sliding(enforcement):
    """The tool's work is stored or dissipated, also by nodes that leave in one of 3 to 6 steps."""
    fine, coarse = (np.array(slide(facets, enforcement=enforcement)) for facets in (0.25, 1.0))
    np.testing.assert_allclose(fine[1] + fine[2], fine[0], rtol=0.006)
    np.testing.assert_allclose(coarse[1], fine[1], rtol=0.05)  # 0.07 without released nodes


@pytest.mark.parametrize("law", (qs.Norton(0.3, 10.0, 0.4), qs.Tresca(2.0), qs.Coulomb(0.2)))
def test_energy_of_flow_is_the_work_of_contact_forces(law):
    """Friction takes the held nodes' work minus the fluid's, in each step of a pressed slide.

    At the trailing end of the block nodes are released, or lose the friction of a law that jumps.
    """
    msh = box(WORLD, (16, 8), "quadrilateral", [0.0, 0.0], [2.0, 1.0])
    V = vector_space(msh)
    u, top = fem.Function(V), fem.Constant(msh, (0.0, 0.0))
    held = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
    F = elastic(u, E=100.0)
    form = fem.form(F)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    options = {"quadrature": "overlay", "enforcement": "augmented-lagrangian", "friction": law}
    contact = qs.Contact(surface, tool, unknown="velocity", dt=0.25, **options)
    problem = qs.ContactProblem([F], [u], [contact], [[fem.dirichletbc(top, held, V)]])

    def drive(t, dt):
        top.value[:] = (0.0, -0.05) if t < 1 + 1e-6 else (0.2, -0.02)

    def solve(step):
        problem.solve()
        residual = fem.assemble_vector(form)
        residual.scatter_reverse(la.InsertMode.add)
        n = V.dofmap.index_map.size_local
        free = np.ones(n, dtype=bool)
        free[held[held < n]] = False
        forces, v = (x[: 2 * n].reshape(n, 2)[free] for x in (residual.array, u.x.array))
        power.append(-WORLD.allreduce(float(np.sum(forces * v)), op=MPI.SUM))

    power: list[float] = []
    stepper = qs.TimeStepper(problem, 0.25, drive, solve=solve, max_penetration=None)
    for step in range(10):
        dt = stepper.step((step + 1) * 0.25)
        if stepper.t > 1.6:  # until gaps are constant, normal forces do work as well
            np.testing.assert_allclose(contact.step_dissipation(), dt * power[-1], rtol=1e-4)


@pytest.mark.parametrize("bulge", (0.02, 0.06))
def test_energy_of_flow_that_closes(bulge):
    """Friction takes Σ F·v Δt in each step; in most steps nodes of a round side become active.

    Each of these nodes gives as much heat as friction dissipates there.
    """
    msh = box(WORLD, (16, 4), "quadrilateral", [0.0, 0.0], [2.0, 1.0])
    x = msh.geometry.x
    x[:, 1] += bulge * (x[:, 0] - 0.7) ** 2 * (1 - x[:, 1])
    V = vector_space(msh)
    bottom = mesh.locate_entities_boundary(
        msh, 1, lambda x: np.isclose(x[1], bulge * (x[0] - 0.7) ** 2)
    )
    v, top = fem.Function(V), fem.Constant(msh, (0.1, -0.05))
    held = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"unknown": "velocity", "dt": 0.1, "friction": qs.Coulomb(0.3)}
    options["constraints"] = "nodes"
    contact = qs.Contact(qs.Surface(V, facets=bottom), tool, **options)
    F = elastic(v, E=10.0)
    problem = qs.ContactProblem([F], [v], [contact], [[fem.dirichletbc(top, held, V)]])
    Q, form = fem.functionspace(msh, ("Lagrange", 1)), fem.form(F)
    T, before, dt = fem.Function(Q), fem.Function(Q), fem.Constant(msh, 0.1)
    law = qs.Conductance(1e-12, tool=0.0, friction=1.0)
    rubbed = qs.Contact(qs.Surface(Q, facets=bottom), tool, law=law, mechanics=contact, dt=0.1)
    warm = qs.ContactProblem([qs.materials.heat(T, 1.0, 1.0, before, dt)], [T], [rubbed])
    power = []

    def read():
        """Record the power: forces at free nodes are contact forces, with friction along x."""
        b = fem.assemble_vector(form)
        b.scatter_reverse(la.InsertMode.add)
        free = np.ones(V.dofmap.index_map.size_local, dtype=bool)
        free[held[held < len(free)]] = False
        along = [values[: 2 * len(free) : 2][free] for values in (b.array, v.x.array)]
        power.append(-WORLD.allreduce(float(along[0] @ along[1]), op=MPI.SUM))

    staggered = qs.Staggered(warm, [before], dt)
    stepper = qs.TimeStepper(problem, 0.1, staggered=staggered, max_penetration=None)
    stepper.on_solved = read
    active, sums = [], 0.0
    for _ in stepper.run(0.8):
        active.append(WORLD.allreduce(int(contact.active().sum()), op=MPI.SUM))
        work = stepper.last_dt * power[-1]
        np.testing.assert_allclose(contact.step_dissipation(), work, rtol=1e-6, atol=1e-12)
        heat = stepper.last_dt * rubbed.flow("slave")
        np.testing.assert_allclose(heat, work, rtol=1e-6, atol=1e-9)
        sums += work
    assert np.count_nonzero(np.diff(active)) >= 3
    np.testing.assert_allclose(contact.dissipated_energy(), sums, rtol=1e-6)


@pytest.mark.parallel
def test_energy_under_an_edge():
    """A block drawn over a longer plate, the slave, in full slip dissipates T times its path."""
    bodies, bcs = [], []
    moved = None
    for n, low, high in (((12, 3), [0.0, -1.0], [4.0, 0.0]), ((4, 4), [0.5, 0.0], [1.5, 1.0])):
        V = vector_space(box(WORLD, n, "quadrilateral", low, high))
        bodies.append((V, fem.Function(V)))
        moved = fem.Constant(V.mesh, np.zeros(2))
        end = plane(V.mesh, 1, -1.0 if low[1] < 0 else 1.0)
        dofs = fem.locate_dofs_topological(V, 1, end)
        bcs.append([fem.dirichletbc(moved, dofs, V)])
    plate, block = (qs.Surface(V, facets=plane(V.mesh, 1, 0.0)) for V, _ in bodies)
    contact = qs.Contact(plate, block, friction=qs.Coulomb(0.3))
    u = [function for _, function in bodies]
    problem = qs.ContactProblem([elastic(f, E=1e4) for f in u], u, [contact], bcs)

    def drive(t, dt):
        moved.value[:] = (0.5 * max(t - 0.2, 0), -0.01 * min(t / 0.2, 1))

    stepper = qs.TimeStepper(problem, 0.1, drive)
    taken, work = 0.0, 0.0
    for t in stepper.run(1.0):
        if t > 0.45:
            taken += contact.step_dissipation()
            work += abs(contact.force("slave")[0]) * 0.5 * stepper.last_dt
    np.testing.assert_allclose(taken, work, rtol=0.01)


@pytest.mark.parallel
@pytest.mark.parametrize("steps", (1, 3))
@pytest.mark.parametrize("is_slave", (False, True))
def test_energy_as_force_and_path_grow(is_slave, steps):
    """A block pressed and dragged at once: D is the work that is not stored, for either slave."""
    F, energies, u, bcs, sides = [], [], [], [], []
    for n, low, high, held, touching in (
        ((20, 5), [0.0, -1.0], [4.0, 0.0], -1.0, 0.0),
        ((6, 5), [1.05, 0.0], [2.05, 1.0], 1.0, 0.0),
    ):
        V = vector_space(box(WORLD, n, "quadrilateral", low, high))
        u.append(fem.Function(V))
        F.append(elastic(u[-1], E=1e3, nu=0.0))
        energies.append(fem.form(0.5 * 1e3 * ufl.inner(strain(u[-1]), strain(u[-1])) * ufl.dx))
        moved = fem.Constant(V.mesh, np.zeros(2))
        dofs = fem.locate_dofs_topological(V, 1, plane(V.mesh, 1, held))
        bcs.append([fem.dirichletbc(moved, dofs, V)])
        sides.append(qs.Surface(V, facets=plane(V.mesh, 1, touching)))
    if not is_slave:
        sides.reverse()
    contact = qs.Contact(*sides, friction=qs.Coulomb(0.3))
    problem = qs.ContactProblem(F, u, [contact], bcs)

    def drive(t, dt):
        moved.value = (0.2 * t, -0.02 * t)

    stepper = qs.TimeStepper(problem, 1 / steps, drive)
    work, force, place = 0.0, np.zeros(2), np.zeros(2)
    for _ in stepper.run(1.0):
        before, force = force, -contact.force("master" if is_slave else "slave")
        start, place = place, np.array(moved.value)
        work += 0.5 * (before + force) @ (place - start)
    stored = sum(WORLD.allreduce(fem.assemble_scalar(energy)) for energy in energies)
    assert contact.dissipated_energy() == pytest.approx(work - stored, rel=0.02)


def strain(u):
    return ufl.sym(ufl.grad(u))


# --- Constraints whose pressure changes


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_energy_of_a_block_with_walls(sliding):
    """In steady sliding, friction dissipates the work of the drag, also if walls are named.

    At the corners, pressures end at the wall, which has none.
    """
    msh = box(WORLD, (6, 3), "quadrilateral", [0.0, 0.0], [0.8, 0.4])
    V = vector_space(msh)
    u = fem.Function(V)
    facets = mesh.locate_entities_boundary(msh, 1, lambda x: x[1] < 0.39)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    surface = qs.Surface(V, facets=facets)
    contact = qs.Contact(surface, floor, friction=qs.Coulomb(0.4), sliding=sliding)
    top = fem.Constant(msh, (0.0, 0.0))
    dofs = fem.locate_dofs_topological(V, 1, plane(msh, 1, 0.4))
    problem = qs.ContactProblem([elastic(u)], u, contact, [fem.dirichletbc(top, dofs, V)])

    def drive(t, dt):
        top.value[:] = 0.2 * max(t - 1, 0), -0.02 * min(t, 1)

    stepper = qs.TimeStepper(problem, 0.25, drive)
    for t in stepper.run(2.5):
        if t > 1.9:  # slips everywhere, steadily
            work = 0.2 * stepper.last_dt * abs(contact.force("slave")[0])
            assert np.isclose(contact.step_dissipation(), work, rtol=1e-6)


def evaluated(law, pressed, pressure, slip, gap=0.0, before=0.0, same=True, means=False, used=1.0):
    """Evaluate a law at one constraint in the plane, slipping along x, with rigid stick."""
    one = np.ones(1)
    rows = Rows(
        np.array([[slip, 0.0]]),
        np.array([[0.0, 0.0]]),
        pressure * one,
        np.array([pressure > 0]),
        np.zeros(1, dtype=bool),
        1e9 * one,
        np.eye(2)[None],
        one,
        0.5,
        1e-3,
        {name: value * one for name, value in law.parameters.items()},
        slip / (slip + before) * one,
        pressed * one,
    )
    response = law.respond(rows)
    assert isinstance(response, Response)
    leaving = np.array([used if pressure == 0 and pressed > 0 else 0.0])
    way = np.array([[before, 0.0]])
    return Evaluated(rows, response, leaving, gap * one, 0.1, means, way, same)


LAWS = {
    "coulomb": (qs.Coulomb(0.3), lambda p: 0.3 * p),
    "tresca": (qs.Tresca(0.4), lambda p: 0.4 + 0 * p),
    "both": (qs.CoulombTresca(0.3, 1.0, 0.5), lambda p: np.minimum(0.3 * p, 0.5 / np.sqrt(3))),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("pressures", ((1.0, 2.0), (2.0, 0.5), (0.0, 1.0)))
def test_pressure_that_changes(law, pressures):
    """With a pressure of constant rate, friction is the mean of the limit along the path."""
    friction, limit = LAWS[law]
    slip, energy = slip_and_energy(friction, evaluated(friction, *pressures, slip=0.2))
    expected = 0.2 * np.mean(limit(np.linspace(*pressures, 100_001)))
    np.testing.assert_allclose(slip, [[0.2, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(energy, expected, rtol=3e-3)


@pytest.mark.parametrize("law", LAWS)
def test_row_that_leaves(law):
    """λ_0 = 2 at compliance 0.1 is a gap of 0.2: release after 2/5 of the path to a gap of 0.3."""
    friction, limit = LAWS[law]
    step = evaluated(friction, 2.0, 0.0, slip=0.5, gap=-0.3)
    slip, energy = slip_and_energy(friction, step)
    expected = 0.4 * 0.5 * np.mean(limit(np.linspace(2.0, 0.0, 100_001)))
    np.testing.assert_allclose(slip, [[0.2, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(energy, expected, rtol=3e-3)
    friction = qs.Norton(0.3, 2.0, 0.5, v0=1e-6)  # at the slip rate of the time in contact
    step = evaluated(friction, 2.0, 0.0, slip=0.5, gap=-0.3)
    rate = 0.5 / 0.5
    np.testing.assert_allclose(
        slip_and_energy(friction, step)[1], 0.3 * 2.0 * rate**0.5 * 0.2, rtol=1e-6
    )


@pytest.mark.parametrize("law", LAWS)
def test_row_that_sticks_and_leaves(law):
    """A row that used the part a of its limit slips during the last part a of its time."""
    friction, _ = LAWS[law]
    slips, energies = zip(
        *(
            slip_and_energy(friction, evaluated(friction, 2.0, 0.0, slip=0.5, gap=-0.3, used=used))
            for used in (0.0, 0.5, 1.0)
        ),
        strict=True,
    )
    np.testing.assert_allclose(np.ravel(slips)[::2], [0.0, 0.1, 0.2], rtol=1e-6)
    np.testing.assert_allclose(np.ravel(energies), energies[-1] * [0.0, 0.25, 1.0], rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_edge_that_slides_over_rows(law):
    """Pressures on different areas change like the normal force of the contact."""
    friction, limit = LAWS[law]
    for pressed, pressure, begun in ((3.0, 1.0, 1.0), (3.0, 1.0, 0.0), (2.0, 0.0, 1.0)):
        step = evaluated(friction, pressed, pressure, slip=0.2, same=False)
        expected = 0.0
        if pressure:
            expected = 0.2 * np.mean(limit(np.linspace(begun, 1.0, 10001) * pressure))
        found = slip_and_energy(friction, step, begun)[1]
        np.testing.assert_allclose(found, expected, rtol=2e-3)  # by a quadrature rule


def test_means_over_a_step():
    """A multiplier that is a mean over the step acts on all of it, also before activation.

    In this case the initial pressure, a mean over the previous step, gives no information.
    """
    friction = qs.Coulomb(0.3)
    whole = slip_and_energy(friction, evaluated(friction, 1.0, 2.0, slip=0.2, means=True))
    np.testing.assert_allclose(whole[1], 0.3 * 2.0 * 0.2, rtol=1e-6)
    part = evaluated(friction, 0.0, 2.0, slip=0.2, before=0.6, means=True)
    np.testing.assert_allclose(slip_and_energy(friction, part)[1], 0.3 * 2 * 0.8, rtol=1e-6)
