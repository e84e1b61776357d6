"""Friction laws of the user's own with history variables."""

from mpi4py import MPI

import numpy as np
import pytest
from contact.bond import Bond
from friction.weakening import Weakening, Worn
from rigid_scenes import flat
from scenes import (
    WORLD,
    box,
    clamp,
    elastic,
    largest,
    plane,
    raises_everywhere,
    slide,
    vector_space,
)

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import memory
from qsdolfinx.remeshing.contact_values import ContactValues

SELF = MPI.COMM_SELF

FIRST, LAST, LENGTH = 0.5, 0.2, 0.1

#: Displacements of the tool along the block in each step; sticks in the last but one.
WAYS = (0.05, 0.04, -0.08, 0.03, 0.0, 0.06)

AT = {
    "nodes": {"constraints": "nodes", "sliding": "small"},
    "points": {"constraints": "points", "sliding": "small"},
    "finite": {"sliding": "finite"},
    "penalty": {"enforcement": "penalty", "penalty": 1e4, "constraints": "nodes"},
}


def prescribed(V, i):
    """Return a zero function, and all unknowns of one component, for a Dirichlet condition."""
    W, _ = V.sub(i).collapse()
    every = fem.locate_dofs_geometrical((V.sub(i), W), lambda x: np.full(x.shape[1], True))
    return fem.Function(W), every, V.sub(i)


class Rubbed:
    """A block that is strained in one direction only, and a plane that is pressed and drawn on it.

    Pressure and slip are uniform, and known.

    Args:
        friction: The friction law.
        cell: Kind of cells.
        n: Number of cells along an edge.
        plate: Whether the plane is a face of another body, whose facets pass those of the block.
        options: Of the contact.
    """

    def __init__(self, friction, cell="triangle", n=3, plate=False, **options):
        self.gdim = gdim = 2 if cell == "triangle" else 3
        self.mesh = box(WORLD, [n] * gdim, cell, [0.0] * gdim, [1.0] * gdim)
        V = vector_space(self.mesh)
        u, bcs = [fem.Function(V)], [slide(V, gdim - 1, plane(self.mesh, gdim - 1, 0.0))]
        bcs += [fem.dirichletbc(*prescribed(V, i)) for i in range(gdim - 1)]
        forms = [elastic(u[0], 7.0, 0.0)]
        self.surface = qs.Surface(V, facets=plane(self.mesh, gdim - 1, 1.0))
        self.motion, self.tool = np.zeros(gdim), flat(WORLD, gdim)
        self.of_plate = []
        if plate:
            low, high = [-1.03] * (gdim - 1) + [1.0], [2.07] * (gdim - 1) + [1.5]
            top = box(WORLD, [7] * (gdim - 1) + [1], cell, low, high)
            W = vector_space(top)
            u.append(fem.Function(W))
            forms.append(elastic(u[1], 7.0, 0.0))
            for i in range(gdim):
                values, *rest = prescribed(W, i)
                self.of_plate.append(values)
                bcs.append(fem.dirichletbc(values, *rest))
            self.tool = qs.Surface(W, facets=plane(top, gdim - 1, 1.0))
        self.contact = qs.Contact(self.surface, self.tool, friction=friction, **options)
        self.problem = qs.ContactProblem(forms, u, [self.contact], bcs)
        self.pressure = 7.0 * 0.1
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.drive)

    def drive(self, t, dt):
        """Press in the first step; then draw at a constant rate within each unit of time."""
        change = np.zeros(self.gdim)
        if t <= 1:
            change[-1] = -0.1 * dt
        else:
            change[0] = WAYS[int(np.ceil(t - 1e-9)) - 2] * dt
        self.motion += change
        if not self.of_plate:
            self.tool.displacement = change
        for values, x in zip(self.of_plate, self.motion, strict=False):
            values.x.array[:] = x

    def force(self):
        """Tangential and normal force of the tool on the block."""
        force = self.contact.force("slave")
        return np.array([force[0], force[-1]])

    def remembered(self, name):
        """Least and largest value of a history variable on all ranks."""
        values = self.contact.memory(name)
        ends = values.min(initial=np.inf), -values.max(initial=-np.inf)
        low, high = (WORLD.allreduce(x, min) for x in ends)
        return np.array([low, -high])


def weakening():
    return Weakening(FIRST, LAST, LENGTH)


@pytest.mark.parametrize("at", AT)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
@pytest.mark.parametrize("plate", (False, True))
def test_coefficient_that_falls_with_slip(cell, at, plate):
    """Friction agrees with the closed form μ(s) p, s being the slip before the step."""
    scene = Rubbed(weakening(), cell, plate=plate, **AT[at])
    scene.stepper.step()
    pressure, error = scene.pressure, 1e-6
    if at == "penalty":  # the slip includes some elastic stick
        pressure, error = 0.1 / (1 / 7.0 + 1e-4), 1e-3
    way = 0.0
    for step in WAYS:
        scene.stepper.step()
        mu = LAST + (FIRST - LAST) * np.exp(-way / LENGTH)
        way += abs(step)
        if step != 0:
            expected = [np.sign(step) * mu * pressure, -pressure]
            np.testing.assert_allclose(scene.force(), expected, rtol=error)
        np.testing.assert_allclose(scene.remembered("way"), way, rtol=error)
        assert scene.problem.num_iterations < 8


def test_coefficient_that_falls_with_work():
    """History variables of dissipated energy and of pressure times slip, from different starts."""
    scene = Rubbed(Worn(0.5), **AT["points"])
    scene.stepper.step()
    energy, way = 0.0, 0.0
    for step in WAYS:
        scene.stepper.step()
        mu = 0.5 / (1 + energy / Worn.HALF)
        energy += mu * scene.pressure * abs(step)
        way += abs(step)
        np.testing.assert_allclose(scene.remembered("energy"), energy, rtol=1e-6)
        np.testing.assert_allclose(scene.remembered("depth"), 1 + scene.pressure * way, rtol=1e-6)
    np.testing.assert_allclose(scene.contact.dissipated_energy(), energy, rtol=1e-6)
    scene.contact.reset()
    assert largest(scene.contact.memory("energy")) == 0
    assert largest(scene.contact.memory("depth") - 1) == 0


class Drawn:
    """An elastic block on which a stiffer, wider one is pressed and drawn to and fro."""

    PATH = ((0.0, -0.03), (0.04, -0.06), (0.09, -0.06), (0.15, -0.06), (0.14, -0.06), (0.06, -0.06))

    def __init__(self, comm=WORLD, partition="forward", **options):
        low = box(comm, (5, 4), "triangle", [0.0, 0.0], [1.0, 1.0], partition)
        top = box(comm, (9, 2), "triangle", [-0.5, 1.0], [1.5, 1.5], "backward")
        V, W = vector_space(low), vector_space(top)
        u = [fem.Function(V), fem.Function(W)]
        self.motion = fem.Constant(top, (0.0, 0.0))
        dofs = fem.locate_dofs_topological(W, 1, plane(top, 1, 1.5))
        bcs = [[clamp(V, plane(low, 1, 0.0))], [fem.dirichletbc(self.motion, dofs, W)]]
        slave = qs.Surface(V, facets=plane(low, 1, 1.0))
        master = qs.Surface(W, facets=plane(top, 1, 1.0))
        options = {"friction": Weakening(0.2, 0.1, 0.05)} | options
        self.contact = qs.Contact(slave, master, **options)
        forms = [elastic(u[0]), elastic(u[1], E=2.0)]
        self.problem = qs.ContactProblem(forms, u, [self.contact], bcs)
        self.fails = lambda: False
        self.stepper = qs.TimeStepper(self.problem, 1.0, self.drive, solve=self.solve)

    def solve(self, step):
        self.problem.solve()
        if self.fails():
            raise qs.ConvergenceError("asked for")

    def drive(self, t, dt):
        times = np.arange(len(self.PATH) + 1)
        path = np.vstack([np.zeros(2), self.PATH])
        self.motion.value[:] = [np.interp(t, times, path[:, i]) for i in (0, 1)]

    def state(self):
        """Numbers that do not depend on the partition."""
        comm, way = self.problem.comm, self.contact.memory("way")
        sums = comm.allreduce(np.array([way.sum(), way @ way]))
        return np.array([*self.contact.force("slave"), *sums, self.contact.dissipated_energy()])


@pytest.mark.parametrize("at", AT)
def test_restart(tmp_path, at):
    """A run from a checkpoint continues as if uninterrupted, on any partition and on one rank."""
    folder = WORLD.bcast(tmp_path) / "run"
    whole, expected = Drawn(**AT[at]), []
    for _ in range(3):
        whole.stepper.step()
    qs.save_run(whole.stepper, folder)
    way = whole.contact.memory("way")
    assert WORLD.allreduce(way.max(initial=0.0), max) > 0.05
    for _ in range(3):
        whole.stepper.step()
        expected.append(whole.state())
    runs = [Drawn(**AT[at]), Drawn(partition="scattered", **AT[at]), Drawn(SELF, **AT[at])]
    for i, run in enumerate(runs):
        qs.load_run(run.stepper, folder)
        if i == 0:
            assert largest(run.contact.memory("way") - way) < 1e-14
        for numbers in expected:
            run.stepper.step()
            # Facets that have just met have no friction of points of their own yet.
            error = 5e-5 if at == "points" else 2e-6
            np.testing.assert_allclose(run.state(), numbers, rtol=error, atol=1e-9)


@pytest.mark.parametrize("at", ("nodes", "points", "finite"))
@pytest.mark.several_ranks
def test_any_number_of_ranks(at):
    """Forces and history variables are the same on one rank and on all."""
    alone, together = (Drawn(comm, **AT[at]) for comm in (SELF, WORLD))
    for _ in Drawn.PATH:
        for scene in (alone, together):
            scene.stepper.step()
        np.testing.assert_allclose(together.state(), alone.state(), rtol=2e-6, atol=1e-9)


@pytest.mark.parametrize("at", AT)
def test_step_that_is_made_again(at):
    """A failed attempt at a step leaves the history variables as they were."""
    scene, other = Drawn(**AT[at]), Drawn(**AT[at])
    for _ in range(2):
        scene.stepper.step()
        other.stepper.step()
    before, found = scene.contact.memory("way"), []

    def fails():
        found.append(largest(scene.contact.memory("way") - before))
        return len(found) == 1

    scene.fails = fails
    scene.stepper.step()
    other.stepper.step(t_end=scene.stepper.t)
    assert scene.stepper.num_cutbacks == 1 and max(found) < 1e-15
    assert largest(scene.contact.memory("way") - before) > 0.01
    np.testing.assert_allclose(scene.state(), other.state(), rtol=2e-6, atol=1e-9)


@pytest.mark.parametrize("at", ("nodes", "points", "finite"))
def test_another_mesh(at):
    """Transfer to another mesh keeps the integral, and initial values where nothing was."""
    old, new = (Rubbed(Worn(0.5), n=n, **AT[at]) for n in (4, 5))
    state, x = old.contact.model.slips[0].state, old.surface.linear.node_x[:, 0]
    of_patches = np.ones((1, 1 if at == "nodes" else 2))
    state.memory = state.memory.with_values(
        {"energy": (0.2 + 0.5 * x)[:, None] * of_patches, "depth": (2 - x)[:, None] * of_patches}
    )
    ContactValues.of(old.contact.model).hand_over(new.contact.model)
    for name in ("energy", "depth"):
        totals = [
            WORLD.allreduce(scene.contact.memory(name) @ scene.surface.linear.node_area)
            for scene in (old, new)
        ]
        assert totals[0] == pytest.approx(totals[1], rel=1e-12)
    assert largest(new.contact.memory("depth") - 2 + new.surface.linear.node_x[:, 0]) < 0.07


def test_pairing_anew():
    """History variables of friction have unique names, and survive an update of the pairs."""
    scene = Rubbed(Worn(0.5), **AT["points"])
    for _ in range(3):
        scene.stepper.step()
    names = [q.name for q in memory.of_nodes(scene.contact.model)]
    assert [name for name in names if name.startswith("friction")] == [
        "friction_0_energy_begun",
        "friction_0_energy",
        "friction_0_depth_begun",
        "friction_0_depth",
    ]
    before = scene.contact.memory("depth")
    scene.contact.update()
    np.testing.assert_allclose(scene.contact.memory("depth"), before, rtol=1e-15)
    raises_everywhere(WORLD, ValueError, "'damage'", lambda: scene.contact.memory("damage"))


def test_checkpoint_of_another_law(tmp_path):
    """A checkpoint of a friction law with other history variables is refused on all ranks."""
    folder = WORLD.bcast(tmp_path) / "run"
    scene, other = Rubbed(weakening(), **AT["nodes"]), Rubbed(Worn(0.5), **AT["nodes"])
    scene.stepper.step()
    qs.save_run(scene.stepper, folder)
    load = lambda: qs.load_run(other.stepper, folder)  # noqa: E731
    raises_everywhere(WORLD, ValueError, "remember [['way']], not [['depth', 'energy']]", load)


class Forgets(Weakening):
    commit = qs.Friction.commit


class Endless(Weakening):
    memory = {"way": np.inf}  # noqa: RUF012


class Misnamed(Weakening):
    def commit(self, rows, slid):
        return {"slip": rows.memory["way"]}


class Asks(Weakening):
    def limit(self, rows):
        return rows.memory["slip"] * rows.pressure, rows.memory["slip"]


class Returns(Weakening):
    def commit(self, rows, slid):
        return np.linalg.norm(slid.slip, axis=1)


class Vectors(Weakening):
    def commit(self, rows, slid):
        return {"way": slid.slip}


class InPlace(Weakening):
    def commit(self, rows, slid):
        rows.memory["way"][:] = 1.0
        return dict(rows.memory)


@pytest.mark.parametrize(
    "law, match",
    (
        (Forgets, "friction: a law that remembers needs commit"),
        (Endless, "friction: memory must have a name and a finite initial value"),
        (Misnamed, "friction: Misnamed.commit must return a dict of its memory, ['way'], not ['s"),
        (
            Asks,
            "friction: Asks has raised KeyError('slip'); if that is meant to be a history "
            "variable: its memory is ['way']",
        ),
        (Returns, "friction: Returns.commit must return a dict of its memory, ['way'], not ndarr"),
        (Vectors, "friction: Vectors.commit must return finite 'way' for each constraint"),
        (InPlace, "read-only"),
    ),
)
def test_wrong_laws(law, match):
    """Wrong results of a user-defined law are refused on all ranks, and change nothing."""
    scenes = []

    def call():
        scenes.append(Rubbed(law(FIRST, LAST, LENGTH), **AT["points"]))
        scenes[0].tool.displacement = [0.01, -0.1]
        scenes[0].problem.solve()

    raises_everywhere(WORLD, ValueError, match, call)
    for scene in scenes:
        assert largest(scene.contact.memory("way")) == scene.contact.dissipated_energy() == 0


def test_names_of_two_laws():
    """A law and a friction law with history variables of the same name are refused."""
    law = Weakening(FIRST, LAST, LENGTH)
    law.memory = {"damage": 0.0}
    options = {"law": Bond(0.5, 0.2), "penalty": 10.0, "constraints": "nodes"}
    raises_everywhere(
        WORLD,
        ValueError,
        "friction: its memory and that of the law need other names, not ['damage']",
        lambda: Rubbed(law, **options),
    )


def test_bond_with_friction():
    """A law and a friction law of one contact have history variables of their own."""
    options = {"law": Bond(0.5, 0.2), "penalty": 100.0}
    for at in ("nodes", "points"):
        scene = Rubbed(weakening(), **options, constraints=at)
        for step in ((0.0, -0.1), (0.05, 0.0), (0.02, 0.2)):
            scene.tool.displacement = np.add(scene.tool.displacement, step)
            scene.problem.solve()
        np.testing.assert_allclose(scene.remembered("way"), 0.07, rtol=1e-6)
        assert np.all(scene.remembered("damage") > 0.1)
