"""Runs with friction that continue from a checkpoint on any number of ranks."""

import pathlib

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space
from step_scenes import Upset

from dolfinx import fem, mesh

import qsdolfinx as qs

SELF = MPI.COMM_SELF
PENALTY = {"sliding": "small", "enforcement": "penalty", "penalty": 30.0}
AUTOMATIC = {"sliding": "small", "enforcement": "penalty"}
AUGMENTED = {"sliding": "small", "enforcement": "augmented-lagrangian"}
FINITE = {"sliding": "finite"}


@pytest.fixture
def folder(tmp_path_factory):
    """A folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0)) / "state"


class Dragged:
    """An elastic block, pressed and dragged forwards and backwards by a plane or a stiffer block.

    It sticks in part, slips, sticks again and slips back: the result depends on the history.
    """

    PATH = ((0.0, -0.03), (0.03, -0.06), (0.05, -0.06), (0.1, -0.06), (0.098, -0.06), (0.06, -0.06))
    #: Less than the total downward motion of the plane.
    RADIUS = 0.045

    def __init__(self, comm=WORLD, kind="tool", partition="forward", **options):
        low = box(comm, (5, 4), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
        V = vector_space(low)
        self.u, bcs = [fem.Function(V)], [[clamp(V, plane(low, 1, 0.0))]]
        F = [elastic(self.u[0])]
        slave = qs.Surface(V, facets=plane(low, 1, 1.0))
        if kind == "tool":
            self.tool = master = qs.RigidSurface.plane(comm, [0.0, 1.0], [0.0, -1.0])
        else:
            top = box(comm, (9, 2), "triangle", [-0.5, 1.0], [1.5, 1.5], "backward")
            W = vector_space(top)
            self.u.append(fem.Function(W))
            F.append(elastic(self.u[1], E=2.0))
            self.tool, self.motion = None, fem.Constant(top, (0.0, 0.0))
            dofs = fem.locate_dofs_topological(W, 1, plane(top, 1, 1.5))
            bcs.append([fem.dirichletbc(self.motion, dofs, W)])
            master = qs.Surface(W, facets=plane(top, 1, 1.0))
        options |= {"quadrature": "overlay", "search_radius": self.RADIUS}
        options |= {"friction": qs.Coulomb(0.3)}
        self.contacts = [qs.Contact(slave, master, **options)]
        self.problem = qs.ContactProblem(F, self.u, self.contacts, bcs)
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.move)

    def move(self, t, dt):
        step = round(t)
        before = self.PATH[step - 2] if step > 1 else (0.0, 0.0)
        if self.tool is None:
            self.motion.value[:] = self.PATH[step - 1]
        else:
            self.tool.displacement = np.subtract(self.PATH[step - 1], before)


class Rolled:
    """An elastic block with a ball that is pressed into it and moved: the tangent planes tilt."""

    PATH = ((0.0, 0.0, -0.1), (0.1, 0.05, -0.1), (0.1, 0.2, -0.12), (0.2, 0.1, -0.12))

    def __init__(self, comm=WORLD, partition="forward", **options):
        msh = box(comm, (3, 3, 2), "hexahedron", [0.0] * 3, [1.0] * 3, partition)
        V = vector_space(msh)
        u = fem.Function(V)
        self.tool = qs.RigidSurface.sphere(comm, [0.4, 0.4, 1.6], 0.6)
        surface = qs.Surface(V, facets=plane(msh, 2, 1.0))
        options = {"friction": qs.Coulomb(0.3)} | options
        self.contacts = [qs.Contact(surface, self.tool, formulation="master-slave", **options)]
        bcs = [clamp(V, plane(msh, 2, 0.0))]
        self.problem = qs.ContactProblem([elastic(u)], [u], self.contacts, [bcs])
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.move)

    def move(self, t, dt):
        step = round(t)
        before = self.PATH[step - 2] if step > 1 else np.zeros(3)
        self.tool.displacement = np.subtract(self.PATH[step - 1], before)


class Cornered:
    """An elastic block dragged along a floor into the corner with a wall, and moved there."""

    PATH = ((0.0, 0.03), (-0.06, 0.04), (-0.08, 0.06), (-0.12, 0.06), (-0.12, 0.12))

    def __init__(self, comm=WORLD, partition="forward", **options):
        msh = box(comm, (4, 4), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
        V = vector_space(msh)
        u = fem.Function(V)
        x = [[1.02, 1.4], [1.02, 0.8], [1.02, 0.3], [1.02, 0.0], [0.5, 0.0], [-0.5, 0.0]]
        lines = np.column_stack([np.arange(5), np.arange(1, 6)])
        self.tool = qs.RigidSurface.triangulated(comm, x, lines)
        side = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[0], 1) & (x[1] < 0.9))
        faces = np.concatenate([side, plane(msh, 1, 0.0)])
        options = {"friction": qs.Coulomb(0.3), "quadrature": "nodal"} | options
        self.contacts = [qs.Contact(qs.Surface(V, facets=faces), self.tool, **options)]
        bcs = [clamp(V, plane(msh, 1, 1.0))]
        self.problem = qs.ContactProblem([elastic(u)], [u], self.contacts, [bcs])
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.move)

    def move(self, t, dt):
        step = round(t)
        before = self.PATH[step - 2] if step > 1 else np.zeros(2)
        self.tool.displacement = np.subtract(self.PATH[step - 1], before)


class Indented:
    """A block into which a tool with two blunt corners is pressed, then dragged.

    At the solution of a step one corner is not paired that carries in this step and the next.
    """

    def __init__(self, comm=WORLD, partition="forward", **options):
        msh = box(comm, (6, 3), "triangle", [-0.55, 0.0], [0.45, 0.5], partition)
        V = vector_space(msh)
        u = fem.Function(V)
        x = [[-0.6, 0.9], [-0.3, 0.52], [0.1, 0.502], [0.6, 0.9]]
        self.tool = qs.RigidSurface.triangulated(comm, x, [[0, 1], [1, 2], [2, 3]])
        slave = qs.Surface(V, facets=plane(msh, 1, 0.5))
        self.contacts = [qs.Contact(slave, self.tool, friction=qs.Coulomb(0.1), **options)]
        bcs = [clamp(V, plane(msh, 1, 0.0))]
        form = elastic(u, E=2e3, nu=0.3)
        self.problem = qs.ContactProblem([form], [u], self.contacts, [bcs])
        self.stepper = qs.TimeStepper(self.problem, 0.25, self.move)

    def move(self, t, dt):
        self.tool.displacement = [0.02 * dt if t > 0.5 else 0.0, -0.04 * dt]


class Flowing(Upset):
    """A viscous block on an elastic die, upset by a plane that also drags the block."""

    def __init__(self, comm=WORLD, partition="forward", **options):
        options = {"contact": {"friction": qs.Coulomb(0.1)} | options}
        super().__init__(comm, die=True, dt=0.02, growth=1.0, partition=partition, **options)

    def move(self, t, dt):
        way = 1.0 if t < 0.07 else -0.5
        self.tool.displacement = [way * dt, -dt]


class Overhanging:
    """A block with a rounded bottom that is dragged beyond the end of another block, and back.

    In the step back, points between other facets come near each other.
    """

    PATH = ((0.0, -0.02), (0.05, -0.03), (0.1, -0.04), (0.15, -0.05), (0.12, -0.05), (0.2, -0.05))

    def __init__(self, comm=WORLD, partition="forward", **options):
        low = box(comm, (7, 3), "triangle", [0.0, 0.0], [1.0, 0.5], partition)
        top = box(comm, (5, 3), "triangle", [0.35, 0.5], [1.05, 1.0], "backward")
        facets = plane(low, 1, 0.5), plane(top, 1, 0.5)
        x = top.geometry.x
        x[:, 1] += 0.7 * (x[:, 0] - 0.7) ** 2 * (1.0 - x[:, 1])
        V = [vector_space(msh) for msh in (low, top)]
        u, self.motion = [fem.Function(space) for space in V], fem.Constant(top, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(V[1], 1, plane(top, 1, 1.0))
        bcs = [[clamp(V[0], plane(low, 1, 0.0))], [fem.dirichletbc(self.motion, dofs, V[1])]]
        surfaces = [qs.Surface(V[i], facets=facets[i]) for i in (1, 0)]
        options = {"friction": qs.Coulomb(0.3), "search_radius": 0.05} | options
        self.contacts = [qs.Contact(*surfaces, **options)]
        F = [elastic(u[0]), elastic(u[1], E=2.0)]
        self.problem = qs.ContactProblem(F, u, self.contacts, bcs)
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.move)

    def move(self, t, dt):
        self.motion.value[:] = self.PATH[round(t) - 1]


CASES = {
    "tool": (Dragged, {"kind": "tool"}),
    "body": (Dragged, {"kind": "body"}),
    "ball": (Rolled, {}),
    "corner": (Cornered, {}),
    "flow": (Flowing, {}),
    "edges": (Indented, {}),
    "overhanging": (Overhanging, {}),
}


def results(case):
    """Numbers that do not depend on the partition."""
    comm, out = case.problem.comm, []
    for contact in case.contacts:
        slip, tau, pressure = contact.slip(), contact.tangential_multiplier(), contact.multiplier()
        local = [a.sum(axis=0) for a in (slip, slip**2, tau, tau**2)]
        sums = np.concatenate([*local, [pressure @ pressure, *states(contact)]])
        out += [*comm.allreduce(sums), *contact.force("slave"), contact.step_dissipation()]
        out.append(contact.dissipated_energy())
    return np.array(out)


def states(contact):
    """Counts of this rank's nodes that slip, and that are in contact."""
    return np.array([np.count_nonzero(contact.slipping()), np.count_nonzero(contact.active())])


@pytest.mark.parametrize(
    "name, at, options",
    (
        ("tool", 1, AUGMENTED),
        ("tool", 3, PENALTY),
        ("tool", 2, AUTOMATIC),
        ("body", 2, PENALTY),
        ("body", 3, AUGMENTED),
        ("ball", 2, PENALTY),
        ("ball", 2, AUGMENTED),
        ("corner", 2, PENALTY),
        ("corner", 2, AUGMENTED),
        ("edges", 4, {"sliding": "small"}),
        ("flow", 2, PENALTY),
        ("flow", 2, AUGMENTED),
        ("overhanging", 4, PENALTY),
        ("overhanging", 4, AUGMENTED),
        ("overhanging", 4, AUGMENTED | FINITE),
        ("tool", 1, AUGMENTED | FINITE),
        ("body", 2, PENALTY | FINITE),
        ("ball", 2, AUGMENTED | FINITE),
    ),
)
def test_goes_on_as_if_uninterrupted(folder, name, at, options):
    """After a restart, tractions, slip and energy of later steps are as without interruption.

    This holds on another partition and on one rank, too.
    """
    make, more = CASES[name]
    whole, expected = make(**more, **options), []
    for _ in range(at):
        whole.stepper.step()
    qs.save_run(whole.stepper, folder)
    kept = [whole.contacts[-1].slip(), whole.contacts[-1].dissipated_energy()]
    for _ in range(2):
        whole.stepper.step()
        expected.append(results(whole))
        slipping, active = whole.problem.comm.allreduce(states(whole.contacts[-1]))
        assert slipping > 0 or (name == "tool" and whole.stepper.t > 4)
        assert active > 1
        corners = sum(gap.points.num_corners for gap in whole.contacts[-1].model.gaps)
        assert (whole.problem.comm.allreduce(corners) > 0) == (name == "corner")
    runs = [make(**more, **options), make(partition="scattered", **more, **options)]
    runs.append(make(SELF, **more, **options))
    for i, run in enumerate(runs):
        qs.load_run(run.stepper, folder)
        if i == 0:
            assert largest(run.contacts[-1].slip() - kept[0]) < 1e-15
        np.testing.assert_allclose(run.contacts[-1].dissipated_energy(), kept[1], rtol=1e-14)
        for numbers in expected:
            run.stepper.step()
            scale = np.abs(numbers).max()
            # Vectors that turned from the normals of another contact detection differ by 5e-9.
            np.testing.assert_allclose(results(run), numbers, rtol=1e-9, atol=1e-9 * scale)
