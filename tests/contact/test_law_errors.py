"""Errors in laws of the user's: all ranks raise them, and everything is as it was before."""

import numpy as np
import pytest
from contact.bond import Bond
from contact.test_memory import AT, OPENING, STRENGTH, WAYS, bonded, state, stepper_of
from friction.weakening import Weakening
from rigid_scenes import Pressed, flat
from scenes import WORLD, largest, raises_everywhere

import qsdolfinx as qs
from qsdolfinx.friction import Limited


class Mended(RuntimeError):
    """The error of a law that the user mends afterwards."""


class Faulty(Bond):
    """A bond whose functions fail on the last rank, as long as they are named in ``fails``."""

    fails = ()

    def _fail(self, function):
        if function in self.fails and WORLD.rank == WORLD.size - 1:
            raise Mended(function)

    def commit(self, gap, penalty, damage):
        self._fail("commit")
        return super().commit(gap, penalty, damage)

    def slope(self, gap, penalty, touching, damage):
        self._fail("slope")
        lasts = 1 - Bond.commit(self, gap, penalty, damage)["damage"]
        return np.where(gap[:, 0] < 0, lasts, 1.0) * penalty

    def multiplier(self, gap, penalty, damage):
        self._fail("multiplier")
        lasts = 1 - Bond.commit(self, gap, penalty, damage)["damage"]
        return (np.where(gap[:, 0] < 0, lasts, 1.0) * penalty)[:, None] * gap


def of_run(stepper, scene):
    """Return all that a step changes."""
    contact, tool = scene.contact, scene.tool
    return [
        np.array([stepper.t, stepper.dt, stepper.num_steps, len(stepper.log)]),
        *(u.x.array.copy() for u in scene.problem.u),
        tool.position.copy(),
        np.array(state(scene)),
        contact.multiplier(),
        contact.memory("damage"),
    ]


@pytest.mark.parallel
@pytest.mark.parametrize("at", ("nodes", "finite"))
@pytest.mark.parametrize("function", ("commit", "slope"))
def test_stepper_goes_on_after_an_error(at, function):
    """After an error in a law all is as after the last step, from which the run goes on."""
    law, other = Faulty(STRENGTH, OPENING), bonded(**AT[at])
    scene = bonded(**(AT[at] | {"law": law}))
    stepper, reference = stepper_of(scene), stepper_of(other)
    for _ in range(2):
        stepper.step()
        reference.step()
    before = of_run(stepper, scene)
    law.fails = (function,)
    raises_everywhere(WORLD, Mended, function, stepper.step)
    law.fails = ()
    for was, now in zip(before, of_run(stepper, scene), strict=True):
        np.testing.assert_array_equal(now, was)
    for _ in range(2):
        stepper.step()
        reference.step()
        np.testing.assert_allclose(state(scene), state(other), rtol=1e-9, atol=1e-11)
    assert [row.result for row in stepper.log] == ["accepted"] * 4


class Breaking(Weakening):
    """Friction whose commit fails on the last rank, as long as ``fails`` is set."""

    fails = False

    def commit(self, rows, slid):
        if self.fails and WORLD.rank == WORLD.size - 1:
            raise Mended("commit")
        return super().commit(rows, slid)


def dragged(law):
    """Return a block dragged with Coulomb friction, then with this law, and its stepper."""
    scene = Pressed("triangle", flat, friction=qs.Coulomb(0.1), name="first")
    second = qs.Contact(scene.surface, scene.tool, friction=law, name="second", penalty=1e3)
    contacts = scene.contact, second
    problem = qs.ContactProblem([scene.F], [scene.u], contacts, [scene.bcs])

    def drive(t, dt):
        scene.tool.displacement = [0.02 * dt, -0.01 * dt]

    def values():
        out = [np.array([contact.results.dissipated_energy() for contact in contacts])]
        out += [contact.slip() for contact in contacts] + [second.memory("way")]
        return [*out, *(contact.force("slave") for contact in contacts), scene.u.x.array.copy()]

    return qs.TimeStepper(problem, 1.0, drive), values


@pytest.mark.parallel
def test_friction_of_other_contacts_after_an_error():
    """If friction fails at the end of a step, that of contacts before it is put back, too."""
    law, length = Breaking(0.3, 0.1, 0.1), 2
    (stepper, values), (reference, expected) = dragged(law), dragged(Weakening(0.3, 0.1, 0.1))
    for _ in range(length):
        stepper.step()
        reference.step()
    before = values()
    assert before[0].min() > 0
    law.fails = True
    raises_everywhere(WORLD, Mended, "commit", stepper.step)
    law.fails = False
    for was, now in zip(before, values(), strict=True):
        np.testing.assert_array_equal(now, was)
    stepper.step()
    reference.step()
    for found, right in zip(values(), expected(), strict=True):
        np.testing.assert_allclose(found, right, rtol=1e-8, atol=1e-11)


@pytest.mark.parallel
@pytest.mark.parametrize("function", ("multiplier", "slope"))
def test_readings_raise_on_all_ranks(function):
    """Results that evaluate a law which fails on one rank raise an error on all ranks."""
    law = Faulty(STRENGTH, OPENING)
    scene = bonded(law=law)
    scene.tool.displacement[-1] = WAYS[0]
    scene.problem.solve()
    law.fails = (function,)
    readings = {
        "multiplier": (
            lambda: scene.contact.force("slave"),
            scene.contact.multiplier,
            lambda: scene.contact.pressure("slave"),
            lambda: scene.contact.moment("slave"),
        ),
        "slope": (scene.contact.active, scene.contact.results.patch),
    }
    for reading in readings[function]:
        raises_everywhere(WORLD, Mended, function, reading)


class Nan(Bond):
    """A bond one of whose functions returns NaN on the last rank, from an opening on."""

    def __init__(self, function, beyond=-1.0):
        super().__init__(STRENGTH, OPENING)
        self.function, self.beyond = function, beyond

    def _spoilt(self, function, gap, found):
        if function == self.function and WORLD.rank == WORLD.size - 1:
            found[-gap[:, 0] > self.beyond] = np.nan
        return found

    def slope(self, gap, penalty, touching, damage):
        return self._spoilt("slope", gap, Bond.slope(self, gap, penalty, touching, damage))

    def multiplier(self, gap, penalty, damage):
        found = Bond.slope(self, gap, penalty, 0.0, damage)[:, None] * gap
        return self._spoilt("multiplier", gap, found)


@pytest.mark.parallel
@pytest.mark.parametrize("at", AT)
@pytest.mark.parametrize("function", ("multiplier", "slope"))
def test_law_that_is_not_finite(at, function):
    """NaN of a law on one rank is an error that names contact, law, gap and history variables."""
    scene = bonded(**(AT[at] | {"law": Nan(function)}), name="glue")
    scene.tool.displacement[-1] = 0.01
    error = raises_everywhere(
        WORLD, qs.ConvergenceError, f"contact 'glue': law: Nan.{function}", scene.problem.solve
    )
    assert error.reason_name == "LAW_NOT_FINITE" and "damage = 0" in str(error)
    assert "for gap = " in error.why and "straight line" in str(error)


def test_step_is_cut_back_where_a_law_is_not_finite():
    """A time step in which a law is not finite is made with a smaller Δt, as far as that helps."""
    scene = bonded(law=Nan("multiplier", 0.045), name="glue")
    stepper = stepper_of(scene, (0.04, 0.15), dt_min=0.2)
    stepper.step()
    raises_everywhere(WORLD, qs.StepError, "Nan.multiplier", lambda: list(stepper.run(2.0)))
    assert 1 <= stepper.t < 2 and largest(scene.contact.weighted_gap()) < 0.045
    assert "LAW_NOT_FINITE: contact 'glue'" in stepper.log[-1].reason


class NanFriction(Weakening):
    """Friction that returns NaN on the last rank."""

    def respond(self, rows):
        found = super().respond(rows)
        spoilt = found.traction * (np.nan if WORLD.rank == WORLD.size - 1 else 1.0)
        return found._replace(traction=spoilt)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_friction_that_is_not_finite(sliding):
    """NaN of a friction law on one rank is an error that names contact, law and input."""
    law = NanFriction(0.3, 0.1, 0.1)
    scene = Pressed("triangle", flat, friction=law, sliding=sliding, name="rubbed")
    scene.tool.displacement[:] = 0.01, -0.01
    error = raises_everywhere(
        WORLD, qs.ConvergenceError, "contact 'rubbed': friction: NanFriction", scene.problem.solve
    )
    assert error.reason_name == "LAW_NOT_FINITE" and "way = 0" in error.why


class Spoilt(Limited):
    """Coulomb friction whose limit or slope is changed by a factor on the last rank."""

    def __init__(self, limit=1.0, slope=1.0):
        super().__init__(mu=0.3)
        self._factors = (limit, slope) if WORLD.rank == WORLD.size - 1 else (1.0, 1.0)

    def limit(self, rows):
        mu = rows.parameters["mu"]
        return self._factors[0] * mu * rows.pressure, self._factors[1] * mu


@pytest.mark.parametrize(
    ("factors", "error", "match"),
    [
        ({"limit": np.nan}, qs.ConvergenceError, "Spoilt.respond has returned"),
        ({"slope": np.nan}, qs.ConvergenceError, "(∂τ/∂λ) has returned"),
        ({"limit": -1.0}, ValueError, "Spoilt.limit must not be negative"),
    ],
)
def test_limits_of_friction(factors, error, match):
    """A limit that is NaN or negative, or whose slope is NaN, is an error: nothing may stick."""
    scene = Pressed("triangle", flat, friction=Spoilt(**factors))
    scene.tool.displacement[:] = 0.01, -0.01
    raises_everywhere(WORLD, error, match, scene.problem.solve)
