"""Contact laws with history variables: a user-defined bond that breaks."""

import warnings

from petsc4py import PETSc

import numpy as np
import pytest
from contact.bond import Bond
from rigid_scenes import Pressed, flat
from scenes import WORLD, Pair, box, elastic, largest, plane, raises_everywhere, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import memory
from qsdolfinx.gap.law_memory import LawMemory
from qsdolfinx.remeshing.contact_values import ContactValues

STRENGTH, OPENING, EPS = 0.5, 0.2, 10.0

#: Displacements of the tool: to strength, softening, back, again and further, broken, pressed.
WAYS = 0.04, 0.1, 0.15, 0.06, 0.15, 0.2, 0.3, -0.05


#: Where the law is evaluated. With finite sliding, areas are those of the deformed block.
AT = {
    "nodal": {"quadrature": "nodal"},
    "nodes": {"constraints": "nodes"},
    "points": {"constraints": "points"},
    "finite": {"sliding": "finite", "nu": 0.0},
}


def bonded(cell="triangle", n=3, **options):
    options = {"law": Bond(STRENGTH, OPENING), "penalty": EPS} | options
    return Pressed(cell, flat, n=n, **options)


def in_closed_form(modulus):
    """Return the tension at each displacement: of the block, 1 high, in series with the bond."""
    damage, out = 0.0, []
    for way in WAYS:
        if way < 0:
            out.append(way * modulus * EPS / (modulus + EPS))
            continue
        first = STRENGTH / EPS
        # In softening σ = strength (δ − w)/(δ − w₁), and σ = modulus (way − w).
        k = STRENGTH / (OPENING - first)
        w = (modulus * way - k * OPENING) / (modulus - k)
        elastic = way * modulus / (modulus + (1 - damage) * EPS)
        stress = lambda w, d: (1 - d) * EPS * w  # noqa: E731
        if stress(elastic, damage) <= max(k * (OPENING - elastic), 0.0):
            w = elastic
        elif w >= OPENING:
            damage, w = 1.0, way
        else:
            damage = 1 - k * (OPENING - w) / (EPS * w)
        out.append(stress(w, damage))
    return out


@pytest.mark.parametrize("at", AT)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_bond_that_breaks(cell, at):
    """Uniform tension as the tool moves up and down agrees with the closed form."""
    scene = bonded(cell, 2 if cell == "hexahedron" else 3, **AT[at])
    found, damage = [], []
    for way in WAYS:
        scene.tool.displacement[-1] = way
        scene.problem.solve()
        found.append(scene.contact.force("master")[-1] * -1)
        damage.append(WORLD.allreduce(scene.contact.memory("damage").max(initial=0.0), max))
        assert scene.problem.num_iterations < 40
    np.testing.assert_allclose(found, in_closed_form(scene.modulus), atol=1e-7)
    assert np.diff(damage).min() > -1e-12 and damage[0] == 0
    assert damage[-1] == pytest.approx(1, abs=1e-12)
    assert found[6] == pytest.approx(0, abs=1e-9) and found[2] > 0.1
    assert largest(scene.contact.memory("damage") - 1) < 1e-12


def stepper_of(scene, ways=WAYS, **options):
    """Make a stepper that takes one step per displacement of the tool."""
    times, places = np.arange(len(ways) + 1), np.concatenate([[0.0], ways])

    def drive(t, dt):
        at = np.interp([t - dt, t], times, places)
        scene.tool.displacement = np.eye(scene.gdim)[-1] * (at[1] - at[0])

    return qs.TimeStepper(scene.problem, 1.0, drive, max_penetration=None, **options)


def state(scene):
    """Return force and damage; both are uniform, so that any numbers of ranks can be compared."""
    damage = WORLD.allreduce(scene.contact.memory("damage").max(initial=0.0), max)
    return [*scene.contact.force("master"), damage]


@pytest.mark.parametrize("at", AT)
def test_restart(tmp_path, at):
    """A run that is resumed from a checkpoint continues as if uninterrupted."""
    folder = WORLD.bcast(tmp_path) / "run"
    whole, first, second = (bonded(**AT[at]) for _ in range(3))
    steppers = [stepper_of(scene) for scene in (whole, first, second)]
    for _ in range(3):
        steppers[0].step()
        steppers[1].step()
    assert 0.1 < state(first)[-1] < 1
    qs.save_run(steppers[1], folder)
    qs.load_run(steppers[2], folder)
    of_second, of_first = (scene.contact.memory("damage") for scene in (second, first))
    np.testing.assert_allclose(of_second, of_first, atol=1e-14)
    # Forces are those of the step, with the history variables at its start; at nodes, the areas
    # are those of the end of the step (docs/howto/cluster.md).
    rtol = 1e-4 if at in ("nodal", "nodes") else 1e-9
    np.testing.assert_allclose(state(second), state(first), rtol=rtol, atol=1e-11)
    for _ in range(3):
        steppers[0].step()
        steppers[2].step()
        np.testing.assert_allclose(state(second), state(whole), rtol=1e-9, atol=1e-11)


class Two(Bond):
    memory = {"damage": 0.0, "most": 0.0}  # noqa: RUF012

    def commit(self, gap, penalty, damage, most):
        return super().commit(gap, penalty, damage) | {"most": np.maximum(most, -gap[:, 0])}

    def slope(self, gap, penalty, touching, damage, most):
        lasts = 1 - self.commit(gap, penalty, damage, most)["damage"]
        return np.where(gap[:, 0] < 0, lasts, 1.0) * penalty

    def multiplier(self, gap, penalty, damage, most):
        return self.slope(gap, penalty, 0.0, damage, most)[:, None] * gap


def test_checkpoint_of_another_law(tmp_path):
    """A checkpoint of a law with more or fewer history variables is refused on all ranks."""
    folder = WORLD.bcast(tmp_path)
    scenes = bonded(), bonded(law=Two(STRENGTH, OPENING))
    steppers = [stepper_of(scene) for scene in scenes]
    for i, stepper in enumerate(steppers):
        stepper.step()
        qs.save_run(stepper, folder / f"{i}")
    for i, stepper in enumerate(steppers):
        other = folder / f"{1 - i}"
        raises_everywhere(
            WORLD, ValueError, "remember", lambda s=stepper, f=other: qs.load_run(s, f)
        )


def test_checkpoint_of_another_kind_of_contact(tmp_path):
    """A checkpoint of another formulation, or with friction, is refused with the contact's name."""
    folder = WORLD.bcast(tmp_path)
    steppers = []
    for options in ({}, {"friction": qs.Coulomb(0.1)}, {"formulation": "master-slave"}):
        pair = Pair("quadrilateral", penalty="auto", contact_options={"name": "joint"})
        contact = qs.Contact(pair.slave, pair.master, name="joint", **options)
        problem = qs.ContactProblem(pair.F, pair.u, [contact], pair.bcs)
        steppers.append(qs.TimeStepper(problem, 1.0))
    steppers[0].step()
    qs.save_run(steppers[0], folder / "run")
    for stepper, text in zip(
        steppers[1:], ("not quasi-symmetric with", "not master-"), strict=True
    ):
        raises_everywhere(WORLD, ValueError, text, lambda s=stepper: qs.load_run(s, folder / "run"))
        raises_everywhere(
            WORLD,
            ValueError,
            "contact 'joint' is",
            lambda s=stepper: qs.load_run(s, folder / "run"),
        )


@pytest.mark.parametrize("at", AT)
def test_step_that_is_made_again(at):
    """A failed attempt at a step leaves no damage behind."""
    scene, other, tried = bonded(**AT[at]), bonded(**AT[at]), []

    def solve(step):
        scene.problem.solve()
        tried.append(step)
        if tried.count(2) == 1 and step == 2:
            raise qs.ConvergenceError(-5, [], [])

    stepper, easy = stepper_of(scene, solve=solve), stepper_of(other)
    for _ in range(2):
        stepper.step()
        easy.step()
    before = state(scene)[-1]
    stepper.step()
    easy.step(t_end=2.5)
    assert stepper.num_cutbacks == 1 and stepper.t == easy.t == 2.5
    np.testing.assert_allclose(state(scene), state(other), rtol=1e-9, atol=1e-12)
    assert state(scene)[-1] > before + 0.01


def test_solve_that_fails():
    """After a failed solve the history variables are unchanged."""
    scene = bonded()
    for scene.tool.displacement[-1] in WAYS[:3]:
        scene.problem.solve()
    before = scene.contact.memory("damage")
    assert largest(before) > 0.1
    scene.problem.snes.setTolerances(max_it=1)
    scene.tool.displacement[-1] = 0.18
    raises_everywhere(WORLD, qs.ConvergenceError, "did not converge", scene.problem.solve)
    np.testing.assert_array_equal(scene.contact.memory("damage"), before)


@pytest.mark.parametrize("at", ("nodes", "points"))
def test_another_mesh(at):
    """Transfer to another mesh keeps the integral of the damage."""
    old, new = bonded(n=4, **AT[at]), bonded(n=5, **AT[at])
    state = old.contact.model.gaps[0].state
    x = old.surface.linear.node_x[:, 0]
    damage = np.repeat(0.2 + 0.5 * x[:, None], 1 if at == "nodes" else 2, axis=1)
    state.memory = state.memory.with_values({"damage": damage})
    ContactValues.of(old.contact.model).hand_over(new.contact.model)
    found = new.contact.memory("damage")
    totals = [
        WORLD.allreduce(values @ scene.surface.linear.node_area)
        for values, scene in ((0.2 + 0.5 * x, old), (found, new))
    ]
    assert totals[0] == pytest.approx(totals[1], rel=1e-12)
    assert largest(found - 0.2 - 0.5 * new.surface.linear.node_x[:, 0]) < 0.06


@pytest.mark.parametrize("at", AT)
def test_pairing_anew(at):
    """Nodes keep their history variables when the contact pairs are updated."""
    scene = bonded(**AT[at])
    for scene.tool.displacement[-1] in WAYS[:3]:
        scene.problem.solve()
    before = scene.contact.memory("damage")
    scene.contact.update()
    np.testing.assert_array_equal(scene.contact.memory("damage"), before)
    names = [q.name for q in memory.of_nodes(scene.contact.model)]
    assert names == ["multiplier_0", "law_0_damage_begun", "law_0_damage"]


def at_points(n=5):
    """Return a bonded scene, the constraints at its points, and their positions along the face."""
    scene = bonded(n=n, **AT["points"])
    rows = scene.contact.model.gaps[0].rows
    return scene, rows, rows.from_nodes(scene.surface.linear.node_x[:, 0])


def test_what_points_keep():
    """At points, linear changes are exact, nothing is smoothed at rest, and integrals are kept."""
    scene, rows, x = at_points()
    of_nodes, area = scene.surface.linear.node_x[:, :1], rows.operator.row_area
    before = (0.5 + of_nodes**2) * np.ones(2)
    old = rows.from_patches(before)
    assert largest(rows.advanced(before, old, old) - before) < 1e-15
    found = rows.advanced(before, old, old + 0.2 + 0.3 * x)
    assert largest(found - before - 0.2 - 0.3 * of_nodes) < 1e-10
    found = rows.advanced(before, old, old + 0.1 * np.sin(20 * x))
    change = [area @ (rows.from_patches(found) - old), area @ (0.1 * np.sin(20 * x))]
    change = WORLD.allreduce(np.array(change))
    assert change[0] == pytest.approx(change[1], abs=1e-12)


@pytest.mark.parallel
def test_steep_front_at_points():
    """Beside a steep front, a law gets no values beyond those that it has returned."""
    _, rows, x = at_points()
    memory = LawMemory.of(Bond(STRENGTH, OPENING), rows)
    front = {"damage": np.where(x < 0.43, 1.0, 0.0)}
    memory = memory.after(rows, front).begun().at(rows)
    assert WORLD.allgather(memory.limits) == [{"damage": [0.0, 1.0]}] * WORLD.size
    found, seen = rows.from_patches(memory.start["damage"]), memory.known["damage"]
    assert largest(np.clip(found, 0.0, 1.0) - found) > 0.02
    assert largest(np.clip(seen, 0.0, 1.0) - seen) == 0
    assert largest(np.where(x < 0.2, seen - 1, 0.0)) < 0.3


class Peeled:
    """A strip that is bonded to a plate and lifted at one end: the damage has a front."""

    def __init__(self, **options):
        msh = box(WORLD, (16, 4), "triangle", [0.0, 0.0], [4.0, 1.0])
        V = vector_space(msh)
        u, self.end = fem.Function(V), fem.Constant(msh, np.zeros(2))
        dofs = fem.locate_dofs_topological(V, 1, plane(msh, 0, 4.0))
        plate = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        options |= {"law": Bond(STRENGTH, OPENING), "penalty": 20.0, "search_radius": 1.0}
        self.contact = qs.Contact(surface, plate, **options)
        bc = fem.dirichletbc(self.end, dofs, V)
        self.problem = qs.ContactProblem([elastic(u, 20.0)], [u], [self.contact], [[bc]])

    def pull(self):
        """Return the force after each step."""
        forces = []
        for self.end.value[1] in np.linspace(0.05, 0.4, 8):
            self.problem.solve()
            forces.append(-self.contact.force("slave")[1])
        return np.array(forces)


def test_front_of_damage():
    """With a front of damage, constraints at points agree with those at nodes."""
    scenes = [Peeled(**AT[at], sliding="small") for at in ("nodes", "points")]
    forces, points = (scene.pull() for scene in scenes)
    np.testing.assert_allclose(points, forces, rtol=0.02)
    damage = scenes[1].contact.memory("damage")
    assert forces.max() > 1.5 * forces[-1] and largest(np.clip(damage, 0, 1) - damage) < 0.05
    assert WORLD.allreduce(damage.max(initial=0.0), max) == pytest.approx(1.0, abs=0.05)


class Glue(qs.Law):
    """A bond in all directions, whose stiffness falls with the largest displacement so far."""

    jump, linear = True, False
    memory = {"most": 0.0}  # noqa: RUF012

    def commit(self, gap, penalty, most):
        return {"most": np.maximum(most, np.linalg.norm(gap, axis=1))}

    def slope(self, gap, penalty, touching, most):
        return penalty / (1 + self.commit(gap, penalty, most)["most"] / 0.1)

    def multiplier(self, gap, penalty, most):
        return self.slope(gap, penalty, 0.0, most)[:, None] * gap

    def energy(self, gap, penalty, most):
        return 0.5 * self.slope(gap, penalty, 0.0, most) * np.sum(gap**2, axis=1)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_law_of_the_relative_displacement(sliding):
    """A law of all components remembers, also with finite sliding, and damages both directions."""
    scene = bonded(law=Glue(), sliding=sliding, nu=0.0)
    way, most = np.array([0.0, 0.05, 0.15, 0.08]), 0.0
    for i in way:
        scene.tool.displacement = [0.0, i]
        scene.problem.solve()
        force = -scene.contact.force("master")[-1]
        gap = i - force / scene.modulus
        most = max(most, gap)
        assert force == pytest.approx(EPS / (1 + most / 0.1) * gap, abs=1e-9)
    assert largest(scene.contact.memory("most") - most) < 1e-9


@pytest.mark.parametrize(
    "law, options, match",
    (
        (Bond, {"enforcement": "augmented-lagrangian"}, "enforcement: a law that remembers"),
        (Bond, {"penalty": "auto"}, "penalty: a law that remembers needs a number"),
    ),
)
def test_what_is_refused(law, options, match):
    raises_everywhere(
        WORLD, ValueError, match, lambda: bonded(law=law(STRENGTH, OPENING), **options)
    )


class Forgets(Bond):
    commit = qs.Law.commit


class InPlace(Bond):
    def commit(self, gap, penalty, damage):
        damage[:] = 1.0
        return {"damage": damage}


class Other(Bond):
    def commit(self, gap, penalty, damage):
        return {"wear": damage}

    def slope(self, gap, penalty, touching, damage):
        return penalty


class Misnamed(Bond):
    def commit(self, gap, penalty, damage):
        return {"wear": damage}


class Lists(Other):
    def commit(self, gap, penalty, damage):
        return damage


class Tangent(Other):
    def slope(self, gap, penalty, touching, damage):
        return -penalty


class Flat(Bond):
    def multiplier(self, gap, penalty, damage):
        return penalty * gap[:, 0]


class Deep(Bond):
    def slope(self, gap, penalty, touching, damage):
        return penalty[:, None]

    def multiplier(self, gap, penalty, damage):
        return penalty[:, None] * gap


class Named(Bond):
    memory = {"damage": np.nan}  # noqa: RUF012


@pytest.mark.parametrize(
    "law, match",
    (
        (Forgets, "law: a law that remembers needs commit"),
        (Named, "law: memory must have a name"),
        (InPlace, "read-only"),
        (Other, "law: Other.commit must return a dict of its memory, ['damage'], not ['wear']"),
        (
            Misnamed,
            "law: Misnamed has raised KeyError('damage'); if that is meant to be a history "
            "variable: its memory is ['damage'], and its commit",
        ),
        (Lists, "law: Lists.commit must return a dict of its memory, ['damage'], not ndarray"),
        (Tangent, "law: slope must be positive"),
        (Flat, "law: multiplier must return an array of the gap's shape ("),
        (Deep, "law: slope must return an array of shape ("),
    ),
)
def test_wrong_laws(law, match):
    """Wrong results of a user-defined law are refused."""

    def call():
        scene = bonded(law=law(STRENGTH, OPENING))
        scene.tool.displacement[-1] = 0.01
        scene.problem.solve()

    raises_everywhere(WORLD, ValueError, match, call)


def test_names_of_what_is_remembered():
    """Unknown history variables are refused, and reset restores their initial values."""
    scene = bonded()
    raises_everywhere(WORLD, ValueError, "damage", lambda: scene.contact.memory("wear"))
    for scene.tool.displacement[-1] in WAYS[:3]:
        scene.problem.solve()
    assert largest(scene.contact.memory("damage")) > 0.1
    scene.contact.reset()
    assert largest(scene.contact.memory("damage")) == 0


def test_bond_beyond_the_search_radius():
    """Nodes that open beyond the search radius are lost with a warning; a larger one keeps them."""
    ways = 0.12, 0.16, 0.18, 0.19, 0.12
    found = []
    for radius in (0.15, 0.5):
        scene = bonded(n=3, search_radius=radius)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            stepper = stepper_of(scene, ways)
            for _ in ways:
                stepper.step()
        found.append(any("search_radius" in str(w.message) for w in caught))
        lost = scene.contact.force("slave")[-1] == 0
        assert found[-1] == lost
    assert found == [True, False]


def test_own_solver():
    """Steps that a solver of one's own accepts change history variables as those of solve do."""
    scene, other = bonded(**AT["points"]), bonded(**AT["points"])
    for way in WAYS[:4]:
        scene.tool.displacement[-1] = other.tool.displacement[-1] = way
        other.problem.solve()
        equations = scene.problem.equations()
        z = equations.first()
        for _ in range(60):
            residual = equations.residual(z)
            if np.sqrt(WORLD.allreduce(residual @ residual)) < 1e-12:
                break
            b = PETSc.Vec().createWithArray(-residual, comm=WORLD)
            change, ksp = b.duplicate(), PETSc.KSP().create(WORLD)
            ksp.setOperators(equations.tangent(z))
            ksp.setType("preonly")
            ksp.getPC().setType("lu")
            ksp.getPC().setFactorSolverType("mumps")
            ksp.solve(b, change)
            z = z + change.array_r
            for thing in (b, change, ksp):
                thing.destroy()
        equations.accept(z)
        np.testing.assert_allclose(state(scene), state(other), atol=1e-9)
    assert state(scene)[-1] > 0.3
