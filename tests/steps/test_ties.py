"""Ties over time steps: tied points keep their partners, whatever moves with them."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.contact.turned import turning_error

RATE, STIFFNESS = 0.01, 20.0
KINDS = {
    "displacement": {},
    "velocity": {"unknown": "velocity", "dt": 1.0},
}


def block(comm=WORLD, low=0.0, n=4, partition="scattered", degree=1):
    """Function space of a unit block above this height."""
    msh = box(comm, (n, n), "quadrilateral", [0.0, low], [1.0, low + 1.0], partition)
    return fem.functionspace(msh, ("Lagrange", degree, (2,)))


def top_of(V, height=1.0):
    return qs.Surface(V, facets=plane(V.mesh, 1, height))


class OnTool:
    """A block tied to a plane on its top, and its stepper.

    Args:
        drive: Called with the tool, t and Δt.
        form: Function from u to the body's form.
        held: Whether the bottom is clamped.
    """

    def __init__(self, drive, form=None, held=True, kind="displacement", theta=0.5, **options):
        V = block()
        self.u = u = fem.Function(V)
        self.tool = qs.RigidSurface.plane(WORLD, [0.5, 1.0], [0.0, -1.0])
        options = {"penalty": STIFFNESS, "quadrature": "overlay"} | KINDS[kind] | options
        self.contact = qs.Contact(top_of(V), self.tool, law=qs.Tied(), **options)
        form = elastic(u, E=1.0, nu=0.0) if form is None else form(u)
        bcs = [clamp(V, plane(V.mesh, 1, 0.0))] if held else []
        self.problem = qs.ContactProblem([form], [u], [self.contact], [bcs])
        self.stepper = qs.TimeStepper(
            self.problem, 1.0, lambda t, dt: drive(self.tool, t, dt), theta=theta
        )


def pull(tool, t, dt):
    tool.displacement = [0.0, RATE * dt]


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("num_pairings", (1, 2))
def test_pulled_by_a_plane(num_pairings, quadrature, enforcement):
    """Block and tie act as two springs in series; the force grows with the displacement."""
    case = OnTool(pull, quadrature=quadrature, enforcement=enforcement)
    case.stepper.num_pairings = num_pairings
    stiffness = 1 / (1 + (1 / STIFFNESS if enforcement == "penalty" else 0))
    for i in range(1, 6):
        case.stepper.step()
        force = case.contact.force("slave")
        np.testing.assert_allclose(force, [0.0, i * RATE * stiffness], atol=1e-10)
        assert largest(case.contact.gap()[:, 1] + force[1] / STIFFNESS) < 1e-9 or (
            enforcement != "penalty"
        )


def test_moment_of_a_tool_that_has_rotated():
    """A tool stays at its angle if it is driven by the moment of the tie there."""

    def drive(tool, t, dt):
        tool.rotation = 0.4 if t == 1.0 else 0.0

    case = OnTool(drive, enforcement="augmented-lagrangian")
    case.stepper.step()
    moment = case.contact.moment("master", case.tool.center)[0]
    case.tool.drive_moment(-moment)
    case.stepper.step()
    c, s = np.cos(0.4), np.sin(0.4)
    np.testing.assert_allclose(case.tool.position[:, :2], [[c, -s], [s, c]], atol=1e-8)


@pytest.mark.parametrize("theta", (0.0, 0.5))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_flow_follows_a_plane(enforcement, theta):
    """The body lags behind the plane by its force over the stiffness; the lag does not grow."""
    case = OnTool(pull, kind="velocity", theta=theta, enforcement=enforcement)
    for i in range(1, 6):
        case.stepper.step()
        V = case.u.function_space
        height = WORLD.allreduce(V.mesh.geometry.x[:, 1].max(initial=0.0), op=MPI.MAX)
        lag = case.contact.force("slave")[1] / STIFFNESS if enforcement == "penalty" else 0.0
        assert abs(height - (1 + i * RATE - lag)) < 1e-9
        assert abs(case.contact.force("slave")[1]) < 1.1 * RATE


def two_blocks(kind, load, enforcement="penalty", degree=1):
    """Two tied blocks, the lower one clamped, the upper one loaded: problem, contact, unknowns."""
    V = [
        block(low=0.0, n=4, degree=degree),
        block(low=1.0, n=3, partition="backward", degree=degree),
    ]
    u = [fem.Function(space) for space in V]
    F = [elastic(w, E=1.0, nu=0.0) for w in u]
    top = np.sort(plane(V[1].mesh, 1, 2.0))
    tags = mesh.meshtags(V[1].mesh, 1, top, np.ones_like(top))
    ds = ufl.Measure("ds", domain=V[1].mesh, subdomain_data=tags)(1)
    force = fem.Constant(V[1].mesh, np.array(load))
    F[1] -= ufl.inner(force, ufl.TestFunction(V[1])) * ds
    options = {"penalty": STIFFNESS, "quadrature": "overlay", "enforcement": enforcement}
    surfaces = [qs.Surface(space, facets=plane(space.mesh, 1, 1.0)) for space in V]
    contact = qs.Contact(*surfaces[::-1], law=qs.Tied(), **options, **KINDS[kind])
    bcs = [[clamp(V[0], plane(V[0].mesh, 1, 0.0))], []]
    return qs.ContactProblem(F, u, [contact], bcs), contact, u


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
def test_a_constant_load_lets_nothing_creep(enforcement, degree):
    """Under a constant load nothing creeps.

    Surfaces of degree 2 are curved at contact detection, too.
    """
    load = [0.02, -0.1]
    problem, contact, u = two_blocks("displacement", load, enforcement, degree)
    problem.solve()
    expected, jump = [w.x.array.copy() for w in u], contact.gap().copy()
    stepper = qs.TimeStepper(problem, 1.0)
    for _ in range(4):
        stepper.step()
        for w, before in zip(u, expected, strict=True):
            assert largest(w.x.array - before) < 1e-7 * largest(before)
        assert largest(contact.gap() - jump) < 1e-9
        np.testing.assert_allclose(contact.force("slave"), [-0.02, 0.1], atol=1e-8)


def test_flowing_bodies_stay_together():
    """With velocity-based bodies under a constant load, the gap at the tie is that of the force.

    This holds at all times.
    """
    problem, _, u = two_blocks("velocity", [0.0, -0.1])
    stepper = qs.TimeStepper(problem, 0.1)
    for _ in range(4):
        stepper.step()
        x = [w.function_space.mesh.geometry.x[:, 1] for w in u]
        high = WORLD.allreduce(x[0].max(initial=-1.0), op=MPI.MAX)
        low = WORLD.allreduce(x[1].min(initial=9.0), op=MPI.MIN)
        assert abs(high - low - 0.1 / STIFFNESS) < 1e-8


def test_turned_by_a_right_angle():
    """A free block rotates with its plane, without strain in the block or in the tie."""

    def form(u):
        P = materials.neo_hookean(u, 1.0, 1.0)
        return ufl.inner(P, ufl.grad(ufl.TestFunction(u.function_space))) * ufl.dx

    def drive(tool, t, dt):
        tool.rotation = np.pi / 72 * dt
        tool.displacement = [0.025 * dt, 0.0]

    case = OnTool(drive, form, held=False, penalty=5.0)
    for _ in case.stepper.run(36.0):
        pass
    x = case.u.function_space.tabulate_dof_coordinates()[:, :2] - [0.5, 1.0]
    moved = np.array([[0.0, -1.0], [1.0, 0.0]]) @ x.T - x.T + np.array([[0.9], [0.0]])
    assert largest(case.u.x.array.reshape(-1, 2) - moved.T) < 1e-8
    assert largest(case.contact.force("slave")) < 1e-8
    assert case.stepper.num_cutbacks == 0


def test_failed_attempts_leave_no_trace():
    """Steps that are cut back end in the same state as whole steps."""
    whole, case = OnTool(pull), OnTool(pull)
    for _ in whole.stepper.run(3.0):
        pass
    attempts = []

    def solve(step):
        case.problem.solve()
        attempts.append(step)
        if attempts == [0, 1]:
            raise qs.ConvergenceError(-3, [1.0], [])

    stepper = qs.TimeStepper(case.problem, 1.0, lambda t, dt: pull(case.tool, t, dt), solve=solve)
    for _ in stepper.run(3.0):
        pass
    assert stepper.num_cutbacks == 1
    assert largest(case.u.x.array - whole.u.x.array) < 1e-10
    np.testing.assert_allclose(
        case.contact.force("slave"), whole.contact.force("slave"), atol=1e-10
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return WORLD.bcast(str(tmp_path_factory.mktemp("ties")) if WORLD.rank == 0 else None)


@pytest.mark.parametrize("kind", KINDS)
def test_restart(folder, kind):
    whole, again = (OnTool(pull, kind=kind) for _ in range(2))
    for _ in range(2):
        whole.stepper.step()
    qs.save_run(whole.stepper, f"{folder}/{kind}")
    for _ in range(2):
        whole.stepper.step()
    qs.load_run(again.stepper, f"{folder}/{kind}")
    for _ in range(2):
        again.stepper.step()
    np.testing.assert_allclose(
        again.contact.force("slave"), whole.contact.force("slave"), rtol=1e-9, atol=1e-12
    )


def test_steps_by_hand():
    """A tie follows its tool in solves without steps, with or without an update of contact."""
    forces = []
    for updates in (False, True):
        case = OnTool(pull, enforcement="penalty")
        for _ in range(3):
            case.tool.displacement = [0.0, RATE]
            case.problem.solve()
            case.tool.advance()
            if updates:
                case.contact.update()
        case.problem.solve()
        forces.append(case.contact.force("slave")[1])
    np.testing.assert_allclose(forces, 3 * RATE / (1 + 1 / STIFFNESS), rtol=1e-9)


class Rings:
    """Two tied rings whose facets do not match, both rotated at their far sides.

    Their chords have gaps. A tie that did not rotate these gaps would strain a rigid rotation.
    """

    def __init__(self, sliding):
        self.values, F, u, bcs, surfaces = [], [], [], [], []
        for n, low, held in ((8, 0.5, 0.5), (13, 1.0, 1.5)):
            msh = self._mesh(n, low)
            V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
            u.append(fem.Function(V))
            P = materials.neo_hookean(u[-1], 1.0, 1.0)
            F.append(ufl.inner(P, ufl.grad(ufl.TestFunction(V))) * ufl.dx)
            self.values.append(fem.Function(V))
            dofs = fem.locate_dofs_topological(V, 1, self._at(msh, held))
            bcs.append([fem.dirichletbc(self.values[-1], dofs)])
            surfaces.append(qs.Surface(V, facets=self._at(msh, 1.0)))
        self.tie = qs.Contact(*surfaces[::-1], law=qs.Tied(), sliding=sliding)
        self.problem = qs.ContactProblem(F, u, [self.tie], bcs)

    @staticmethod
    def _mesh(n, low):
        r, angle = np.array([low, low + 0.5]), 2 * np.pi * np.arange(n) / n
        x = np.array([[q * np.cos(a), q * np.sin(a)] for a in angle for q in r])
        i = 2 * np.arange(n)
        j = 2 * ((np.arange(n) + 1) % n)
        cells = np.stack([i, j, i + 1, j + 1], axis=1)
        if WORLD.rank > 0:
            x, cells = x[:0], cells[:0]
        element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        return mesh.create_mesh(WORLD, cells=cells, x=x, e=ufl.Mesh(element))

    @staticmethod
    def _at(msh, radius):
        return mesh.locate_entities_boundary(
            msh, 1, lambda x: np.isclose(np.hypot(x[0], x[1]), radius)
        )

    def turn(self, angle):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c - 1, -s], [s, c - 1]])
        for value in self.values:
            value.interpolate(lambda x: R @ x[:2])

    @property
    def traction(self):
        return largest(self.tie.traction("slave").x.array)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_rings_turned_by_half_a_turn(sliding):
    case = Rings(sliding)
    stepper = qs.TimeStepper(case.problem, 1.0, lambda t, dt: case.turn(t * np.pi / 3))
    for _ in range(3):
        stepper.step()
        assert case.traction < 1e-6
    assert stepper.num_cutbacks == 0


def test_rings_turned_by_hand():
    """Solves without steps rotate small gaps by small rotations only, and give a warning."""
    case = Rings("small")
    case.turn(0.5)
    with pytest.warns(qs.ContactWarning, match="tied surfaces with a gap"):
        case.problem.solve()
    assert case.traction > 1e-4


@pytest.mark.parallel
def test_error_of_rotations_on_any_rank():
    """The traction due to linearised rotations is the same on all ranks."""
    case = Rings("small")
    case.turn(0.5)
    with pytest.warns(qs.ContactWarning, match="tied surfaces with a gap"):
        case.problem.solve()
    errors = WORLD.allgather(turning_error(case.tie.model))
    assert min(errors) == max(errors) > 0
