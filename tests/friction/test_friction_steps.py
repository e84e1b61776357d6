"""Friction in time steps: slip counts from the end of the last step, however it is reached."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space
from step_scenes import Upset, refuse

from dolfinx import fem

import qsdolfinx as qs

MU, PRESS, DRAG = 0.3, 0.05, 0.2


def history(case):
    """Return the friction history up to now."""
    contacts = case.contacts
    return np.array([*case.forces(), *(c.dissipated_energy() for c in contacts)])


@pytest.mark.parametrize(
    "friction, late",
    ((qs.Coulomb(0.2), 1), (qs.Norton(0.3, 3.0, 0.5), 1), (qs.Norton(0.3, 3.0, 0.5), 0)),
)
def test_failed_attempts_leave_no_trace(friction, late):
    """A step after an attempt that failed late equals the step without this attempt."""
    found = []
    for fail in (True, False):
        attempts = []

        def solve(step, fail=fail, attempts=attempts):
            case.problem.solve()
            attempts.append(step)
            if fail and attempts.count(late) == 1 and step == late:
                refuse(1.0)

        def faster(t, dt):
            case.tool.displacement = [0.0, -10 * t * dt]

        case = Upset(
            die=True, dt=0.05, drive=faster, solve=solve, contact={"friction": friction}, growth=1.0
        )
        for step in range(late + 2):
            if step == late and not fail:
                case.stepper.dt = 0.025
            case.stepper.step()
        found.append(history(case))
        cutbacks = case.stepper.num_cutbacks
        assert cutbacks == fail
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-12)
    assert np.all(found[0][-2:] > 0)


def sliding(num_pairings, deformable, drag=DRAG, steps=3, constraints="nodes"):
    """Press a block by a plane, or by another block, that then slides over it."""
    low = box(WORLD, (5, 4), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(low)
    u = [fem.Function(V)]
    F, bcs = [elastic(u[0])], [[clamp(V, plane(low, 1, 0.0))]]
    slave = qs.Surface(V, facets=plane(low, 1, 1.0))
    if deformable:
        top = box(WORLD, (21, 2), "triangle", [-2.0, 1.0], [3.0, 1.5])
        W = vector_space(top)
        u.append(fem.Function(W))
        F.append(elastic(u[1], E=2.0))
        motion = fem.Constant(top, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(W, 1, plane(top, 1, 1.5))
        bcs.append([fem.dirichletbc(motion, dofs, W)])
        master = qs.Surface(W, facets=plane(top, 1, 1.0))
    else:
        master = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    options = {"quadrature": "overlay", "enforcement": "augmented-lagrangian"}
    options |= {"friction": qs.Coulomb(MU), "constraints": constraints}
    contact = qs.Contact(slave, master, **options)
    problem = qs.ContactProblem(F, u, [contact], bcs)

    def drive(t, dt):
        change = np.array([0.0, -PRESS]) if t < 1.5 else np.array([drag, 0.0])
        if deformable:
            motion.value[:] = [drag * max(t - 1, 0), -PRESS]
        else:
            master.displacement = change

    stepper = qs.TimeStepper(problem, 1.0, drive, num_pairings=num_pairings)
    rows = []
    for _ in range(steps + 1):
        before = contact.slip()
        stepper.step()
        closed = contact.active()
        slip = WORLD.allreduce(((contact.slip() - before)[closed, 0]).sum())
        slip /= WORLD.allreduce(np.count_nonzero(closed))
        force = contact.force("slave")
        rows.append([slip, force[0] / force[1], contact.step_dissipation(), -force[1]])
        dissipated = contact.dissipated_energy()
    assert np.isclose(dissipated, sum(row[2] for row in rows), rtol=1e-12)
    return np.array(rows)


@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("deformable", (False, True))
@pytest.mark.parametrize("num_pairings", (1, 2, 3))
def test_steady_sliding(num_pairings, deformable, constraints):
    """Slip is the motion of the master, and its energy is friction times slip."""
    rows = sliding(num_pairings, deformable, constraints=constraints)
    slip, ratio, energy, normal = rows[-1]
    # An elastic surface tilts slightly under friction.
    np.testing.assert_allclose(abs(ratio), MU, rtol=0.015 if deformable else 1e-6)
    # The slave comes to rest, and the master moves ahead relative to it.
    np.testing.assert_allclose(slip, -DRAG, rtol=0.02)
    np.testing.assert_allclose(energy, MU * normal * DRAG, rtol=0.02)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("law", (qs.Coulomb(MU), qs.Tresca(0.01), qs.Sticking()))
@pytest.mark.parametrize("sampling", ({}, {"quadrature": "overlay", "constraints": "points"}))
def test_tool_driven_by_a_force(sampling, law, enforcement):
    """Friction enters the force balance of a tool that is pushed at an angle."""
    msh = box(WORLD, (9, 6), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    contact = qs.Contact(surface, tool, friction=law, enforcement=enforcement, **sampling)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
    direction = np.array([0.3, -1.0]) / np.hypot(0.3, 1.0)
    tool.drive(0.08, direction)
    problem.solve()
    first = contact.force("master") @ direction
    # Everything slips, too, except sticking, up to a friction of three pressures.
    way = 0.1 if isinstance(law, qs.Sticking) else 0.5
    tool.displacement = tool.displacement + np.array([way, 0.0])
    problem.solve()
    force = contact.force("slave")
    held = contact.force("master") @ direction
    slipping = WORLD.allreduce(int(contact.slipping().sum()))
    np.testing.assert_allclose([first, held], -0.08, rtol=1e-7)
    assert (slipping == 0) == isinstance(law, qs.Sticking)
    if isinstance(law, qs.Coulomb):
        np.testing.assert_allclose(force[0] / -force[1], MU, rtol=1e-6)


def dragged(unknown="displacement", friction=None):
    """Press a block by a plane and drag it."""
    friction = friction or qs.Coulomb(MU)
    msh = box(WORLD, (5, 4), "triangle", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u = fem.Function(V)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 1.0))
    dt = 1.0 if unknown == "velocity" or friction.needs_dt else None
    contact = qs.Contact(surface, tool, friction=friction, unknown=unknown, dt=dt)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, 0.0))]])
    tool.displacement = [0.3, -PRESS]
    problem.solve()
    return problem, contact


def test_velocities_start_each_step_anew():
    """A velocity-based body solved again without change has the same friction and slip again."""
    problem, contact = dragged("velocity", qs.Norton(1.0, 0.1, 1.0))
    forces, energies = [contact.force("slave")], [contact.step_dissipation()]
    problem.solve()
    forces.append(contact.force("slave"))
    energies.append(contact.step_dissipation())
    assert energies[0] > 0
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-8)
    np.testing.assert_allclose(energies[1], energies[0], rtol=1e-8)


def test_pairing_anew_is_no_slip():
    """contact.update() with total displacements gives no slip: nothing has moved."""
    problem, contact = dragged()
    before = contact.slip(), contact.force("slave"), contact.dissipated_energy()
    contact.update()
    problem.solve()
    after = contact.slip(), contact.force("slave"), contact.dissipated_energy()
    moved = largest(before[0])
    assert moved > 0.01
    np.testing.assert_allclose(after[0], before[0], atol=1e-9)
    np.testing.assert_allclose(after[1], before[1], rtol=1e-8)
    np.testing.assert_allclose(after[2], before[2], rtol=1e-8)


def test_a_step_ends_once():
    problem, contact = dragged()
    before = contact.dissipated_energy(), largest(contact.slip())
    with problem.one_step():
        pass
    contact.model.friction.end_step(contact.model.slips)
    after = contact.dissipated_energy(), largest(contact.slip())
    assert before[0] > 0 and after == before


@pytest.mark.parallel
def test_energy_below_corners_on_any_number_of_ranks():
    """Points beside a corner of a tool keep the friction of points below the same face.

    They took that of the closest point on the same rank, which may be below the other face, and
    with it another part of their slip was elastic.
    """
    found = []
    for comm in (MPI.COMM_SELF, WORLD):
        msh = box(comm, (24, 12), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
        V = vector_space(msh)
        u = fem.Function(V)
        x = np.array([[-0.387, 0.6], [-0.287, 0.0], [0.313, 0.0], [0.413, 0.6]])
        tool = qs.RigidSurface.triangulated(comm, x, [[0, 1], [1, 2], [2, 3]])
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        contact = qs.Contact(surface, tool, friction=qs.Coulomb(0.3), sliding="small")
        bcs = [clamp(V, plane(msh, 1, -1.0))]
        problem = qs.ContactProblem(elastic(u, E=1e3), u, contact, bcs)

        def drive(t, dt, tool=tool):
            tool.displacement = [0.0, -0.03 * dt] if t <= 2 else [0.04 * dt, 0.0]

        stepper, energies = qs.TimeStepper(problem, 1.0, drive), []
        for _ in stepper.run(4.0):
            energies.append(contact.dissipated_energy())
        found.append(energies)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8)
